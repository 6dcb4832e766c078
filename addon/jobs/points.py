# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points from file to files: name frame by frame, let trajectories vote, pose the body, write."""

from collections.abc import Generator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ..blendfile import refuse_long, save_blend
from ..core.blobs.pipeline import Options
from ..core.blobs.search import Hints
from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.models import Model
from ..core.data.takes import LARGEST_FRAME, NO_MARKER, Blobs, LabelledChunk, Labels, Motion, Points, Suspect
from ..core.geometry.cameras import Cameras
from ..core.points.tracklets import cut, renamed
from ..core.review.summary import TakeSummary
from ..core.review.suspects import find_suspects, summarised
from ..io.labels import POINT_KEYS, LabelWriter
from ..io.models import open_model
from ..io.points import FilePoints, read_points
from ..progress import Progress
from .background import in_background, within
from .job import REPORT, USUAL_TARGET, LabelJob, Labelled, finish_report, open_files, timed, write_points
from .naming import Decided, NamedFrames, chosen_method, consistent, decide, joined, name_frames
from .placing import moved
from .refusals import refuse_floods, refuse_others, refuse_strangers
from .resuming import made_of, may_replace, with_results
from .wearer import Wearer, checked, find_wearer

# How the label of a point came about; the index is what `Labels.step` holds.
STEPS = ("", "evidence", "ensemble", "fit", "trajectory")
# What each part takes, as measured: so many times as long as a frame is named in, and that again for each frame.
COSTS = {
    "wearer": (5, 0),
    "others": (150, 0),
    "name": (0, 1),
    "vote": (2, 0.02),
    "pose": (18, 0.12),
    "write": (5, 0.03),
}


def label_points(job: LabelJob) -> Generator[Progress, None, Labelled]:
    """Labels the take and writes its files, which appear together or not at all.

    Raises UserError with the file where it can be told.
    """
    clock: dict[str, float] = {"load": 0.0}
    with timed(clock, "load"):
        model = open_model(job.model)
        method, made = chosen_method(model, job.method), made_of(job)
        take = _of_frames(read_points(job.source, up=job.up, rate=job.rate), job.frames)
        refuse_floods(take.xyz)
        if job.blend:
            refuse_long(take.first_frame, take.first_frame + len(take.xyz) - 1)
    with ExitStack() as stack:
        files = open_files(job, may_replace(job), stack)
        stack.enter_context(threadpool_limits(1, user_api="blas"))
        labels, suspects = yield from _named(job, model, method, take, clock)
        shares = begins(len(take.xyz), method)
        with timed(clock, "fit"):
            frames = take.first_frame + np.arange(len(take.xyz))
            given = take.xyz, take.residual, labels.marker, labels.confidence, model.markerset, frames
            work = in_background(lambda tell: moved(*given, progress=tell))
            motion = yield from within(work, shares["pose"], shares["write"], "pose the body")
        yield Progress(shares["write"], "write")
        doubtful = find_suspects(motion, model.markerset.markers, take.rate)
        rows, chunk = _as_chunk(take, labels, motion, summarised(suspects + doubtful, take.rate))
        summary = TakeSummary(model.markerset.markers)
        summary.add(rows, chunk)
        with timed(clock, "write"):
            _write_labels(files[".labels.csv"], take, rows, chunk.labels, model.markerset)
            more = write_points(_labelled_take(take, labels.marker, motion, model.markerset), files)
            if job.blend:
                _save_blend(job, files[".blend"], take, model.markerset, rows, chunk)
            more["made_of"] = with_results(made, files)
        report = _report(job, summary, model, method, take, clock, chunk, files[REPORT], more)
    return Labelled(report, [(rows, chunk)] if job.keep else [])


def begins(frames: int, method: str) -> dict[str, float]:
    """How far along the work is when each of its parts begins, for a take of so many frames."""
    costs = COSTS | ({"others": (5, 0)} if method == "fit" else {})
    spent = np.array([fixed + each * frames for fixed, each in costs.values()])
    return dict(zip(costs, ((np.cumsum(spent) - spent) / spent.sum()).tolist(), strict=True))


def _of_frames(take: FilePoints, frames: tuple[int | None, int | None] | None) -> FilePoints:
    """The take's frames from A to B, both included."""
    first, last = frames or (None, None)
    start = 0 if first is None else max(first - take.first_frame, 0)
    stop = len(take.xyz) if last is None else max(last - take.first_frame + 1, 0)
    part = slice(start, stop)
    if not np.isfinite(take.xyz[part]).any():
        raise InputError("has no point that is present in these frames; expected frames with markers")
    end = take.first_frame + min(stop, len(take.xyz)) - 1
    if end > LARGEST_FRAME:
        raise InputError(f"goes on to frame {end}; expected frame numbers up to {LARGEST_FRAME}")
    return replace(take, xyz=take.xyz[part], residual=take.residual[part], first_frame=take.first_frame + start)


def _named(job: LabelJob, model: Model, method: str, take: FilePoints, clock):
    """Labels (T, P) after the vote, and what is doubtful about them."""
    options, shares = Options(hints=Hints(job.height, job.facing)), begins(len(take.xyz), method)
    begin = perf_counter()
    yield Progress(shares["wearer"], "look who wears the markers")
    tracklet = cut(take.xyz, take.rate)
    wearer = find_wearer(model, method, take.xyz, tracklet, take.rate)
    model = wearer.model
    yield Progress(shares["others"], "look whether the model is for this take")
    refuse_others(model, method, take.xyz, options)
    named = yield from _frame_by_frame(model, method, take, options)
    yield Progress(shares["vote"], "let trajectories vote")
    decided = _decided(named, tracklet, wearer, take, job.target)
    # Who asks for surer labels gets fewer, and the take is no stranger's for that.
    usual = decided if job.target == USUAL_TARGET else _decided(named, tracklet, wearer, take, USUAL_TARGET)
    refuse_strangers(model, method, take.xyz, usual.marker)
    step = np.where(decided.alone, STEPS.index(method), STEPS.index("trajectory"))
    clock["label"] = perf_counter() - begin
    changed = renamed(decided.marker, tracklet, model.markerset.markers, take.first_frame)
    labels = Labels(decided.marker, np.where(decided.marker == NO_MARKER, 0, step), decided.confidence)
    return labels, by_file_number(decided.suspects + changed, take.columns)


def _frame_by_frame(
    model: Model, method: str, take: FilePoints, options: Options
) -> Generator[Progress, None, NamedFrames]:
    """What every frame says on its own."""
    parts, done, shares = [], 0, begins(len(take.xyz), method)
    yield Progress(shares["name"], f"frame {take.first_frame}")
    for part in name_frames(model, method, take.xyz, take.rate, options):
        parts.append(part)
        done += len(part.marker)
        share = shares["name"] + (shares["vote"] - shares["name"]) * done / len(take.xyz)
        yield Progress(share, f"frame {take.first_frame + done - 1}")
    return joined(parts)


def _decided(named: NamedFrames, tracklet: np.ndarray, wearer: Wearer, take: FilePoints, target: float) -> Decided:
    """The names that trajectories, the rest of the take and its motion bear out, sure enough for the target."""
    markerset = wearer.model.markerset
    decided = decide(named, tracklet, wearer.model, target, take.first_frame)
    decided = consistent(decided, take.xyz, markerset.likelihood, take.first_frame)
    return checked(decided, wearer, take.first_frame)


def by_file_number(suspects: Sequence[Suspect], columns: np.ndarray) -> tuple[Suspect, ...]:
    """The suspects with trajectories called as in label files: by their index in the file, `columns` (P,)."""
    return tuple(
        one if one.trajectory is None else replace(one, trajectory=int(columns[one.trajectory])) for one in suspects
    )


def _save_blend(job: LabelJob, path: Path, take: FilePoints, markerset: MarkerSet, rows: Blobs, chunk: LabelledChunk):
    """Saves the take with all its points, named and unnamed, as Blender shows it when it labels them itself."""
    points, residual = (array[rows.frame, rows.camera] for array in (take.xyz, take.residual))
    seen = (replace(rows, camera=take.columns[rows.camera]), chunk)
    save_blend(path, job.source.stem, job.source, take.rate, no_cameras(), markerset, [seen], points, residual)


def _as_chunk(take: FilePoints, labels: Labels, motion: Motion, suspects) -> tuple[Blobs, LabelledChunk]:
    """The points that are there, frame by frame as rows, and what is said of them; `camera` is the column."""
    frame, column = np.nonzero(np.isfinite(take.xyz).all(axis=2))
    rows = Blobs(motion.frames, frame, column, np.zeros((len(frame), 2)), np.full(len(frame), np.nan))
    flat = Labels(*(getattr(labels, name)[frame, column] for name in ("marker", "step", "confidence")))
    return rows, LabelledChunk(flat, motion, tuple(sorted(suspects, key=lambda suspect: suspect.first)))


def _write_labels(path, take: FilePoints, rows: Blobs, labels: Labels, markerset: MarkerSet):
    with LabelWriter(path, markerset.markers, POINT_KEYS) as writer:
        frames, columns = rows.frames[rows.frame].tolist(), take.columns[rows.camera].tolist()
        keys = [f"{frame},{column}" for frame, column in zip(frames, columns, strict=True)]
        writer.write(keys, labels, STEPS)


def _labelled_take(take: FilePoints, marker: np.ndarray, motion: Motion, markerset: MarkerSet) -> Points:
    """The model's markers in its order, then what stays unlabelled."""
    left = np.isfinite(take.xyz).all(axis=2) & (marker == NO_MARKER)
    columns = np.flatnonzero(left.any(axis=0))
    rest = np.where(left[:, columns, None], take.xyz[:, columns], np.nan)
    residual = np.where(left[:, columns], take.residual[:, columns], np.nan)
    names = (*markerset.markers, *[""] * len(columns))
    xyz = np.concatenate([motion.markers, rest], axis=1)
    return Points(names, xyz, np.concatenate([motion.residual, residual], axis=1), take.rate, take.first_frame)


def _report(
    job: LabelJob, summary: TakeSummary, model: Model, method: str, take, clock, chunk, path: Path, more
) -> dict:
    steps = np.bincount(chunk.labels.step, minlength=len(STEPS))
    if take.assumed:
        more["unit_assumed"] = take.assumed
    more |= {
        "up_axis": take.up,
        "notes": list(take.notes),
        "points": summary.blobs,
        "trajectories": take.xyz.shape[1],
        "method": method,
        "target": job.target,
        "steps": {step: int(count) for step, count in zip(STEPS, steps, strict=True) if step and count},
    }
    return finish_report(job, summary, model.markerset.name, take.rate, clock, path, **more)


def no_cameras() -> Cameras:
    """Nobody's cameras: points come without any."""
    return Cameras((), *(np.zeros((0, *shape)) for shape in ((2,), (3, 3), (5,), (3, 3), (3,))))
