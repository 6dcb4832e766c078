# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points from file to files: read it, step through its labelling, write what came of it."""

from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from ..blendfile import save_blend
from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.models import Model
from ..core.data.progress import Progress
from ..core.data.takes import STEPS, LabelledChunk, Labels, PointRows, Points
from ..core.geometry.cameras import NO_CAMERAS
from ..core.pipelines.points import PointOptions, label_points
from ..core.points.naming import chosen_method
from ..core.review.summary import TakeSummary
from ..io.labels import write_point_labels
from ..io.models import open_model
from ..io.points import FilePoints, read_points
from .job import LabelJob, Labelled, finish_report, open_files, timed, write_points

NAMED = 0.95  # of the work is naming; the rest is writing


def label_point_file(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels the take and writes its files, which appear together or not at all.

    Raises UserError with the file where it can be told.
    """
    clock: dict[str, float] = {}
    with timed(clock, "load"):
        model = open_model(job.model)
        take = _of_frames(read_points(job.source), job.frames)
        method = chosen_method(model, job.method)
    with ExitStack() as stack:
        files = open_files(job, stack)
        labelled = yield from _scaled(label_points(take, model, PointOptions(method, job.target, job.options)))
        yield Progress(NAMED, "write")
        rows = PointRows.of(take)
        given = labelled.labels[np.nonzero(take.present)]
        with timed(clock, "write"):
            write_point_labels(files[".labels.csv"], rows, given, model.markerset.markers)
            more = write_points(labelled_take(take, labelled, model.markerset), files)
            shown = replace(labelled, labels=given)
            if job.blend:
                save_blend(files[".blend"], job.source, take.rate, model.markerset, [(rows, shown)], NO_CAMERAS)
        more |= _facts(take, given, method, job)
        report = finish_report(
            job, _summary(labelled, given, model), model.markerset.name, take.rate, clock, files, more
        )
    return Labelled(report, [(rows, shown)] if job.keep else [])


def _scaled(steps: Generator[Progress, None, LabelledChunk]) -> Generator[Progress, None, LabelledChunk]:
    """The same steps as a part of the whole job."""
    while True:
        try:
            step = next(steps)
        except StopIteration as end:
            return end.value
        yield Progress(NAMED * step.fraction, step.note)


def _of_frames(take: FilePoints, frames: tuple[int | None, int | None] | None) -> FilePoints:
    """The take's frames from A to B, both included."""
    first, last = frames or (None, None)
    start = 0 if first is None else max(first - take.first_frame, 0)
    stop = len(take.xyz) if last is None else max(last - take.first_frame + 1, 0)
    part = slice(start, stop)
    if not np.isfinite(take.xyz[part]).any():
        raise InputError("has no point that is present in these frames; expected frames with markers")
    return replace(take, xyz=take.xyz[part], residual=take.residual[part], first_frame=take.first_frame + start)


def labelled_take(take: Points, labelled: LabelledChunk, markerset: MarkerSet) -> Points:
    """The model's markers in its order, then what stays unlabelled."""
    motion = labelled.motion
    left = take.present & ~labelled.labels.named
    columns = np.flatnonzero(left.any(axis=0))
    rest = np.where(left[:, columns, None], take.xyz[:, columns], np.nan)
    residual = np.where(left[:, columns], take.residual[:, columns], np.nan)
    names = (*markerset.markers, *[""] * len(columns))
    xyz = np.concatenate([motion.markers, rest], axis=1)
    return Points(names, xyz, np.concatenate([motion.residual, residual], axis=1), take.rate, take.first_frame)


def _summary(labelled: LabelledChunk, given: Labels, model: Model) -> TakeSummary:
    summary = TakeSummary(model.markerset.markers)
    summary.add(replace(labelled, labels=given))
    return summary


def _facts(take: FilePoints, given: Labels, method: str, job: LabelJob) -> dict:
    """What the report of points says beside what every report says."""
    steps = np.bincount(given.step, minlength=len(STEPS))
    facts = {"unit_assumed": take.assumed} if take.assumed else {}
    return facts | {
        "points": len(given.marker),
        "trajectories": take.xyz.shape[1],
        "method": method,
        "target": job.target,
        "steps": {step: int(count) for step, count in zip(STEPS, steps, strict=True) if step and count},
    }
