# SPDX-License-Identifier: GPL-3.0-or-later
"""Levenberg-Marquardt: nine parameters, a cost that never rises, better than where it began, blind to far blobs."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.blobs.subject import Setup
from addon.core.body.bodies import PLACEMENT, BodyModel
from addon.core.body.prior import Prior
from addon.core.geometry import rotations
from addon.core.geometry.views import split_views
from addon.core.papers.virtual_occlusions.cost import BlobPull
from addon.core.papers.virtual_occlusions.fit import Fit, fit_body, fit_placement, placement_state
from addon.core.simulation.rigs import paper_rig
from tests.core.papers.virtual_occlusions.stages import fit_from, point_pull
from tests.core.scenes import blobs_at, built_in, stand
from tests.core.toybody import toy_markerset

RIG = paper_rig()


@cache
def setup_of(name):
    return Setup.of(RIG, built_in(name))


def starts_around(bodies, generator, count, turn=1.0, height=1.0, place=1.0):
    """Rest bodies off by up to so many times the paper's ±20° about each axis, ±0.25 m of height, ±0.2 m along each."""
    model = setup_of("gait15").model if bodies.bends.shape[1] < 10 else setup_of("body26").model
    truth = model.pose(bodies)
    ahead = truth.rotations[0, 0, :, 0]
    facing = rotations.about_z(np.full(count, np.arctan2(ahead[1], ahead[0])))
    turned = rotations.turned(facing, generator.uniform(-1, 1, (count, 3)) * np.radians(20) * turn)
    tall = bodies.scale.mean() + generator.uniform(-0.25, 0.25, (count, 1)) * height
    starts = replace(model.rest(count), quaternion=turned, scale=np.repeat(tall, 3, axis=1))
    foot = bodies.translation * [1, 1, 0]
    return replace(starts, translation=foot + generator.uniform(-0.2, 0.2, (count, 3)) * place)


def blob_fit(name, view, start, stages, prior=None) -> list[Fit]:
    """The paper's fit in stages (softness, reach, steps), visible markers only, visibility renewed at every stage."""
    setup, fits = setup_of(name), []
    for softness, reach, steps in stages:
        visible = setup.visible(start.scale, setup.model.pose(start))
        pull = BlobPull(visible, view, setup.sight, softness, reach)
        fits.append(fit_placement(setup.model, start, pull, steps, prior))
        start = fits[-1].bodies
    return fits


def off(name, bodies, scene):
    """(B,) m, mean distance of the bodies' markers from where they really are."""
    return np.linalg.norm(setup_of(name).model.pose(bodies).markers - scene.points, axis=-1).mean(axis=1)


@given(st.integers(0, 2**16))
def test_nine_parameters_are_equation_6(seed):
    """A6, A7: x = R_q (S ∘ X) + T before the cameras, with three, four (one of them bound) and three numbers."""
    generator = np.random.default_rng(seed)
    model = BodyModel(toy_markerset())
    body = model.rest(1).moved(np.append(generator.normal(0, 0.5, 6), generator.normal(0.7, 0.1, 3))[None])
    turn = rotations.quaternion_to_matrix(body.quaternion[0])
    expected = (model.markerset.rest_markers * body.scale[0]) @ turn.T + body.translation[0]
    state = placement_state(model, body, no_pull)
    assert state.gradient.shape == (1, PLACEMENT) == (1, 9)
    assert state.posed.markers[0] == pytest.approx(expected, abs=1e-12)
    assert RIG.normalised(state.posed.markers[0]) == pytest.approx(
        setup_of("gait15").sight.image(setup_of("gait15").sight.local(expected[None]))[0], abs=1e-9
    )


def no_pull(markers):
    return point_pull(markers, np.full(markers.shape, np.nan), np.ones(markers.shape[:2]))


def to_points(points, deviation=0.01):
    return lambda markers: point_pull(
        markers, np.broadcast_to(points, markers.shape), np.full(markers.shape[:2], deviation)
    )


def test_quaternions_stay_units_step_after_step():
    """A6: after each of ten steps, from starts that have far to turn."""
    model = BodyModel(toy_markerset())
    goal = model.pose(model.rest(1, 1.6).moved(np.array([[0.3, -0.2, 0.1, 0.2, -0.3, 1.2, 0, 0, 0]])))
    for steps in range(11):
        bodies = fit_placement(model, model.rest(3, 1.7), to_points(goal.markers), steps).bodies
        assert np.linalg.norm(bodies.quaternion, axis=1) == pytest.approx(np.ones(3), abs=1e-12)


@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_five_and_ten_iterations_beat_the_start_and_never_rise(name):
    """A9, A21, A22: over the paper's box of starts, jointly; the first five iterations gain more than the next five."""
    generator, setup = np.random.default_rng(1), setup_of(name)
    better, gains = {5: [], 10: []}, []
    for seed in range(5):
        scene = stand(built_in(name), RIG, seed, facing=1.3 * seed, height=1.4 + 0.1 * seed)
        starts, view = starts_around(scene.bodies, generator, 40), scene.views()[0]
        prior = Prior(setup.model, upright_sd=0.35)
        before = off(name, starts, scene)
        for steps, stages in ((5, ((0.2, 0.6, 3), (0.1, 0.3, 2))), (10, ((0.2, 0.6, 5), (0.1, 0.3, 5)))):
            fits = blob_fit(name, view, starts, stages, prior)
            for fit in fits:
                assert (np.diff(fit.trace, axis=0) <= 0).all()
                assert np.array_equal(fit.trace[-1], fit.cost)
            assert (fits[0].trace[-1] < fits[0].trace[0]).all()
            better[steps].append(off(name, fits[-1].bodies, scene) < before)
        ten = blob_fit(name, view, starts, ((0.20, 0.60, 10),), prior)[0].trace
        gains.append((ten[0] - ten[5], ten[5] - ten[10]))
    assert np.mean(better[5]) >= 0.99 and np.mean(better[10]) >= 0.99
    early, late = np.sum(gains, axis=(0, 2))
    assert early > 10 * late


@pytest.mark.parametrize("off_by", [(1, 0, 0), (0, 1, 0), (0, 0, 1), (1, 1, 1), (2, 2, 2)], ids=str)
@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_the_whole_fit_finds_the_person_from_the_papers_box(name, off_by):
    """A21: starts off by ±20°, ±0.25 m of height and ±0.2 m end at the person: one by one, jointly, twice as far."""
    generator, ends = np.random.default_rng(2), []
    for seed in range(4):
        scene = stand(built_in(name), RIG, seed + 20, facing=0.7 + 1.6 * seed, height=1.2 + 0.2 * seed)
        starts = starts_around(scene.bodies, generator, 12, *off_by)
        fit = fit_from(scene.views()[0], starts, setup_of(name))
        ends.append(off(name, fit.bodies, scene))
    assert np.mean(np.array(ends) < 0.05) >= (0.95 if max(off_by) == 1 else 0.9)


def test_a_far_blob_moves_nothing():
    """A14: a ghost beyond every marker's reach leaves the solution where it was, to a hundredth of a millimetre."""
    name = "gait15"
    scene = stand(built_in(name), RIG, 7, facing=0.4)
    start = starts_around(scene.bodies, np.random.default_rng(3), 1)
    stages = ((0.10, 0.30, 10), (0.03, 0.12, 10))
    pixels = [scene.blobs.xy[scene.blobs.camera == camera] for camera in range(4)]
    plain = blob_fit(name, split_views(blobs_at(pixels), RIG)[0], start, stages)[-1]
    high = np.array([0, 0, 0.9])
    ghost = RIG.project(scene.points[0].max(axis=0) + high)
    haunted = blob_fit(
        name,
        split_views(blobs_at([np.vstack([p, g]) for p, g in zip(pixels, ghost, strict=True)]), RIG)[0],
        start,
        stages,
    )[-1]
    model = setup_of(name).model
    assert model.pose(haunted.bodies).markers == pytest.approx(model.pose(plain.bodies).markers, abs=1e-5)


def test_freed_joints_and_shape_explain_what_nine_parameters_cannot():
    markerset = built_in("body26")
    scene, setup = stand(markerset, RIG, 11, facing=2.5), setup_of("body26")
    prior = Prior(setup.model)
    start = setup.model.rest(1, float(scene.bodies.scale.mean()))
    start = replace(start, translation=scene.bodies.translation, quaternion=scene.bodies.quaternion)
    pull = to_points(scene.points, 0.005)
    rigid = fit_placement(setup.model, start, pull, 10, prior)
    free = fit_body(setup.model, start, pull, 10, prior)
    assert (np.diff(free.trace, axis=0) <= 0).all()
    assert free.cost < 0.2 * rigid.cost
    assert off("body26", free.bodies, scene) < 0.4 * off("body26", rigid.bodies, scene)


def test_covariance_is_the_spread_of_refitted_noise():
    """m² of every marker, against many fits to points that noise moved."""
    model, deviation = BodyModel(toy_markerset()), 0.01
    generator, truth = np.random.default_rng(6), BodyModel(toy_markerset()).rest(1, 1.7)
    points = model.pose(truth).markers
    noisy = points + generator.normal(0, deviation, (400, *points.shape[1:]))
    starts = truth.pick(np.zeros(400, dtype=int))
    ends = model.pose(fit_placement(model, starts, to_points(noisy, deviation), 6).bodies).markers
    real = np.einsum("bmi,bmj->mij", ends - points, ends - points) / 400
    said = placement_state(model, truth, to_points(points, deviation)).covariance()[0]
    assert said == pytest.approx(said.swapaxes(-1, -2))
    assert np.trace(real, axis1=1, axis2=2) == pytest.approx(np.trace(said, axis1=1, axis2=2), rel=0.25)
