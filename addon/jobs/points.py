# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points, which is read and named as a whole."""

from collections.abc import Generator, Iterator
from contextlib import ExitStack

from ..blendfile import refuse_long
from ..core.data.errors import InputError
from ..core.data.progress import Progress
from ..core.data.takes import MAX_FRAME, LabelledChunk, Points, Suspect
from ..core.geometry.cameras import NO_CAMERAS
from ..core.points.handedness import MEND_MIRRORED, MEND_POINTS
from ..core.points.models import Model
from ..core.points.motion import labelled_points
from ..core.points.naming import chosen_method
from ..core.points.possible import slow_words
from ..core.points.several.wearers import SeveralOptions
from ..core.points.whole_take.pipeline import PointOptions, label_take
from ..io.edits import open_edits
from ..io.labels import POINT_KEYS, point_keys
from ..io.points import read_points
from ..io.poses import is_long, refuse_keys
from ..io.tables import Room
from .captures import facts_of_capture
from .job import LabelJob
from .labelling import Results, TakePart
from .several import label_subjects


class PointTake:
    """See `labelling.OpenTake`."""

    cameras, keys, in_parts = NO_CAMERAS, POINT_KEYS, False

    def __init__(
        self, job: LabelJob, model: Model, several: SeveralOptions | None, stack: ExitStack, _clock: dict[str, float]
    ):
        self.job, self.model, self.several = job, model, several
        room = Room(stack)
        self.read = take = read_points(
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
        self.edits = open_edits(job.edits_applied, job.source, named, **known)
        method = chosen_method(model, job.method)
        hints = job.options if method == "fit" else None
        self.options = PointOptions(method, job.target, hints, self.edits, room, job.force)
        self.rate, self.mend = take.rate, MEND_MIRRORED if job.mirror else MEND_POINTS

    def name(self) -> Generator[Progress, None, None]:
        """Names all of it."""
        if self.several is None:
            self.labelled = yield from label_take(self.read, self.model, self.options)
            self.worn = self.model.markerset
        else:
            self.labelled = yield from label_subjects(self.job, self.read, self.several, self.options)
            self.worn = self.labelled.worn
            if self.job.shown:
                refuse_keys(len(self.read.frames), self.worn)
        joints = sum(len(one.skeleton) for _, one in self.worn.worn)
        self.long = is_long(len(self.labelled.motion), len(self.worn.markers), joints)

    def parts(self, kept: bool) -> Iterator[TakePart]:
        """The named parts; one where they are kept: then all of it is in memory anyhow."""
        motion = self.labelled.motion
        for part in [slice(0, len(motion))] if kept else motion.parts():
            rows, chunk = self.labelled.part(self.read, part)
            yield rows, point_keys(rows), chunk, 1.0

    def doubts(self, _chunk: LabelledChunk) -> tuple[tuple[Suspect, ...], tuple[Suspect, ...]]:
        """What the motion shows, and all suspects."""
        return self.labelled.doubts, self.labelled.suspects

    def end(self) -> tuple[list[str], tuple[Suspect, ...], frozenset]:
        """Nothing is left to be noticed; some edits accept what the naming noticed."""
        return [], (), self.labelled.heard

    def facts(self, results: Results) -> dict:
        """What the report of points says beside what every report says."""
        take, summary = self.read, results.summary
        facts = {"unit_assumed": take.assumed} if take.assumed else {}
        return facts | {
            "up_axis": take.up,
            "notes": [*take.notes, *filter(None, [slow_words(take.xyz, take.rate)])],
            "points": summary.rows,
            "trajectories": len(take.names),
            "method": self.options.method,
            "target": self.options.target,
            "steps": {step: count for step, count in summary.steps.items() if count},
            **facts_of_capture(self.job.source, True),
        }

    def points(self) -> Points:
        """The markers, then what stays unnamed."""
        return labelled_points(self.read, self.labelled, self.worn)

    def rays(self):
        """No camera sees points."""
        from ..core.filling.rays import NO_RAYS

        return NO_RAYS
