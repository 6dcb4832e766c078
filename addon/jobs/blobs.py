# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of blobs from file to files, chunk by chunk: named by a fitted body, by the points that they make, or both."""

from collections import deque
from collections.abc import Callable, Generator, Iterator, Sequence
from contextlib import ExitStack, suppress
from dataclasses import replace
from itertools import tee
from pathlib import Path
from time import perf_counter
from typing import Self

import numpy as np

from ..blendfile import Chunks, open_cameras, refuse_long, save_blend
from ..core.blobs.pipeline import Options, label_take
from ..core.blobs.search import Hints
from ..core.data.errors import InputError
from ..core.data.models import Model
from ..core.data.takes import STEPS, Blobs, LabelledChunk, Motion, Points, Suspect
from ..core.geometry.cameras import Cameras
from ..core.review.odd_cameras import CameraCheck
from ..core.review.summary import TakeSummary
from ..io.blobs import BlobRows, read_blobs
from ..io.labels import LabelWriter
from ..io.models import open_model
from ..io.scratch import scratch_folder, told_of
from ..progress import Progress
from . import both_ways, by_points
from .job import REPORT, LabelJob, Labelled, finish_report, open_files, timed, write_points
from .naming import chosen_method
from .resuming import made_of, may_replace, with_results
from .spool import append

Way = Callable[[Iterator[Blobs]], Iterator[LabelledChunk]]


def label_blobs(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels the take and writes its files, which appear together or not at all. Memory does not grow with the take.

    Raises UserError with the file where it can be told.
    """
    begin = perf_counter()
    model, cameras = open_model(job.model), open_cameras(job.cameras, job.up)
    made = made_of(job)
    ways, markerset, agreement = _ways(job, model, cameras), model.markerset, both_ways.Agreement()
    with ExitStack() as stack:
        files = open_files(job, may_replace(job), stack)
        source = Source(job, cameras)
        steps, work = _work(job, ways, source.blobs(), markerset.markers, agreement)
        results, check = Results(job, files, markerset.markers, steps, stack), CameraCheck(cameras)
        clock = {"load": perf_counter() - begin, "write": 0.0}
        for chunk in work:
            row = source.taken.popleft()
            with timed(clock, "write"):
                results.add(row, chunk)
            check.add(row.blobs, chunk)
            yield Progress(row.fraction, f"frame {row.blobs.frames[-1]}")
        clock["load"] += source.seconds
        with timed(clock, "label"):
            doubts = check.suspects()
            results.doubt(doubts)
        chunks = results.chunks
        with timed(clock, "write"):
            results.labels.file.flush()
            more = write_points(results.motion.points(), files)
            if job.blend:
                save_blend(files[".blend"], job.source.stem, job.source, job.frame_rate, cameras, markerset, chunks)
        if len(ways) == 2:
            more["agreement"] = agreement.as_dict()
        more |= {"method": _method(job), "rate_assumed": job.rate is None, "steps": results.counts()}
        more |= {"cameras": check.of_cameras(), "camera_doubts": [doubt.reason for doubt in doubts]}
        if cameras.remarks:
            more["calibration"] = list(cameras.remarks)
        more["made_of"] = with_results(made, files)
        report = finish_report(job, results.summary, markerset.name, job.frame_rate, clock, files[REPORT], **more)
    return Labelled(report, chunks if job.keep else [])


def _method(job: LabelJob) -> str:
    """The method that "auto" stands for, or the one that was wanted."""
    return "fit" if job.method == "auto" else job.method


def _work(
    job: LabelJob, ways: Sequence[Way], blobs: Iterator[Blobs], markers: tuple[str, ...], agreement: both_ways.Agreement
) -> tuple[tuple[str, ...], Iterator[LabelledChunk]]:
    """The steps by which blobs get their names, and the naming, one way or both; then `agreement` is added to."""
    if len(ways) == 1:
        return STEPS if _method(job) == "fit" else by_points.STEPS, ways[0](blobs)
    own, *each = tee(blobs, 3)
    named = (way(part) for way, part in zip(ways, each, strict=True))
    return both_ways.ALL_STEPS, both_ways.label_both_ways(own, *named, markers, agreement)


def _ways(job: LabelJob, model: Model, cameras: Cameras) -> list[Way]:
    """The ways in which the job wants blobs named; InputError where the model does not know how."""

    def fit(chunks: Iterator[Blobs]) -> Iterator[LabelledChunk]:
        return label_take(chunks, cameras, model.markerset, job.frame_rate, options(job))

    if _method(job) == "fit":
        return [fit]
    method = chosen_method(model, "auto" if job.method == "both" else job.method)
    if method == "fit":
        raise InputError(
            f"model {model.markerset.name} has nothing to name points by; expected one made by train, or --method fit"
        )

    def points(chunks: Iterator[Blobs]) -> Iterator[LabelledChunk]:
        return by_points.label_by_points(chunks, cameras, model, method, job.frame_rate, options(job), job.target)

    return [fit, points] if job.method == "both" else [points]


def options(job: LabelJob) -> Options:
    """The user's hints as the labelling takes them."""
    return Options(hints=Hints(job.height, job.facing))


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

    chunks  the chunks, where the job keeps them
    """

    def __init__(
        self,
        job: LabelJob,
        files: dict[str, Path],
        markers: tuple[str, ...],
        steps: tuple[str, ...],
        stack: ExitStack,
    ):
        self.steps, self.blend, self.kept = steps, job.blend, job.keep or job.blend
        self.motion = stack.enter_context(MotionFile(stack.enter_context(scratch_folder()), markers, job.frame_rate))
        self.labels = stack.enter_context(LabelWriter(files[".labels.csv"], markers))
        self.summary = TakeSummary(markers)
        self.chunks: Chunks = []
        self._given = np.zeros(len(steps), np.int64)

    def add(self, row: BlobRows, chunk: LabelledChunk):
        """Writes the labels and keeps what the end needs; JobError once a `.blend` is wanted that cannot be."""
        self.labels.write(row.keys, chunk.labels, self.steps)
        self.motion.append(chunk.motion)
        if self.blend:
            refuse_long(self.motion.first_frame, int(row.blobs.frames[-1]))
        self.summary.add(row.blobs, chunk)
        self._given += np.bincount(chunk.labels.step, minlength=len(self.steps))
        if self.kept:
            self.chunks.append((row.blobs, chunk))

    def doubt(self, suspects: tuple[Suspect, ...]):
        """Adds what was noticed at the end of the take."""
        self.summary.suspects += suspects
        if self.chunks:
            blobs, last = self.chunks[-1]
            self.chunks[-1] = (blobs, replace(last, suspects=(*last.suspects, *suspects)))

    def counts(self) -> dict[str, int]:
        """How many labels came about by each step."""
        return dict(zip(self.steps[1:], self._given[1:].tolist(), strict=True))


class MotionFile:
    """The markers of a take on disk while it is labelled; use it as a context manager."""

    def __init__(self, folder: Path, names: tuple[str, ...], rate: float):
        self.folder, self.names, self.rate, self.first_frame = folder, names, rate, None
        self.paths = [folder / "xyz", folder / "residual"]
        self.files = []

    def __enter__(self) -> Self:
        with told_of(self.folder):
            self.files = [path.open("w+b") for path in self.paths]
        return self

    def __exit__(self, *_):
        for file in self.files:
            with suppress(OSError):  # of a full disk, which was told
                file.close()

    def append(self, motion: Motion):
        """Adds the frames of the next chunk."""
        if self.first_frame is None:
            self.first_frame = int(motion.frames[0])
        with told_of(self.folder):
            for file, part in zip(self.files, (motion.markers, motion.residual), strict=True):
                append(file, part.astype(np.float32))

    def points(self) -> Points:
        """All frames, read from disk where they are looked at."""
        residual = np.memmap(self.paths[1], np.float32, "r").reshape(-1, len(self.names))
        xyz = np.memmap(self.paths[0], np.float32, "r").reshape(*residual.shape, 3)
        return Points(self.names, xyz, residual, self.rate, self.first_frame)
