# SPDX-License-Identifier: GPL-3.0-or-later
"""Known bodies with other markers, what of a take is not on the subject, and markers that are hardly there."""

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.posing.posing import fit_points
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
