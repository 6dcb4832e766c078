# SPDX-License-Identifier: GPL-3.0-or-later
"""Rows on disk while a take is worked on, and trajectories among them as the columns of a file in the end."""

from pathlib import Path

import numpy as np

from ..core.data.lanes import Lanes
from ..core.data.made import Made, by_frames
from ..core.data.takes import Points
from ..core.reconstruction.trajectories import Reconstructed, TrajectorySpans
from ..io.scratch import RowFile

# How trajectories become the columns of a file.
# format: as many as one list of names in a C3D file holds; of more, those share one that are far apart
MAX_COLUMNS = 255
REST_S = 1.0  # s between two of one column, so that no program takes them for one; assumed


ROW = np.dtype([("trajectory", "<i4"), ("xyz", "<f4", 3), ("residual", "<f4")])


class TrajectoryFile(RowFile):
    """The points of a take, row after row in a scratch file; use it as a context manager."""

    def __init__(self, folder: Path, rate: float):
        super().__init__(folder, ROW)
        self.rate, self.first_frame = rate, 0
        self.counts: list[int] = []
        self.spans = TrajectorySpans()

    def add(self, part: Reconstructed):
        """Adds the frames of the next chunk."""
        if not self.counts:
            self.first_frame = int(part.frames[0])
        self.spans.note(part.trajectory, len(self.counts) + part.frame)
        rows = np.empty(len(part.points), ROW)
        rows["trajectory"], rows["xyz"], rows["residual"] = part.trajectory, part.points, part.residual
        self.append(rows)
        self.counts += np.bincount(part.frame, minlength=len(part.frames)).tolist()

    def points(self) -> Points:
        """The whole take, a trajectory a column, in the order in which they begin; read from disk part by part.

        Passing coincidences of rays are left out.
        """
        column = self._columns()
        width = int(column.max(initial=-1)) + 1
        starts = np.concatenate([[0], np.cumsum(self.counts)])
        rows = self.rows()
        xyz, residual = (_columns(rows, starts, column, width, field) for field in ("xyz", "residual"))
        return Points(("",) * width, xyz, residual, self.rate, self.first_frame)

    def _columns(self) -> np.ndarray:
        """The column of every trajectory, -1 for those that are left out."""
        column = np.full(len(self.spans.table), -1)
        kept = self.spans.lasting(len(self.counts))
        column[kept] = np.arange(len(kept))
        if len(kept) > MAX_COLUMNS:
            first, last = self.spans.table[kept, 1:].T
            column[kept] = Lanes.packed(first, last + round(REST_S * self.rate)).lane
        return column


def _columns(rows: np.ndarray, starts: np.ndarray, column: np.ndarray, width: int, field: str) -> Made:
    """One field of the rows as an array (T, P, …) of which slices and single frames can be had."""
    shape = (len(starts) - 1, width, *ROW[field].shape)

    def block(frames: slice) -> np.ndarray:
        own = rows[starts[frames.start] : starts[frames.stop]]
        frame = np.repeat(np.arange(frames.stop - frames.start), np.diff(starts[frames.start : frames.stop + 1]))
        found = np.full((frames.stop - frames.start, *shape[1:]), np.nan, np.float32)
        to = column[own["trajectory"]]
        found[frame[to >= 0], to[to >= 0]] = own[field][to >= 0]
        return found

    return Made(shape, by_frames(shape[0], block))
