# SPDX-License-Identifier: GPL-3.0-or-later
"""The volumes that four moving things span: on which side of three of them the fourth is."""

from itertools import combinations
from math import comb

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


class MedianVolumes:
    """The median signed volume of any four of G things in F frames, each worked out when it is first asked for.

    There are too many of all: with a hundred things four million in each frame.
    """

    def __init__(self, place: np.ndarray):
        """Of things at place (F, G, 3) m, NaN where not seen."""
        self._place = np.ascontiguousarray(np.moveaxis(place, 0, 2))
        self._known = np.full(comb(place.shape[1], 4), np.nan)

    def of(self, *corners: np.ndarray) -> np.ndarray:
        """(...) the volumes of four things each, whose numbers (...) are given; 0 where they were never seen together.

        And where one of the four is there twice.
        """
        four = np.stack(np.broadcast_arrays(*corners), axis=-1)
        order = np.argsort(four, axis=-1, kind="stable")
        ascending = np.take_along_axis(four, order, axis=-1)
        different = (np.diff(ascending, axis=-1) > 0).all(axis=-1)
        quads = ascending[different]
        number = _number(quads)
        new, first = np.unique(number[np.isnan(self._known[number])], return_index=True)
        if len(new):
            self._known[new] = median_volumes(self._place, quads[np.isnan(self._known[number])][first])
        volume = np.zeros(four.shape[:-1])
        volume[different] = self._known[number] * _sign(order[different])
        return volume


@stands_for(point_calls.median_volumes)
def median_volumes(place: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """(Q,) the median volumes of quads (Q, 4) of different things at place (G, 3, F) m; 0 where never together."""
    size = max(VOLUMES_AT_ONCE // max(place.shape[2], 1), 1)
    corners = np.moveaxis(place, 1, 2)
    parts = [
        _median(signed_volumes(*(corners[corner] for corner in quads[first : first + size].T)))
        for first in range(0, len(quads), size)
    ]
    return np.concatenate(parts)


def _median(values: np.ndarray) -> np.ndarray:
    """(Q,) the median of values (Q, F) that are not NaN, 0 where all are."""
    ascending = np.sort(values, axis=1)
    count = np.isfinite(ascending).sum(axis=1, keepdims=True)
    middle = np.maximum(np.concatenate([count - 1, count], axis=1) // 2, 0)
    found = np.take_along_axis(ascending, np.minimum(middle, values.shape[1] - 1), axis=1).mean(axis=1)
    return np.where(count[:, 0] > 0, found, 0.0)


def _number(quads: np.ndarray) -> np.ndarray:
    """(Q,) the place of ascending quads (Q, 4) in a list of all of them: the combinatorial number system."""
    a, b, c, d = quads.T
    return a + b * (b - 1) // 2 + c * (c - 1) * (c - 2) // 6 + d * (d - 1) * (d - 2) * (d - 3) // 24


def _sign(order: np.ndarray) -> np.ndarray:
    """(Q,) 1 for even permutations (Q, 4) and -1 for odd ones."""
    inversions = sum((order[:, one] > order[:, two]).astype(int) for one, two in combinations(range(4), 2))
    return 1 - 2 * (inversions % 2)
