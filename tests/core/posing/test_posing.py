# SPDX-License-Identifier: GPL-3.0-or-later
"""A body on named points, and as a character's bones."""

from pathlib import Path

import numpy as np
import pytest

from addon.core.body.bodies import Bodies, BodyModel
from addon.core.geometry import rotations
from addon.core.posing import posing
from addon.core.posing.character import character_of
from addon.core.posing.posing import fit_points
from addon.core.simulation.virtual import Act, perform
from addon.io.markersets import open_markerset
from scripts import learn_markersets
from scripts.people_study import learn
from tests.core.scenes import person_of

PEOPLE = Path(__file__).resolve().parents[4] / "shared" / "data" / "people"
needs_people = pytest.mark.skipif(not PEOPLE.is_dir(), reason="the recorded people are not beside the project")


@pytest.fixture(scope="module")
def model():
    return BodyModel(open_markerset("body26"))


def walk(model: BodyModel, frames: int = 60, height: float = 1.4, seed: int = 0) -> Bodies:
    """A virtual person of that height who walks and turns."""
    person = person_of(model.markerset, seed, height)
    return perform(model, person, [Act(4.0, 0.8, turn=3.0)], 20.0, seed).pick(np.arange(frames))


def off(model: BodyModel, bodies: Bodies, points: np.ndarray) -> np.ndarray:
    return np.linalg.norm(model.pose(bodies).markers - points, axis=2)


def test_an_arm_that_is_in_another_fold_for_a_while_is_put_right_from_both_sides(monkeypatch):
    """From there a fit does not come back on its own, and only the first and the last frame have a right one beside."""
    model, begin = BodyModel(open_markerset("body39")), posing._between
    arm, points = model.markerset.skeleton.segments.index("upper_arm.R"), model.pose(walk(model)).markers
    twist = rotations.exponential(np.array([3.0, 0, 0]))[0]

    def folded(*given):
        start = begin(*given)
        bent = rotations.exponential(start.bends[20:40, arm])[0] @ twist
        start.bends[20:40, arm] = rotations.rotation_vector(bent)
        return start

    monkeypatch.setattr(posing, "_between", folded)
    found = fit_points(model, points)
    assert off(model, found, points).max() < 0.02


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
    turn = rotations.exponential(np.array([0, np.pi / 2, 0]))[0]
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


def person_points(markerset, stem: str) -> np.ndarray:
    names, points, _ = learn_markersets.read_c3d(PEOPLE / "mcgill" / stem[:6] / f"{stem}.c3d")
    return np.stack([points[:, names.index(name)] for name in markerset.markers], axis=1)


@needs_people
@pytest.mark.slow
@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_people_who_were_not_learned_from_are_posed_within_15_mm(name):
    left_out = ("HC002D", "HC033A", "HC044A")
    markerset = learn(learn_markersets.read_people(PEOPLE, left_out), name)
    model = BodyModel(markerset)
    for stem in ("HC002D02", "HC002D06", "HC044A29"):
        points = person_points(markerset, stem)
        away = off(model, fit_points(model, points), points)
        assert np.nanmedian(away) < 0.005, stem
        assert np.nanpercentile(away, 99) < 0.015, stem


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
    character, count = character_of(*at_rest(markerset)), len(markerset.skeleton)
    turns = rotations.exponential(np.full((1, count, 3), np.nan))[0]
    heads, _ = character.posed(np.full((1, count, 3), np.nan), turns)
    assert np.isnan(heads).all()
