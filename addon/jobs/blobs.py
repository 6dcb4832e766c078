# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of blobs from file to files, chunk by chunk: read it, step through its labelling, write what came of it."""

import tempfile
from collections import deque
from collections.abc import Generator, Iterator
from contextlib import ExitStack
from pathlib import Path
from time import perf_counter
from typing import Self

import numpy as np

from ..blendfile import Chunks, has_blender, mesh_occlusion, open_cameras
from ..core.body.occlusion import Occlusion
from ..core.data.models import Model
from ..core.data.progress import Progress
from ..core.data.takes import STEPS, Blobs, LabelledChunk, Motion, Points
from ..core.geometry.cameras import Cameras
from ..core.pipelines.blobs import BlobOptions, blob_method, label_blobs, steps_of
from ..core.pipelines.cross_check import MethodAgreement
from ..core.review.summary import TakeSummary
from ..io.blobs import BlobRows, read_blobs
from ..io.labels import LabelWriter
from ..io.models import open_model
from .job import LabelJob, Labelled, Outcome, open_files, timed, write_take


def label_blob_file(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels the take and writes its files, which appear together or not at all. Memory does not grow with the take.

    Raises UserError with the file where it can be told.
    """
    begin = perf_counter()
    model, cameras = open_model(job.model), _cameras(job)
    settings, agreement = (
        BlobOptions(job.method, job.frame_rate, job.target, job.options, _occlusion(job, model)),
        MethodAgreement(),
    )
    method, markerset = blob_method(settings), model.markerset
    with ExitStack() as stack:
        files = open_files(job, stack)
        source = Source(job, cameras)
        work = label_blobs(source.blobs(), cameras, model, settings, agreement)
        results = Results(job, files, markerset.markers, stack)
        clock = {"load": perf_counter() - begin, "write": 0.0}
        for chunk in work:
            row = source.taken.popleft()
            with timed(clock, "write"):
                results.add(row, chunk)
            yield Progress(row.fraction, f"frame {row.blobs.frames[-1]}")
        clock["load"] += source.seconds
        results.labels.file.flush()
        facts = {
            "method": method,
            "occlusion": _casts(job),
            "rate_assumed": job.rate is None,
            "steps": results.counts(method),
        }
        if method == "both":
            facts["agreement"] = agreement.as_dict()
        made = Outcome(results.motion.points(), results.chunks, cameras, results.summary, facts)
        report = write_take(job, files, markerset, made, clock)
    return Labelled(report, results.chunks if job.keep else [])


def _casts(job: LabelJob) -> str:
    """What asks whether the body hides a marker: "bvh" or "capsules"."""
    if job.occlusion != "auto":
        return job.occlusion
    return "bvh" if has_blender() else "capsules"


def _occlusion(job: LabelJob, model: Model) -> Occlusion | None:
    """The body in the way; None for the closed form. InputError where rays are wanted and there is no Blender."""
    if _casts(job) == "capsules":
        return None
    return mesh_occlusion(model.markerset) if job.body is None else job.body


def _cameras(job: LabelJob) -> Cameras:
    return job.cameras if isinstance(job.cameras, Cameras) else open_cameras(job.cameras)


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

    def __init__(self, job: LabelJob, files: dict[str, Path], markers: tuple[str, ...], stack: ExitStack):
        self.kept = job.keep or job.blend
        folder = tempfile.TemporaryDirectory(prefix="mocap-autolabel-", ignore_cleanup_errors=True)
        self.motion = stack.enter_context(MotionFile(Path(stack.enter_context(folder)), markers, job.frame_rate))
        self.labels = stack.enter_context(LabelWriter(files[".labels.csv"], markers))
        self.summary = TakeSummary(markers)
        self.chunks: Chunks = []

    def add(self, row: BlobRows, chunk: LabelledChunk):
        """Writes the labels and keeps what the end needs."""
        self.labels.write(row.keys, chunk.labels)
        self.motion.append(chunk.motion)
        self.summary.add(chunk)
        if self.kept:
            self.chunks.append((row.blobs, chunk))

    def counts(self, method: str) -> dict[str, int]:
        """How many labels came about by each step that the method has."""
        return {STEPS[step]: self.summary.steps[STEPS[step]] for step in steps_of(method)}


class MotionFile:
    """The markers of a take on disk while it is labelled; use it as a context manager."""

    def __init__(self, folder: Path, names: tuple[str, ...], rate: float):
        self.names, self.rate, self.first_frame = names, rate, None
        self.paths = [folder / "xyz", folder / "residual"]
        self.files = []

    def __enter__(self) -> Self:
        self.files = [path.open("w+b") for path in self.paths]
        return self

    def __exit__(self, *_):
        for file in self.files:
            file.close()

    def append(self, motion: Motion):
        """Adds the frames of the next chunk."""
        if self.first_frame is None:
            self.first_frame = int(motion.frames[0])
        for file, part in zip(self.files, (motion.markers, motion.residual), strict=True):
            part.astype(np.float32).tofile(file)

    def points(self) -> Points:
        """All frames, read from disk where they are looked at."""
        for file in self.files:
            file.flush()
        residual = np.memmap(self.paths[1], np.float32, "r").reshape(-1, len(self.names))
        xyz = np.memmap(self.paths[0], np.float32, "r").reshape(*residual.shape, 3)
        return Points(self.names, xyz, residual, self.rate, self.first_frame)
