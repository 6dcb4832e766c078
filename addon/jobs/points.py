# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points, which is read and named as a whole."""

from collections.abc import Generator, Iterator

from ..blendfile import refuse_long
from ..core.data.errors import InputError
from ..core.data.progress import Progress
from ..core.data.takes import MAX_FRAME, LabelledChunk, Points, Suspect
from ..core.pipelines.misfits import misfit_of
from ..core.points.handedness import MEND_MIRRORED, MEND_POINTS
from ..core.points.motion import labelled_points
from ..core.points.naming import chosen_method
from ..core.points.possible import slow_words
from ..core.points.refusals import SubjectsError, UnsuitedError
from ..core.points.whole_take.pipeline import PointOptions, label_take
from ..io.labels import POINT_KEYS, point_keys
from ..io.markersets import builtin_markersets
from ..io.models import open_model
from ..io.points import read_points
from ..io.poses import is_long, refuse_keys
from ..io.tables import Room
from ..io.world import turns_from
from .job import facts_of_capture
from .labelling import OpenTake, Results, TakePart, label_subjects


class PointTake(OpenTake):
    """A take of 3D points."""

    keys = POINT_KEYS

    def read(self) -> dict:
        """Reads all of it, and gives its trajectories and frames."""
        job, model, several = self.job, self.model, self.several
        self.room = Room(self.stack)
        self.take = take = read_points(
            job.source, frames=job.frames, up=job.up, rate=job.rate, make_table=self.room, mirror=job.mirror
        )
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
        options = PointOptions(self.method, self.job.target, self.edits, self.room, self.job.force)
        if self.several is None:
            try:
                self.labelled = yield from label_take(self.take, self.model, options)
            except SubjectsError:
                raise
            except UnsuitedError as error:
                raise (yield from self._misfit(error, options)) from None
            self.worn = self.model.markerset
        else:
            self.labelled = yield from label_subjects(self.job, self.take, self.several, options)
            self.worn = self.labelled.worn
            if self.job.shown:
                refuse_keys(len(self.take.frames), self.worn)
        joints = sum(len(one.skeleton) for _, one in self.worn.worn)
        self.long = is_long(len(self.labelled.motion), len(self.worn.markers), joints)

    def _misfit(self, error: UnsuitedError, options: PointOptions) -> Generator[Progress, None, UnsuitedError]:
        """The error with its reason: another axis up, or another built-in marker set."""
        others = [open_model(name) for name in builtin_markersets() if name != self.model.markerset.name]
        return (yield from misfit_of(error, self.take, self.model, options, turns_from(self.take.up), others))

    def parts(self, kept: bool) -> Iterator[TakePart]:
        """The named parts; one where they are kept: then all of it is in memory anyhow."""
        motion = self.labelled.motion
        for part in [slice(0, len(motion))] if kept else motion.parts():
            rows, chunk = self.labelled.part(self.take, part)
            yield rows, point_keys(rows), chunk, 1.0

    def doubts(self, _chunk: LabelledChunk) -> tuple[tuple[Suspect, ...], tuple[Suspect, ...]]:
        """What the motion shows, and all suspects."""
        return self.labelled.doubts, self.labelled.suspects

    def end(self) -> tuple[list[str], tuple[Suspect, ...]]:
        """Nothing is left to be noticed."""
        return [], ()

    def facts(self, results: Results) -> dict:
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
