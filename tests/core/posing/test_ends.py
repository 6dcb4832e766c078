# SPDX-License-Identifier: GPL-3.0-or-later
"""Toes and fingers at the ends of limbs, on sets that somebody else's markers were added to."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.data.markersets import Capsules
from addon.core.posing.character import BONE_NAMES, character_of, toes_axis
from addon.core.posing.ends import with_ends
from addon.core.posing.posing import fit_points
from addon.io.markersets import open_markerset
from tests.inputs.worn import FINGERS, with_fingers, with_markers


def segment_of(markerset, marker: str) -> str:
    return markerset.skeleton.segments[markerset.attachment[markerset.by_name[marker]]]


@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_every_foot_has_toes_which_carry_what_is_ahead_of_them(name):
    coarse = open_markerset(name)
    markerset = with_ends(coarse)
    assert set(markerset.skeleton.segments) - set(coarse.skeleton.segments) == {"toes.L", "toes.R"}
    assert with_ends(markerset) is markerset
    assert segment_of(markerset, "LTOE") == "foot.L"
    before = BodyModel(coarse)
    assert not fit_points(BodyModel(markerset), before.pose(before.rest(2, 1.7)).markers).bends[:, -2:].any()
    toe, heel = (coarse.offsets[coarse.by_name[name]] for name in ("LTOE", "LHEE"))
    tipped = with_markers(coarse, {"LTIP": ("foot.L", 1.35 * toe - 0.35 * heel)})  # as a tip is described
    model = BodyModel(with_ends(tipped))
    toes = model.markerset.skeleton.segments.index("toes.L")
    assert segment_of(model.markerset, "LTIP") == "toes.L"
    np.testing.assert_allclose(model.markerset.rest_markers, tipped.rest_markers, atol=1e-12)
    bodies = model.rest(9, 1.7)
    bend, axis = np.linspace(0, 1, 9), toes_axis(model.markerset.skeleton.offsets[toes])
    assert axis @ model.markerset.skeleton.offsets[toes] < 1e-12 and axis[1] < -0.8
    bodies.bends[:, toes] = np.outer(bend, axis)
    found = fit_points(model, model.pose(bodies).markers).bends[:, toes]
    # By how much more from frame to frame; where the marker sits on the toes the body learns.
    np.testing.assert_allclose(found @ axis - found[0] @ axis, bend, atol=0.15)
    assert np.linalg.norm(np.cross(found, axis), axis=1).max() < 0.02


def test_a_foot_keeps_a_marker_that_alone_shows_how_it_is_turned():
    coarse = open_markerset("gait15")
    offsets = coarse.offsets.copy()
    offsets[coarse.by_name["LTOE"], 0] = 0.11
    markerset = with_ends(replace(coarse, offsets=offsets))
    assert segment_of(markerset, "LTOE") == "foot.L"
    assert "toes.L" in markerset.skeleton.segments


def test_feet_have_toes_both_or_neither():
    coarse = open_markerset("gait15")
    own = coarse.capsules
    foot = np.flatnonzero(own.segment == coarse.skeleton.segments.index("foot.R"))
    rows = np.concatenate([np.arange(len(own.segment)), foot])
    parted = Capsules(own.segment[rows], own.start[rows], own.end[rows], own.radius[rows])
    segments = with_ends(replace(coarse, capsules=parted)).skeleton.segments
    assert not {"toes.L", "toes.R"} & set(segments)


def test_the_middle_of_a_hand_is_no_finger_and_a_hand_keeps_a_marker():
    worn = open_markerset("body39")
    far = 1.4 * worn.offsets[worn.by_name["LFIN"]]
    assert segment_of(with_ends(with_markers(worn, {"LMIDHAND": ("hand.L", far)})), "LMIDHAND") == "hand.L"
    assert segment_of(with_ends(with_markers(worn, {"LMidTip": ("hand.L", 2 * far)})), "LMidTip") == "middle.L"
    away = worn.attachment.copy()
    away[worn.by_name["LFIN"]] = worn.skeleton.segments.index("forearm.L")
    alone = with_markers(replace(worn, attachment=away), {"LMidTip": ("hand.L", 2 * far)})
    assert segment_of(with_ends(alone), "LMidTip") == "hand.L"


def test_fingers_with_markers_are_bones_that_follow_them_and_rigs_know_them():
    worn = with_fingers(open_markerset("body39"))
    markerset = with_ends(worn)
    fingers = [f"{finger}.{side}" for side in "LR" for finger in FINGERS]
    segments = markerset.skeleton.segments
    assert set(fingers) <= set(segments)
    assert segment_of(markerset, "LIDX6") == "index.L"  # by the first word of a finger in the name
    assert segment_of(markerset, "LThumbMiddle") == "thumb.L"
    assert segment_of(markerset, "LFIN") == segment_of(markerset, "LRingKnuckle") == "hand.L"
    np.testing.assert_allclose(markerset.rest_markers, worn.rest_markers, atol=1e-12)
    model, rigid = BodyModel(markerset), BodyModel(worn)
    bodies = model.rest(12, 1.7)
    rng = np.random.default_rng(0)
    for finger in fingers:
        at = segments.index(finger)
        along = markerset.skeleton.offsets[at] / np.linalg.norm(markerset.skeleton.offsets[at])
        bodies.bends[:, at] = np.cross(along, rng.normal(0, 0.4, (12, 3)))
    points = model.pose(bodies).markers
    own = [at for at, segment in enumerate(markerset.attachment) if segments[segment] in fingers]
    off, was = (
        np.linalg.norm(one.pose(fit_points(one, points)).markers - points, axis=2)[:, own] for one in (model, rigid)
    )
    assert np.median(off) < np.median(was) / 5
    ends = np.add(markerset.skeleton.rest_joints, [0, 0, -0.05])
    character = character_of(segments, markerset.skeleton.rest_joints, ends)
    assert set(fingers) <= set(character.names)
    for names in BONE_NAMES.values():
        assert len({names[name] for name in character.names}) == len(character.names)
    at = character.names.index("index.L")
    assert character.names[character.parents[at]] == "hand.L"
    np.testing.assert_allclose(character.tails[at] - character.heads[at], [0.05, 0, 0], atol=0.03)
