# SPDX-License-Identifier: GPL-3.0-or-later
"""Learning from made-up people whose bodies are known: the mean comes out, symmetric, and what is missing is said."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.body.sides import other_side
from addon.core.geometry import rotations
from addon.io.markersets import open_markerset
from scripts.anatomy import LOWER_SEGMENTS, SETS
from scripts.people_study import Person, learn, study

JOINT_CENTRES = {site.name: site.landmarks[0] for site in LOWER_SEGMENTS if site.landmarks}


def made_up(markerset, seed: int, standing: int = 8, walking: int = 16) -> Person:
    """A person of a shape within the marker set's spread, who stands facing somewhere and then walks."""
    rng = np.random.default_rng(seed)
    model, frames = BodyModel(markerset), standing + walking
    height = rng.uniform(1.3, 1.8)
    rest = model.rest(frames, height)
    covariance = markerset.spread.pose_covariance
    bends = rng.multivariate_normal(markerset.spread.pose_mean.ravel(), covariance, frames, method="eigh")
    bends[:standing] *= 0.02
    heading = np.where(np.arange(frames) < standing, rng.uniform(-np.pi, np.pi), np.linspace(0, 3, frames))
    posed = model.pose(
        replace(
            rest,
            translation=np.column_stack([rng.normal(size=(frames, 2)), np.zeros(frames)]),
            quaternion=rotations.about_z(heading),
            bends=bends.reshape(rest.bends.shape),
            shape=np.repeat(rng.normal(0, 0.6, (1, rest.shape.shape[1])), frames, axis=0),
        )
    )
    centres = [markerset.skeleton.segments.index(name) for name in JOINT_CENTRES]
    points = np.concatenate([posed.markers, posed.joints[:, centres]], axis=1)
    points[rng.random(points.shape[:2]) < 0.03] = np.nan
    names = (*markerset.markers, *JOINT_CENTRES.values())
    return Person(f"P{seed}", names, points, np.arange(frames) < standing, height)


@pytest.fixture(scope="module")
def truth():
    return open_markerset("gait15")


@pytest.fixture(scope="module")
def people(truth):
    return [made_up(truth, seed) for seed in range(6)]


@pytest.fixture(scope="module")
def learned(people):
    return learn(people, "gait15")


def test_the_mean_body_comes_out(truth, learned):
    assert learned.markers == truth.markers
    away = np.linalg.norm(learned.rest_markers - truth.rest_markers, axis=1)
    assert away.max() < 0.025
    assert np.linalg.norm(learned.skeleton.rest_joints - truth.skeleton.rest_joints, axis=1).max() < 0.025


def test_left_and_right_are_alike(learned):
    mirror = [learned.markers.index(other_side(name)) for name in learned.markers]
    np.testing.assert_allclose(learned.rest_markers[mirror], learned.rest_markers * [1, -1, 1], atol=1e-9)
    deviation = np.sqrt(np.diag(learned.spread.pose_covariance)).reshape(-1, 3)
    segments = learned.skeleton.segments
    swapped = [segments.index(other_side(name)) for name in segments]
    np.testing.assert_allclose(deviation[swapped], deviation, atol=1e-9)


def test_everybodys_own_body_fits_closely(people):
    found = study(people, whole_body=False)
    assert np.nanmax(found.residual) < 0.005
    np.testing.assert_allclose(found.stature, [person.stature for person in people])


def test_what_is_missing_is_said(people):
    nobody_stands = [replace(person, standing=np.zeros_like(person.standing)) for person in people]
    with pytest.raises(ValueError, match="nobody stands"):
        learn(nobody_stands, "gait15")
    with pytest.raises(ValueError, match="no standing take shows head"):
        learn(people, "body26")
    index = [person.names.index(name) for person in people[:1] for name in ("LTHI", "RTHI")]
    blind = []
    for person in people:
        points = person.points.copy()
        points[:, index] = np.nan
        blind.append(replace(person, points=points))
    with pytest.raises(ValueError, match="no take shows RTHI LTHI"):
        learn(blind, "gait15")


def test_a_person_without_a_stature_or_a_standing_take_still_counts(people, truth):
    walker = replace(people[0], stature=None, standing=np.zeros_like(people[0].standing))
    learned = learn([walker, *people[1:]], "gait15")
    assert np.linalg.norm(learned.rest_markers - truth.rest_markers, axis=1).max() < 0.03
    assert set(learned.markers) == set(SETS["gait15"].markers)
