# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs named by the points that they make: reconstructed without names, named in space, and back to the images.

The second paper after the first one's cameras: it checks the fitted body, which goes the other way round.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from ..core.blobs.pipeline import Options
from ..core.data.models import Model
from ..core.data.takes import NO_MARKER, Blobs, LabelledChunk, Labels, Suspect
from ..core.geometry.cameras import Cameras
from ..core.reconstruction.trajectories import Reconstructed, Reconstructor
from ..core.review.suspects import find_suspects
from .naming import Decided, NamedFrames, consistent, decide, joined, name_frames
from .placing import moved
from .refusals import LEAST_SURE, sure_share
from .spool import SHORTEST

# How the label of a blob came about, by index into `Labels.step`.
STEPS = ("", "evidence", "ensemble", "trajectory")
WINDOW = 1024  # frames, about, whose trajectories vote together


@dataclass(frozen=True, eq=False)
class _Way:
    """How blobs are named, the same from window to window: arguments of `label_by_points`."""

    cameras: Cameras
    model: Model
    method: str
    rate: float
    options: Options
    target: float


@dataclass(frozen=True, eq=False)
class _Window:
    """The Q points that some chunks make, as P trajectories over their T frames.

    frames         (T,) the source's numbers
    starts         for each chunk where its frames begin, and where the last ones end
    frame, column  (Q,) frame and trajectory of each point
    xyz, residual  (T, P, 3) and (T, P) m, NaN where missing; trajectories too short to trust are left out
    """

    frames: np.ndarray
    starts: np.ndarray
    frame: np.ndarray
    column: np.ndarray
    xyz: np.ndarray
    residual: np.ndarray

    @property
    def tracklet(self) -> np.ndarray:
        """(T, P) the number of the trajectory of each point that is there, -1 elsewhere."""
        return np.where(np.isfinite(self.xyz).all(axis=2), np.arange(self.xyz.shape[1]), -1)


def label_by_points(
    chunks: Iterable[Blobs],
    cameras: Cameras,
    model: Model,
    method: str,
    rate: float,
    options: Options,
    target: float,
) -> Iterator[LabelledChunk]:
    """Names the blobs of a take as `core.pipeline.label_take` does: one `LabelledChunk` for each chunk, in their order.

    Raises JobError when there are fewer than two cameras, or a frame has more blobs than any capture.
    """
    way = _Way(cameras, model, method, rate, options, target)
    reconstructor = Reconstructor(cameras, rate)
    waiting: list[tuple[Blobs, Reconstructed]] = []
    seconds = 0.0
    for blobs in chunks:
        begin = perf_counter()
        waiting.append((blobs, reconstructor.reconstruct(blobs)))
        seconds += perf_counter() - begin
        if sum(len(part.frames) for part, _ in waiting) >= WINDOW:
            yield from _labelled(way, waiting, seconds)
            waiting, seconds = [], 0.0
    if waiting:
        yield from _labelled(way, waiting, seconds)


def _labelled(way: _Way, waiting: list[tuple[Blobs, Reconstructed]], seconds: float) -> Iterator[LabelledChunk]:
    """The chunks of one window, which took `seconds` to reconstruct."""
    begin = perf_counter()
    markerset, window = way.model.markerset, _window(waiting)
    decided = _decided(way, window)
    named = perf_counter()
    motion = moved(window.xyz, window.residual, decided.marker, decided.confidence, markerset, window.frames)
    suspects = decided.suspects + find_suspects(motion, markerset.markers, way.rate)
    spent = {"place": seconds, "label": named - begin, "fit": perf_counter() - named}
    step = np.where(decided.alone, STEPS.index(way.method), STEPS.index("trajectory"))
    given = [array[window.frame, window.column] for array in (decided.marker, decided.confidence, step)]
    first = 0
    for index, (blobs, part) in enumerate(waiting):
        here, last = slice(*window.starts[index : index + 2]), first + len(part.points)
        labels, px = _of_blobs(blobs, part, way.cameras, *(array[first:last] for array in given), len(markerset))
        fields = {name: getattr(motion, name)[here] for name in vars(motion)}
        mine = tuple(s for s in suspects if blobs.frames[0] <= s.first <= blobs.frames[-1])
        yield LabelledChunk(labels, type(motion)(**{**fields, "residual_px": px}), mine, spent)
        first, spent = last, {}


def _window(waiting: list[tuple[Blobs, Reconstructed]]) -> _Window:
    """The points of all chunks as trajectories."""
    frames = np.concatenate([blobs.frames for blobs, _ in waiting])
    starts = np.cumsum([0, *(len(blobs.frames) for blobs, _ in waiting)])
    frame = np.concatenate([start + part.frame for start, (_, part) in zip(starts, waiting, strict=False)])
    trajectory = np.concatenate([part.trajectory for _, part in waiting])
    number, column, lengths = np.unique(trajectory, return_inverse=True, return_counts=True)
    shape = (len(frames), max(len(number), 1))
    xyz, residual = np.full((*shape, 3), np.nan), np.full(shape, np.nan)
    lasting = (lengths >= min(SHORTEST, len(frames)))[column]
    xyz[frame[lasting], column[lasting]] = np.concatenate([part.points for _, part in waiting])[lasting]
    residual[frame[lasting], column[lasting]] = np.concatenate([part.residual for _, part in waiting])[lasting]
    return _Window(frames, starts, frame, column, xyz, residual)


def _decided(way: _Way, window: _Window) -> Decided:
    """The names of a window's points; none, and why, where nobody in the model's markers is there."""
    markerset, first, shape = way.model.markerset, int(window.frames[0]), window.residual.shape
    found, said = NamedFrames(np.full(shape, NO_MARKER), np.zeros(shape), np.zeros(shape)), ()
    if np.isfinite(window.xyz).any():
        found = joined(list(name_frames(way.model, way.method, window.xyz, way.rate, way.options)))
    if sure_share(found, window.xyz, len(markerset)) < LEAST_SURE:
        found = replace(found, marker=np.full(shape, NO_MARKER), confidence=np.zeros(shape), rate=np.zeros(shape))
        said = (Suspect(first, int(window.frames[-1]), f"no subject that wears {markerset.name} was recognised"),)
    decided = decide(found, window.tracklet, way.model, way.target, first)
    decided = consistent(decided, window.xyz, markerset.likelihood, first)
    return replace(decided, suspects=tuple(_without_number(one) for one in decided.suspects) + said)


def _without_number(suspect: Suspect) -> Suspect:
    """The suspect without the number of its trajectory, which is in no file here."""
    if suspect.trajectory is None:
        return suspect
    return replace(suspect, words=f"a trajectory of points {suspect.words}", trajectory=None)


def _of_blobs(blobs: Blobs, part: Reconstructed, cameras: Cameras, marker, confidence, step, markers: int):
    """The labels of a chunk's blobs from those of its points, and (F, M) px how far they are from their points."""
    labels = Labels(np.full(len(blobs), NO_MARKER), np.zeros(len(blobs), int), np.zeros(len(blobs)))
    point, camera = np.nonzero((part.rows >= 0) & (marker != NO_MARKER)[:, None])
    rows = part.rows[point, camera]
    labels.marker[rows], labels.step[rows], labels.confidence[rows] = marker[point], step[point], confidence[point]
    off = blobs.xy[rows] - cameras.project(part.points)[camera, point]
    total, count = np.zeros((2, len(blobs.frames), markers))
    at = part.frame[point], marker[point]
    np.add.at(total, at, np.einsum("ni,ni->n", off, off))
    np.add.at(count, at, 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return labels, np.sqrt(total / count)
