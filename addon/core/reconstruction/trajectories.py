# SPDX-License-Identifier: GPL-3.0-or-later
"""Unnamed 3D points from unnamed blobs, as trajectories: a take from end to end, of which one chunk is held."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..blobs.subject import SUBJECT
from ..data.errors import JobError
from ..data.takes import Blobs
from ..geometry.cameras import Cameras
from ..geometry.triangulation import trimmed_deviation
from ..geometry.views import Sight, View, split_views
from ..papers.virtual_occlusions.labelling import Rules
from .linking import Links
from .matching import Circumstances, Expected, FrameMatcher, FramePoints

LEARNING_FRAMES = 12  # of the first chunk that the circumstances are learned from, twice


@dataclass(frozen=True)
class ReconstructionOptions:
    """How a capture's circumstances are learned.

    Measured on walks in 4 to 8 cameras: half or twice of each number changes 1 % of the points at most; of the two
    shares, `first_seen` and `max_seen`, half of it, as twice of it would be more than all.

    min_points  measured: of a trajectory; a shorter one is a passing coincidence of rays
    first_seen  measured: assumed before anything is seen: `Circumstances.seen`, and
    first_ghosts  measured: `Circumstances.ghosts`
    min_seen  measured: least that may be assumed; points of many rays, which say it, are the ones that are seen well,
        and
    max_seen  measured: most
    min_ghosts  measured: a frame, in every camera
    new_share  measured: of what a chunk shows in what is believed from then on
    """

    min_points: int = 5
    first_seen: float = 0.6
    first_ghosts: float = 3.0
    min_seen: float = 0.2
    max_seen: float = 0.7
    min_ghosts: float = 0.2
    new_share: float = 0.3


RECONSTRUCTION = ReconstructionOptions()


@dataclass(frozen=True, eq=False)
class Reconstructed:
    """The points of one chunk of F frames, Q in all, frame after frame.

    frames      (F,) the source's own frame numbers
    frame       (Q,) index into `frames`
    trajectory  (Q,) number of the trajectory, from nought, the same over all chunks
    points      (Q, 3) m
    residual    (Q,) m, root mean square distance of the point from its rays
    rows        (Q, C) the row of each camera's blob of the point in the chunk, -1 where it has none
    pixel       px, standard deviation of a blob's position, as the take shows it
    """

    frames: np.ndarray
    frame: np.ndarray
    trajectory: np.ndarray
    points: np.ndarray
    residual: np.ndarray
    rows: np.ndarray
    pixel: float

    @property
    def support(self) -> np.ndarray:
        """(Q,) cameras whose blobs make the point."""
        return (self.rows >= 0).sum(axis=1)


class TrajectorySpans:
    """How many points the N trajectories of a take have, and in which frames, as chunks come in.

    table  (N, 3) points, first and last frame, by the index in the take
    """

    def __init__(self):
        self.table = np.zeros((0, 3), np.int64)

    def note(self, trajectory: np.ndarray, frame: np.ndarray):
        """Counts points (Q,) of more frames."""
        fresh = int(trajectory.max(initial=-1)) + 1 - len(self.table)
        if fresh > 0:
            self.table = np.concatenate([self.table, np.tile([0, np.iinfo(np.int64).max, -1], (fresh, 1))])
        np.add.at(self.table[:, 0], trajectory, 1)
        np.minimum.at(self.table[:, 1], trajectory, frame)
        np.maximum.at(self.table[:, 2], trajectory, frame)

    def lasting(self, frames: int) -> np.ndarray:
        """(P,) those that are no passing coincidence of rays in a take of so many frames, as they begin."""
        kept = np.flatnonzero(self.table[:, 0] >= min(RECONSTRUCTION.min_points, frames))
        return kept[np.argsort(self.table[kept, 1], kind="stable")]


def reconstruct_take(chunks: Iterable[Blobs], cameras: Cameras, rate: float = 100.0) -> Iterator[Reconstructed]:
    """Points from the blobs of a take, chunk by chunk: one `Reconstructed` for each of `chunks`, in their order.

    `rate` is frames a second. Raises JobError when there are fewer than two cameras, or a frame has more blobs than
    any capture.
    """
    if len(cameras) < 2:
        raise JobError(f"{len(cameras)} camera cannot fix a point in space; expected two or more")
    reconstructor = Reconstructor(cameras, rate)
    for blobs in chunks:
        yield reconstructor.reconstruct(blobs)


class Reconstructor:
    """Reconstructs the chunks of one take in their order; between them it keeps the trajectories' ends."""

    def __init__(self, cameras: Cameras, rate: float):
        self.cameras, self.sight, self.links = cameras, Sight(cameras), Links.at(rate)
        ghosts = np.full(len(cameras), RECONSTRUCTION.first_ghosts)
        self.circumstances = Circumstances(Rules.pixel, RECONSTRUCTION.first_seen, ghosts)
        self.learned = False

    def reconstruct(self, blobs: Blobs) -> Reconstructed:
        """The points of the next chunk."""
        views = split_views(blobs, self.cameras)
        if not self.learned:
            self._learn_first(views)
        found, numbers = [], []
        for view in views:
            found.append(self._match(view, self.links.expected()))
            numbers.append(self.links.link(found[-1].points))
        self._learn(views, found, RECONSTRUCTION.new_share)
        counts = [len(points.points) for points in found]
        points, residual = (np.concatenate([getattr(one, name) for one in found]) for name in ("points", "residual"))
        rows = np.concatenate([_rows(view, one) for view, one in zip(views, found, strict=True)])
        frame, trajectory = np.repeat(np.arange(len(views)), counts), np.concatenate(numbers)
        return Reconstructed(blobs.frames, frame, trajectory, points, residual, rows, self.circumstances.pixel)

    def _match(self, view: View, expected: Expected) -> FramePoints:
        if not view.count:
            return FramePoints.nothing(len(self.cameras))
        return FrameMatcher(view, self.sight, self.cameras.size, self.circumstances).match(expected)

    def _learn_first(self, views: list[View]):
        """What the capture is like, from frames spread over the first chunk, each on its own."""
        full = [view for view in views if view.count]
        sample = full[:: max(len(full) // LEARNING_FRAMES, 1)][:LEARNING_FRAMES]
        for _ in range(2 if sample else 0):
            matched = [self._match(view, Expected.nothing()) for view in sample]
            self.learned |= self._learn(sample, matched, 1.0)

    def _learn(self, views: list[View], found: list[FramePoints], share: float) -> bool:
        """Moves what is believed of the capture by `share` towards what these frames show; whether they could."""
        if not found:
            return False
        support, squares, watching = (
            np.concatenate([getattr(points, name) for points in found]) for name in ("support", "squares", "watching")
        )
        pixel = _pixel_noise(squares, support)
        if not np.isfinite(pixel):
            return False
        blobs = np.sum([view.real.sum(axis=1) for view in views], axis=0)
        used = np.sum([(points.slots >= 0).sum(axis=0) for points in found], axis=0)
        old, options = self.circumstances, RECONSTRUCTION
        many = support >= 3
        seen = np.clip(support[many].sum() / max(watching[many].sum(), 1), options.min_seen, options.max_seen)
        self.circumstances = replace(
            old,
            pixel=float(np.clip(old.pixel + share * (pixel - old.pixel), SUBJECT.min_noise_px, SUBJECT.max_noise_px)),
            seen=float(old.seen + share * (seen - old.seen)),
            ghosts=np.maximum(old.ghosts + share * ((blobs - used) / len(views) - old.ghosts), options.min_ghosts),
        )
        return True


def _rows(view: View, points: FramePoints) -> np.ndarray:
    """(Q, C) the rows of the points' blobs in their chunk, -1 where there is none."""
    rows = view.row[np.arange(len(view.row)), np.maximum(points.slots, 0)]
    return np.where(points.slots >= 0, rows, -1)


def _pixel_noise(squares: np.ndarray, support: np.ndarray) -> float:
    """px, standard deviation of the blobs' positions as the meeting rays show it; NaN when too few rays meet.

    The worst of the points do not count: a wrong set or a merged blob is not noise.
    """
    freedom = 2.0 * support - 3
    many = support >= 3
    if many.sum() < Rules.min_meetings:
        many = support >= 2
    if many.sum() < Rules.min_meetings:
        return float("nan")
    return trimmed_deviation(squares[many], freedom[many])
