# SPDX-License-Identifier: GPL-3.0-or-later
"""Two-point classifiers as bit masks: once a first marker has its point, which points are left for a second."""

from dataclasses import dataclass

import numpy as np

from .features import Tables
from .model import KIND_DISTANCE, KIND_HEIGHT, Classifiers

WORD = 64  # bits


TOLERANCE = 1e-9  # of closed intervals, m, rad or a pure number: their ends are in, whichever way a value was rounded


@dataclass(frozen=True)
class Bounds:
    """Intervals that a pair of points must keep: of their distance, and of the first's height over the second."""

    distance: tuple[float, float] | None = None
    height: tuple[float, float] | None = None

    @property
    def turned(self) -> "Bounds":
        """The same for the pair in the other order."""
        return Bounds(self.distance, None if self.height is None else (-self.height[1], -self.height[0]))


ANYTHING = Bounds()


def pair_bounds(classifiers: Classifiers) -> dict[tuple[int, int], Bounds]:
    """The intervals of every pair that a two-point classifier judges, in both orders."""
    found: dict[tuple[int, int], Bounds] = {}
    for row in np.flatnonzero(np.isin(classifiers.kind, (KIND_DISTANCE, KIND_HEIGHT))):
        pair = (int(classifiers.points[row, 0]), int(classifiers.points[row, 1]))
        before = found.get(pair, ANYTHING)
        interval = (float(classifiers.low[row]), float(classifiers.high[row]))
        is_distance = classifiers.kind[row] == KIND_DISTANCE
        bounds = Bounds(interval, before.height) if is_distance else Bounds(before.distance, interval)
        found[pair], found[pair[::-1]] = bounds, bounds.turned
    return found


class Masks:
    """The bit masks of T clouds of P points, W words each; made when first asked for, shared by all solvers.

    everyone (T, W) the points that are there; bit (P, W) each point's own bit
    """

    def __init__(self, clouds: Tables):
        self.clouds = clouds
        self.points = clouds.present.shape[1]
        self.words = max(-(-self.points // WORD), 1)
        self.everyone = self.packed(clouds.present)
        self.bit = self.packed(np.eye(self.points, dtype=bool))
        self._made: dict[Bounds, tuple[np.ndarray, float]] = {}

    def allowed(self, bounds: Bounds) -> np.ndarray:
        """(T, P, W) for each point as the first of a pair, the points that `bounds` allow as the second."""
        return self._entry(bounds)[0]

    def fill(self, bounds: Bounds) -> float:
        """Mean share of the points that stay allowed: the smaller, the earlier this pair is worth a look."""
        return self._entry(bounds)[1]

    def _entry(self, bounds: Bounds) -> tuple[np.ndarray, float]:
        if bounds not in self._made:
            inside = np.ones(self.clouds.distance.shape, dtype=bool)
            with np.errstate(invalid="ignore"):
                for table, interval in ((self.clouds.distance, bounds.distance), (self.clouds.height, bounds.height)):
                    if interval is not None:
                        inside &= (table >= interval[0] - TOLERANCE) & (table <= interval[1] + TOLERANCE)
            self._made[bounds] = self.packed(inside), float(inside.mean()) if inside.size else 0.0
        return self._made[bounds]

    def packed(self, flags: np.ndarray) -> np.ndarray:
        """Flags (..., P) as whole words (..., W), the first point in the lowest bit."""
        octets = np.packbits(flags, axis=-1, bitorder="little")
        padded = np.zeros((*octets.shape[:-1], self.words * WORD // 8), dtype=np.uint8)
        padded[..., : octets.shape[-1]] = octets
        return padded.view("<u8")
