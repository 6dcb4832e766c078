# SPDX-License-Identifier: GPL-3.0-or-later
"""A calibration refined by a take of blobs, from file to file; memory does not grow with the take."""

from collections.abc import Generator
from dataclasses import dataclass
from pathlib import Path
from time import perf_counter

import numpy as np

from ..core.calibration.refining import Refinement, parts_of, refine_cameras
from ..core.data.errors import InputError, of_file
from ..core.data.progress import Progress, within
from ..core.data.takes import Blobs
from ..core.geometry.cameras import Cameras
from ..io.blobs import frames_in, read_blobs
from ..io.cameras import write_cameras
from ..io.markersets import markerset_file, open_markerset
from ..io.whole import whole_file
from .job import USUAL_RATE, RoomJob, facts_of_capture

READ = 0.1  # of the work, in its progress


@dataclass(frozen=True, kw_only=True)
class RefineJob(RoomJob):
    """What to refine; `out` is the `.toml` to write, and `frames` are what to go by."""

    source: Path  # the blob file
    model: str  # a built-in model's name or the path of one
    rate: float | None = None  # frames a second, None where nobody knows
    # write nothing where there is nothing to refine; else the cameras are written as they were
    if_refined: bool = False


def refine_file(job: RefineJob) -> Generator[Progress, None, tuple[dict, Cameras]]:
    """Writes the refined calibration, or the same one where there is nothing to refine.

    Gives what there is to say, and the cameras as they are written.
    Raises UserError with the file where that is known.
    """
    begin = perf_counter()
    if job.out.suffix.lower() != ".toml":
        raise InputError("is no file of a calibration that is written; expected a name that ends in .toml", job.out)
    cameras, files = job.opened()
    with whole_file(job.out, job.overwrite, [job.source, markerset_file(job.model), *files]) as target:
        markerset = open_markerset(job.model)
        rate = USUAL_RATE if job.rate is None else job.rate
        parts = yield from _read_parts(job, cameras)
        with of_file(job.source):
            work = refine_cameras(parts, cameras, markerset, rate)
            found = yield from within(work, READ, 1.0)
        if found.refined or not job.if_refined:
            write_cameras(target, found.cameras)
    return _report(job, found, rate, perf_counter() - begin), found.cameras


def _read_parts(job: RefineJob, cameras: Cameras) -> Generator[Progress, None, list[Blobs]]:
    """The parts of the take that are looked at; InputError for a file that is not sound."""
    ends = frames_in(job.source, cameras) or (0, 0)
    first, last = job.frames or (None, None)
    first = ends[0] if first is None else max(first, ends[0])
    last = ends[1] if last is None else min(last, ends[1])
    wanted = parts_of(first, max(first, last))
    chunks: list[list[Blobs]] = [[] for _ in wanted]
    for rows in read_blobs(job.source, cameras, job.frames):
        for part, frames in zip(chunks, wanted, strict=True):
            chunk = rows.blobs.between(*frames)
            if len(chunk.frames):
                part.append(chunk)
        yield Progress(READ * rows.fraction, f"read frame {rows.blobs.frames[-1]}")
    return [Blobs.join(part) for part in chunks if part]


def _report(job: RefineJob, found: Refinement, rate: float, seconds: float) -> dict:
    """What there is to say; errors in px, shifts in mm, turns in degrees."""
    return {
        "take": job.source.stem,
        "out": str(job.out),
        "rate": rate,
        "rate_assumed": job.rate is None,
        "refined": found.refined,
        "cameras": {
            name: {
                "before_px": _number(found.before[index]),
                "after_px": _number(found.after[index]),
                "blobs": int(found.blobs[index]),
                "shifted_mm": _number(1000 * found.shifted[index]),
                "turned_deg": _number(np.degrees(found.turned[index])),
            }
            for index, name in enumerate(found.cameras.names)
        },
        "camera_doubts": list(found.doubts),
        "frames_labelled": found.frames,
        "rounds": found.rounds,
        **facts_of_capture(job.source, found.cameras),
        "seconds": round(seconds, 3),
    }


def _number(value: float) -> float | None:
    """Three digits, as reports have them; None where nothing is known."""
    return float(f"{value:.3g}") if np.isfinite(value) else None
