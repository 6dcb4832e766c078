# SPDX-License-Identifier: GPL-3.0-or-later
"""The force on a plate and where it acts, of every kind, against one push that is known."""

import numpy as np
import pytest

from addon.core.geometry.force_plates import force_on_plate

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
