# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points, which is read and named as a whole."""

from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from functools import partial

import numpy as np

from ..blendfile import refuse_long
from ..core.data.errors import InputError, of_file
from ..core.data.progress import Progress
from ..core.data.takes import MAX_FRAME, LabelledChunk, Points, Suspect
from ..core.pipelines.known_sets import misfit_of
from ..core.points.models import chosen_method
from ..core.points.motion import labelled_points
from ..core.points.possible import MEND_MIRRORED, MEND_POINTS, slow_words
from ..core.points.refusals import SubjectsError, UnsuitedError
from ..core.points.whole_take.mirrored import refuse_mirrored
from ..core.points.whole_take.pipeline import PointOptions
from ..core.points.whole_take.pipeline import label_take as name_points
from ..core.posing.finer import finer
from ..io.labels import POINT_KEYS, point_keys
from ..io.markersets import builtin_markersets
from ..io.models import open_model
from ..io.points import FilePoints, read_points
from ..io.poses import is_long, refuse_keys
from ..io.tables import Room
from .job import LabelJob, facts_of_capture
from .open_take import OpenTake, TakePart
from .results import Results


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


def _points_of(job: LabelJob, room: Room) -> FilePoints:
    return read_points(job.source, frames=job.frames, up=job.up, rate=job.rate, make_table=room, mirror=job.mirror)
