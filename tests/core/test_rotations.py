# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotations: the same turns as SciPy's, unit quaternions after every step, vectors found again."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from addon.core.geometry import rotations

parts = st.floats(-1, 1, allow_subnormal=False)
vectors = st.tuples(parts, parts, parts).map(np.array)
lengths = st.one_of(st.floats(0, 3), st.floats(0, 1e-6))


def quaternion(vector):
    return rotations.turned(np.array([1.0, 0, 0, 0]), np.asarray(vector, dtype=float))


def scipys(quaternion):
    """SciPy's rotation of a quaternion in the order w x y z."""
    return Rotation.from_quat(np.roll(quaternion, -1))


@given(vectors, vectors)
def test_the_skew_matrix_is_the_vector_product(first, second):
    """A5: equation 3."""
    assert rotations.cross_matrix(first) @ second == pytest.approx(np.cross(first, second), abs=1e-15)


@given(vectors, lengths)
def test_exponential_is_scipys(direction, length):
    vector = direction * length
    assert rotations.exponential(vector)[0] == pytest.approx(Rotation.from_rotvec(vector).as_matrix(), abs=1e-12)


@given(vectors, lengths, vectors)
def test_left_jacobian_says_how_the_turn_changes(direction, length, change):
    vector, small = direction * length, 1e-5
    _, left = rotations.exponential(vector)
    higher = rotations.exponential(vector + small * change)[0]
    lower = rotations.exponential(vector - small * change)[0]
    expected = rotations.cross_matrix(left @ change) @ rotations.exponential(vector)[0]
    assert (higher - lower) / (2 * small) == pytest.approx(expected, abs=1e-7)


@given(st.lists(st.tuples(vectors, st.floats(0, 1)), min_size=1, max_size=30))
def test_quaternions_stay_units_and_turn_as_matrices_do(steps):
    """A6: the quaternion's norm is 1 after each step, and a step is a turn in world axes."""
    turn, matrix = np.array([1.0, 0, 0, 0]), np.eye(3)
    for direction, length in steps:
        turn = rotations.turned(turn, direction * length)
        matrix = Rotation.from_rotvec(direction * length).as_matrix() @ matrix
        assert np.linalg.norm(turn) == pytest.approx(1, abs=1e-14)
    assert rotations.quaternion_to_matrix(turn) == pytest.approx(matrix, abs=1e-12)
    assert rotations.quaternion_to_matrix(turn) == pytest.approx(scipys(turn).as_matrix(), abs=1e-13)


@given(vectors, vectors)
def test_product_is_one_turn_after_the_other(first, second):
    product = rotations.quaternion_product(quaternion(first), quaternion(second))
    expected = Rotation.from_rotvec(first) * Rotation.from_rotvec(second)
    assert rotations.quaternion_to_matrix(product) == pytest.approx(expected.as_matrix(), abs=1e-12)


@given(vectors, vectors, st.booleans())
def test_turn_between_leads_from_one_to_the_other_the_short_way(first, second, other_sign):
    start, end = quaternion(first), quaternion(2 * second)
    vector = rotations.turn_between(start, -end if other_sign else end)
    assert np.linalg.norm(vector) <= np.pi + 1e-12
    reached = rotations.quaternion_to_matrix(rotations.turned(start, vector))
    assert reached == pytest.approx(rotations.quaternion_to_matrix(end), abs=1e-10)


def test_about_z_turns_forward_to_the_left():
    forward = rotations.quaternion_to_matrix(rotations.about_z(np.array([0, np.pi / 2]))) @ [1.0, 0, 0]
    assert forward == pytest.approx(np.array([[1, 0, 0], [0, 1, 0]]), abs=1e-15)


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
