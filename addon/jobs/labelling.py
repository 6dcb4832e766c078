# SPDX-License-Identifier: GPL-3.0-or-later
"""A take from file to files, of blobs as of 3D points: named part by part, and written as a whole."""

from collections.abc import Generator
from contextlib import ExitStack
from dataclasses import replace

from ..core.data.progress import Progress, rising, within
from ..core.geometry.force_plates import NO_LAB
from ..core.pipelines.known_sets import known_worn, model_worn
from ..core.points.refusals import SubjectsError, refuse_two_groups
from ..io.markersets import AUTO_MODEL, builtin_markersets
from ..io.models import open_model
from ..io.points import holds_points
from .job import LabelJob, Labelled, open_files, timed
from .models import model_for
from .open_take import OpenTake
from .points import PointTake
from .results import Results


def _kind_of(job: LabelJob) -> type[OpenTake]:
    """What opens the take; of blobs it takes long to load, and takes of points need none of it."""
    if holds_points(job.source, job.use):
        return PointTake
    from .blobs import BlobTake

    return BlobTake


def find_worn(job: LabelJob) -> Generator[Progress, None, tuple]:
    """What can be told of a take before it is labelled: known models that it may wear, if that is sure, if two wear it.

    There is one model where that is sure, else those of a user come first. Raises UserError where there is none.
    """
    with ExitStack() as read:
        take, turns = _kind_of(job).shown(job, read)
        known = {open_model(name): name for name in job.models}
        worn, likely = yield from known_worn(take, turns, known, job.force)
        if worn is None:
            return sorted(likely.values(), key=lambda name: name in builtin_markersets()), False, False
        try:
            refuse_two_groups(worn, take.xyz)
        except SubjectsError:
            return [likely[worn]], True, True
    return [likely[worn]], True, False


# Where its parts end in the whole of a labelling that has all of them: finding what is worn, and naming; assumed.
FINDING_ENDS, NAMING_ENDS = 0.4, 0.8


def label_take(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels the take, of whichever kind, and writes its files, which appear together or not at all.

    Memory does not grow with a take of blobs, unless its gaps are to be filled: that takes all frames.
    Raises UserError with the file where it can be told.
    """
    clock: dict[str, float] = {}
    begin, end = FINDING_ENDS if job.model == AUTO_MODEL else 0.0, NAMING_ENDS if job.fill else 1.0
    with ExitStack() as stack:
        inputs, files = open_files(job, stack)  # before they are read
        found: list[str] = []
        if job.model == AUTO_MODEL:
            with timed(clock, "load"), ExitStack() as read:
                shown = _kind_of(job).shown(job, read)
                known = {open_model(name): name for name in job.models}
                model, *found = yield from within(model_worn(*shown, known, job.force), 0.0, begin)
                inputs["model"] = [inputs["model"][job.models.index(model)]]
                job = replace(job, model=model)
        with timed(clock, "load"):
            models = {}
            for name in job.models:
                models[name] = yield from within(model_for(name, job.method), begin, begin)
            take = _kind_of(job)(job, models, stack, clock)
        yield from within(rising(take.name()), begin, end)
        results = Results(job, take, files[".labels.csv"], stack)
        results.notes += found
        for rows, keys, chunk, read in take.parts(results.kept):
            with timed(clock, "write"):
                results.labels.write(keys, chunk.labels)
            results.add(rows, chunk, read)
            if take.in_parts:
                yield Progress(begin + (end - begin) * read, f"frame {chunk.motion.frames[-1]}")
        with timed(clock, "label"):
            results.end(*take.end(results.handedness.refuse))
        results.labels.file.flush()
        points, of_gaps, fills = take.points(), {}, ()
        if job.fill:
            from .fill import fill_labelled

            with timed(clock, "fill"):
                listeners, rays = (results.overview, results.trouble), take.rays()
                given = points, take.worn, listeners, *(() if rays is None else (rays,))
                points, of_gaps, fills = yield from within(fill_labelled(*given), end, 1.0)
        report = results.write(files, points, of_gaps, fills, inputs, clock)
    chunks = results.chunks if job.keep else []
    return Labelled(report, take.worn, chunks, take.edits, job.models[0], take.lab if job.keep else NO_LAB)
