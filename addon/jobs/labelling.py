# SPDX-License-Identifier: GPL-3.0-or-later
"""A take from file to files, of blobs as of 3D points: named part by part, and written as a whole."""

from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import cached_property, partial
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..blendfile import Chunks, refuse_long, save_blend, save_played
from ..core.data.errors import InputError, of_file
from ..core.data.markersets import Worn
from ..core.data.progress import Progress, rising, within
from ..core.data.takes import MAX_FRAME, Blobs, EditOutcome, LabelledChunk, PointRows, Points, Suspect
from ..core.edits.applying import joined
from ..core.geometry.cameras import NO_CAMERAS, Cameras
from ..core.geometry.force_plates import NO_LAB, LabRecords
from ..core.pipelines.known_sets import known_worn, misfit_of, model_worn
from ..core.points.models import Model, chosen_method
from ..core.points.motion import labelled_points
from ..core.points.possible import MEND_MIRRORED, MEND_POINTS, Handedness, slow_words
from ..core.points.refusals import SubjectsError, UnsuitedError, refuse_two_groups
from ..core.points.several.wearers import SetsWorn, SeveralOptions, Wearer, kinds
from ..core.points.whole_take.mirrored import refuse_mirrored
from ..core.points.whole_take.pipeline import PointOptions
from ..core.points.whole_take.pipeline import label_take as name_points
from ..core.posing.finer import finer
from ..core.review.answering import doubtful_samples
from ..core.review.summary import SampleOrigins, TakeSummary
from ..core.review.suspects import Ranges
from ..core.review.take_trouble import TakeTrouble
from ..io.c3d.lab import read_lab
from ..io.c3d.reading import TrialFile
from ..io.edits import open_edits
from ..io.labels import POINT_KEYS, LabelWriter, facts_of_changes, point_keys
from ..io.markersets import AUTO_MODEL, builtin_markersets
from ..io.models import open_model
from ..io.points import FilePoints, holds_points, read_points, write_c3d, write_trc
from ..io.poses import PoseFile, is_long, refuse_keys
from ..io.provenance import REPORT, sealed
from ..io.report import facts_of_edits, facts_of_trouble, renumbered, take_report
from ..io.samples import TextHead
from ..io.scratch import scratch_folder
from ..io.source import digest
from ..io.tables import Room
from ..io.text import write_json
from ..version import version
from .job import MOTION_FILE, PAGE, LabelJob, Labelled, facts_of_capture, leftovers, open_files, timed
from .models import model_for

if TYPE_CHECKING:
    from ..core.filling.kept import KeptFill
    from ..core.filling.rays import MarkerRays
    from ..core.review.overview import TakeOverview


def facts_of_subjects(job: LabelJob, worn: SetsWorn, notes: list[str], in_room: bool) -> dict:
    """What a report says of who is in the take; `notes` it has, `in_room` as in `SeveralOptions`."""
    first = "stands first along a line across the room" if in_room else "is first in the file"
    return {
        "notes": [*notes, *(_alike(worn, first) if job.wearers else ())],
        "subjects": [
            {
                "name": one.name,
                "model": one.model.markerset.name,
                "model_version": one.model.history.version,
                "model_fingerprint": one.model.fingerprint,
            }
            for one in worn.subjects
        ],
    }


def _alike(worn: SetsWorn, who: str) -> list[str]:
    """Who cannot be told from whom by their models, a sentence for each model; `who` the first of them is."""
    notes, first_of = [], kinds(worn.subjects)
    for first in dict.fromkeys(first_of):
        names = [one.name for one, kind in zip(worn.subjects, first_of, strict=True) if kind is first]
        if len(names) > 1:
            words = f"{' and '.join(names)} wear the same model, which does not tell them apart"
            notes.append(f"{words}: {names[0]} is who {who}")
    return notes


TakePart = tuple[Blobs | PointRows, list[str], LabelledChunk, float]  # with the keys of its rows, and the part read


class OpenTake:
    """A take while it is labelled; `PointTake` and `BlobTake` say what is different.

    shown     reads the part of it that marker sets are found by, or more, as points; with how they may be turned, as
              `known_worn` has it
    read      opens the take, and gives what edits are checked by; InputError for what cannot be labelled
    name      names what is named of the whole take at once, and refuses what cannot be named
    parts     the named parts, in their order; they may be long where all of them are kept
    doubts    what the motion of a part shows, and the suspects that are about it
    end       what all of it shows: notes and suspects; ForceableError where it cannot be, as `check_sides` raises it
              where its markers are on the other sides of the body
    facts     what the report says beside what every report says
    points    the markers in space, then what stays unnamed of points
    keys      the columns that tell one row of its labels from another
    mend      what is expected of a take that is mirrored
    in_parts  whether it is named part by part, so that progress is told of the parts
    long      whether it has too many frames for keys; None where that shows only while it is read
    cameras   that saw it; none for points
    edits     those that the labels follow
    worn      whose markers are named, one set or those that several subjects wear; known once `name` has ended
    named_by  the same with only the joints that they are named by, which `worn` may have more than
    trial     for what else of its file goes into the named one; None where there is nothing, or it is not wanted
    """

    keys: tuple[str, ...]
    mend: str
    in_parts = False
    long: bool | None = None
    cameras: Cameras = NO_CAMERAS
    worn: Worn
    named_by: Worn
    trial: TrialFile | TextHead | None = None

    def __init__(self, job: LabelJob, models: dict[str, Model], stack: ExitStack, clock: dict[str, float]):
        self.job, self.stack, self.clock = job, stack, clock
        self.model, self.several = models[job.models[0]], None
        if job.several:
            if job.body is not None:
                raise InputError("a body of your own is one subject's; expected the bodies of the models", job.source)
            subjects = tuple(Wearer(name, models[worn]) for name, worn in job.wearers)
            self.several = SeveralOptions(subjects=subjects) if subjects else SeveralOptions(self.model, job.subjects)
        self.rate = job.frame_rate
        known = self.read()
        named = self.several.possible if self.several else self.model.markerset
        self.edits = open_edits(job.edits_applied, job.source, named, **known)

    @cached_property
    def lab(self) -> LabRecords:
        """What its file records beside points, which only somebody who sees the take looks at."""
        if isinstance(self.trial, TextHead):
            return LabRecords(0, self.trial.events)
        return NO_LAB if self.trial is None else read_lab(self.trial, self.rate)

    def rays(self) -> "MarkerRays | None":
        """Those of the markers that one camera alone sees; None where no camera is known."""
        return None


class PointTake(OpenTake):
    """A take of 3D points."""

    keys = POINT_KEYS

    @staticmethod
    def shown(job: LabelJob, stack: ExitStack) -> tuple[Points, dict[str, np.ndarray]]:
        """All of it."""
        take = _points_of(job, Room(stack))
        return take, take.turns

    def read(self) -> dict:
        """Reads all of it, and gives its trajectories and frames."""
        job, model, several = self.job, self.model, self.several
        self.room = Room(self.stack)
        self.take = take = _points_of(job, self.room)
        self.trial = None if job.plain else take.trial
        last = int(take.frames[-1])
        if last > MAX_FRAME:
            words = f"goes on to frame {last}; expected frame numbers up to {MAX_FRAME}"
            raise InputError(words, job.source)
        if job.blend:
            refuse_long(take.first_frame, last)
        if job.shown:
            refuse_keys(len(take.frames), several.at_least if several else model.markerset)
        self.rate, self.mend = take.rate, MEND_MIRRORED if job.mirror else MEND_POINTS
        self.method = chosen_method(model, job.method)
        # Of a part of a take nobody knows how long it is.
        return {"points": take.columns.tolist(), "frames": None if job.frames else (take.first_frame, last)}

    def name(self) -> Generator[Progress, None, None]:
        """Names all of it."""
        options = PointOptions(self.method, self.job.target, self.edits, self.room, self.job.force, finer=True)
        if self.several is None:
            try:
                self.labelled = yield from name_points(self.take, self.model, options)
            except SubjectsError:
                raise
            except UnsuitedError as error:
                raise (yield from self._misfit(error, options)) from None
            self.named_by, self.worn = self.model.markerset, finer(self.model.markerset)
        else:
            from ..core.points.several.pipeline import label_several

            with of_file(self.job.edits_file or self.job.source, InputError):
                self.labelled = yield from label_several(self.take, self.several, options)
            self.named_by, self.worn = self.labelled.worn, self.labelled.worn.finer
            if self.job.shown:
                refuse_keys(len(self.take.frames), self.worn)
        joints = sum(len(one.skeleton) for _, one in self.worn.worn)
        self.long = is_long(len(self.labelled.motion), len(self.worn.markers), joints)

    def _misfit(self, error: UnsuitedError, options: PointOptions) -> Generator[Progress, None, UnsuitedError]:
        """The error with its reason: another axis up, or another built-in marker set."""
        others = [open_model(name) for name in builtin_markersets() if name != self.model.markerset.name]
        return (yield from misfit_of(error, self.take, [self.model], options, self.take.turns, others))

    def parts(self, kept: bool) -> Iterator[TakePart]:
        """The named parts; one where they are kept: then all of it is in memory anyhow."""
        motion = self.labelled.motion
        for part in [slice(0, len(motion))] if kept else motion.parts():
            rows, chunk = self.labelled.part(self.take, part)
            yield rows, point_keys(rows), chunk, 1.0

    def doubts(self, _chunk: LabelledChunk) -> tuple[tuple[Suspect, ...], tuple[Suspect, ...]]:
        """What the motion shows, and all suspects."""
        return self.labelled.doubts, self.labelled.suspects

    def end(self, check_sides: Callable[[], None]) -> tuple[list[str], tuple[Suspect, ...]]:
        """Whether the take is mirrored, by its markers or its frames: nothing else is left to be noticed."""
        models = [self.model] if self.several is None else [one.model for one in self.named_by.subjects]
        by_frames = partial(refuse_mirrored, self.take, self.labelled.labels.marker, models, self.mend)
        return self.job.doubted(check_sides, by_frames), ()

    def facts(self, results: "Results") -> dict:
        """What the report of points says beside what every report says."""
        take, summary = self.take, results.summary
        facts = {"unit_assumed": take.assumed} if take.assumed else {}
        return facts | {
            "up_axis": take.up,
            "notes": [*take.notes, *filter(None, [slow_words(take.xyz, take.rate)])],
            "points": summary.rows,
            "trajectories": len(take.names),
            "method": self.method,
            "target": self.job.target,
            "steps": {step: count for step, count in summary.steps.items() if count},
            **facts_of_capture(self.job.source),
        }

    def points(self) -> Points:
        """The markers, then what stays unnamed."""
        return labelled_points(self.take, self.labelled, self.worn)


def _points_of(job: LabelJob, room: Room) -> FilePoints:
    return read_points(job.source, frames=job.frames, up=job.up, rate=job.rate, make_table=room, mirror=job.mirror)


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


class Results:
    """What becomes of a take, part by part; its files are open for as long as `stack` is.

    chunks    the parts, where the job keeps them; of a take that is too long for keys only where the job is asked to
    notes     what a person should know of the whole take
    outcomes  what became of the edits in each part
    """

    def __init__(self, job: LabelJob, take: OpenTake, labels: Path, stack: ExitStack):
        self.job, self.take = job, take
        worn = take.worn
        self.labels = stack.enter_context(LabelWriter(labels, worn.markers, take.keys))
        self.summary, self.handedness = TakeSummary(worn.markers), Handedness(take.named_by, take.mend)
        self.trouble = TakeTrouble(worn.markers, take.rate, take.edits, take.cameras, worn.by_name)
        self.origins = SampleOrigins(worn.markers, take.edits, worn.by_name)
        self.overview: TakeOverview | None = None
        if job.html:  # what the take's page is drawn from
            from ..core.review import overview

            self.overview = overview.TakeOverview(
                overview.OverviewSubject.of(worn), take.rate, take.cameras, take.edits
            )
        played = job.blend and take.long is not False
        self.poses = stack.enter_context(PoseFile(stack.enter_context(scratch_folder()))) if played else None
        self.kept = job.keep or (job.blend and not take.long)
        self.chunks: Chunks = []
        self.notes: list[str] = []
        self.outcomes: list[tuple[EditOutcome, ...]] = []
        self._doubtful = Ranges(len(worn.markers))

    def add(self, rows: Blobs | PointRows, chunk: LabelledChunk, read: float):
        """Adds the next part, after which the part `read` of the take was read."""
        self.summary.add(chunk)
        self.handedness.add(chunk.motion.markers)
        self.origins.add(rows, chunk)
        if self.overview is not None:
            self.overview.add(rows, chunk)
        self.trouble.add(rows, chunk.labels, chunk.motion)
        self._add_doubtful(rows, chunk)
        self.outcomes.append(chunk.outcomes)
        if self.poses is not None:
            self.poses.append(chunk.motion, 1.0 if self.job.frames else read)
            if self.poses.long and not self.job.keep:
                self.kept = False
                self.chunks.clear()
        if self.kept:
            self.chunks.append((rows, chunk))

    def _add_doubtful(self, rows: Blobs | PointRows, chunk: LabelledChunk):
        """Notes which samples are doubtful."""
        markers, frames = self.take.worn.markers, chunk.motion.frames
        edits, words = self.take.edits, self.take.worn.by_name
        doubtful = doubtful_samples(rows, chunk.labels, frames, *self.take.doubts(chunk), markers, edits, words)
        self._doubtful.add(frames, doubtful.T)

    def end(self, notes: list[str], suspects: tuple[Suspect, ...]):
        """Adds what shows at the end of the take."""
        self.notes += notes
        self.summary.suspects += suspects
        if self.chunks and suspects:
            rows, last = self.chunks[-1]
            self.chunks[-1] = (rows, replace(last, suspects=(*last.suspects, *suspects)))

    @property
    def played(self) -> PoseFile | None:
        """The poses of a take that is too long for keys, where a Blender file is wanted."""
        return self.poses if self.poses is not None and self.poses.long else None

    def _facts(self) -> dict:
        """What the report says of the take and of who is in it, beside what every report says."""
        facts = self.take.facts(self)
        if self.notes:
            facts["notes"] = [*facts.get("notes", []), *self.notes]
        if self.job.several:
            facts |= facts_of_subjects(self.job, self.take.worn, facts.get("notes", []), bool(len(self.take.cameras)))
        return facts

    def write(
        self,
        files: dict[str, Path],
        points: Points,
        of_gaps: dict,
        fills: "tuple[KeptFill, ...]",
        made_of: dict,
        clock: dict[str, float],
    ) -> dict:
        """Writes all files of a take but its labels, which are written part by part; gives the report.

        `points` are its markers once gaps are filled, and `of_gaps` what the report says of that.
        """
        job, take, rate, facts = self.job, self.take, points.rate, self._facts() | of_gaps
        with timed(clock, "write"):
            if self.played is not None:
                of_take = points, self.played, self.summary.suspects, take.cameras
                part = job.for_a_part(not len(take.cameras))
                save_played(files[".blend"], files[MOTION_FILE], job.source, take.worn, *of_take, part)
            elif job.blend:
                shown = self.chunks, take.cameras, take.edits, fills, take.lab
                save_blend(files[".blend"], job.source, rate, take.worn, *shown)
            changed = facts_of_changes(job.path(".labels.csv"), files[".labels.csv"], take.worn.markers)
            subjects = [] if job.plain else [name for name, _ in take.worn.worn if name]
            words = write_c3d(files[".c3d"], points, take.trial, subjects)
            if job.trc:
                write_trc(files[".trc"], points, take.trial)
            written = {ending: path for ending, path in files.items() if ending not in (PAGE, REPORT)}
            digests = {ending: digest(path) for ending, path in written.items() if path.exists()}
        markers, origins = take.worn.markers, self.origins.of_markers(of_gaps.get("filled", ()), None)
        report = take_report(self.summary, job.source.stem, take.worn.name, rate, version(), clock)
        report |= (
            {"model_version": take.model.history.version, "model_fingerprint": take.model.fingerprint}
            | {"first_frame": points.first_frame}
            | renumbered(points)
            | facts_of_edits(job.edits_file, joined(filter(None, self.outcomes)))
            | facts
            | facts_of_trouble(self.trouble, self.summary.suspects)  # in which gaps that were filled are no trouble
            | {"doubtful": {name: spans for at, name in enumerate(markers) if (spans := self._doubtful.spans(at))}}
            | changed
            | {"provenance": {**made_of, "results": digests, "markers": origins}}
        )
        if "points" in report:
            del report["blobs"]
        words += [f"{path.name} is not of this run, and stays as it is" for path in leftovers(job)]
        if words:
            report["notes"] = [*report.get("notes", []), *words]
        if self.overview is not None:
            from ..io.html.pages import write_take_page
            from .pages import today

            write_take_page(files[PAGE], report, self.overview, job.source.name, today())
            digests[PAGE] = digest(files[PAGE])
        report = sealed(report)
        write_json(files[REPORT], report)
        return report
