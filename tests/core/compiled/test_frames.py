# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies, rays, algorithm 1 and following a subject in C against NumPy: the same labels, bodies and tracks."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.blobs import confidence
from addon.core.blobs.confidence import CONFIDENCE
from addon.core.blobs.image_tracklets import link_blobs
from addon.core.blobs.tracking import Anchor, followed_by_library, followed_by_numpy
from addon.core.body import bodies as posing
from addon.core.body.bodies import PLACEMENT, Bodies, BodyModel
from addon.core.body.prior import Prior
from addon.core.geometry import cameras, triangulation
from addon.core.geometry.triangulation import MAX_CONDITION, RAY_RIDGE
from addon.core.geometry.views import Sight, View, split_views
from addon.core.kernels import frame_calls
from addon.core.papers.virtual_occlusions import cost, fit, occlusion
from addon.core.papers.virtual_occlusions.labelling import Expectation, Rules, named_by_library, named_by_numpy
from addon.core.simulation.rigs import paper_rig, ring_rig
from addon.core.simulation.simulate import CaptureOptions
from addon.core.simulation.virtual import Act
from tests.core.blobs.test_following import begun as begun_in
from tests.core.scenes import act, blobs_at, built_in
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
    """Compares what the kernel and its twin give, an array or several; gives the twin's."""
    one, other = function.kernel(*arguments), function.reference(*arguments)
    same(*((one, other) if isinstance(one, tuple) else ([one], [other])))
    return other


def refused(*calls):
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


RULES = Rules(pixel=0.7)


def scene(seed: int, cameras: int, markers: int, ghosts: int):
    """A room's view of points that are about where they are expected, some close together, some out of sight."""
    generator = np.random.default_rng(seed)
    rig = ring_rig(cameras, generator=np.random.default_rng(1))
    points = generator.uniform([-0.3, -0.3, 0.6], [0.3, 0.3, 1.4], (markers, 3))
    points[1::3] = points[: len(points[1::3])] + generator.normal(0, 0.015, points[1::3].shape)
    pixels = []
    for rows in rig.project(points):
        rows = rows[generator.random(len(rows)) < 0.85] + generator.normal(0, 0.5, (1, 2))
        pixels.append(np.concatenate([rows, generator.uniform(0, 600, (ghosts, 2))]))
    view = split_views(blobs_at(pixels), rig)[0]
    spread = generator.normal(0, 0.01, (markers, 3, 3))
    covariance = spread @ spread.swapaxes(1, 2) + 1e-5 * np.eye(3)
    expected = points + generator.normal(0, 0.008, points.shape)
    if markers > 2:
        expected[-1] = [50, 50, 1]  # behind some camera, far from all
    visible = generator.random((cameras, markers)) < 0.85
    return generator, Sight(rig), view, Expectation(expected, covariance, visible)


@settings(max_examples=40, deadline=None)
@given(SEEDS, st.sampled_from([2, 3, 4, 8]), st.sampled_from([1, 2, 9, 20]), st.integers(0, 4), st.booleans())
def test_names_are_the_same(seed, cameras, markers, ghosts, by_hand):
    generator, sight, view, expected = scene(seed, cameras, markers, ghosts)
    fixed = None
    if by_hand:
        fixed = np.full((cameras, markers), -1)
        camera = int(generator.integers(cameras))
        if view.real[camera, 0]:
            fixed[camera, generator.integers(markers)] = 0
    for first_only in (True, False):
        one = named_by_library(view, sight, expected, RULES, fixed, first_only)
        with numpy_everywhere():
            other = named_by_numpy(view, sight, expected, RULES, fixed, first_only)
            for name in ("slot", "step", "owner", "partner", "conflicts"):
                assert (getattr(one, name) == getattr(other, name)).all(), name
            same([one.frame.nll, one.reprojection], [other.frame.nll, other.reprojection])
            same([one.meeting.points, one.meeting.miss], [other.meeting.points, other.meeting.miss])


def test_nothing_seen_and_nothing_known():
    _, sight, view, expected = scene(0, 3, 4, 0)
    nothing = split_views(blobs_at([np.zeros((0, 2))] * 3), ring_rig(3, generator=np.random.default_rng(1)))
    unknown = replace(expected, points=expected.points * np.nan)
    for seen, wanted in ((nothing[0] if nothing else view, expected), (view, unknown)):
        for named in (named_by_library, named_by_numpy):
            assert (named(seen, sight, wanted, RULES, None, False).slot < 0).all()


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from([1, 2, 5]), st.booleans())
def test_rays_meet_the_same(seed, cameras, lengths):
    generator, sight, view, _ = scene(seed, max(cameras, 2), 6, 1)
    rays = both(triangulation.blob_rays, view.image, sight.rotation, sight.centres)
    slot = generator.integers(-1, view.real.shape[1], (len(view.real), 7))
    slot[:, 0], slot[1:, 1] = -1, -1
    depth = generator.uniform(1, 5, slot.shape) if lengths else None
    slot = np.where(view.real[np.arange(len(slot))[:, None], np.maximum(slot, 0)], slot, -1)
    both(triangulation.meet, slot, depth, *rays[1:], sight.centres, RAY_RIDGE, MAX_CONDITION)


def test_indices_and_shapes_beyond_are_refused():
    _, sight, view, expected = scene(0, 3, 4, 0)
    rays = triangulation.blob_rays(view.image, sight.rotation, sight.centres)
    ends = *rays[1:], sight.centres, RAY_RIDGE, MAX_CONDITION
    far = np.full((3, 4), view.real.shape[1])
    many = SimpleNamespace(real=np.ones((frame_calls.MOST_CAMERAS + 1, 1), bool))
    refused(
        lambda: triangulation.meet(far, None, *ends),
        lambda: triangulation.meet(far - 99, None, *ends),
        lambda: triangulation.meet(np.full((2, 4), -1), None, *ends),
        lambda: triangulation.blob_rays(view.image, sight.rotation[:2], sight.centres),
        lambda: named_by_library(view, sight, expected, RULES, far, False),
        lambda: named_by_library(view, sight, replace(expected, visible=expected.visible.T), RULES, None, False),
        lambda: named_by_library(many, sight, expected, RULES, None, False),
    )


ROOM_RIG = ring_rig(4, radius=4.5, volume_radius=1.3)
ROOM = CaptureOptions(noise=0.4, reflections=2, flicker=0.2)


class Nothing:
    """A volume that hides no marker, and is not of capsules."""

    def hidden(self, rotations, joints, scale, markers, centres):
        return np.zeros((len(markers), len(centres), markers.shape[1]), bool)


def begun(name: str, occlusion=None):
    markerset = toy_markerset() if name == "toy" else built_in(name)
    walk = act(markerset, ROOM_RIG, [Act(0.4, stride=0.9)], seed=4, options=ROOM)
    setup, views, _, track = begun_in(walk, occlusion)
    return setup, views, track


def numbers_of(followed) -> list[np.ndarray]:
    track, naming = followed.track, followed.naming
    bodies = [getattr(track.subject.bodies, name) for name in Bodies.__dataclass_fields__]
    learned = [track.subject.own_sd, np.array(track.subject.pixel), track.velocity, track.lag]
    seen = [naming.meeting.points, naming.meeting.residual, naming.meeting.miss, naming.reprojection]
    measured = [getattr(naming.frame, name) for name in ("image", "slope", "depth", "metres", "nll")]
    return [*bodies, *learned, *seen, *measured, followed.expected.points, followed.expected.covariance]


def compare(track, view, setup, fixed=None):
    """The next frame by the library, found to be the same as by NumPy."""
    one = followed_by_library(track, view, setup, fixed)
    with numpy_everywhere():
        other = followed_by_numpy(track, view, setup, fixed)
        same(numbers_of(one), numbers_of(other))
    for name in ("slot", "step", "owner", "partner", "conflicts"):
        assert (getattr(one.naming, name) == getattr(other.naming, name)).all(), name
    assert one.track.lost == other.track.lost
    assert (one.expected.visible == other.expected.visible).all()
    return one


@pytest.mark.parametrize(("name", "how"), [("toy", None), ("gait15", None), ("gait15", Nothing()), ("body26", None)])
def test_frames_are_followed_the_same(name, how):
    setup, views, track = begun(name, how)
    for view in views[1:12]:
        track = compare(track, view, setup).track
    assert not track.lost


def test_what_a_person_named_a_frame_without_blobs_and_one_with_many_more_are_followed_the_same():
    setup, views, track = begun("gait15")
    fixed = np.full((len(ROOM_RIG), setup.model.marker_count), -1)
    for camera in range(len(ROOM_RIG)):
        fixed[camera, camera] = np.flatnonzero(views[1].real[camera])[-1]
    followed = compare(track, views[1], setup, fixed)
    assert (followed.naming.slot[fixed >= 0] == fixed[fixed >= 0]).all()
    assert (followed.naming.frame.fixed == fixed).all()
    setup, views, track = begun("gait15")
    view = views[1]
    nothing = replace(view, image=view.image * 0 + 1e6, real=view.real & False)
    crowd = replace(view, **{name: np.repeat(getattr(view, name), 3, axis=1) for name in ("image", "real", "row")})
    for seen in (nothing, crowd, view):
        followed = compare(track, seen, setup)
    assert compare(track, nothing, setup).track.lost and not followed.track.lost


def test_what_does_not_fit_is_refused():
    setup, views, track = begun("toy")
    far = np.full((len(ROOM_RIG), setup.model.marker_count), views[1].real.shape[1])
    refused(
        lambda: followed_by_library(track, views[1], setup, far),
        lambda: followed_by_library(track, views[1], setup, far[1:]),
        lambda: followed_by_library(replace(track, lag=track.lag[1:]), views[1], setup, None),
        lambda: followed_by_library(replace(track, visible=track.visible.T), views[1], setup, None),
        lambda: followed_by_library(track, replace(views[1], real=views[1].real[1:]), setup, None),
    )


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from([2, 3, 8]), st.sampled_from([1, 2, 9, 20]), st.integers(0, 4))
def test_confidences_are_the_same(seed, cameras, markers, ghosts):
    _, sight, view, expected = scene(seed, cameras, markers, ghosts)
    naming = named_by_numpy(view, sight, expected, RULES, None, step1_only=False)
    both(confidence.named_confidences, naming, CONFIDENCE)


@settings(max_examples=25, deadline=None)
@given(SEEDS, st.sampled_from([1, 3]), st.sampled_from([1, 4, 12]), st.sampled_from([1, 3, 14]))
def test_blobs_go_on_the_same(seed, cameras, earlier, blobs):
    generator = np.random.default_rng(seed)
    places = [generator.uniform(-0.05, 0.05, (cameras, count, 2)) for count in (earlier, blobs)]
    some = min(earlier, blobs)
    places[1][:, :some] = places[0][:, :some] + generator.normal(0, 0.004, (cameras, some, 2))
    real = [generator.random(part.shape[:2]) < 0.8 for part in places]
    before, view = (View(part, there, there - 1) for part, there in zip(places, real, strict=True))
    speed = np.where(generator.random((cameras, earlier, 1)) < 0.3, np.nan, generator.normal(0, 0.004, places[0].shape))
    depth = generator.uniform(2, 5, cameras)
    both(link_blobs, before, view, speed, depth, (0.015, 0.06), (2.0, 0.003))


def test_a_frame_whose_fit_cannot_be_solved_is_left_to_numpy():
    setup, views, track = begun("toy")
    bodies = track.subject.bodies
    nowhere = replace(bodies, translation=bodies.translation * np.nan)
    lost = replace(track, subject=replace(track.subject, bodies=nowhere))
    assert followed_by_library(lost, views[1], setup, None) is None
