# SPDX-License-Identifier: GPL-3.0-or-later
"""The body model: its rest pose, what moving it does, and its derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.body.bodies import BodyModel
from addon.io.markersets import open_markerset
from tests.core.body.test_prior import some_bodies
from tests.core.toybody import toy_markerset

seeds = st.integers(0, 2**32 - 1)


def differences(bodies, pose, columns: int, step: float = 1e-6) -> np.ndarray:
    """(B, M, 3, columns) slopes of the markers by moving every parameter both ways."""
    slopes = []
    for column in range(columns):
        move = np.zeros((len(bodies), columns))
        move[:, column] = step
        slopes.append((pose(bodies.moved(move)) - pose(bodies.moved(-move))) / (2 * step))
    return np.stack(slopes, axis=-1)


@settings(max_examples=15, deadline=None)
@given(seed=seeds)
def test_derivatives_are_those_of_the_markers(seed):
    model = BodyModel(toy_markerset())
    bodies = some_bodies(model, seed)
    bodies = replace(bodies, own=np.random.default_rng(seed).normal(0, 0.02, bodies.own.shape))
    posed, columns = model.derivatives(bodies)
    np.testing.assert_allclose(posed.markers, model.pose(bodies).markers, atol=1e-12)
    expected = differences(bodies, lambda moved: model.pose(moved).markers, model.parameters)
    np.testing.assert_allclose(columns, expected, atol=1e-7)


def test_bending_an_elbow_moves_only_what_it_carries():
    model = BodyModel(toy_markerset())
    bent = model.rest(1)
    elbow = model.markerset.skeleton.segments.index("forearm.L")
    bent.bends[0, elbow] = [0, -1, 0]
    moved = np.linalg.norm(model.pose(bent).markers - model.pose(model.rest(1)).markers, axis=2)[0]
    carried = model.attachment == elbow
    assert (moved[carried] > 0.05).all()
    np.testing.assert_allclose(moved[~carried], 0, atol=1e-12)


@pytest.mark.parametrize("name", ["gait15", "body26", "body39", "actor41", "actor53"])
def test_rest_pose_reproduces_the_marker_table(name):
    """Checklist A1."""
    markerset = open_markerset(name)
    posed = BodyModel(markerset).pose(BodyModel(markerset).rest())
    np.testing.assert_allclose(posed.markers[0], markerset.rest_markers, atol=1e-6)
    np.testing.assert_allclose(posed.joints[0], markerset.skeleton.rest_joints, atol=1e-6)
    np.testing.assert_allclose(posed.rotations[0], np.broadcast_to(np.eye(3), posed.rotations[0].shape), atol=1e-12)
