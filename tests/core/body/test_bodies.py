# SPDX-License-Identifier: GPL-3.0-or-later
"""The body model: its rest pose and what moving it does; what is known of people; derivatives against differences."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.body.bodies import Bodies, BodyModel
from addon.core.body.prior import Prior
from addon.core.geometry import rotations
from addon.io.markersets import open_markerset
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


@pytest.fixture(scope="module")
def model():
    return BodyModel(toy_markerset())


def some_bodies(model: BodyModel, seed: int, count: int = 3) -> Bodies:
    rng = np.random.default_rng(seed)
    rest = model.rest(count, 1.6)
    bends = rng.normal(0, 0.3, rest.bends.shape)
    bends[:, 0] = 0
    return replace(
        rest,
        translation=rng.normal(size=(count, 3)),
        quaternion=rotations.turned(rest.quaternion, rng.normal(0, 0.3, (count, 3))),
        scale=rest.scale + rng.normal(0, 0.1, (count, 3)),
        bends=bends,
        shape=rng.normal(size=rest.shape.shape),
    )


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_gradient_is_half_the_slope_of_the_cost(seed):
    model = BodyModel(toy_markerset())
    prior = Prior(model, height=1.7, height_sd=0.1, upright_sd=0.2)
    bodies = some_bodies(model, seed)
    gradient, step = prior.terms(bodies)[1], 1e-6
    for column in range(model.parameters):
        move = np.zeros((len(bodies), model.parameters))
        move[:, column] = step
        slope = (prior.terms(bodies.moved(move))[0] - prior.terms(bodies.moved(-move))[0]) / (2 * step)
        np.testing.assert_allclose(gradient[:, column], slope / 2, rtol=1e-5, atol=1e-5)


def test_one_newton_step_reaches_the_least_cost(model):
    prior = Prior(model)
    bodies = some_bodies(model, 1)
    cost, gradient, hessian = prior.terms(bodies)
    free = np.arange(6, model.parameters)
    step = np.zeros_like(gradient)
    step[:, free] = -np.linalg.solve(hessian[np.ix_(free, free)], gradient[:, free, None])[..., 0]
    after = bodies.moved(step)
    np.testing.assert_allclose(prior.terms(after)[0], 0, atol=1e-9)
    np.testing.assert_allclose(after.scale, model.markerset.spread.height, atol=1e-9)
    assert (cost > 0).all()


def test_a_set_that_is_sure_of_the_height_is_held_to_it_and_where_one_stands_costs_nothing(model):
    spread = replace(model.markerset.spread, height_sd=0.0)
    sure = Prior(BodyModel(replace(model.markerset, spread=spread)))
    assert np.isfinite(sure.hessian).all()
    tall, right = (model.rest(1, height) for height in (spread.height + 0.01, spread.height))
    assert sure.terms(tall)[0] - sure.terms(right)[0] == pytest.approx(100)
    prior = Prior(model, upright_sd=0.1)
    bodies = model.rest(2, 1.7)
    turned = replace(bodies, quaternion=rotations.about_z(np.array([0.5, -2.0])), translation=np.ones((2, 3)))
    np.testing.assert_allclose(prior.terms(turned)[0], prior.terms(bodies)[0], atol=1e-12)


def test_options_hold_what_they_say(model):
    tall = replace(model.rest(1, 1.9))
    assert Prior(model, height=1.9, height_sd=0.02).terms(tall)[0] < Prior(model).terms(tall)[0]
    leaning = replace(tall, quaternion=rotations.turned(tall.quaternion, np.array([[0.0, 0.3, 0.0]])))
    held = Prior(model, upright_sd=0.1)
    assert held.terms(leaning)[0] - held.terms(tall)[0] == pytest.approx((np.sin(0.3) / 0.1) ** 2)
    stretched = replace(tall, scale=tall.scale * [1.1, 0.9, 1.0])
    assert held.terms(stretched)[0] > held.terms(tall)[0] + 1
