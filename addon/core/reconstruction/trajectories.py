# SPDX-License-Identifier: GPL-3.0-or-later
"""Unnamed 3D points from unnamed blobs, as trajectories: a take from end to end, of which one chunk is held."""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np

from ..data.errors import JobError
from ..data.physical import MARKER_LIMITS
from ..data.takes import Blobs, evenly_spread
from ..geometry.cameras import Cameras
from ..geometry.triangulation import trimmed_deviation
from ..geometry.views import Sight, View, split_views
from .linking import LINKING, Links
from .matching import Expected, FrameMatcher, FramePoints, joined


@dataclass(frozen=True)
class ReconstructionOptions:
    """How a capture is begun, and what counts as a trajectory.

    min_points      measured: of a trajectory; a shorter one is a passing coincidence of rays, of which half as many let
                    in twice the breaks
    max_noise_px    measured: px, up to which the deviation of a blob's position is tried, twice as much each time
    sample_frames   measured: of the first chunk that the deviation is taken from; half or twice as many is alike
    opening_frames  measured: at the beginning, of which the calmest is where trajectories begin; twice as many is alike
    """

    min_points: int = 5
    max_noise_px: float = 4.0
    sample_frames: int = 12
    opening_frames: int = 64


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

    def __init__(self, cameras: Cameras, rate: float, options: ReconstructionOptions = RECONSTRUCTION):
        self.cameras, self.sight, self.links, self.options = cameras, Sight(cameras), Links.at(rate), options
        self.pixel, self.learned = MARKER_LIMITS.noise_px, False

    def reconstruct(self, blobs: Blobs) -> Reconstructed:
        """The points of the next chunk."""
        views = split_views(blobs, self.cameras)
        linked = [] if self.learned else self._open(views)
        linked += [self._linked(view, self.links) for view in views[len(linked) :]]
        found, numbers = [points for points, _ in linked], [number for _, number in linked]
        counts = [len(points.points) for points in found]
        columns = {name: np.concatenate([getattr(points, name) for points in found]) for name in ("points", "residual")}
        rows = np.concatenate([_rows(view, points) for view, points in zip(views, found, strict=True)])
        frame, trajectory = np.repeat(np.arange(len(views)), counts), np.concatenate(numbers)
        return Reconstructed(blobs.frames, frame, trajectory, rows=rows, pixel=self.pixel, **columns)

    def _linked(self, view: View, links: Links) -> tuple[FramePoints, np.ndarray]:
        """The points of the next frame and the numbers of their trajectories."""
        points = self._match(view, links.expected())
        return points, links.link(points.points)

    def _match(self, view: View, expected: Expected) -> FramePoints:
        if not view.count:
            return FramePoints.nothing(len(self.cameras))
        return FrameMatcher(view, self.sight, self.cameras.size, self.pixel).match(expected)

    def _open(self, views: list[View]) -> list[tuple[FramePoints, np.ndarray]]:
        """The beginning of the take, linked forward and backward from its calmest frame.

        Nothing tells the velocity of a trajectory's first point, and a foot that swings may be at its own toe's place
        in the next frame.
        """
        self.learned = len(views) > 1 and self._learn(views)
        if not self.learned:
            return []
        first = self._calmest(views[: self.options.opening_frames])
        middle = [self._linked(view, self.links) for view in views[first : first + 2]]
        back = self.links.backwards(middle[0][0].points, middle[0][1])
        before = [self._linked(view, back) for view in reversed(views[:first])]
        self.links.begun = back.begun
        return [*reversed(before), *middle]

    def _calmest(self, views: list[View]) -> int:
        """The frame, of those tried that have many points, from which they move least to the next."""
        starts = evenly_spread(len(views) - 1, self.options.sample_frames).tolist()
        pairs = [[part.points for part in self._matched(views[start : start + 2])] for start in starts]
        counts = np.array([len(points) for points, _ in pairs])
        moves = np.where(counts >= np.median(counts), [_movement(*pair) for pair in pairs], np.inf)
        return starts[int(np.argmin(moves))]

    def _learn(self, views: list[View]) -> bool:
        """Takes the deviation of blobs from frames spread over the first chunk, each on its own; whether they show it.

        The coarser blobs are taken to be, the more of them belong to points, which show how coarse they are.
        """
        full = [view for view in views if view.count]
        sample = [full[index] for index in evenly_spread(len(full), self.options.sample_frames)] if full else []
        grows = bool(sample)
        while grows:
            shown = _pixel_noise(self._matched(sample))
            if not np.isfinite(shown):
                return False
            shown = float(np.clip(shown, MARKER_LIMITS.noise_px / 10, self.options.max_noise_px))
            grows, self.pixel = shown > self.pixel, shown
        return bool(sample)

    def _matched(self, views: list[View]) -> list[FramePoints]:
        return [self._match(view, Expected.nothing()) for view in views]


def _rows(view: View, points: FramePoints) -> np.ndarray:
    """(Q, C) the rows of the points' blobs in their chunk, -1 where there is none."""
    rows = view.row[np.arange(len(view.row)), np.maximum(points.slots, 0)]
    return np.where(points.slots >= 0, rows, -1)


def _movement(before: np.ndarray, after: np.ndarray) -> float:
    """m², mean square of how far points (Q, 3) are from the nearest of those after them."""
    if not len(before) or not len(after):
        return np.inf
    distance = np.linalg.norm(before[:, None] - after, axis=2).min(axis=1)
    return float((np.minimum(distance, LINKING.max_reach_m) ** 2).mean())


def _pixel_noise(found: list[FramePoints]) -> float:
    """px, standard deviation of the blobs' positions as the meeting rays show it; NaN where none meet.

    The worst of the points do not count: a wrong set or a merged blob is not noise.
    """
    points = joined(found)
    freedom = 2.0 * points.support - 3
    many = points.support >= min(points.support.max(initial=0), 3)
    return trimmed_deviation(points.squares[many], freedom[many]) if many.any() else float("nan")
