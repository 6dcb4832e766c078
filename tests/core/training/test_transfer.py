# SPDX-License-Identifier: GPL-3.0-or-later
"""Known bodies with other markers, or in words; markers hardly there, or exchanged; skeletons from movement."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.data.errors import InputError
from addon.core.data.markersets import Layout, Site
from addon.core.geometry import rotations
from addon.core.posing.posing import fit_points
from addon.core.simulation.virtual import Act
from addon.core.training.contradictions import contradictions, leads
from addon.core.training.described import DESCRIBING, described
from addon.core.training.segments import find_segments, segment_markerset
from addon.core.training.takes import LabelledTake, contradicted, learnable, standing_apart
from addon.core.training.transfer import known_body, may_carry, transferred, without_markers
from addon.demo.take import make_performance
from addon.io.layouts import open_layout, shipped_layouts
from addon.io.markersets import open_markerset
from addon.jobs.models import known_bodies
from addon.jobs.training_takes import read_takes
from tests import recorded
from tests.core.scenes import walker

ARM = ("ELB", "WRA", "WRB", "FIN")


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


def test_nothing_hangs_on_a_limb_that_nobody_marks_but_what_is_far_off_all_else(known, take):
    """Of who wears no marker on the arms a hand that hangs at the hip is nearer to a hip's marker than the thigh is.

    An elbow's marker alone is beside the trunk, and moves with the arm.
    """
    body = open_markerset("body26")
    armless = without_markers(body, np.flatnonzero([not name.endswith(ARM) for name in body.markers]))
    hand, thigh = (body.skeleton.segments.index(name) for name in ("hand.L", "thigh.L"))
    away = np.full((2, len(body.skeleton)), 0.2)
    away[:, hand], away[:, thigh] = 0.01, (0.05, 0.1)
    assert may_carry(body, away).all()
    assert may_carry(armless, away)[:, [hand, thigh]].tolist() == [[False, True], [True, True]]
    names, points = take
    worn = [name for name in names if not name.endswith(ARM[1:])]
    called = [name.replace("ELB", "XTRA") for name in worn]
    found = transferred(body, [points[:1, [names.index(name) for name in worn]]], called, "mine")
    on = [found.skeleton.segments[found.attachment[called.index(name)]] for name in ("LXTRA", "RXTRA")]
    assert all("arm" in segment for segment in on)


def test_limbs_hang_from_the_trunk_and_takes_without_the_known_markers_are_refused(known):
    skeleton = open_markerset("body39").skeleton
    limbs = (skeleton.segments[at] if at >= 0 else "" for at in skeleton.limbs)
    limb = dict(zip(skeleton.segments, limbs, strict=True))
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


def test_what_is_farther_off_than_the_subject_is_wide_is_no_marker():
    body = np.random.default_rng(4).normal(size=(30, 6, 3)) * 0.3 + [3, 1, 1]
    other_unit = body[:, :1] / 1000
    take = LabelledTake("push", "she", tuple("ABCDEFG"), np.concatenate([body, other_unit], axis=1))
    assert standing_apart([take], take.names) == ("G",)
    ball = body[:, :1] + 0.2
    ball[15:] += 9
    kicked = LabelledTake("kick", "she", tuple("ABCDEFG"), np.concatenate([body, ball], axis=1))
    assert standing_apart([kicked], kicked.names) == (), "it was with her"
    hand = np.concatenate([body[:, :3] * 0.1, body[:, :1] * 0.1 + 0.2], axis=1)
    assert standing_apart([LabelledTake("wave", "she", tuple("ABCD"), hand)], tuple("ABCD")) == (), "a shoulder"


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
# By part its joint in the one above, how high its markers are, how far and how often it swings.
LEG = (
    ([0, 0, 0], 0.1, 0.3, 1.3),
    ([0, 0, -0.05], -0.25, 0.7, [2, 1.1, 0.7]),
    ([0.02, 0, -0.5], -0.2, 0.6, [1.7, 0.9, 2.3]),
)


def leg(frames: int = 120, size: float = 1.0, seed: int = 0, form: int = 7) -> np.ndarray:
    """(T, 12, 3) a hanging chain of three rigid parts with four markers each; it swings and twists as it walks."""
    form, motion = np.random.default_rng(form), np.random.default_rng(seed)
    time = np.arange(frames)[:, None] / 60
    place, turn, parts = time * [0.5, 0, 0] + [0, 0, 1], np.eye(3), []
    for joint, height, amount, often in LEG:
        shape = np.add(form.uniform(-0.08, 0.08, (4, 3)), [0, 0, height])
        bend = amount * np.sin(time * often + motion.uniform(0, 6, 3))
        place, turn = place + turn @ np.array(joint), turn @ rotations.turn_of(bend)
        parts.append(place[:, None] + np.einsum("fij,mj->fmi", turn, shape))
    return size * np.concatenate(parts, axis=1) + motion.normal(0, 0.0005, (frames, 12, 3))


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


@pytest.fixture(scope="module")
def bodies():
    return known_bodies()


def one(bodies, **words) -> np.ndarray:
    """(3,) where a marker in words is in the rest pose, heights."""
    return described(Layout("a", "", "", {"A": Site(**words)}), bodies).rest_markers[0]


@pytest.mark.parametrize("name", shipped_layouts())
def test_every_published_layout_is_a_marker_set(name, bodies):
    layout = open_layout(name)
    markerset = described(layout, bodies)
    assert layout.name == name and layout.source
    assert f"{len(markerset)} markers" in layout.description
    at = markerset.rest_markers
    apart = np.linalg.norm(at[:, None] - at, axis=2) + np.eye(len(at))
    assert apart.min() > 0.01  # heights: no two of them are in one place
    assert (at[:, 2] > 0).all() and (at[:, 2] < 1.05).all()


def test_landmarks_and_places_between_beside_and_along_them_are_where_the_body_has_them(bodies):
    usual, found = open_markerset("body39"), described(open_layout("plugin_gait"), bodies)
    for name in usual.markers:
        np.testing.assert_allclose(found.offsets[found.index(name)], usual.offsets[usual.index(name)], atol=1e-9)
    for name in shipped_layouts():
        markerset = described(open_layout(name), bodies)
        for index, marker in enumerate(markerset.markers):
            for left, right in (("L", "R"), ("Left", "Right")):
                other = marker.replace(left, right)
                if other != marker and other in markerset.markers and marker != "CLAV":
                    mirrored = markerset.rest_markers[markerset.index(other)] * [1, -1, 1]
                    np.testing.assert_allclose(markerset.rest_markers[index], mirrored, atol=2e-3)
    lateral, medial = (one(bodies, segment="thigh.L", place=f"{side} epicondyle") for side in ("lateral", "medial"))
    assert lateral[1] > medial[1] > 0
    assert abs(lateral[2] - medial[2]) < 0.02
    heads = [one(bodies, segment="foot.L", place=f"{which} metatarsal head") for which in ("first", "second", "fifth")]
    assert (np.diff(heads, axis=0)[:, 1] > 0.005).all()
    high, low = (one(bodies, segment="thigh.R", place="front", along=along) for along in (0.2, 0.8))
    body = min(bodies, key=lambda body: len(body.skeleton))
    hip = body.skeleton.rest_joints[body.skeleton.segments.index("thigh.R")]
    assert high[2] > low[2] and high[0] > hip[0] and low[1] < 0
    words = {"segment": "shank.L", "place": "outer", "along": 0.5}
    skin, wand = one(bodies, **words), one(bodies, **words, off_m=0.08)
    height = described(Layout("a", "", "", {"A": Site(**words)}), bodies).spread.height
    assert np.linalg.norm(wand - skin) * height == pytest.approx(0.08)
    assert wand[1] > skin[1]
    sites = {"A": Site("thigh.L", "lateral epicondyle"), "B": Site("thigh.L", "outer", 0.5)}
    sd = described(Layout("a", "", "", sites), bodies).spread.marker_sd
    assert sd[0] < sd[1] == DESCRIBING.anywhere_sd


@pytest.mark.parametrize(
    ("site", "words"),
    [
        (Site("tail", "tip"), "A is on 'tail', which is no segment; expected one of pelvis, thorax"),
        (Site("thigh.L", "kneecap"), "A is at 'kneecap', which is no place of thigh.L; expected one of outside"),
        (Site("thigh.L", "front"), "which is no place of thigh.L"),
        (Site("thigh.L", "outside", 0.5), "which is no place of thigh.L"),
        (Site("pelvis", "ASIS"), "A is at 'ASIS', which is on both sides; expected left or right before it"),
    ],
)
def test_an_unknown_word_is_said(site, words, bodies):
    with pytest.raises(InputError, match=words):
        described(Layout("a", "", "", {"A": site}), bodies)


def test_it_stands_on_the_lower_body_where_that_is_enough(bodies):
    legs = described(open_layout("helen_hayes"), bodies)
    assert legs.skeleton.segments == open_markerset("gait15").skeleton.segments
    layout = open_layout("helen_hayes")
    more = replace(layout, sites=layout.sites | {"C7": Site("thorax", "C7")})
    assert "head" in described(more, bodies).skeleton.segments


MARKERS = open_markerset("body26").markers


@pytest.fixture(scope="module")
def takes() -> list[np.ndarray]:
    """(T, 26, 3) m each: virtual people who walk."""
    return [walker("body26", seed, [Act(1.5)], noise=0.0) for seed in range(5)]


def found(takes) -> list[list[tuple[str, ...]]]:
    return [
        [tuple(MARKERS[place] for place in group) for group in groups]
        for groups in contradictions([leads(points) for points in takes])
    ]


def exchanged(points: np.ndarray, *pairs: tuple[str, str]) -> np.ndarray:
    points = points.copy()
    for pair in pairs:
        one, two = map(MARKERS.index, pair)
        points[:, [one, two]] = points[:, [two, one]]
    return points


def test_takes_that_agree_contradict_nobody(takes):
    assert found(takes) == [[]] * 5
    assert found(takes[:2]) == [[], []]
    assert found(takes[:1]) == [[]]


@pytest.mark.parametrize(
    "pairs",
    [
        [("LKNE", "RKNE")],
        [("LANK", "RANK")],
        [("LHEE", "LTOE")],
        [("LWRA", "LWRB")],
        [("LFHD", "RFHD"), ("LBHD", "RBHD")],
    ],
)
def test_an_exchange_is_found_in_its_take_and_in_no_other(takes, pairs):
    wrong = exchanged(takes[2], *pairs)
    assert found([*takes[:2], wrong, *takes[3:]]) == [[], [], pairs, [], []]


def test_missing_markers_are_no_contradiction(takes):
    gaps = takes[1].copy()
    gaps[:, MARKERS.index("LKNE")] = np.nan
    gaps[20:, MARKERS.index("RANK")] = np.nan
    assert found([takes[0], gaps, *takes[2:]]) == [[]] * 5
    only = exchanged(gaps, ("LHEE", "RHEE"))
    assert found([takes[0], only, *takes[2:]])[1] == [("LHEE", "RHEE")]


def test_the_recorded_takes_with_exchanged_names_are_found(shared_data):
    said = contradicted(read_takes(recorded.takes(shared_data, *recorded.MCGILL), ()), MARKERS)
    assert [line.split(", if")[0] for line in said] == [
        "LWRA and LWRB have each other's names in HC030A01.c3d",
        "LWRA and LWRB have each other's names in HC030A05.c3d",
        "LWRA and LWRB have each other's names in HC030A22.c3d",
        "LWRA and LWRB have each other's names in HC038A11.c3d",
        "RWRA and RWRB have each other's names in HC038A11.c3d",
        "LFHD and LBHD have each other's names in HC039A17.c3d",
        "RFHD and RBHD have each other's names in HC039A17.c3d",
        "LFHD and RFHD have each other's names in HC055A34.c3d",
        "LBHD and RBHD have each other's names in HC055A34.c3d",
    ]


def test_a_plate_that_is_named_front_to_back_in_a_standing_trial_is_found(shared_data):
    trials = [shared_data.parent / f"strangers/still/amputee_a01_{kind}.trc" for kind in ("standing", "walk_fast")]
    takes = read_takes(trials, ())
    assert [line.split(" in one")[0] for line in contradicted(takes, takes[0].names)] == [
        "R_LL_PROX_POST and R_LL_PROX_ANT have each other's names",
        "R_LL_DIST_ANT and R_LL_DIST_POST have each other's names",
    ]
