# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers in space from named blobs; rotations, the same as SciPy's; and the push on a force plate."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from addon.core.geometry import rotations
from addon.core.geometry.force_plates import force_on_plate
from addon.core.geometry.triangulation import Rays
from addon.core.geometry.views import Sight, split_views
from addon.core.simulation.rigs import paper_rig, ring_rig
from tests.core.scenes import blobs_at

RIG = paper_rig()


def rays_to(points, cameras=RIG, noise=None):
    """Rays of one blob a point in every camera, in the points' order."""
    pixels = cameras.project(points) + (0 if noise is None else noise)
    view = split_views(blobs_at(list(pixels)), cameras)[0]
    return Rays(view, Sight(cameras))


def slots(count, cameras=4):
    return np.tile(np.arange(count), (cameras, 1))


@given(st.integers(0, 2**16), st.integers(2, 4))
def test_rays_without_noise_meet_in_the_marker(seed, cameras):
    generator = np.random.default_rng(seed)
    points = generator.uniform([-0.7, -0.7, 0.1], [0.7, 0.7, 1.9], (6, 3))
    chosen = slots(6)
    for marker in range(6):
        chosen[generator.permutation(4)[cameras:], marker] = -1
    met = rays_to(points).meet(chosen)
    assert met.points == pytest.approx(points, abs=1e-9)
    assert met.residual == pytest.approx(np.zeros(6), abs=1e-7)
    assert (met.miss[chosen < 0] == 0).all()


def test_one_camera_none_and_parallel_rays_fix_no_point():
    chosen = slots(2)
    chosen[1:, 0] = -1
    chosen[:, 1] = -1
    met = rays_to(np.array([[0.1, 0, 1.0], [0, 0.2, 1.2]])).meet(chosen)
    assert np.isnan(met.points).all() and np.isnan(met.residual).all()
    assert (met.miss == 0).all()
    # Two cameras side by side look along one line at a far point: its depth is anybody's guess.
    near = ring_rig(2)
    centres = near.centres.copy()
    centres[1] = centres[0] + [0, 0, 0.01]
    rotation = np.repeat(near.rotation[:1], 2, axis=0)
    pair = replace(near, rotation=rotation, translation=-np.einsum("cij,cj->ci", rotation, centres))
    assert np.isnan(rays_to(np.array([[0.0, 0, 1]]), pair).meet(slots(1, 2)).points).all()


def test_weights_make_the_reprojection_error_least():
    """A pixel is worth more metres to a far camera, so the near one's ray counts for more."""
    cameras = ring_rig(4)
    point = np.array([[1.6, 0.3, 1.0]])
    noise = np.random.default_rng(5).normal(0, 1, (4, 1, 2))
    met = rays_to(point, cameras, noise).meet(slots(1))

    def error(candidate):
        return np.sum((cameras.project(candidate) - cameras.project(point) - noise) ** 2)

    best = error(met.points)
    moved = [error(met.points + step) for step in 0.002 * np.vstack([np.eye(3), -np.eye(3)])]
    assert best < min(moved)


parts = st.floats(-1, 1, allow_subnormal=False)
vectors = st.tuples(parts, parts, parts).map(np.array)
lengths = st.one_of(st.floats(0, 3), st.floats(0, 1e-6))


def quaternion(vector):
    return rotations.turned(np.array([1.0, 0, 0, 0]), np.asarray(vector, dtype=float))


@given(vectors, lengths)
def test_exponential_is_scipys(direction, length):
    vector = direction * length
    for turn in (rotations.exponential(vector)[0], rotations.turn_of(vector)):
        assert turn == pytest.approx(Rotation.from_rotvec(vector).as_matrix(), abs=1e-12)


@given(st.lists(st.tuples(vectors, st.floats(0, 1)), min_size=1, max_size=30))
def test_quaternions_stay_units_and_turn_as_matrices_do(steps):
    """A6: the quaternion's norm is 1 after each step, and a step is a turn in world axes."""
    turn, matrix = np.array([1.0, 0, 0, 0]), np.eye(3)
    for direction, length in steps:
        turn = rotations.turned(turn, direction * length)
        matrix = Rotation.from_rotvec(direction * length).as_matrix() @ matrix
        assert np.linalg.norm(turn) == pytest.approx(1, abs=1e-14)
    assert rotations.quaternion_to_matrix(turn) == pytest.approx(matrix, abs=1e-12)
    scipys = Rotation.from_quat(np.roll(turn, -1))  # which has w last
    assert rotations.quaternion_to_matrix(turn) == pytest.approx(scipys.as_matrix(), abs=1e-13)


@given(vectors, vectors, st.booleans())
def test_turn_between_leads_from_one_to_the_other_the_short_way(first, second, other_sign):
    start, end = quaternion(first), quaternion(2 * second)
    vector = rotations.turn_between(start, -end if other_sign else end)
    assert np.linalg.norm(vector) <= np.pi + 1e-12
    reached = rotations.quaternion_to_matrix(rotations.turned(start, vector))
    assert reached == pytest.approx(rotations.quaternion_to_matrix(end), abs=1e-10)


@given(vectors, lengths)
def test_rotation_vectors_are_found_again(direction, length):
    vector = direction * length / max(np.linalg.norm(direction), 1)
    assert rotations.rotation_vector(rotations.exponential(vector)[0]) == pytest.approx(vector, abs=1e-9)


@given(vectors.filter(lambda v: np.linalg.norm(v) > 0.1), st.one_of(st.just(0.0), st.floats(1e-9, 0.05)))
def test_half_turns_and_nearly_half_turns_are_found_again(direction, missing):
    """Both signs of the axis: a turn by just under half a circle to the left is not one to the right."""
    vector = direction / np.linalg.norm(direction) * (np.pi - missing)
    matrix = rotations.exponential(vector)[0]
    found = rotations.exponential(rotations.rotation_vector(matrix))[0]
    assert found == pytest.approx(matrix, abs=1e-6)


# A plate of 0.6 x 0.4 m whose own x is the room's -y and whose y is the room's -x; so its z is down.
CORNERS = np.array([[0.0, 0.0, 0.1], [0.0, 0.6, 0.1], [0.4, 0.6, 0.1], [0.4, 0.0, 0.1]])
FORCE, PLACE = np.array([30.0, -20.0, 700.0]), np.array([0.25, 0.2, 0.1])  # in the room
PUSH, AT = np.array([20.0, -30.0, -700.0]), np.array([0.1, -0.05, 0.0])  # the same in the plate


def measured(kind: int, origin: np.ndarray) -> np.ndarray:
    """What the sensors of a plate say, from which the middle of the surface is `origin` away."""
    if kind == 1:
        return np.concatenate([PUSH, AT[:2], [0.0]])
    if kind != 3:
        return np.concatenate([PUSH, np.cross(AT + origin, PUSH)])
    # Four sensors at (a, b), (-a, b), (-a, -b) and (a, -b), each of which bears a part.
    by_x, by_y, _ = np.cross(AT + origin * [0, 0, 1], PUSH) / [origin[1], origin[0], 1]
    bear = (PUSH[2] + np.array([by_x - by_y, by_x + by_y, by_y - by_x, -by_x - by_y])) / 4
    return np.concatenate([PUSH[0] * np.array([0.25, 0.75]), PUSH[1] * np.array([0.5, 0.5]), bear])


@pytest.mark.parametrize("kind", [1, 2, 3, 4])
@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("depth", [-0.04, 0.0])
def test_a_push_is_found_where_it_is(kind, sign, depth):
    origin = np.array([0.25, 0.15, depth])
    own = measured(kind, origin)
    channels, matrix = np.stack([own, np.zeros_like(own)]), np.eye(6)
    if kind == 4:
        matrix = np.triu(np.ones((6, 6)))
        channels = channels @ np.linalg.inv(matrix)
    force, place = force_on_plate(kind, CORNERS, sign * origin, channels, matrix)
    np.testing.assert_allclose(force, [FORCE, np.zeros(3)], atol=1e-9)
    np.testing.assert_allclose(place[0], PLACE, atol=1e-9)
    assert np.isnan(place[1]).all()
