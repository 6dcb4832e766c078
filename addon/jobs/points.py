# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points from file to files: read it, step through its labelling, write what came of it."""

from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import replace

import numpy as np

from ..blendfile import refuse_long
from ..core.data.errors import InputError
from ..core.data.progress import Progress
from ..core.data.takes import MAX_FRAME, STEPS, Labels, PointRows
from ..core.geometry.cameras import NO_CAMERAS
from ..core.points.motion import labelled_points
from ..core.points.naming import chosen_method
from ..core.points.whole_take.pipeline import PointOptions, label_points
from ..core.review.doubtful import doubtful_ranges, doubtful_samples
from ..core.review.overview import OverviewSubject, TakeOverview
from ..core.review.summary import TakeSummary
from ..core.review.trouble import TakeTrouble
from ..io.edits import open_edits
from ..io.models import open_model
from ..io.points import FilePoints, read_points
from ..io.report import facts_of_trouble
from .fill import fill_labelled
from .job import LabelJob, Labelled, timed
from .outcome import Outcome, write_take
from .resuming import open_files


def label_point_file(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels the take and writes its files, which appear together or not at all.

    Raises UserError with the file where it can be told.
    """
    clock: dict[str, float] = {}
    with ExitStack() as stack:
        inputs, files = open_files(job, stack)  # before they are read
        with timed(clock, "load"):
            model, take = open_model(job.model), read_points(job.source, frames=job.frames, up=job.up, rate=job.rate)
            last = int(take.frames[-1])
            if last > MAX_FRAME:
                words = f"goes on to frame {last}; expected frame numbers up to {MAX_FRAME}"
                raise InputError(words, job.source)
            if job.blend:
                refuse_long(take.first_frame, last)
            # Of a part of a take nobody knows how long it is.
            known = {"points": take.columns.tolist(), "frames": None if job.frames else (take.first_frame, last)}
            edits = open_edits(job.edits_applied, job.source, model.markerset, **known)
            options = PointOptions(chosen_method(model, job.method), job.target, job.options, edits)
        labelled = yield from label_points(take, model, options)
        rows, markerset = PointRows.of(take), model.markerset
        present = np.nonzero(take.present)
        unedited = None if labelled.unedited is None else labelled.unedited[present]
        chunk = replace(labelled, labels=labelled.labels[present], unedited=unedited)
        summary = TakeSummary(markerset.markers)
        summary.add(chunk)
        overview = TakeOverview(OverviewSubject.of(markerset), take.rate, edits=edits) if job.html else None
        if overview is not None:
            overview.add(rows, chunk)
        points = labelled_points(take, labelled, markerset)
        facts = _facts(take, chunk.labels, options)
        trouble = TakeTrouble(markerset.markers, take.rate, edits, words=markerset.by_name)
        trouble.add(rows, chunk.labels, chunk.motion)
        fills = ()
        if job.fill:
            with timed(clock, "fill"):
                points, of_gaps, fills = yield from fill_labelled(points, markerset, (overview, trouble))
            facts |= of_gaps
        facts |= facts_of_trouble(trouble, chunk.suspects)
        asked = doubtful_samples(
            rows, chunk.labels, chunk.motion, chunk.suspects, markerset.markers, take.rate, edits, markerset.by_name
        )
        facts["doubtful"] = doubtful_ranges(asked, chunk.motion.frames, markerset.markers)
        said = labelled.outcomes, overview, fills
        made = Outcome(points, [(rows, chunk)], NO_CAMERAS, summary, facts, inputs, edits, *said)
        report = write_take(job, files, markerset, made, clock)
    return Labelled(report, made.chunks if job.keep else [], edits)


def _facts(take: FilePoints, given: Labels, options: PointOptions) -> dict:
    """What the report of points says beside what every report says."""
    steps = np.bincount(given.step, minlength=len(STEPS))
    facts = {"unit_assumed": take.assumed} if take.assumed else {}
    return facts | {
        "up_axis": take.up,
        "notes": list(take.notes),
        "points": len(given.marker),
        "trajectories": take.xyz.shape[1],
        "method": options.method,
        "target": options.target,
        "steps": {step: int(count) for step, count in zip(STEPS, steps, strict=True) if step and count},
    }
