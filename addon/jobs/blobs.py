# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of blobs from file to files, chunk by chunk: read it, step through its labelling, write what came of it."""

from collections import deque
from collections.abc import Generator, Iterator
from contextlib import ExitStack, suppress
from dataclasses import replace
from itertools import tee
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Self

import numpy as np

from ..blendfile import Chunks, mesh_occlusion, open_cameras, refuse_long
from ..core.data.errors import InputError
from ..core.data.markersets import Worn
from ..core.data.progress import Progress
from ..core.data.takes import BY_EDIT, STEPS, Blobs, EditOutcome, LabelledChunk, Motion, Points, Suspect
from ..core.edits.applying import BLOB_EDITING, joined, unless_heard
from ..core.edits.blob_tracks import followed, wants_tracks
from ..core.edits.kinds import Accepted, Edits
from ..core.geometry.cameras import Cameras
from ..core.papers.virtual_occlusions.occlusion import Occlusion
from ..core.pipelines.blobs import BlobOptions, blob_method, label_blobs, steps_of, with_edits
from ..core.pipelines.cross_check import MethodAgreement
from ..core.pipelines.others import OtherSubjects, refuse_two
from ..core.points.handedness import MEND_BLOBS, Handedness
from ..core.points.models import Model
from ..core.review.answering import heard_in, without_accepted
from ..core.review.doubtful import doubtful_ranges, doubtful_samples
from ..core.review.odd_cameras import CameraCheck
from ..core.review.summary import TakeSummary
from ..core.review.take_trouble import TakeTrouble
from ..io.blobs import BlobRows, frames_in, read_blobs
from ..io.edits import open_edits
from ..io.labels import LabelWriter
from ..io.poses import PoseFile, refuse_keys
from ..io.report import facts_of_trouble
from ..io.scratch import naming_scratch, scratch_folder
from ..io.tables import Room
from .captures import facts_of_capture
from .job import LabelJob, Labelled, timed
from .models import model_for
from .outcome import Outcome, overview_of, write_take
from .resuming import open_files
from .several import NOT_HELD, facts_of_subjects, several_asked, subjects_in_blobs
from .spool import append

if TYPE_CHECKING:  # only who fills gaps needs it
    from ..core.filling.rays import MarkerRays


def label_blob_file(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels the take and writes its files, which appear together or not at all.

    Memory does not grow with the take, unless its gaps are to be filled: that takes all frames.

    Raises UserError with the file where it can be told; JobError where one subject was asked for and two are there.
    """
    begin = perf_counter()
    with ExitStack() as stack:
        inputs, files = open_files(job, stack)  # before they are read
        model = yield from model_for(job.model, job.method)
        cameras = _cameras(job)
        several = (yield from several_asked(job, model)) if job.several else None
        known = {"cameras": cameras.names, "frames": _frames_if_edited(job, cameras)}
        named = several.possible if several else model.markerset
        edits = _tracked(open_edits(job.edits_applied, job.source, named, **known), job, cameras)
        # Whoever corrected names has seen who is in the take.
        others = OtherSubjects(cameras, model) if several is None and not edits else None
        if others is not None:
            yield Progress(0.0, "look how many there are")
            refuse_two(Source(job, cameras).blobs, cameras, model)
        agreement, source = MethodAgreement(), Source(job, cameras)
        clock = {"load": perf_counter() - begin, "write": 0.0}
        if several is None:
            settings = BlobOptions(job.method, job.frame_rate, job.target, job.options, _occlusion(job, model), edits)
            work, method = label_blobs(source.blobs(), cameras, model, settings, agreement), blob_method(settings)
            worn, sized = model.markerset, model.markerset
        else:
            seen = yield from subjects_in_blobs(job, cameras, several, edits, Room(stack, NOT_HELD))
            worn, sized, method = seen.worn, None, "likelihood"
            own, read = tee(source.blobs())
            work = with_edits(own, seen.chunks(read), edits, cameras, worn) if edits else seen.chunks(source.blobs())
        check, handedness = CameraCheck(cameras, sized), Handedness(worn, MEND_BLOBS)
        trouble = TakeTrouble(worn.markers, job.frame_rate, edits, cameras, worn.by_name)
        overview = overview_of(job, worn, job.frame_rate, edits, cameras)
        results = Results(job, cameras, files, worn, stack)
        said_of, doubtful = (worn.markers, job.frame_rate), {}
        for chunk in work:
            row = source.taken.popleft()
            with timed(clock, "write"):
                results.add(row, chunk)
            check.add(row.blobs, chunk)
            handedness.add(chunk.motion.markers)
            if others is not None:
                others.add(row.blobs, chunk)
            if overview is not None:
                overview.add(row.blobs, chunk)
            trouble.add(row.blobs, chunk.labels, chunk.motion)
            asked = doubtful_samples(
                row.blobs, chunk.labels, chunk.motion, chunk.suspects, *said_of, edits, worn.by_name
            )
            for name, spans in doubtful_ranges(asked, chunk.motion.frames, worn.markers).items():
                doubtful.setdefault(name, []).extend(spans)
            if several is None:
                yield Progress(row.fraction, f"frame {row.blobs.frames[-1]}")
        clock["load"] += source.seconds
        with timed(clock, "label"):
            if others is not None:
                others.refuse()
            noticed = check.suspects()
            doubts = without_accepted(noticed, edits)
            forced = (job.doubted(check.refuse) if doubts else []) + job.doubted(handedness.refuse)
            results.doubt(doubts)
        results.labels.file.flush()
        facts = _facts(job, method, cameras, results, agreement)
        facts |= {"notes": forced} if forced else {}
        facts |= facts_of_subjects(job, worn, facts.get("notes", [])) if several else {}
        counts = {one.name: one.as_dict() for one in trouble.by_camera.figures()}
        of_cameras = {name: row | counts[name] for name, row in check.of_cameras().items()}
        facts |= {"cameras": of_cameras, "camera_doubts": [doubt.reason for doubt in doubts]}
        points, fills = results.motion.points(), ()
        if job.fill:
            with timed(clock, "fill"):
                from ..core.filling.rays import MarkerRays
                from .fill import fill_labelled

                rays = MarkerRays.join(results.rays)
                points, of_gaps, fills = yield from fill_labelled(points, worn, (overview, trouble), rays)
            facts |= of_gaps
        facts |= facts_of_trouble(trouble, results.summary.suspects) | {"doubtful": doubtful}
        heard = results.heard | heard_in(edits, noticed) | trouble.accepted(results.summary.suspects)
        outcomes = unless_heard(joined(results.outcomes), edits, heard)
        said = {"outcomes": outcomes, "overview": overview, "fills": fills, "poses": results.played}
        made = Outcome(worn, points, results.chunks, cameras, results.summary, facts, inputs, edits, **said)
        report = write_take(job, files, model, made, clock)
    return Labelled(report, worn, results.chunks if job.keep else [], edits)


def _frames_if_edited(job: LabelJob, cameras: Cameras) -> tuple[int, int] | None:
    """The first and last frame of a take that is edited, to check the edits' frames by; None for a part of one."""
    return frames_in(job.source, cameras) if job.edits_applied and not job.frames else None


def _tracked(edits: Edits, job: LabelJob, cameras: Cameras) -> Edits:
    """The edits, which know the tracks of the blobs that they are of: for that their cameras' blobs are read before."""
    wanted = wants_tracks(edits).values()
    if not wanted:
        return edits
    frames = min(span[0] for span in wanted), max(span[1] for span in wanted)
    chunks = (rows.blobs for rows in read_blobs(job.source, cameras, frames))
    try:
        return followed(edits, chunks, cameras.names, BLOB_EDITING.max_distance_px)
    except InputError:  # nothing is there in these frames; whatever else is wrong with the file, reading it tells
        return edits


def _facts(job: LabelJob, method: str, cameras: Cameras, results: "Results", agreement: MethodAgreement) -> dict:
    """What the report of blobs says beside what every report says."""
    facts = {"method": method, "occlusion": job.casts, "rate_assumed": job.rate is None}
    facts["steps"] = results.counts("both" if job.several else method)  # bodies of several name what has no point
    if method == "both":
        facts["agreement"] = agreement.as_dict()
    if cameras.remarks:
        facts["calibration"] = list(cameras.remarks)
    return facts | facts_of_capture(job.source, False, cameras)


def _occlusion(job: LabelJob, model: Model) -> Occlusion | None:
    """The body in the way; None for the closed form. InputError where rays are wanted and there is no Blender."""
    if job.casts == "capsules":
        return None
    return mesh_occlusion(model.markerset) if job.body is None else job.body


def _cameras(job: LabelJob) -> Cameras:
    return job.cameras if isinstance(job.cameras, Cameras) else open_cameras(job.cameras, job.up)


class Source:
    """The blob file as the labelling takes it, with each row's own text kept until its labels come back.

    taken    chunks that went into the labelling and did not come out yet
    seconds  spent reading
    """

    def __init__(self, job: LabelJob, cameras: Cameras):
        self.job, self.cameras = job, cameras
        self.taken: deque[BlobRows] = deque()
        self.seconds = 0.0

    def blobs(self) -> Iterator[Blobs]:
        """The chunks of the file."""
        chunks = read_blobs(self.job.source, self.cameras, self.job.frames)
        while True:
            begin = perf_counter()
            rows = next(chunks, None)
            self.seconds += perf_counter() - begin
            if rows is None:
                return
            self.taken.append(rows)
            yield rows.blobs


class Results:
    """What becomes of a take, chunk by chunk; its files are open for as long as `stack` is.

    chunks    the chunks, where the job keeps them; of a take that is too long for keys only where the job is asked to
    outcomes  what became of the edits in each chunk
    heard     the edits that accept a doubt that there was
    rays      of the markers that one camera alone sees, by chunk, each with the index of its first frame; where gaps
              are to be filled
    """

    def __init__(self, job: LabelJob, cameras: Cameras, files: dict[str, Path], worn: Worn, stack: ExitStack):
        markers = worn.markers
        self.blend, self.kept = job.blend, job.keep or job.blend
        self.cameras = cameras if job.fill else None
        self.rays: list[tuple[int, MarkerRays]] = []
        self.motion = stack.enter_context(MotionFile(stack.enter_context(scratch_folder()), markers, job.frame_rate))
        self.labels = stack.enter_context(LabelWriter(files[".labels.csv"], markers))
        self.summary = TakeSummary(markers)
        self.poses = stack.enter_context(PoseFile(stack.enter_context(scratch_folder()))) if job.blend else None
        self.keep, self.showing, self.whole = job.keep, worn if job.shown else None, not job.frames
        self.chunks: Chunks = []
        self.outcomes: list[tuple[EditOutcome, ...]] = []
        self.heard: frozenset[Accepted] = frozenset()

    def add(self, row: BlobRows, chunk: LabelledChunk):
        """Writes the labels and keeps what the end needs; JobError once a `.blend` is wanted that cannot be."""
        self.labels.write(row.keys, chunk.labels)
        self.motion.append(chunk.motion)
        if self.cameras is not None:
            from ..core.filling.rays import rays_of

            missing = ~np.isfinite(chunk.motion.markers).all(axis=2)
            first = int(chunk.motion.frames[0]) - self.motion.first_frame
            self.rays.append((first, rays_of(row.blobs, chunk.labels, self.cameras, missing)))
        if self.blend:
            refuse_long(self.motion.first_frame, int(row.blobs.frames[-1]))
        if self.showing is not None:
            frames = int(row.blobs.frames[-1]) - self.motion.first_frame + 1
            refuse_keys(frames, self.showing, row.fraction if self.whole else 0.0)
        self.summary.add(chunk)
        self.outcomes.append(chunk.outcomes)
        self.heard |= chunk.heard
        if self.poses is not None:
            self.poses.append(chunk.motion, row.fraction if self.whole else 1.0)
            if self.poses.long and not self.keep:
                self.kept = False
                self.chunks.clear()
        if self.kept:
            self.chunks.append((row.blobs, chunk))

    @property
    def played(self) -> PoseFile | None:
        """The poses of a take that is too long for keys, where a Blender file is wanted."""
        return self.poses if self.poses is not None and self.poses.long else None

    def doubt(self, suspects: tuple[Suspect, ...]):
        """Adds what was noticed at the end of the take."""
        self.summary.suspects += suspects
        if self.chunks:
            blobs, last = self.chunks[-1]
            self.chunks[-1] = (blobs, replace(last, suspects=(*last.suspects, *suspects)))

    def counts(self, method: str) -> dict[str, int]:
        """How many labels came about by each step that the method has."""
        steps = (*steps_of(method), *([BY_EDIT] if any(self.outcomes) else []))
        return {STEPS[step]: self.summary.steps[STEPS[step]] for step in steps}


class MotionFile:
    """The markers of a take on disk while it is labelled; use it as a context manager."""

    def __init__(self, folder: Path, names: tuple[str, ...], rate: float):
        self.folder, self.names, self.rate, self.first_frame = folder, names, rate, None
        self.paths = [folder / "xyz", folder / "residual"]
        self.files = []

    def __enter__(self) -> Self:
        with naming_scratch(self.folder):
            self.files = [path.open("w+b") for path in self.paths]
        return self

    def __exit__(self, *_):
        for file in self.files:
            with suppress(OSError):  # of a full disk, which was said
                file.close()

    def append(self, motion: Motion):
        """Adds the frames of the next chunk."""
        if self.first_frame is None:
            self.first_frame = int(motion.frames[0])
        with naming_scratch(self.folder):
            for file, part in zip(self.files, (motion.markers, motion.residual), strict=True):
                append(file, part.astype(np.float32))

    def points(self) -> Points:
        """All frames, read from disk where they are looked at."""
        residual = np.memmap(self.paths[1], np.float32, "r").reshape(-1, len(self.names))
        xyz = np.memmap(self.paths[0], np.float32, "r").reshape(*residual.shape, 3)
        return Points(self.names, xyz, residual, self.rate, self.first_frame)
