# SPDX-License-Identifier: GPL-3.0-or-later
"""The volumes that four moving things span: on which side of three of them the fourth is."""

from itertools import combinations, permutations

import numpy as np

from ...kernels import point_calls, stands_for

VOLUMES_AT_ONCE = 100_000  # volumes at once, of all frames together; small enough for the processor's own memory


def signed_volumes(one: np.ndarray, two: np.ndarray, three: np.ndarray, four: np.ndarray) -> np.ndarray:
    """(...) volumes of tetrahedra with corners (..., 3), in units of their sides; a mirror image has the other sign."""
    # Axis by axis: NumPy's own cross and norm take several times as long on vectors of three.
    corners = [np.moveaxis(corner, -1, 0) for corner in (one, two, three, four)]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (corner - corners[0] for corner in corners[1:])
    volume = (ay * bz - az * by) * cx + (az * bx - ax * bz) * cy + (ax * by - ay * bx) * cz
    sides = 1.0
    for start, end in combinations(corners, 2):
        along = end - start
        sides = sides * (along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
    return volume / np.sqrt(np.sqrt(np.maximum(sides, 1e-36)))


def quad_volumes(place: np.ndarray) -> np.ndarray:
    """(G + 1,) * 4 the median signed volumes of any four of G things at place (F, G, 3) m, NaN where not seen.

    0 where they were never seen together, where one of the four is there twice, and for -1, which is none.
    """
    quads = np.array(list(combinations(range(place.shape[1]), 4)), int).reshape(-1, 4)
    volume = median_volumes(np.ascontiguousarray(np.moveaxis(place, 0, 2)), quads)
    table = np.zeros((place.shape[1] + 1,) * 4)
    for order in permutations(range(4)):
        table[tuple(quads[:, order].T)] = np.linalg.det(np.eye(4)[list(order)]) * volume
    return table


@stands_for(point_calls.median_volumes)
def median_volumes(place: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """(Q,) the median volumes of quads (Q, 4) of different things at place (G, 3, F) m; 0 where never together."""
    size = max(VOLUMES_AT_ONCE // max(place.shape[2], 1), 1)
    corners = np.moveaxis(place, 1, 2)
    parts = [
        _median(signed_volumes(*(corners[corner] for corner in quads[first : first + size].T)))
        for first in range(0, len(quads), size)
    ]
    return np.concatenate([np.zeros(0), *parts])


def _median(values: np.ndarray) -> np.ndarray:
    """(Q,) the median of values (Q, F) that are not NaN, 0 where all are."""
    ascending = np.sort(values, axis=1)
    count = np.isfinite(ascending).sum(axis=1, keepdims=True)
    middle = np.maximum(np.concatenate([count - 1, count], axis=1) // 2, 0)
    found = np.take_along_axis(ascending, np.minimum(middle, values.shape[1] - 1), axis=1).mean(axis=1)
    return np.where(count[:, 0] > 0, found, 0.0)
