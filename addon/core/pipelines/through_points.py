# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs named through the points that they make: reconstructed without names, named in space, and back to the images.

The second paper after the first one's cameras: it checks the fitted body, which goes the other way round.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np

from ..data.takes import BY_LIKELIHOOD, BY_TRAJECTORY, Blobs, LabelledChunk, Labels, Suspect, Verdict
from ..edits.blobs_in_points import named_points
from ..edits.kinds import NO_EDITS, Edits
from ..edits.replay import ANYBODY, Replay
from ..geometry.cameras import Cameras
from ..points.models import Model
from ..points.motion import motion_of
from ..points.naming import Namer, namer_of
from ..points.refusals import REFUSAL, sure_share
from ..points.whole_take.deciding import can_be_solved, solution_of, verdict_of
from ..points.whole_take.rulings import Rulings
from ..reconstruction.trajectories import RECONSTRUCTION, Reconstructed, Reconstructor
from ..review.suspects import find_suspects


@dataclass(frozen=True, eq=False)
class _Work:
    """How blobs are named, the same from window to window: arguments of `label_through_points`."""

    cameras: Cameras
    model: Model
    namer: Namer
    rate: float
    target: float
    edits: Edits


@dataclass(frozen=True, eq=False)
class _Window:
    """The Q points that some chunks make, as P trajectories over their T frames.

    frames         (T,) the source's numbers
    starts         for each chunk where its frames begin, and where the last ones end
    frame, column  (Q,) frame and trajectory of each point
    xyz, residual  (T, P, 3) and (T, P) m, NaN where missing; trajectories too short to go by are left out
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


def label_through_points(
    chunks: Iterable[Blobs],
    cameras: Cameras,
    model: Model,
    method: str,
    rate: float,
    target: float,
    window_frames: int = 1024,
    edits: Edits = NO_EDITS,
) -> Iterator[LabelledChunk]:
    """Names the blobs of a take as `blobs.pipeline.label_take` does: a `LabelledChunk` for each chunk, in their order.

    The trajectories of about `window_frames` vote together, so that memory does not grow with the take. Where `edits`
    name blobs, the points that these make have their names, and `unedited` is what was labelled without.
    Raises JobError when there are fewer than two cameras, or a frame has more blobs than any capture.
    """
    work = _Work(cameras, model, namer_of(model, method), rate, target, edits)
    reconstructor = Reconstructor(cameras, rate)
    waiting: list[tuple[Blobs, Reconstructed]] = []
    seconds = 0.0
    for blobs in chunks:
        begin = perf_counter()
        waiting.append((blobs, reconstructor.reconstruct(blobs)))
        seconds += perf_counter() - begin
        if sum(len(part.frames) for part, _ in waiting) >= window_frames:
            yield from _labelled(work, waiting, seconds)
            waiting, seconds = [], 0.0
    if waiting:
        yield from _labelled(work, waiting, seconds)


def _labelled(work: _Work, waiting: list[tuple[Blobs, Reconstructed]], seconds: float) -> Iterator[LabelledChunk]:
    """The chunks of one window, which took `seconds` to reconstruct."""
    begin = perf_counter()
    markerset, window = work.model.markerset, _window(waiting)
    found, doubts = _named(work, window)
    alone = verdict = _decided(work, window, found, doubts)
    rulings = _rulings(work, window, waiting, alone.labels)
    if rulings is not None:
        verdict = _decided(work, window, rulings.heard(found), doubts, rulings)
        verdict = Verdict(_as_said(verdict.labels, rulings), verdict.suspects)
    named = perf_counter()
    markers = verdict.labels.placed(window.xyz, len(markerset))
    residual = verdict.labels.placed(window.residual, len(markerset))
    motion = motion_of(markers, residual, verdict.labels, markerset, window.frames)
    suspects = verdict.suspects + find_suspects(motion, markerset.markers, work.rate)
    spent = {"place": seconds, "label": named - begin, "fit": perf_counter() - named}
    given, without = (labels[window.frame, window.column] for labels in (verdict.labels, alone.labels))
    first = 0
    for index, (blobs, part) in enumerate(waiting):
        here, last = slice(*window.starts[index : index + 2]), first + len(part.points)
        labels, px = _of_blobs(blobs, part, work.cameras, given[first:last], len(markerset))
        unedited = None
        if rulings is not None:
            unedited, _ = _of_blobs(blobs, part, work.cameras, without[first:last], len(markerset))
        fields = {name: getattr(motion, name)[here] for name in vars(motion)}
        mine = tuple(s for s in suspects if blobs.frames[0] <= s.first <= blobs.frames[-1])
        yield LabelledChunk(labels, type(motion)(**{**fields, "residual_px": px}), mine, spent, unedited)
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
    lasting = (lengths >= min(RECONSTRUCTION.min_points, len(frames)))[column]
    xyz[frame[lasting], column[lasting]] = np.concatenate([part.points for _, part in waiting])[lasting]
    residual[frame[lasting], column[lasting]] = np.concatenate([part.residual for _, part in waiting])[lasting]
    return _Window(frames, starts, frame, column, xyz, residual)


def _named(work: _Work, window: _Window) -> tuple[Labels, tuple[Suspect, ...]]:
    """What frames of a window say on their own; nothing, and why, where nobody in the model's markers is there."""
    markerset, first = work.model.markerset, int(window.frames[0])
    found = Labels.none(*window.residual.shape)
    doubts: tuple[Suspect, ...] = ()
    found = replace(found, rate=np.zeros(window.residual.shape))
    if np.isfinite(window.xyz).any():
        found = Labels.join(work.namer.name(window.xyz, work.rate))
    if sure_share(found, window.xyz, len(markerset)) < REFUSAL.min_sure:
        found = found.kept(np.zeros(found.marker.shape, bool))
        doubts = (Suspect(first, int(window.frames[-1]), f"no subject that wears {markerset.name} was recognised"),)
    return found, doubts


def _decided(
    work: _Work, window: _Window, found: Labels, doubts: tuple[Suspect, ...], rulings: Rulings | None = None
) -> Verdict:
    """The names of a window's points, from what frames say on their own, and from what a person says of some."""
    first, solution = int(window.frames[0]), None
    tracklet = window.tracklet if rulings is None else rulings.parted()
    if work.namer.step == BY_LIKELIHOOD and found.named.any() and can_be_solved(work.model, window.tracklet):
        solution = solution_of(found, tracklet, window.xyz, work.model, work.rate, rulings=rulings)
    verdict = verdict_of(solution, found, tracklet, window.xyz, work.model, work.target, first)
    return Verdict(verdict.labels, tuple(_without_number(one) for one in verdict.suspects) + doubts)


def _rulings(
    work: _Work, window: _Window, waiting: list[tuple[Blobs, Reconstructed]], labels: Labels
) -> Rulings | None:
    """What edits say of a window's points (T, P) with these labels; None where they name no blob of a point.

    A point keeps the name of its blob for as long as it is followed, or to half the way to another that a person named.
    """
    worn, width = work.model.markerset, window.tracklet.shape[1]
    replay = Replay.of_table(labels, len(worn))
    claims: dict[int, dict[int, int]] = {}
    first = 0
    for blobs, part in waiting:
        named = named_points(work.edits, blobs, work.cameras.names, worn.by_name, len(worn), part.rows)
        for point, marker in named.items():
            column, frame = int(window.column[first + point]), int(window.frame[first + point])
            claims.setdefault(column, {})[frame] = marker
        first += len(part.points)
    for column, marker_at in claims.items():
        frames = np.array(sorted(marker_at))
        ends = [0, *((frames[1:] + frames[:-1] + 1) // 2).tolist(), len(window.frames)]
        for frame, begin, end in zip(frames.tolist(), ends[:-1], ends[1:], strict=True):
            there = begin + np.flatnonzero(window.tracklet[begin:end, column] >= 0)
            replay.assign(there, there * width + column, marker_at[frame])
    return Rulings(replay.done(labels), labels, window.tracklet) if claims else None


def _as_said(labels: Labels, rulings: Rulings) -> Labels:
    """The labels (T, P), in which what a person named is that marker, and nothing else is."""
    edited = rulings.edited
    row, column = np.nonzero(labels.named & ~edited.named)
    taken = edited.claim[row, labels.marker[row, column]] != ANYBODY
    kept = labels.named
    kept[row[taken], column[taken]] = False
    named = edited.labels
    followed = Labels(named.marker, np.where(edited.named, BY_TRAJECTORY, named.step), named.confidence)
    return labels.kept(kept).replaced(edited.named, followed)


def _without_number(suspect: Suspect) -> Suspect:
    """The suspect without the number of its trajectory, which is in no file here."""
    if suspect.trajectory is None:
        return suspect
    return replace(suspect, words=f"a trajectory of points {suspect.words}", trajectory=None)


def _of_blobs(blobs: Blobs, part: Reconstructed, cameras: Cameras, given: Labels, markers: int):
    """The labels of a chunk's blobs from those of its points, and (F, M) px how far they are from their points."""
    labels = Labels.none(len(blobs))
    point, camera = np.nonzero((part.rows >= 0) & given.named[:, None])
    rows, marker = part.rows[point, camera], given.marker[point]
    labels.marker[rows], labels.step[rows], labels.confidence[rows] = marker, given.step[point], given.confidence[point]
    off = blobs.xy[rows] - cameras.project(part.points)[camera, point]
    total, count = np.zeros((2, len(blobs.frames), markers))
    at = part.frame[point], marker
    np.add.at(total, at, np.einsum("ni,ni->n", off, off))
    np.add.at(count, at, 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        return labels, np.sqrt(total / count)
