# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of blobs, which is read and named chunk by chunk."""

from collections import deque
from collections.abc import Callable, Generator, Iterator
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from itertools import chain, tee
from typing import TYPE_CHECKING

import numpy as np

from ..blendfile import mesh_occlusion, open_cameras, refuse_long
from ..core.data.errors import InputError, of_file
from ..core.data.progress import Progress
from ..core.data.takes import BY_EDIT, STEPS, Blobs, LabelledChunk, Points, Suspect
from ..core.edits.blob_tracks import followed
from ..core.edits.kinds import Edits
from ..core.geometry.cameras import Cameras
from ..core.papers.virtual_occlusions.occlusion import Occlusion
from ..core.pipelines.blobs import BlobOptions, blob_method, label_blobs, steps_of, with_edits
from ..core.pipelines.known_sets import TRIED_S
from ..core.pipelines.others import OtherSubjects, refuse_two
from ..core.pipelines.through_points import PointsOfBlobs
from ..core.points.models import chosen_method
from ..core.points.possible import MEND_BLOBS, refuse_impossible
from ..core.points.several.together import FinerBodies
from ..core.points.whole_take.pipeline import PointOptions
from ..core.posing.finer import finer
from ..core.review.answering import without_accepted
from ..core.review.odd_cameras import CameraCheck
from ..core.review.suspects import find_suspects
from ..io.blobs import BlobRows, frames_in, read_blobs
from ..io.labels import BLOB_KEYS
from ..io.points import Frames
from ..io.poses import refuse_keys
from ..io.report import facts_of_cameras
from ..io.scratch import scratch_folder
from ..io.tables import Room, RowFile
from .job import LabelJob, facts_of_capture, timed
from .open_take import OpenTake, TakePart
from .results import Results

if TYPE_CHECKING:  # only who fills gaps needs it
    from ..core.filling.rays import MarkerRays
    from ..core.pipelines.followed_together import FollowedTogether
    from ..core.pipelines.several_through_points import SubjectsInImages


def _cameras_of(job: LabelJob) -> Cameras:
    return job.cameras if isinstance(job.cameras, Cameras) else open_cameras(job.cameras, job.up)


class BlobTake(OpenTake):
    """A take of blobs; memory does not grow with it."""

    keys, mend = BLOB_KEYS, MEND_BLOBS

    @staticmethod
    def shown(job: LabelJob, _stack: ExitStack) -> tuple[Points, None]:
        """The points that the blobs around its middle make; JobError where they make none."""
        cameras = _cameras_of(job)
        wanted, ends = job.frames or (None, None), frames_in(job.source, cameras) or (None, None)
        ends = [end if own is None else own for own, end in zip(wanted, ends, strict=True)]
        if None not in ends:
            middle, half = sum(ends) // 2, max(round(TRIED_S * job.frame_rate / 2), 1)
            ends = [max(ends[0], middle - half), min(ends[1], middle + half)]
        points = PointsOfBlobs(cameras, job.frame_rate)
        for rows in read_blobs(job.source, cameras, tuple(ends)):
            points.add(rows.blobs)
        return points.take(), None

    def read(self) -> dict:
        """Reads the cameras, and gives them; of a take that is edited its frames, too, where these are known."""
        job = self.job
        self.cameras = _cameras_of(job)
        self.in_parts = self.several is None
        self.taken: deque[BlobRows] = deque()  # that went into the labelling and did not come out yet
        self._rays: list[tuple[int, MarkerRays]] = []  # by chunk, each with the index of its first frame
        frames = frames_in(job.source, self.cameras) if job.edits_applied and not job.frames else None
        return {"cameras": self.cameras.names, "frames": frames}

    def name(self) -> Generator[Progress, None, None]:
        """Begins to name one subject, or finds all who are there."""
        job, cameras, model = self.job, self.cameras, self.model
        self.edits = self._tracked()
        # Whoever corrected names, or wants them regardless, has seen who is in the take.
        known = bool(self.several or self.edits or job.force)
        self.others = None if known else OtherSubjects(cameras, model)
        blobs = self._blobs()
        if self.others is not None:
            yield Progress(0.0, "look how many there are")
            begun = next(blobs)
            with timed(self.clock, "load"):
                refuse_two(begun, partial(self._read, job.frames), cameras, model)
            blobs = chain([begun], blobs)
        if self.several is None:
            given = job.hints, self._occlusion(), self.edits, job.force
            settings = BlobOptions(self.rate, job.method, job.target, *given)
            self.work = label_blobs(blobs, cameras, model, settings)
            self.method, self.named_by, more = blob_method(settings), model.markerset, finer(model.markerset)
            self.check = CameraCheck(cameras, self.named_by)
        else:
            seen = yield from self._subjects()
            self.method, self.named_by, more = "likelihood", seen.worn, seen.worn.finer
            own, read = tee(blobs)
            self.work = seen.chunks(read)
            if self.edits:
                self.work = with_edits(own, self.work, self.edits, cameras, self.named_by)
            self.check = CameraCheck(cameras)
        self.worn = more if job.blend or job.keep else self.named_by  # else nobody sees the body
        self.bodies = FinerBodies(self.named_by, self.worn)
        count = len(self.worn.markers)
        row = np.dtype([("xyz", "<f4", (count, 3)), ("residual", "<f4", (count,))])
        self.motion = self.stack.enter_context(RowFile(self.stack.enter_context(scratch_folder()), row))

    def parts(self, _kept: bool) -> Iterator[TakePart]:
        """The named chunks; JobError once they are too many frames for what is made of them."""
        for chunk in self.work:
            rows = self.taken.popleft()
            frames = rows.blobs.frames
            if not self.motion.count:
                self.first_frame = int(frames[0])
            first = self.first_frame
            with timed(self.clock, "write"):
                self._keep(rows.blobs, chunk)
            if self.job.blend:
                refuse_long(first, int(frames[-1]))
            if self.job.shown:
                refuse_keys(int(frames[-1]) - first + 1, self.worn, 0.0 if self.job.frames else rows.fraction)
            self.check.add(rows.blobs, chunk.labels.marker, chunk.motion.expected)
            if self.others is not None:
                self.others.add(rows.blobs, chunk)
            if self.worn is not self.named_by:
                with timed(self.clock, "fit"):
                    chunk = replace(chunk, motion=self.bodies.of(chunk.motion))
            yield rows.blobs, rows.keys, chunk, rows.fraction

    def doubts(self, chunk: LabelledChunk) -> tuple[tuple[Suspect, ...], tuple[Suspect, ...]]:
        """What the motion of the chunk shows, and its suspects."""
        return find_suspects(chunk.motion, self.worn.markers, self.rate), chunk.suspects

    def end(self, check_sides: Callable[[], None]) -> tuple[list[str], tuple[Suspect, ...]]:
        """What is wrong with cameras, rate and sides; JobError where two subjects are there."""
        if self.others is not None:
            self.others.refuse()
        self.noticed = without_accepted(self.check.suspects(), self.edits)
        notes = self.job.doubted(self.check.refuse) if self.noticed else []
        if self.several is None:  # else they were looked at before
            found = self.points().xyz
            notes += self.job.doubted(partial(refuse_impossible, found, self.rate, None, [self.model]))
        return notes + self.job.doubted(check_sides), self.noticed

    def facts(self, results: Results) -> dict:
        """What the report of blobs says beside what every report says."""
        facts: dict = {"method": self.method, "occlusion": self.job.casts, "rate_assumed": self.job.rate is None}
        steps = steps_of(self.method, self.several is not None)
        words = [STEPS[step] for step in (*steps, *([BY_EDIT] if any(results.outcomes) else []))]
        facts["steps"] = {step: results.summary.steps[step] for step in words}
        facts |= facts_of_capture(self.job.source, self.cameras)
        return facts | facts_of_cameras(self.check, results.trouble, self.noticed)

    def points(self) -> Points:
        """The markers, read from disk where they are looked at."""
        rows = self.motion.rows()
        return Points(self.worn.markers, rows["xyz"], rows["residual"], self.rate, self.first_frame)

    def rays(self) -> "MarkerRays":
        """Those of the markers that one camera alone sees."""
        from ..core.filling.rays import MarkerRays

        return MarkerRays.join(self._rays)

    def _blobs(self) -> Iterator[Blobs]:
        """The chunks of the file, with each row's own text kept until its labels come back."""
        chunks = read_blobs(self.job.source, self.cameras, self.job.frames)
        while True:
            with timed(self.clock, "load"):
                rows = next(chunks, None)
            if rows is None:
                return
            self.taken.append(rows)
            yield rows.blobs

    def _read(self, frames: Frames) -> Iterator[Blobs]:
        """The chunks of some frames of the file, to be looked at before they are labelled."""
        return (rows.blobs for rows in read_blobs(self.job.source, self.cameras, frames))

    def _subjects(self) -> "Generator[Progress, None, FollowedTogether | SubjectsInImages]":
        """Who is there, by their bodies or the points that blobs make; InputError where edits are of who is not."""
        from ..core.pipelines.several_through_points import SeveralBlobs, label_several_blobs

        job, asked = self.job, self.several

        def read() -> Iterator[tuple[Blobs, float]]:
            first = None
            for rows in read_blobs(job.source, self.cameras, job.frames):
                first = int(rows.blobs.frames[0]) if first is None else first
                if job.shown:
                    frames = int(rows.blobs.frames[-1]) - first + 1
                    refuse_keys(frames, asked.at_least, 0.0 if job.frames else rows.fraction)
                yield rows.blobs, rows.fraction

        room = Room(self.stack, 0)  # no table is held: those of chunks are small, and a long take has many
        options = PointOptions(chosen_method(asked.models[0], job.method), job.target, self.edits, room, job.force)
        body_of = mesh_occlusion if job.casts == "bvh" else None
        with of_file(job.edits_file or job.source, InputError):
            take = SeveralBlobs(read, self.cameras, asked, options, self.rate, body_of)
            return (yield from label_several_blobs(take))

    def _keep(self, blobs: Blobs, chunk: LabelledChunk):
        """Keeps of a chunk what the end needs."""
        rows = np.empty(len(chunk.motion.frames), self.motion.kind)
        rows["xyz"], rows["residual"] = chunk.motion.markers, chunk.motion.residual
        self.motion.append(rows)
        if self.job.fill:
            from ..core.filling.rays import rays_of

            missing = ~np.isfinite(chunk.motion.markers).all(axis=2)
            first = int(chunk.motion.frames[0]) - self.first_frame
            self._rays.append((first, rays_of(blobs, chunk.labels, self.cameras, missing)))

    def _tracked(self) -> Edits:
        """The edits, which know the tracks of the blobs that they are of: their cameras' blobs are read before."""
        try:
            return followed(self.edits, self._read, self.cameras.names)
        except InputError:  # nothing is there in these frames; whatever else is wrong with the file, reading it tells
            return self.edits

    def _occlusion(self) -> Occlusion | None:
        """The body in the way; None for the closed form. InputError where rays are wanted and there is no Blender."""
        if self.job.casts == "capsules":
            return None
        return mesh_occlusion(self.model.markerset) if self.job.body is None else self.job.body
