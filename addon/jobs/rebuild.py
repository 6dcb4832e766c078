# SPDX-License-Identifier: GPL-3.0-or-later
"""Unnamed 3D points from a file of unnamed blobs, as a `.c3d` or `.trc`; memory does not grow with the take."""

from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import dataclass
from itertools import tee
from pathlib import Path
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ..core.data.errors import InputError, JobError
from ..core.data.lanes import Lanes
from ..core.data.made import Made, by_frames
from ..core.data.progress import Progress
from ..core.data.takes import Points
from ..core.reconstruction.trajectories import Reconstructed, TrajectorySpans, reconstruct_take
from ..io.blobs import read_blobs
from ..io.c3d.writing import MAX_POINTS
from ..io.points import write_c3d, write_trc
from ..io.report import renumbered
from ..io.scratch import scratch_folder
from ..io.tables import RowFile
from ..io.whole import whole_file
from .job import USUAL_RATE, RoomJob, facts_of_capture

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
        rows = np.empty(len(part.points), ROW)
        rows["trajectory"], rows["xyz"], rows["residual"] = part.trajectory, part.points, part.residual
        self.append(rows)
        self.spans.note(part.trajectory, len(self.counts) + part.frame)
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
            column[kept] = self.shared(kept, MAX_POINTS)
        return column

    def shared(self, kept: np.ndarray, most: int) -> np.ndarray:
        """(K,) columns of trajectories (K,) that share them REST_S apart, or less where there would be over `most`."""
        first, last = self.spans.table[kept, 1:].T
        rest = round(REST_S * self.rate)
        many = len(kept) > most
        while (column := Lanes.packed(first, last + rest, always=many).lane).max(initial=-1) >= most and rest:
            rest //= 2
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


WRITERS = {".c3d": write_c3d, ".trc": write_trc}


@dataclass(frozen=True, kw_only=True)
class RebuildJob(RoomJob):
    """What to reconstruct: the blob file, and frames a second, None where nobody knows; `out` is `.c3d` or `.trc`."""

    source: Path
    rate: float | None = None


def rebuild_file(job: RebuildJob) -> Generator[Progress, None, dict]:
    """Writes the points of the take and gives what there is to say of them.

    Raises UserError with the file where it can be told.
    """
    begin = perf_counter()
    write = WRITERS.get(job.out.suffix.lower())
    if write is None:
        raise InputError("is no file of 3D points; expected a name that ends in .c3d or .trc", job.out)
    cameras, files = job.opened()
    rate = USUAL_RATE if job.rate is None else job.rate
    blobs, sums, pixel = 0, np.zeros((2, 0)), float("nan")
    with ExitStack() as stack:
        target = stack.enter_context(whole_file(job.out, job.overwrite, [job.source, *files]))
        spool = stack.enter_context(TrajectoryFile(stack.enter_context(scratch_folder()), rate))
        stack.enter_context(threadpool_limits(1, user_api="blas"))
        chunks, read = tee(read_blobs(job.source, cameras, job.frames))
        parts = reconstruct_take((rows.blobs for rows in read), cameras, rate)
        for rows, part in zip(chunks, parts, strict=True):
            spool.add(part)
            blobs, sums, pixel = blobs + len(rows.blobs), _summed(sums, part, len(spool.spans.table)), part.pixel
            yield Progress(rows.fraction, f"frame {part.frames[-1]}")
        points = spool.points()
        if not points.names:
            raise JobError("no two cameras see the same point for long; expected blobs of these cameras", job.source)
        write(target, points)
    written = spool.spans.lasting(len(spool.counts))
    count, (used, squares) = int(spool.spans.table[written, 0].sum()), sums[:, written].sum(axis=1).tolist()
    return {
        "take": job.source.stem,
        "out": str(job.out),
        "rate": rate,
        "rate_assumed": job.rate is None,
        "first_frame": points.first_frame,
        "frames": len(spool.counts),
        "trajectories": len(points.names),
        "points": count,
        "blobs": blobs,
        "blobs_explained": int(used),
        "residual_mm": float(f"{1000 * np.sqrt(squares / count):.4g}"),
        "noise_px": float(f"{pixel:.4g}"),
        **facts_of_capture(job.source, cameras),
        **(renumbered(points) if write is write_c3d else {}),
        "seconds": round(perf_counter() - begin, 3),
    }


def _summed(sums: np.ndarray, part: Reconstructed, count: int) -> np.ndarray:
    """(2, N) how many blobs each of N trajectories has, and its squared residuals, m², up to a part and with it."""
    new = [np.bincount(part.trajectory, of, count) for of in (part.support, part.residual**2)]
    return np.pad(sums, ((0, 0), (0, count - sums.shape[1]))) + new
