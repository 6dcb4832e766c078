# SPDX-License-Identifier: GPL-3.0-or-later
"""Posing, pulls, fits and occlusion in C against NumPy, over random bodies and what no body should be like."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.blobs.tracking import Anchor
from addon.core.body import bodies as posing
from addon.core.body.bodies import PLACEMENT, Bodies, BodyModel
from addon.core.body.prior import Prior
from addon.core.geometry import cameras
from addon.core.geometry.views import Sight, split_views
from addon.core.papers.virtual_occlusions import cost, fit, occlusion
from addon.core.simulation.rigs import paper_rig
from tests.core.scenes import blobs_at, built_in
from tests.core.toybody import toy_markerset

from .conftest import numpy_everywhere

SEEDS = st.integers(0, 2**16)
FEW = settings(max_examples=15, deadline=None)
MODELS = [BodyModel(markerset) for markerset in (toy_markerset(), built_in("gait15"), built_in("body26"))]
RIG = paper_rig()
SIGHT = Sight(RIG)


def people(model: BodyModel, generator, count: int) -> Bodies:
    """Bodies of any pose, some at rest: there a turn has no axis."""
    rest = model.rest(count, 1.7)
    bends = generator.normal(0, 0.6, rest.bends.shape) * generator.integers(0, 2, (count, 1, 1))
    turn = generator.normal(size=(count, 4))
    return replace(
        rest,
        translation=generator.normal(0, 0.5, rest.translation.shape),
        quaternion=turn / np.linalg.norm(turn, axis=1, keepdims=True),
        scale=generator.uniform(1.2, 2.0, rest.scale.shape),
        bends=bends,
        shape=generator.normal(size=rest.shape.shape),
        own=generator.normal(0, 0.01, rest.own.shape),
    )


def same(one, other, tolerance=1e-9):
    """Whether arrays are equal to `tolerance` of the largest number in them, and missing in the same places."""
    for a, b in zip(one, other, strict=True):
        assert a.shape == b.shape
        most = np.nanmax(np.abs(np.where(np.isfinite(b), b, 0)), initial=1.0)
        np.testing.assert_allclose(a, b, rtol=0, atol=tolerance * most)


def both(function, *arguments):
    """Compares what the kernel and its twin give."""
    same(function.kernel(*arguments), function.reference(*arguments))


def refused(*calls):
    """Each call is refused, in words."""
    for call in calls:
        with pytest.raises(ValueError, match="expected"):
            call()


@FEW
@given(SEEDS, st.sampled_from(MODELS), st.integers(0, 4))
def test_posing_and_its_derivatives(seed, model, count):
    bodies = people(model, np.random.default_rng(seed), count)
    both(posing.pose, model, bodies)
    both(posing.derivatives, model, bodies)


def seen_by(generator, markers, blobs=None):
    """The view of markers (M, 3), off by some pixels, some cameras with fewer blobs and one with none."""
    pixels = [rows + generator.normal(0, 3, rows.shape) for rows in RIG.project(markers)[:, : blobs or len(markers)]]
    pixels[-1] = pixels[-1][:0]
    return split_views(blobs_at(pixels), RIG)[0]


def pull_alike(pull: cost.DataPull, markers):
    one, other = pull(markers), pull._by_numpy(markers)
    same([one.cost, one.gradient, one.hessian], [other.cost, other.gradient, other.hessian])


@FEW
@given(SEEDS, st.integers(1, 3), st.sampled_from([1, 2, 15]), st.booleans())
def test_what_data_say_to_markers(seed, count, markers, behind):
    generator = np.random.default_rng(seed)
    at = generator.uniform([-0.4, -0.4, 0.2], [0.4, 0.4, 1.8], (count, markers, 3))
    if behind:
        at[0, 0] = [40, 40, 1]  # no camera is farther out
    view = seen_by(generator, at[0])
    visible = generator.random((count, len(RIG), markers)) < 0.7
    pull_alike(cost.BlobPull(visible, view, SIGHT, 0.1, 0.3), at)
    points = generator.normal(0, 0.5, (generator.integers(0, 9), 3))
    pull_alike(cost.CloudPull(points, generator.random(len(points)), 0.1, 0.3), at)
    named = generator.normal(0, 0.5, at.shape)
    named[generator.random(at.shape[:2]) < 0.3] = np.nan
    pull_alike(cost.PointPull(named, 0.01, 0.1), at)
    image = generator.normal(0, 0.1, (count, len(RIG), markers, 2))
    deviation = np.where(generator.random((count, len(RIG), markers)) < 0.3, np.inf, 0.002)
    pull_alike(cost.RayPull(image, deviation, SIGHT), at)
    pull_alike(cost.RayPull(image[:1], deviation[:1], SIGHT), at)


def pulls_of(generator, model, start):
    """One of each kind."""
    goal = model.pose(people(model, generator, 1)).markers[0]
    view = seen_by(generator, goal)
    visible = generator.random((len(start), len(RIG), model.marker_count)) < 0.8
    image = SIGHT.image(SIGHT.local(goal[None]))
    deviation = np.where(generator.random(image.shape[:-1]) < 0.2, np.inf, 0.003)
    return (
        cost.BlobPull(visible, view, SIGHT, 0.1, 0.3),
        cost.CloudPull(goal, np.ones(len(goal)), 0.1, 0.3),
        cost.RayPull(image, deviation, SIGHT),
        cost.PointPull(np.repeat(goal[None], len(start), axis=0), 0.01, 0.1),
    )


@settings(max_examples=6, deadline=None)
@given(SEEDS, st.sampled_from(MODELS), st.booleans(), st.integers(0, 3))
def test_fits(seed, model, anchored, kind):
    generator = np.random.default_rng(seed)
    start = people(model, generator, 1 if anchored else 2)
    # A placement is fitted to bodies at rest.
    start = replace(start, bends=0 * start.bends, shape=0 * start.shape, own=0 * start.own)
    pull = pulls_of(generator, model, start)[kind]
    prior = Prior(model, upright_sd=0.3)
    for width, fitted in ((PLACEMENT, fit.fit_placement), (model.parameters, fit.fit_body)):
        held = prior
        if width > PLACEMENT:
            start = replace(people(model, generator, len(start)), translation=start.translation)
        if anchored and width > PLACEMENT:
            held = Anchor(prior, people(model, generator, 1), 1.5)
        found = fitted(model, start, pull, 3, held)
        with numpy_everywhere():
            expected = fitted(model, start, pull, 3, held)
        # What the steps make of the last digits is more than they are.
        same([found.trace, found.state.posed.markers], [expected.trace, expected.state.posed.markers], 1e-7)
        first = fitted(model, start, pull, 0, held).state
        with numpy_everywhere():
            other = fitted(model, start, pull, 0, held).state
        for name in ("cost", "gradient", "normal", "columns"):
            same([getattr(first, name)], [getattr(other, name)])
        same([first.covariance()], [fit.marker_covariance.reference(other.normal, other.columns, fit.DAMPING.ridge)])


@settings(max_examples=6, deadline=None)
@given(SEEDS, st.sampled_from(MODELS), st.integers(1, 5), st.integers(1, 3))
def test_fits_until_bodies_are_still(seed, model, steps, at_once):
    generator = np.random.default_rng(seed)
    start, prior = people(model, generator, 3), Prior(model)
    goal = model.pose(people(model, generator, 3)).markers
    goal[0] = model.pose(start).markers[0]  # which is still at once

    def found():
        pull_on = lambda some: cost.PointPull(goal[some], 0.01, 0.1)  # noqa: E731
        return fit.fit_until_still(model, start, pull_on, steps, prior, at_once, 1e-3)

    bodies = found()
    with numpy_everywhere():
        expected = found()
    same([model.pose(bodies).markers], [model.pose(expected).markers], 1e-7)


def test_a_fit_that_cannot_be_solved_is_left_to_numpy():
    model = MODELS[0]
    start = people(model, np.random.default_rng(0), 1)
    broken = replace(start, translation=start.translation * np.nan)
    pull = cost.CloudPull(np.zeros((3, 3)), np.ones(3), 0.1, 0.3)
    assert fit.descend(model, broken, pull, 2, Prior(model), model.parameters) is None


@FEW
@given(SEEDS, st.integers(1, 3), st.integers(1, 6), st.integers(1, 4), st.integers(1, 5))
def test_capsules_hide_the_same(seed, bodies, capsules, markers, cameras):
    generator = np.random.default_rng(seed)
    axis = generator.normal(0, 0.3, (bodies, capsules, 3)) * generator.integers(0, 2, (bodies, capsules, 1))
    arguments = (
        generator.normal(0, 0.5, (bodies, capsules, 3)),
        axis,
        generator.uniform(0, 0.2, (bodies, capsules)),
        generator.normal(0, 0.5, (bodies, markers, 3)),
        generator.normal(0, 3, (cameras, 3)),
        generator.uniform(0, 0.02, bodies),
        0.3,
    )
    assert (occlusion.capsules_hide.kernel(*arguments) == occlusion.capsules_hide.reference(*arguments)).all()
    for none in (slice(0), slice(1)):
        start, axis, radius, markers, centres, standoff, share = arguments
        parts = start[none], axis[none], radius[none], markers[none], centres[:0], standoff[none], share
        assert occlusion.capsules_hide.kernel(*parts).shape == (len(start[none]), 0, markers.shape[1])


def test_arrays_that_do_not_go_together_are_refused():
    generator, model = np.random.default_rng(0), MODELS[0]
    bodies = people(model, generator, 2)
    wrong = replace(bodies, bends=bodies.bends[:, 1:])
    points = np.zeros((2, 3, 3))
    refused(
        lambda: posing.pose(model, wrong),
        lambda: posing.derivatives(model, wrong),
        lambda: cost.PointPull(points[:1], 0.01, 0.1)(points),
        lambda: cost.CloudPull(np.zeros((4, 3)), np.ones(3), 0.1, 0.3)(points),
        lambda: cost.RayPull(np.zeros((2, len(RIG), 2, 2)), np.ones((2, len(RIG), 2)), SIGHT)(points),
        lambda: cost.RayPull(np.zeros((3, len(RIG), 3, 2)), np.ones((3, len(RIG), 3)), SIGHT)(points),
        lambda: cost.BlobPull(np.ones((1, len(RIG), 3)), seen_by(generator, points[0]), SIGHT, 0.1, 0.3)(points),
        lambda: fit.marker_covariance(np.eye(9)[None], np.zeros((1, 3, 3, 8)), 1e-9),
        lambda: fit.fit_body(model, wrong, cost.CloudPull(points[0], np.ones(3), 0.1, 0.3), 1, Prior(model)),
        lambda: occlusion.capsules_hide(points, points, np.ones((2, 2)), points, np.zeros((4, 3)), np.ones(2), 0.3),
    )


@FEW
@given(SEEDS, st.sampled_from([0, 1, 50]))
def test_lenses_are_taken_out_the_same(seed, count):
    """Far beyond a lens' reach, where no light comes from, and where nothing was seen, too."""
    generator = np.random.default_rng(seed)
    image = generator.normal(0, 0.6, (count, 2))
    image[:1] = 0
    image[1:2] = np.nan
    lens = generator.normal(0, [0.2, 0.05, 0.002, 0.002, 0.01], (count, 5))
    lens[2:3] = 0
    both(cameras.straightened, image, lens, cameras.lens_reach(lens), *cameras.LENS_NEWTON)
