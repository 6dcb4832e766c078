# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points from file to files: read it, step through its labelling, write what came of it."""

from collections.abc import Generator
from contextlib import ExitStack

from ..blendfile import refuse_long
from ..core.data.errors import InputError
from ..core.data.markersets import Worn
from ..core.data.progress import Progress
from ..core.data.takes import MAX_FRAME
from ..core.edits.applying import unless_heard
from ..core.geometry.cameras import NO_CAMERAS
from ..core.points.handedness import MEND_MIRRORED, MEND_POINTS, Handedness
from ..core.points.motion import labelled_points
from ..core.points.naming import chosen_method
from ..core.points.possible import slow_words
from ..core.points.whole_take.pipeline import PointOptions, label_take
from ..core.review.doubtful import AskedNames, doubtful_of, doubtful_ranges
from ..core.review.summary import TakeSummary
from ..core.review.take_trouble import TakeTrouble
from ..io.edits import open_edits
from ..io.labels import POINT_KEYS, LabelWriter
from ..io.points import FilePoints, read_points
from ..io.poses import PoseFile, is_long, refuse_keys
from ..io.report import facts_of_trouble
from ..io.scratch import scratch_folder
from ..io.tables import Room
from .captures import facts_of_capture
from .job import LabelJob, Labelled, timed
from .models import model_for
from .outcome import Outcome, overview_of, write_take
from .resuming import open_files
from .several import facts_of_subjects, label_subjects, several_asked


def label_point_file(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels the take and writes its files, which appear together or not at all.

    Raises UserError with the file where it can be told.
    """
    clock: dict[str, float] = {}
    with ExitStack() as stack:
        inputs, files = open_files(job, stack)  # before they are read
        with timed(clock, "load"):
            model = yield from model_for(job.model, job.method)
            several = (yield from several_asked(job, model)) if job.several else None
            room = Room(stack)
            take = read_points(
                job.source, frames=job.frames, up=job.up, rate=job.rate, make_table=room, mirror=job.mirror
            )
            last = int(take.frames[-1])
            if last > MAX_FRAME:
                words = f"goes on to frame {last}; expected frame numbers up to {MAX_FRAME}"
                raise InputError(words, job.source)
            if job.blend:
                refuse_long(take.first_frame, last)
            if job.shown:
                refuse_keys(len(take.frames), several.at_least if several else model.markerset)
            # Of a part of a take nobody knows how long it is.
            known = {"points": take.columns.tolist(), "frames": None if job.frames else (take.first_frame, last)}
            named = several.possible if several else model.markerset
            edits = open_edits(job.edits_applied, job.source, named, **known)
            method = chosen_method(model, job.method)
            hints = job.options if method == "fit" else None
            options = PointOptions(method, job.target, hints, edits, room, job.force)
        if several is None:
            labelled = yield from label_take(take, model, options)
            markerset, motion = model.markerset, labelled.motion
        else:
            labelled = yield from label_subjects(job, take, several, options)
            markerset, motion = labelled.worn, labelled.motion
            if job.shown:
                refuse_keys(len(take.frames), markerset)
        overview = overview_of(job, markerset, take.rate, edits)
        handedness = Handedness(markerset, MEND_MIRRORED if job.mirror else MEND_POINTS)
        trouble = TakeTrouble(markerset.markers, take.rate, edits, words=markerset.by_name)
        summary, chunks, asked = TakeSummary(markerset.markers), [], []
        # Who keeps the take has all of it in memory anyhow.
        played = job.blend and is_long(len(motion), len(markerset.markers), _joints(markerset))
        kept = job.keep or (job.blend and not played)
        poses = stack.enter_context(PoseFile(stack.enter_context(scratch_folder()))) if played else None
        with LabelWriter(files[".labels.csv"], markerset.markers, POINT_KEYS) as writer:
            for part in [slice(0, len(motion))] if kept else motion.parts():
                rows, chunk = labelled.part(take, part)
                with timed(clock, "write"):
                    writer.write_points(rows, chunk.labels)
                summary.add(chunk)
                handedness.add(chunk.motion.markers)
                if poses is not None:
                    poses.append(chunk.motion)
                if overview is not None:
                    overview.add(rows, chunk)
                trouble.add(rows, chunk.labels, chunk.motion)
                asked.append(AskedNames.of(rows, chunk.labels, chunk.motion.residual.shape))
                chunks += [(rows, chunk)] if kept else []
        del rows, chunk
        forced = job.doubted(handedness.refuse)
        points = labelled_points(take, labelled, markerset)
        facts, fills = _facts(take, summary, options) | facts_of_capture(job.source, True), ()
        facts["notes"] += forced
        facts |= facts_of_subjects(job, markerset, facts.get("notes", [])) if several else {}
        if job.fill:
            from .fill import fill_labelled

            with timed(clock, "fill"):
                points, of_gaps, fills = yield from fill_labelled(points, markerset, (overview, trouble))
            facts |= of_gaps
        facts |= facts_of_trouble(trouble, labelled.suspects)
        said = labelled.doubts, labelled.suspects, markerset.markers, edits, markerset.by_name
        unsure = doubtful_of(AskedNames.join(asked), motion.frames, *said)
        facts["doubtful"] = doubtful_ranges(unsure, motion.frames, markerset.markers)
        heard = labelled.heard | trouble.accepted(labelled.suspects)
        said = unless_heard(labelled.outcomes, edits, heard), overview, fills, poses
        made = Outcome(markerset, points, chunks, NO_CAMERAS, summary, facts, inputs, edits, *said)
        report = write_take(job, files, model, made, clock)
    return Labelled(report, markerset, made.chunks if job.keep else [], edits)


def _joints(worn: Worn) -> int:
    """The joints of everybody."""
    return sum(len(one.skeleton) for _, one in worn.worn)


def _facts(take: FilePoints, summary: TakeSummary, options: PointOptions) -> dict:
    """What the report of points says beside what every report says."""
    facts = {"unit_assumed": take.assumed} if take.assumed else {}
    return facts | {
        "up_axis": take.up,
        "notes": [*take.notes, *filter(None, [slow_words(take.xyz, take.rate)])],
        "points": summary.rows,
        "trajectories": len(take.names),
        "method": options.method,
        "target": options.target,
        "steps": {step: count for step, count in summary.steps.items() if count},
    }
