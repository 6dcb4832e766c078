# SPDX-License-Identifier: GPL-3.0-or-later
"""Values of a take added up chunk by chunk, by time and by size: memory does not grow with the take."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True)
class OverviewOptions:
    """How finely a take is kept.

    columns      format: spans of time at most that a page shows, an even number; they get longer as the take does
    per_decade   format: classes of a histogram in which a value grows tenfold: its quantiles are known to 6 %
    least        format: the smallest length that is distinguished from others, mm or px, and
    decades      format: in which all lengths are
    at_once      memory: frames whose markers are projected into all cameras at a time
    """

    columns: int = 1000
    per_decade: int = 40
    least: float = 0.001
    decades: int = 7
    at_once: int = 500


OVERVIEW = OverviewOptions()


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
        self.counts = np.zeros((of, OVERVIEW.decades * OVERVIEW.per_decade), np.int64)

    def add(self, values: np.ndarray, kind: np.ndarray | int = 0):
        """Adds values (N,), each of a kind; those that are not finite or not above zero are left out."""
        known = np.isfinite(values) & (values > 0)
        classes = np.floor(OVERVIEW.per_decade * np.log10(values[known] / OVERVIEW.least)).astype(int)
        classes = np.clip(classes, 0, self.counts.shape[1] - 1)
        kind = np.broadcast_to(kind, values.shape)[known]
        flat = np.bincount(kind * self.counts.shape[1] + classes, minlength=self.counts.size)
        self.counts += flat.reshape(self.counts.shape)

    def quantile(self, share: float, kind: int = 0) -> float:
        """The value below which a share of those of a kind lie; NaN where there are none."""
        counts = self.counts[kind]
        if not counts.any():
            return float("nan")
        place = int(np.searchsorted(np.cumsum(counts), share * counts.sum()))
        return float(OVERVIEW.least * 10 ** ((min(place, len(counts) - 1) + 0.5) / OVERVIEW.per_decade))
