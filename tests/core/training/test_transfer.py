# SPDX-License-Identifier: GPL-3.0-or-later
"""Known bodies with other markers, markers that are hardly there, and skeletons found from how markers move."""

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.geometry import rotations
from addon.core.posing.posing import fit_points
from addon.core.training.segments import find_segments, segment_markerset
from addon.core.training.takes import LabelledTake, learnable, standing_apart
from addon.core.training.transfer import known_body, transferred
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset


@pytest.fixture(scope="module")
def take():
    """Names and points (T, M, 3) of the virtual person."""
    performance = make_performance(open_markerset("body26"))
    return list(performance.take.names), performance.take.xyz[::10]


def test_the_body_that_has_most_of_the_markers_is_taken(known, take):
    names, _ = take
    assert known_body(names, known).name == "body26"
    assert known_body([*names, "T10", "STRN"], known).name in ("body26", "body39")
    lower = open_markerset("gait15").markers
    assert known_body(lower, known).name == "gait15"
    assert known_body(["s2", "r_asis", *lower[3:]], known).name == "gait15"
    assert known_body([f"P{index}" for index in range(20)], known) is None
    assert known_body(names[:5] + [f"P{index}" for index in range(30)], known) is None


def test_a_new_marker_goes_to_the_segment_that_carries_it(known, take):
    names, points = take
    body = known_body(names, known)
    model = BodyModel(body)
    order = [names.index(name) for name in body.markers]
    posed = model.pose(fit_points(model, points[:, order]))
    shin = body.skeleton.segments.index("shank.L")
    extra = posed.joints[:, shin] + np.einsum("fij,j->fi", posed.rotations[:, shin], [0.06, 0.02, -0.1])
    shown = np.concatenate([points, extra[:, None]], axis=1)
    found = transferred(body, [shown, shown[::2]], [*names, "LXTRA"], "mine")
    assert found.markers == (*names, "LXTRA")
    assert found.skeleton.segments[found.attachment[-1]] == "shank.L"
    assert found.spread.modes.shape[1] == len(found.skeleton) + len(found.markers)
    fresh = BodyModel(found)
    away = np.linalg.norm(fresh.pose(fit_points(fresh, shown)).markers - shown, axis=2)
    assert np.nanmedian(away) < 0.012
    assert np.nanmedian(away[:, -1]) < 0.012


def test_nothing_hangs_on_a_limb_that_nobody_marks(known, take):
    """Of who wears no marker on the arms a hand that hangs at the hip is nearer to a hip's marker than the thigh is."""
    names, points = take
    body = open_markerset("body26")
    posed = BodyModel(body).pose(fit_points(BodyModel(body), points[:1, [names.index(name) for name in body.markers]]))
    hand = body.skeleton.segments.index("hand.L")
    armless = [name for name in names if name[1:] not in ("ELB", "WRA", "WRB", "FIN")]
    shown = np.concatenate([points[:1, [names.index(name) for name in armless]], posed.joints[:, [hand]]], axis=1)
    on = {}
    for worn, cloud in ((armless, shown), (names, np.concatenate([points[:1], posed.joints[:, [hand]]], axis=1))):
        found = transferred(body, [cloud], [*worn, "LXTRA"], "mine")
        on[len(worn)] = found.skeleton.segments[found.attachment[-1]]
    assert on[len(names)] in ("hand.L", "forearm.L")
    assert on[len(armless)] in ("pelvis", "thigh.L")


def test_limbs_hang_from_the_trunk_and_takes_without_the_known_markers_are_refused(known):
    skeleton = open_markerset("body39").skeleton
    limb = dict(
        zip(skeleton.segments, (skeleton.segments[at] if at >= 0 else "" for at in skeleton.limbs), strict=True)
    )
    assert limb["hand.L"] == limb["upper_arm.L"] == "upper_arm.L" and limb["foot.R"] == "thigh.R"
    assert not (limb["pelvis"] or limb["thorax"] or limb["head"])
    body = known[0]
    with pytest.raises(ValueError, match="known markers"):
        transferred(body, [np.full((5, len(body), 3), np.nan)], body.markers, "none")


def test_a_number_beside_two_zeros_is_no_marker():
    rng = np.random.default_rng(3)
    names = (*"ABCDEF", "height", "floor", "unseen")
    body = rng.normal(size=(1, 6, 3)) * 0.3 + rng.normal(size=(50, 6, 3)) * 0.01
    height = np.concatenate([np.zeros((50, 1, 2)), rng.normal(0.02, 0.01, (50, 1, 1))], axis=2)
    floor, gone = np.zeros((50, 1, 3)), np.full((50, 1, 3), np.nan)
    take = LabelledTake("sway", "she", names, np.concatenate([body, height, floor, gone], axis=1))
    assert standing_apart([take], names) == ("height", "floor")
    # Feet that stand as still as a file can say are markers, and so is what moves in another take.
    still = LabelledTake("still", "she", names[:8], np.concatenate([body[:1].repeat(50, 0), height, floor], axis=1))
    assert standing_apart([still], names[:8]) == ("height", "floor")
    moved = LabelledTake("again", "she", names[:8], take.xyz[:, :8] + 0.1)
    assert standing_apart([take, moved], names[:8]) == ()


NAMES = ("LHEE", "RHEE", "LTOE", "RTOE")


def test_markers_that_are_never_or_hardly_there_are_said():
    xyz = np.ones((1000, 4, 3))
    xyz[:, 0] = np.nan
    xyz[5:, 1] = np.nan
    doubtful = np.zeros((1000, 4), bool)
    doubtful[:, 2] = True
    _, told = learnable(xyz, doubtful, NAMES)
    assert told[0].startswith("LTOE: 1000 doubtful frames")
    assert told[1] == "LHEE, LTOE: found in no frame that could be learned, so what was known before stays"
    assert told[2] == "RHEE (5): found in hardly any frames that could be learned, so little is new of them"


PARTS = [f"{part}{number}" for part in ("HIP", "SHIN", "TOE") for number in range(1, 5)]


def turn_of(vectors) -> np.ndarray:
    return rotations.exponential(np.asarray(vectors, dtype=float))[0]


def leg(frames: int = 120, size: float = 1.0, seed: int = 0, noise: float = 0.0005) -> np.ndarray:
    """(T, 12, 3) a hanging chain of three rigid parts with four markers each; it swings and twists as it walks."""
    form, motion = np.random.default_rng(7), np.random.default_rng(seed)
    shapes = [
        form.uniform([-0.08, -0.08, height - 0.08], [0.08, 0.08, height + 0.08], (4, 3))
        for height in (0.1, -0.25, -0.2)
    ]
    time = np.arange(frames)[:, None] / 60
    swing = [
        amount * np.sin(time * rate + motion.uniform(0, 6, 3))
        for amount, rate in ((0.3, 1.3), (0.7, [2, 1.1, 0.7]), (0.6, [1.7, 0.9, 2.3]))
    ]
    knee, ankle = np.array([0, 0, -0.05]), np.array([0.02, 0, -0.5])
    place = np.column_stack([time * 0.5, 0 * time, 1 + 0 * time])
    turn, parts = turn_of(swing[0]), []
    parts.append(place[:, None] + np.einsum("fij,mj->fmi", turn, shapes[0]))
    place = place + np.einsum("fij,j->fi", turn, knee)
    turn = turn @ turn_of(swing[1])
    parts.append(place[:, None] + np.einsum("fij,mj->fmi", turn, shapes[1]))
    place = place + np.einsum("fij,j->fi", turn, ankle)
    turn = turn @ turn_of(swing[2])
    parts.append(place[:, None] + np.einsum("fij,mj->fmi", turn, shapes[2]))
    return size * np.concatenate(parts, axis=1) + motion.normal(0, noise, (frames, 12, 3))


def test_what_moves_together_is_a_segment_and_gaps_and_a_swapped_stretch_change_nothing():
    found = find_segments([leg()])
    assert sorted(found.members) == [(0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10, 11)]
    by_first = {group[0]: index for index, group in enumerate(found.members)}
    assert found.members[0] == (4, 5, 6, 7)
    assert [found.parents[by_first[0]], found.parents[by_first[8]]] == [0, 0]
    # From the knee to the ankle, whatever the markers.
    assert np.linalg.norm(found.joints[by_first[0]] - found.joints[by_first[8]]) == pytest.approx(0.5, abs=0.01)
    points = leg(200)
    chance = np.random.default_rng(3)
    points[chance.random(points.shape[:2]) < 0.15] = np.nan
    points[50:56, [0, 4]] = points[50:56, [4, 0]]
    found = find_segments([points])
    assert sorted(found.members) == [(0, 1, 2, 3), (4, 5, 6, 7), (8, 9, 10, 11)]


def test_the_marker_set_poses_takes_it_has_not_seen():
    markerset = segment_markerset([leg(seed=1), leg(seed=2, size=1.2)], PARTS, "leg")
    assert set(markerset.skeleton.segments) == {"HIP segment", "SHIN segment", "TOE segment"}
    assert markerset.spread.height_sd > 0.05
    assert (markerset.spread.marker_sd >= 0.01).all()
    assert (markerset.capsules.radius > 0).all()
    assert markerset.rest_markers[:, 2].min() == pytest.approx(0, abs=0.02)
    model, fresh = BodyModel(markerset), leg(60, size=1.1, seed=9)
    away = np.linalg.norm(model.pose(fit_points(model, fresh)).markers - fresh, axis=2)
    assert np.median(away) < 0.006


def test_nothing_to_see_is_said():
    with pytest.raises(ValueError, match="three or more"):
        segment_markerset([np.full((5, 4, 3), np.nan)], list("ABCD"), "none")
