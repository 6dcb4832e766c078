# SPDX-License-Identifier: GPL-3.0-or-later
"""What becomes of a take while it is labelled, and its files."""

from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from ..blendfile import Chunks, save_blend, save_played
from ..core.data.takes import Blobs, EditOutcome, LabelledChunk, PointRows, Points, Suspect
from ..core.edits.applying import joined
from ..core.points.possible import Handedness
from ..core.points.several.wearers import SetsWorn, kinds
from ..core.review.answering import doubtful_samples
from ..core.review.summary import SampleOrigins, TakeSummary
from ..core.review.suspects import Ranges
from ..core.review.take_trouble import TakeTrouble
from ..io.labels import LabelWriter, facts_of_changes
from ..io.points import write_c3d, write_trc
from ..io.poses import PoseFile
from ..io.provenance import REPORT, sealed
from ..io.report import facts_of_edits, facts_of_trouble, renumbered, take_report
from ..io.scratch import scratch_folder
from ..io.source import digest
from ..io.text import write_json
from ..version import version
from .job import MOTION_FILE, PAGE, LabelJob, leftovers, timed
from .open_take import OpenTake

if TYPE_CHECKING:
    from ..core.filling.kept import KeptFill
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
