# SPDX-License-Identifier: GPL-3.0-or-later
"""The body model, what is known of people, a body on named points, and as a character's bones."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.body.bodies import Bodies, BodyModel
from addon.core.body.prior import Prior
from addon.core.body.sides import mirror_order
from addon.core.data.markersets import Capsules
from addon.core.geometry import rotations
from addon.core.posing import posing
from addon.core.posing.character import BONE_NAMES, character_of, toes_axis
from addon.core.posing.ends import with_ends
from addon.core.posing.finer import finer
from addon.core.posing.posing import fit_points
from addon.core.simulation.virtual import Act, perform
from addon.io.markersets import open_markerset
from scripts import learn_markersets
from scripts.people_study import learn
from tests.core.scenes import person_of
from tests.core.toybody import toy_markerset
from tests.inputs.worn import FINGERS, with_fingers, with_markers

TOY = BodyModel(toy_markerset())


@pytest.fixture(scope="module")
def model():
    return BodyModel(open_markerset("body26"))


def walk(model: BodyModel, frames: int = 60, height: float = 1.4, seed: int = 0) -> Bodies:
    """A virtual person of that height who walks and turns."""
    person = person_of(model.markerset, seed, height)
    return perform(model, person, [Act(4.0, 0.8, turn=3.0)], 20.0, seed).pick(np.arange(frames))


def off(model: BodyModel, bodies: Bodies, points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(model.pose(bodies).markers - points, axis=2)


@pytest.mark.parametrize("skin", [0.0, 0.015])
def test_an_arm_that_is_in_another_fold_for_a_while_is_put_right_from_both_sides(monkeypatch, skin):
    """From there a fit does not come back on its own, and only the first and the last frame have a right one beside.

    So it is where `skin` (m) moves so much that the arm makes a frame hardly worse than others.
    """
    model, begin = BodyModel(open_markerset("body39")), posing._between
    arm, points = model.markerset.skeleton.segments.index("upper_arm.R"), model.pose(walk(model)).markers
    twist = rotations.turn_of(np.array([3.0, 0, 0]))

    def folded(*given):
        start = begin(*given)
        bent = rotations.turn_of(start.bends[20:40, arm]) @ twist
        start.bends[20:40, arm] = rotations.rotation_vector(bent)
        return start

    monkeypatch.setattr(posing, "_between", folded)
    found = fit_points(model, points + np.random.default_rng(5).normal(scale=skin, size=points.shape))
    assert off(model, found, points).max() < 0.02 + 3 * skin


def test_frames_are_posed_as_they_come_and_who_was_away_is_found_anew(model):
    points = model.pose(walk(model)).markers
    followed = posing.FollowedBody(model, posing.subject_of(model, points, Prior(model), 16))
    assert max(np.abs(followed.pose(frame).markers[0] - frame).max() for frame in points) < 0.03
    few = np.where(np.arange(len(points[0]))[:, None] < 3, points[0], np.nan)
    assert followed.pose(few) is None
    there = points[0] + np.array([7.0, 0, 0])
    assert np.abs(followed.pose(there).markers[0] - there).max() < 0.03
    for frame in points[:30, mirror_order(model.markerset.markers)] + np.array([7.0, 0, 0]):
        followed.pose(frame)
    assert np.abs(followed.pose(there).markers[0] - there).max() < 0.03, "it was turned round by wrong names"


def test_a_made_up_walk_is_found_again(model):
    points = model.pose(walk(model)).markers
    found = fit_points(model, points)
    assert np.median(off(model, found, points)) < 0.004
    assert off(model, found, points).max() < 0.02
    np.testing.assert_allclose(found.scale.mean(), 1.4, atol=0.06)
    np.testing.assert_allclose(np.linalg.norm(found.quaternion, axis=1), 1, atol=1e-12)
    for shared in (found.scale, found.shape, found.own):
        assert (shared == shared[:1]).all()


@pytest.mark.parametrize("facing", [0, 90, 180, 270])
def test_any_facing_and_any_place(model, facing):
    bodies = walk(model, 9)
    turn = rotations.quaternion_to_matrix(rotations.about_z(np.radians(facing)))
    points = model.pose(bodies).markers @ turn.T + [5, -3, 0]
    assert np.median(off(model, fit_points(model, points), points)) < 0.004


def test_who_lies_or_lacks_markers_is_posed_where_there_are_enough_and_no_wrong_label_drags_the_body(model):
    turn = rotations.turn_of(np.array([0, np.pi / 2, 0]))
    points = model.pose(walk(model, 9)).markers @ turn.T
    assert np.median(off(model, fit_points(model, points), points)) < 0.004
    whole = model.pose(walk(model)).markers
    points = whole.copy()
    rng = np.random.default_rng(3)
    points[rng.random(points.shape[:2]) < 0.2] = np.nan
    found = off(model, fit_points(model, points), whole)
    assert np.nanmedian(found) < 0.004
    assert np.percentile(found, 95) < 0.03
    points = model.pose(walk(model)).markers
    points[7] = np.nan
    points[8, 3:] = np.nan
    found = fit_points(model, points)
    empty = np.isnan(model.pose(found).markers).all(axis=(1, 2))
    assert np.flatnonzero(empty).tolist() == [7, 8]
    assert len(found) == len(points)
    with pytest.raises(ValueError, match="enough markers"):
        fit_points(model, np.full((4, model.marker_count, 3), np.nan))
    right = model.pose(walk(model)).markers
    points = right.copy()
    points[20, model.markerset.index("LKNE")] += [0.5, 0.5, 1.0]
    found = off(model, fit_points(model, points), right)
    assert np.median(found[20]) < 0.01


@pytest.mark.slow
@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_people_who_were_not_learned_from_are_posed_within_15_mm(name, shared_data):
    people = shared_data / "people"
    markerset = learn(learn_markersets.read_people(people, ("HC002D", "HC033A", "HC044A")), name)
    model = BodyModel(markerset)
    for stem in ("HC002D02", "HC002D06", "HC044A29"):
        names, points, _ = learn_markersets.read_c3d(people / "mcgill" / stem[:6] / f"{stem}.c3d")
        points = points[:, [names.index(name) for name in markerset.markers]]
        away = off(model, fit_points(model, points), points)
        assert np.nanmedian(away) < 0.005, stem
        assert np.nanpercentile(away, 99) < 0.015, stem


@pytest.mark.parametrize("name", ["body39", "actor41", "actor53"])
def test_a_finer_body_is_the_same_at_rest_and_follows_shrugged_shoulders_and_a_round_back(name):
    coarse = open_markerset(name)
    markerset = finer(coarse)
    segments = markerset.skeleton.segments
    own = {"lumbar", "clavicle.L", "clavicle.R", "toes.L", "toes.R"}
    assert set(segments) - set(coarse.skeleton.segments) == own
    assert finer(markerset) is markerset
    np.testing.assert_allclose(markerset.rest_markers, coarse.rest_markers, atol=1e-12)
    model, before = BodyModel(markerset), BodyModel(coarse)
    bodies = replace(model.rest(9, 1.7), shape=np.full((9, len(model.modes)), 0.5))
    same = replace(before.rest(9, 1.7), shape=bodies.shape)
    np.testing.assert_allclose(model.pose(bodies).markers, before.pose(same).markers, atol=1e-12)
    bend = np.linspace(0, 0.4, 9)
    for segment, axis, most in (("clavicle.L", 0, 1), ("clavicle.R", 0, -1), ("lumbar", 1, 1), ("thorax", 1, -0.5)):
        bodies.bends[:, segments.index(segment), axis] = most * bend
    points = model.pose(bodies).markers
    found = fit_points(model, points)
    away, coarsely = off(model, found, points), off(before, fit_points(before, points), points)
    assert away.max() < 0.5 * coarsely.max()
    assert np.median(away) < 0.7 * np.median(coarsely)
    joints, above = model.pose(found).joints, markerset.skeleton.parents[1:]
    lengths = np.linalg.norm(joints[:, 1:] - joints[:, above], axis=2)
    np.testing.assert_allclose(lengths, lengths[:1].repeat(9, axis=0), atol=1e-12)
    turned = found.bends[:, segments.index("clavicle.L")]
    arm = markerset.skeleton.offsets[segments.index("upper_arm.L")]
    assert np.abs(turned @ arm / np.linalg.norm(arm)).max() < 0.02  # about itself: no marker shows that


HEIGHT = 1.7


def at_rest(markerset):
    """Segments' names, joints (J, 3) m and far ends (J, 3) m of a body at rest."""
    joints = markerset.skeleton.rest_joints * HEIGHT
    ends = joints + np.array([0, 0, 0.15])
    for index, name in enumerate(markerset.skeleton.segments):
        if name.startswith(("hand", "foot")):
            ends[index] = joints[index] + (np.array([0, 0, -0.1]) if name.startswith("hand") else [0.15, 0, -0.03])
    return markerset.skeleton.segments, joints, ends


def test_a_lower_body_has_hips_and_legs_and_who_was_not_found_is_nowhere():
    character = character_of(*at_rest(open_markerset("gait15")))
    assert character.names[0] == "hips"
    assert {name.partition(".")[0] for name in character.names[1:]} == {"thigh", "shank", "foot", "toes"}
    markerset = open_markerset("actor41")
    character = character_of(*at_rest(markerset))
    nowhere = np.full((1, len(markerset.skeleton), 3), np.nan)
    assert np.isnan(character.posed(nowhere, rotations.turn_of(nowhere))[0]).all()
    bodies = finer(markerset)
    own = character_of(*at_rest(bodies))
    assert own.names == character.names
    parts = {"spine": "lumbar", "chest": "thorax", "shoulder.L": "clavicle.L", "shoulder.R": "clavicle.R"}
    parts |= {part: part for part in ("foot.L", "toes.L", "toes.R")}
    assert {part: bodies.skeleton.segments[own.segment[own.names.index(part)]] for part in parts} == parts


seeds = st.integers(0, 2**32 - 1)


def some_bodies(seed: int) -> Bodies:
    rng = np.random.default_rng(seed)
    rest = TOY.rest(3, 1.6)
    bends = rng.normal(0, 0.3, rest.bends.shape)
    bends[:, 0] = 0
    return replace(
        rest,
        translation=rng.normal(size=(3, 3)),
        quaternion=rotations.turned(rest.quaternion, rng.normal(0, 0.3, (3, 3))),
        scale=rest.scale + rng.normal(0, 0.1, (3, 3)),
        bends=bends,
        shape=rng.normal(size=rest.shape.shape),
    )


def slopes(of, bodies: Bodies, step: float = 1e-6) -> np.ndarray:
    """(B, ..., parameters) slopes of what `of` gives of bodies, by moving every parameter both ways."""
    moves = step * np.eye(TOY.parameters)[:, None].repeat(len(bodies), axis=1)
    return np.stack([of(bodies.moved(move)) - of(bodies.moved(-move)) for move in moves], axis=-1) / (2 * step)


@settings(max_examples=15)
@given(seed=seeds)
def test_derivatives_are_those_of_the_markers(seed):
    bodies = some_bodies(seed)
    bodies = replace(bodies, own=np.random.default_rng(seed).normal(0, 0.02, bodies.own.shape))
    posed, columns = TOY.derivatives(bodies)
    np.testing.assert_allclose(posed.markers, TOY.pose(bodies).markers, atol=1e-12)
    np.testing.assert_allclose(columns, slopes(lambda moved: TOY.pose(moved).markers, bodies), atol=1e-7)


@pytest.mark.parametrize("name", ["gait15", "body26", "body39", "actor41", "actor53"])
def test_rest_pose_reproduces_the_marker_table(name):
    """Checklist A1."""
    markerset = open_markerset(name)
    posed = BodyModel(markerset).pose(BodyModel(markerset).rest())
    np.testing.assert_allclose(posed.markers[0], markerset.rest_markers, atol=1e-6)
    np.testing.assert_allclose(posed.joints[0], markerset.skeleton.rest_joints, atol=1e-6)
    np.testing.assert_allclose(posed.rotations[0], np.broadcast_to(np.eye(3), posed.rotations[0].shape), atol=1e-12)


@settings(max_examples=20)
@given(seed=seeds)
def test_gradient_is_half_the_slope_of_the_cost(seed):
    prior, bodies = Prior(TOY, height=1.7, height_sd=0.1, upright_sd=0.2), some_bodies(seed)
    half = slopes(lambda moved: prior.terms(moved)[0], bodies) / 2
    np.testing.assert_allclose(prior.terms(bodies)[1], half, rtol=1e-5, atol=1e-5)


def test_a_set_that_is_sure_of_the_height_is_held_to_it_and_where_one_stands_costs_nothing():
    spread = replace(TOY.markerset.spread, height_sd=0.0)
    sure = Prior(BodyModel(replace(TOY.markerset, spread=spread)))
    assert np.isfinite(sure.hessian).all()
    tall, right = (TOY.rest(1, height) for height in (spread.height + 0.01, spread.height))
    assert sure.terms(tall)[0] - sure.terms(right)[0] == pytest.approx(100)
    prior = Prior(TOY, upright_sd=0.1)
    bodies = TOY.rest(2, 1.7)
    turned = replace(bodies, quaternion=rotations.about_z(np.array([0.5, -2.0])), translation=np.ones((2, 3)))
    np.testing.assert_allclose(prior.terms(turned)[0], prior.terms(bodies)[0], atol=1e-12)


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
    now, was = (off(one, fit_points(one, points), points)[:, own] for one in (model, rigid))
    assert np.median(now) < np.median(was) / 5
    ends = np.add(markerset.skeleton.rest_joints, [0, 0, -0.05])
    character = character_of(segments, markerset.skeleton.rest_joints, ends)
    assert set(fingers) <= set(character.names)
    for names in BONE_NAMES.values():
        assert len({names[name] for name in character.names}) == len(character.names)
    at = character.names.index("index.L")
    assert character.names[character.parents[at]] == "hand.L"
    np.testing.assert_allclose(character.tails[at] - character.heads[at], [0.05, 0, 0], atol=0.03)
