# SPDX-License-Identifier: GPL-3.0-or-later
"""Rotations over any leading axes: rotation vectors, unit quaternions (w x y z) and matrices.

SciPy's `Rotation` costs tens of microseconds a call and works on one axis only; these sit in the innermost loop.
"""

import numpy as np

NO_TURN = 1e-8  # rad; below it a series' first terms stand for what would divide by the angle
CROSS_TABLE = np.array([[0.0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]])


def cross_matrix(vector: np.ndarray) -> np.ndarray:
    """(..., 3, 3) K with K @ u = vector × u: the skew matrix of the paper's equation 3."""
    return (vector @ CROSS_TABLE).reshape(*vector.shape, 3)


def exponential(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rotation of a rotation vector (..., 3) rad and its left Jacobian, both (..., 3, 3).

    exp(v + dv) = exp(J dv) exp(v) to first order (Rodrigues' formula and its integral).
    """
    square = np.einsum("...i,...i->...", vector, vector)
    angle = np.sqrt(square)
    safe = np.where(angle < NO_TURN, 1.0, angle)
    first = np.where(angle < NO_TURN, 1 - square / 6, np.sin(safe) / safe)
    second = np.where(angle < NO_TURN, 0.5, (1 - np.cos(safe)) / safe**2)
    third = np.where(angle < NO_TURN, 1 / 6, (safe - np.sin(safe)) / safe**3)
    skew = cross_matrix(vector)
    skew2 = skew @ skew
    identity = np.eye(3)
    rotation = identity + first[..., None, None] * skew + second[..., None, None] * skew2
    return rotation, identity + second[..., None, None] * skew + third[..., None, None] * skew2


def _matrix_table() -> np.ndarray:
    """(16, 9) turns the products of a quaternion's parts into its rotation matrix."""
    table = np.zeros((4, 4, 3, 3))
    table[0, 0] = np.eye(3)
    for axis in range(3):
        table[axis + 1, axis + 1] = -np.eye(3)
        table[axis + 1, axis + 1, axis, axis] = 1
        following, last = (axis + 1) % 3, (axis + 2) % 3
        table[following + 1, last + 1, following, last] = table[following + 1, last + 1, last, following] = 2
        table[0, axis + 1, last, following] = 2
        table[0, axis + 1, following, last] = -2
    return table.reshape(16, 9)


def _product_table() -> np.ndarray:
    """(16, 4) turns the products of two quaternions' parts into the parts of their product."""
    table = np.zeros((4, 4, 4))
    table[0, 0, 0] = 1
    for axis in range(1, 4):
        following, last = axis % 3 + 1, (axis + 1) % 3 + 1
        table[0, axis, axis] = table[axis, 0, axis] = 1
        table[axis, axis, 0] = -1
        table[axis, following, last] = 1
        table[following, axis, last] = -1
    return table.reshape(16, 4)


MATRIX_TABLE, PRODUCT_TABLE = _matrix_table(), _product_table()


def quaternion_to_matrix(quaternion: np.ndarray) -> np.ndarray:
    """(..., 3, 3) rotation of unit quaternions (..., 4) in the order w x y z."""
    parts = quaternion[..., :, None] * quaternion[..., None, :]
    shape = quaternion.shape[:-1]
    return (parts.reshape(*shape, 16) @ MATRIX_TABLE).reshape(*shape, 3, 3)


def carried(turn: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Rotations (..., 3, 3) applied to vectors (..., 3)."""
    return (turn @ vectors[..., None])[..., 0]


def quaternion_product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(..., 4) the turn `second` followed by the turn `first`."""
    parts = first[..., :, None] * second[..., None, :]
    return parts.reshape(*parts.shape[:-2], 16) @ PRODUCT_TABLE


def turned(quaternion: np.ndarray, vector: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) after a further turn by the rotation vector (..., 3), rad, in world axes."""
    product = quaternion_product(_quaternion_of(vector), quaternion)
    return product / np.sqrt(np.einsum("...i,...i->...", product, product))[..., None]


def turn_of(vector: np.ndarray) -> np.ndarray:
    """(..., 3, 3) the rotation of rotation vectors (..., 3) rad, without the Jacobian."""
    return quaternion_to_matrix(_quaternion_of(vector))


def _quaternion_of(vector: np.ndarray) -> np.ndarray:
    """(..., 4) unit quaternions of rotation vectors (..., 3) rad."""
    angle = np.sqrt(np.einsum("...i,...i->...", vector, vector))[..., None]
    turn = np.empty((*vector.shape[:-1], 4))
    turn[..., :1] = np.cos(angle / 2)
    turn[..., 1:] = np.sinc(angle / (2 * np.pi)) / 2 * vector
    return turn


def turn_between(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(..., 3) rotation vector, rad, world axes, that turns quaternion `start` into `end` the short way round."""
    return _vector_of(quaternion_product(end, start * np.array([1.0, -1, -1, -1])))


def _vector_of(quaternion: np.ndarray) -> np.ndarray:
    """(..., 3) rotation vectors, rad, of unit quaternions (..., 4), the short way round."""
    turn = np.where(quaternion[..., :1] < 0, -quaternion, quaternion)
    sine = np.sqrt(np.einsum("...i,...i->...", turn[..., 1:], turn[..., 1:]))[..., None]
    angle = 2 * np.arctan2(sine, turn[..., :1])
    return turn[..., 1:] * np.where(sine < NO_TURN, 2.0, angle / np.where(sine < NO_TURN, 1.0, sine))


def about_z(angle: np.ndarray) -> np.ndarray:
    """Unit quaternions (..., 4) of turns by `angle` (...) rad about the vertical."""
    angle = np.asarray(angle, dtype=float)
    zero = np.zeros_like(angle)
    return np.stack([np.cos(angle / 2), zero, zero, np.sin(angle / 2)], axis=-1)


def matrix_to_quaternion(matrix: np.ndarray) -> np.ndarray:
    """(..., 4) unit quaternions of rotations (..., 3, 3), w x y z; of each pair of opposite ones either.

    Every column of the sixteen products of a quaternion's parts is the quaternion times one part; the longest column
    is the surest (Bar-Itzhack 2000, for exact rotations).
    """
    products = (matrix.reshape(*matrix.shape[:-2], 9) @ PARTS_TABLE + PARTS_OF_NONE).reshape(*matrix.shape[:-2], 4, 4)
    longest = np.argmax(np.diagonal(products, axis1=-2, axis2=-1), axis=-1)
    column = np.take_along_axis(products, longest[..., None, None], axis=-1)[..., 0]
    return column / np.linalg.norm(column, axis=-1, keepdims=True)


def _parts_of(matrix: np.ndarray) -> np.ndarray:
    """(..., 4, 4) products of the parts of the quaternion, times four: the matrix's numbers, added to constants."""
    products = np.empty((*matrix.shape[:-2], 4, 4))
    trace = np.trace(matrix, axis1=-2, axis2=-1)
    products[..., 0, 0] = 1 + trace
    products[..., 1:, 1:] = matrix + matrix.swapaxes(-1, -2) + (1 - trace)[..., None, None] * np.eye(3)
    for axis in range(3):
        following, last = (axis + 1) % 3, (axis + 2) % 3
        turn = matrix[..., last, following] - matrix[..., following, last]
        products[..., 0, axis + 1] = products[..., axis + 1, 0] = turn
    return products


# (16,) the constants, and (9, 16) by which the nine numbers of a rotation become these products at once.
PARTS_OF_NONE = _parts_of(np.zeros((3, 3))).ravel()
PARTS_TABLE = _parts_of(np.eye(9).reshape(9, 3, 3)).reshape(9, 16) - PARTS_OF_NONE


def rotation_vector(matrix: np.ndarray) -> np.ndarray:
    """(..., 3) rotation vector, rad, of rotations (..., 3, 3); angles from 0 to π."""
    return _vector_of(matrix_to_quaternion(matrix))


def least_turn(start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """(..., 3, 3) the least turn that makes directions (..., 3) point as others do; none is least for half a turn."""
    start, end = (part / np.maximum(np.linalg.norm(part, axis=-1, keepdims=True), NO_TURN) for part in (start, end))
    cross, along = cross_matrix(np.cross(start, end)), np.einsum("...i,...i->...", start, end)[..., None, None]
    return np.eye(3) + cross + cross @ cross / np.maximum(1 + along, NO_TURN)
