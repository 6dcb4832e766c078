# SPDX-License-Identifier: GPL-3.0-or-later
"""A labelled take as files of points have it, a column for each marker and each trajectory beside them, never whole.

Thousands of trajectories without a name would make an array that is nearly empty, and larger than memory.
"""

from collections.abc import Callable

import numpy as np

from .made import Made, Table, by_frames
from .takes import Points

# Of the frames from start to stop: frame from there on and column (N,) of what is beside markers, and values (N, …).
Beside = Callable[[slice], tuple[np.ndarray, np.ndarray, np.ndarray]]


class Columns(Made):
    """An array (T, C, …) of which some frames in a row, or one, can be had: markers, and what is beside them.

    markers (T, M, …), of which frames can be had likewise, are in the columns `own` (M,); `beside` tells what is in the
    others.
    """

    def __init__(self, markers: Table, own: np.ndarray, count: int, beside: Beside):
        self.markers, self.own, self.beside = markers, own, beside
        shape = (len(markers), count, *markers.shape[2:])
        super().__init__(shape, by_frames(shape[0], self._filled))

    def _filled(self, frames: slice) -> np.ndarray:
        found = np.full((frames.stop - frames.start, *self.shape[1:]), np.nan)
        found[:, self.own] = self.markers[frames]
        frame, column, values = self.beside(frames)
        found[frame, column] = values
        return found

    def with_markers(self, markers: np.ndarray) -> "Columns":
        """The same with other values (T, M, …) of the markers."""
        return Columns(markers, self.own, self.shape[1], self.beside)


def beside_of(take: Points, values: Table, column: np.ndarray, left: np.ndarray | None = None) -> Beside:
    """What trajectories of a take have of `values` (T, L, …), each in its column (P,), -1 for those left out.

    `left` (T, L) is True for the points that are meant; all that are there unless said.
    """
    standing = take.standing

    def beside(part: slice) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        frame, lane = np.nonzero(np.isfinite(take.xyz[part]).all(axis=2) if left is None else left[part])
        own = column[standing.at(frame + part.start, lane)]
        kept = own >= 0
        return frame[kept], own[kept], values[part][frame[kept], lane[kept]]

    return beside


def markers_in(columns: Table, count: int) -> np.ndarray:
    """(T, M, …) the first columns, which are `count` markers."""
    return columns.markers[:] if isinstance(columns, Columns) else columns[:, :count]
