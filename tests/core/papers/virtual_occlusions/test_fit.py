# SPDX-License-Identifier: GPL-3.0-or-later
"""Levenberg-Marquardt: nine parameters, a cost that never rises; and the body in the way, against a ray marcher."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.blobs.search import FINDING, fit_blobs, visible_pull
from addon.core.blobs.subject import Setup
from addon.core.body.bodies import PLACEMENT, BodyModel
from addon.core.body.prior import Prior
from addon.core.data.takes import Motion
from addon.core.geometry import rotations
from addon.core.geometry.views import split_views
from addon.core.papers.virtual_occlusions.cost import Pull
from addon.core.papers.virtual_occlusions.fit import Fit, fit_placement, placement_state
from addon.core.papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion, capsules_hide, hidden_by_any
from addon.core.simulation.rigs import paper_rig
from tests.core.scenes import blobs_at, built_in, motion_of, stand
from tests.core.toybody import toy_markerset

RIG = paper_rig()


# Softness in m, reach in m, iterations.
PLACEMENT_STAGES = ((0.20, 0.60, 5), (0.10, 0.30, 5))


@cache
def setup_of(name):
    return Setup.of(RIG, built_in(name))


def starts_around(name, bodies, generator, count, turn=1.0, height=1.0, place=1.0):
    """Rest bodies off by up to so many times the paper's ±20° about each axis, ±0.25 m of height, ±0.2 m along each."""
    model = setup_of(name).model
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
        pull = visible_pull(start, setup.model.pose(start), view, setup, softness, reach)
        fits.append(fit_placement(setup.model, start, pull, steps, prior))
        start = fits[-1].bodies
    return fits


def fit_from(name, view, start) -> Fit:
    """The paper's whole fit from a given start of B bodies: nine parameters first, then joints and shape as well."""
    setup = setup_of(name)
    nine = blob_fit(name, view, start, PLACEMENT_STAGES, setup.prior)[-1].bodies
    return fit_blobs(nine, view, setup, Prior(setup.model, upright_sd=FINDING.upright_sd_rad))


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
    state = placement_state(model, body, to_points(np.nan))
    assert state.gradient.shape == (1, PLACEMENT) == (1, 9)
    assert state.posed.markers[0] == pytest.approx(expected, abs=1e-12)
    assert RIG.normalised(state.posed.markers[0]) == pytest.approx(
        setup_of("gait15").sight.image(setup_of("gait15").sight.local(expected[None]))[0], abs=1e-9
    )


def to_points(points, deviation=0.01):
    """What pulls markers (B, M, 3) to named points in space, m, NaN where unknown, of such a standard deviation."""

    def pull(markers):
        known = np.isfinite(np.broadcast_to(points, markers.shape)[..., :1])
        offset = np.where(known, markers - points, 0) / deviation
        hessian = (known / deviation**2)[..., None] * np.eye(3)
        return Pull((offset**2).sum(axis=(1, 2)), offset / deviation, hessian)

    return pull


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
        starts, view = starts_around(name, scene.bodies, generator, 40), scene.views()[0]
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
        starts = starts_around(name, scene.bodies, generator, 12, *off_by)
        fit = fit_from(name, scene.views()[0], starts)
        ends.append(off(name, fit.bodies, scene))
    assert np.mean(np.array(ends) < 0.05) >= (0.95 if max(off_by) == 1 else 0.9)


def test_a_far_blob_moves_nothing():
    """A14: a ghost beyond every marker's reach leaves the solution where it was, to a hundredth of a millimetre."""
    name = "gait15"
    scene = stand(built_in(name), RIG, 7, facing=0.4)
    start = starts_around(name, scene.bodies, np.random.default_rng(3), 1)
    stages = ((0.10, 0.30, 10), (0.03, 0.12, 10))
    pixels = [scene.blobs.xy[scene.blobs.camera == camera] for camera in range(4)]
    plain = blob_fit(name, split_views(blobs_at(pixels), RIG)[0], start, stages)[-1]
    ghost = RIG.project(np.add(scene.points[0].max(axis=0), [0, 0, 0.9]))
    more = [np.vstack([own, one]) for own, one in zip(pixels, ghost, strict=True)]
    haunted = blob_fit(name, split_views(blobs_at(more), RIG)[0], start, stages)[-1]
    model = setup_of(name).model
    assert model.pose(haunted.bodies).markers == pytest.approx(model.pose(plain.bodies).markers, abs=1e-5)


def test_covariance_is_the_spread_of_refitted_noise():
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


STANDOFF = 0.008


def hide(capsules, markers, eyes):
    """(C, M) of one body whose capsules are rows (start, end, radius)."""
    start, end, radius = (np.array(rows, dtype=float) for rows in zip(*capsules, strict=True))
    body = start[None], (end - start)[None], radius[None], np.array(markers, float)[None]
    return capsules_hide(*body, np.array(eyes, float), np.array([STANDOFF]), OCCLUDING.min_side_share)[0]


def marched(capsules, marker, eye, standoff, steps):
    """How near sampled points of the ray come to each capsule's surface; NaN where the marker's side is unclear."""
    margins = []
    for start, end, radius in capsules:
        start, end, point = np.array(start, float), np.array(end, float), np.array(marker, float)
        axis = end - start
        foot = start + axis * np.clip((point - start) @ axis / max(axis @ axis, 1e-12), 0, 1)
        distance = np.linalg.norm(point - foot)
        if distance <= OCCLUDING.min_side_share * radius:
            margins.append(np.nan)
            continue
        if distance < radius + standoff:
            point = foot + (point - foot) / distance * (radius + standoff)
        ray = point + np.linspace(0, 1, steps)[:, None] * (np.array(eye, float) - point)
        along = np.clip((ray - start) @ axis / max(axis @ axis, 1e-12), 0, 1)
        margins.append(np.linalg.norm(ray - start - along[:, None] * axis, axis=1).min() - radius)
    return np.array(margins)


UPRIGHT, SPHERE = [((0, 0, 0), (0, 0, 1), 0.1)], [((0, 0, 0), (0, 0, 0), 0.5)]


@pytest.mark.parametrize(
    ("capsules", "marker", "eye", "expected"),
    [
        (UPRIGHT, (1, 0, 0.5), (-1, 0, 0.5), True),  # straight through the middle
        (UPRIGHT, (1, 0, 0.5), (3, 0, 0.5), False),  # the capsule is behind the marker
        (UPRIGHT, (1, 0, 0.5), (0.3, 0, 0.5), False),  # the camera is in front of the capsule
        (UPRIGHT, (1, 0.099, 0.5), (-1, 0.099, 0.5), True),  # just inside the radius
        (UPRIGHT, (1, 0.101, 0.5), (-1, 0.101, 0.5), False),  # just outside it
        (UPRIGHT, (1, 0, 1.099), (-1, 0, 1.099), True),  # through the round end
        (UPRIGHT, (1, 0, 1.101), (-1, 0, 1.101), False),  # over it
        (UPRIGHT, (0, 0, -1), (0, 0, 3), True),  # along the axis
        (UPRIGHT, (0.2, 0, -1), (0.2, 0, 3), False),  # beside it, parallel
        (UPRIGHT, (np.nan, 0, 0), (0, 0, 3), False),  # a gap is not hidden
        (SPHERE, (2, 0, 0), (-2, 0, 0), True),
        (SPHERE, (2, 1.1, 0), (-2, 1.1, 0), False),
    ],
)
def test_one_upright_capsule_or_one_without_length(capsules, marker, eye, expected):
    assert hide(capsules, [marker], [eye])[0, 0] == expected


@pytest.mark.parametrize("depth", [-0.004, 0.0, 0.01, 0.03])
def test_a_marker_is_seen_from_the_side_it_sits_on_and_hidden_from_the_other(depth):
    marker = (0.1 - depth, 0, 0.5)
    eyes = [(3, 0, 0.5), (3, 2, 1.5), (0.1, 3, 0.5), (-3, 0, 0.5), (-3, 1, 1.5), (-2, 3, 0.5)]
    assert hide(UPRIGHT, [marker], eyes)[:, 0].tolist() == [False, False, False, True, True, True]


def test_a_marker_next_to_the_axis_or_at_a_joint_is_not_hidden_because_its_side_is_not_known():
    assert not hide(UPRIGHT, [(0.01, 0, 0.5)], [(-3, 0, 0.5)])[0, 0]
    assert not hide(UPRIGHT, [(0, 0, 0.5)], [(-3, 0, 0.5)])[0, 0]
    knee = [((0, 0, 1), (0, 0, 0.5), 0.07), ((0, 0, 0.5), (-0.2, 0, 0.1), 0.05)]
    marker, outside, inside = (0, 0.065, 0.5), (0.3, 3, 1.5), (0.3, -3, 1.5)
    assert hide(knee, [marker], [outside, inside])[:, 0].tolist() == [False, True]


def test_random_bodies_agree_with_the_marched_ray_without_exception():
    markerset = toy_markerset()
    model, generator = BodyModel(markerset), np.random.default_rng(3)
    bodies = model.rest(6, 1.7)
    bodies.bends[:, 1:] = generator.normal(0, 0.4, bodies.bends[:, 1:].shape)
    posed = model.pose(bodies)
    eyes = np.array([[3, 2, 2.2], [-3, 1, 0.4], [0.5, -4, 1.5]])
    found = CapsuleOcclusion(markerset).hidden(posed.rotations, posed.joints, bodies.scale, posed.markers, eyes)
    own, sure = markerset.capsules, 0
    for body in range(6):
        turn, joints = posed.rotations[body, own.segment], posed.joints[body, own.segment]
        start = joints + np.einsum("kij,kj->ki", turn, own.start * 1.7)
        end = joints + np.einsum("kij,kj->ki", turn, own.end * 1.7)
        rows = list(zip(start, end, own.radius * 1.7, strict=True))
        for camera, eye in enumerate(eyes):
            for index, marker in enumerate(posed.markers[body]):
                margins = marched(rows, marker, eye, 0.005 * 1.7, 1501)
                if np.nanmin(np.abs(margins)) > 3e-3:
                    sure += 1
                    assert found[body, camera, index] == bool((margins < 0).any())
    assert sure > 200


def standing(height=1.7, yaw=0.0):
    markerset = toy_markerset()
    model = BodyModel(markerset)
    bodies = model.rest(1, height)
    bodies.quaternion[:] = [np.cos(yaw / 2), 0, 0, np.sin(yaw / 2)]
    return markerset, bodies, model.pose(bodies)


@pytest.mark.parametrize("yaw", [0.0, 1.0, 2.5, 4.0])
@pytest.mark.parametrize("height", [1.1, 1.7, 2.0])
def test_the_front_image_discards_the_back_markers_and_the_back_image_the_front_ones(height, yaw):
    markerset, bodies, posed = standing(height, yaw)
    ahead = np.array([np.cos(yaw), np.sin(yaw), 0])
    eyes = np.array([4 * ahead + [0, 0, 1.2], -4 * ahead + [0, 0, 1.2]])
    body = posed.rotations, posed.joints, bodies.scale, posed.markers
    front, back = CapsuleOcclusion(markerset).hidden(*body, eyes)[0]
    for name in ("CLAV", "LASI", "RASI", "LFHD"):
        assert (front[markerset.index(name)], back[markerset.index(name)]) == (False, True), name
    for name in ("C7", "SACR", "RBHD"):
        assert (front[markerset.index(name)], back[markerset.index(name)]) == (True, False), name


def test_a_shrunk_body_hides_a_part_of_what_the_whole_body_hides():
    markerset, bodies, posed = standing()
    angle = np.linspace(0, 2 * np.pi, 24, endpoint=False)
    eyes = np.stack([3 * np.cos(angle), 3 * np.sin(angle), np.full(24, 1.5)], axis=1)
    whole, thin = (
        CapsuleOcclusion(markerset, shrink).hidden(posed.rotations, posed.joints, bodies.scale, posed.markers, eyes)[0]
        for shrink in (1.0, 0.5)
    )
    assert thin.sum() < whole.sum()
    assert (thin & ~whole).mean() < 0.01


def waiting(model: BodyModel, places: list[float]) -> Motion:
    """The body at rest at some places along x, frame after frame, m; NaN where it was not found."""
    posed, shift = model.pose(model.rest(1, 1.0)), np.array(places)[:, None, None] * [1.0, 0.0, 0.0]
    markers, turns = posed.markers + shift, np.repeat(posed.rotations, len(places), axis=0)
    return replace(motion_of(markers, markers), joints=posed.joints + shift, rotations=turns)


def test_whoever_stands_between_hides_the_markers_of_others():
    markerset = toy_markerset()
    model, bodies = BodyModel(markerset), (CapsuleOcclusion(markerset),) * 2
    front, behind = waiting(model, [1.0, 1.0, np.nan]), waiting(model, [0.0, 6.0, 0.0])
    centres = np.array([[30.0, 0.0, float(behind.joints[0, :, 2].mean())]])
    each, size = [front, behind], len(markerset)
    markers = np.concatenate([one.markers for one in each], axis=1)
    found = hidden_by_any(bodies, each, markers, centres)
    alone = np.concatenate([hidden_by_any(bodies[:1], [one], one.markers, centres) for one in each], axis=2)
    assert found.shape == (3, 1, 2 * size)
    assert (found >= alone).all()
    assert (found & ~alone)[0, 0, size:].any()
    assert not (found & ~alone)[0, 0, :size].any(), "nobody is in front of the one in front"
    assert (found & ~alone)[1, 0, :size].any(), "now the other is in front"
    assert (found == alone)[2].all(), "a body that was not found hides nothing"
