# SPDX-License-Identifier: GPL-3.0-or-later
"""Unnamed 3D points from a file of unnamed blobs, as a `.c3d` or `.trc`; memory does not grow with the take."""

from collections import deque
from collections.abc import Generator, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ..blendfile import open_cameras
from ..core.data.errors import InputError, JobError
from ..core.data.progress import Progress
from ..core.data.takes import Blobs
from ..core.reconstruction.trajectories import reconstruct_take
from ..io.blobs import BlobRows, read_blobs
from ..io.cameras import calibration_files
from ..io.points import write_c3d, write_trc
from ..io.scratch import scratch_folder
from ..io.whole import whole_file
from .job import USUAL_RATE, facts_of_capture
from .labelling import renumbered
from .spool import TrajectoryFile

WRITERS = {".c3d": write_c3d, ".trc": write_trc}


@dataclass(frozen=True)
class RebuildJob:
    """What to reconstruct.

    source   the blob file
    cameras  the calibration
    out      the file to write, `.c3d` or `.trc`
    frames   first and last frame, both included, None for the take's own
    rate     frames a second, None where nobody knows
    up       the axis that points up in the calibration, None for what it says or tells
    """

    source: Path
    cameras: Path
    out: Path
    frames: tuple[int | None, int | None] | None = None
    rate: float | None = None
    overwrite: bool = False
    up: str | None = None


def rebuild_file(job: RebuildJob) -> Generator[Progress, None, dict]:
    """Writes the points of the take and gives what there is to say of them.

    Raises UserError with the file where it can be told.
    """
    begin = perf_counter()
    write = WRITERS.get(job.out.suffix.lower())
    if write is None:
        raise InputError("is no file of 3D points; expected a name that ends in .c3d or .trc", job.out)
    cameras = open_cameras(job.cameras, job.up)
    rate = USUAL_RATE if job.rate is None else job.rate
    blobs, used, squares, pixel = 0, 0, 0.0, float("nan")
    with ExitStack() as stack:
        target = stack.enter_context(whole_file(job.out, job.overwrite, [job.source, *calibration_files(job.cameras)]))
        spool = stack.enter_context(TrajectoryFile(stack.enter_context(scratch_folder()), rate))
        stack.enter_context(threadpool_limits(1, user_api="blas"))
        taken: deque[BlobRows] = deque()
        for part in reconstruct_take(_noted(read_blobs(job.source, cameras, job.frames), taken), cameras, rate):
            rows = taken.popleft()
            spool.add(part)
            blobs, used, pixel = blobs + len(rows.blobs), used + int(part.support.sum()), part.pixel
            squares += float((part.residual**2).sum())
            yield Progress(rows.fraction, f"frame {part.frames[-1]}")
        points = spool.points()
        if not points.names:
            raise JobError("no two cameras see the same point for long; expected blobs of these cameras", job.source)
        write(target, points)
    return {
        "take": job.source.stem,
        "out": str(job.out),
        "rate": rate,
        "rate_assumed": job.rate is None,
        "first_frame": points.first_frame,
        "frames": len(spool.counts),
        "trajectories": len(points.names),
        "points": spool.count,
        "blobs": blobs,
        "blobs_explained": used,
        "residual_mm": float(f"{1000 * np.sqrt(squares / max(spool.count, 1)):.4g}"),
        "noise_px": float(f"{pixel:.4g}"),
        **facts_of_capture(job.source, False, cameras),
        **({"calibration": list(cameras.remarks)} if cameras.remarks else {}),
        **(renumbered(points) if write is write_c3d else {}),
        "seconds": round(perf_counter() - begin, 3),
    }


def _noted(chunks: Iterator[BlobRows], taken: deque[BlobRows]) -> Iterator[Blobs]:
    for rows in chunks:
        taken.append(rows)
        yield rows.blobs
