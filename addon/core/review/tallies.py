# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a take added up chunk by chunk, by time and by size: memory does not grow with the take."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class OverviewOptions:
    """How finely a take is kept.

    columns  format: spans of time at most that a page shows, an even number; they get longer as the take does
    """

    columns: int = 1000


OVERVIEW = OverviewOptions()
# Edges of the classes of a histogram of lengths, mm or px, in which they grow by 6 %: as well are quantiles known.
LENGTH_EDGES = np.geomspace(1e-3, 1e4, 281)


class TimeBins:
    """Values (F, …) of frames one after the other, added up in so many columns of equal length at most.

    values  (columns, …), of which `used` hold something; width is how many frames a column is of
    """

    def __init__(self, *shape: int, columns: int = OVERVIEW.columns):
        self.width, self.frames = 1, 0
        self.values = np.zeros((columns, *shape))

    @property
    def used(self) -> int:
        """How many columns hold a frame."""
        return -(-self.frames // self.width)

    def add(self, values: np.ndarray):
        """Adds the next frames."""
        if not len(values):
            return
        while self.frames + len(values) > self.width * len(self.values):
            half = self.values[::2] + self.values[1::2]
            self.values[: len(half)], self.values[len(half) :] = half, 0
            self.width *= 2
        column = (self.frames + np.arange(len(values))) // self.width
        starts = np.flatnonzero(np.diff(column, prepend=-1))
        at = column[starts]
        self.values[at] += np.add.reduceat(values, starts, axis=0, dtype=float)
        self.frames += len(values)


class Lengths:
    """How values above zero are spread: in logarithmic classes, each of `of` kinds on its own."""

    def __init__(self, of: int = 1):
        self.counts = np.zeros((of, len(LENGTH_EDGES) - 1), np.int64)

    def add(self, values: np.ndarray, kind: np.ndarray | int = 0):
        """Adds values (N,), each of a kind; those that are not finite or not above zero are left out."""
        known = np.isfinite(values) & (values > 0)
        classes = np.searchsorted(LENGTH_EDGES[1:-1], values[known], side="right")
        kind = np.broadcast_to(kind, values.shape)[known]
        flat = np.bincount(kind * self.counts.shape[1] + classes, minlength=self.counts.size)
        self.counts += flat.reshape(self.counts.shape)

    def quantile(self, share: float, kind: int = 0) -> float:
        """The value below which a share of those of a kind lie; NaN where there are none."""
        counts = self.counts[kind]
        if not counts.any():
            return float("nan")
        place = min(int(np.searchsorted(np.cumsum(counts), share * counts.sum())), len(counts) - 1)
        return float(np.sqrt(LENGTH_EDGES[place] * LENGTH_EDGES[place + 1]))
