# SPDX-License-Identifier: GPL-3.0-or-later
"""Unnamed 3D points from unnamed blobs, as trajectories: a take from end to end, of which one chunk is held."""

from collections.abc import Iterable, Iterator, Sequence
from copy import deepcopy
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
from .matching import MAX_RAY_PAIRS, Circumstances, FramePoints, Matcher, joined

MATCHED_FRAMES = 2  # measured: more of them lose points of two rays that begin
LEARNING_FRAMES = 4  # of the first chunk that the circumstances are learned from, half of them first


class RECONSTRUCTION:
    """How a capture's circumstances are learned.

    Measured on walks in 4 to 8 cameras: half or twice of each number changes 1 % of the points at most; of `max_seen`
    half of it, as twice of it would be more than all.
    """

    min_points: int = 5  # measured: of a trajectory; a shorter one is a passing coincidence of rays
    first_ghosts: float = 3.0  # measured: `Circumstances.ghosts` before anything is seen
    # least that may be assumed; points of many rays, which say it, are the ones that are seen well, and
    min_seen: float = 0.2  # measured
    max_seen: float = 0.7  # measured: most, which is assumed before anything is seen
    min_ghosts: float = 0.2  # measured: a frame, in every camera
    new_share: float = 0.3  # measured: of what a chunk shows in what is believed from then on


@dataclass(frozen=True, eq=False)
class Reconstructed:
    """The points of one chunk of F frames, Q in all, frame after frame."""

    frames: np.ndarray  # (F,) the source's own frame numbers
    frame: np.ndarray  # (Q,) index into `frames`
    trajectory: np.ndarray  # (Q,) number of the trajectory, from nought, the same over all chunks
    points: np.ndarray  # (Q, 3) m
    residual: np.ndarray  # (Q,) m, root mean square distance of the point from its rays
    rows: np.ndarray  # (Q, C) the row of each camera's blob of the point in the chunk, -1 where it has none
    pixel: float  # px, standard deviation of a blob's position, as the take shows it

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
        self.circumstances = Circumstances(Rules.pixel, RECONSTRUCTION.max_seen, ghosts)
        self.learned = False

    def reconstruct(self, blobs: Blobs) -> Reconstructed:
        """The points of the next chunk."""
        views = split_views(blobs, self.cameras)
        self.learn_once(views)
        found, numbers = [FramePoints.nothing(len(self.cameras))], [np.zeros(0, int)]
        for first in range(0, len(views), MATCHED_FRAMES):
            matcher = self.matcher(views[first : first + MATCHED_FRAMES])
            found += [
                replace(points, frame=points.frame + first, slots=matcher.rows(points.slots))
                for points in self._followed(matcher, numbers)
            ]
        every = joined(found)
        self._learn(views, every, RECONSTRUCTION.new_share)
        made = every.frame, np.concatenate(numbers), every.points, every.residual, every.slots
        return Reconstructed(blobs.frames, *made, self.circumstances.pixel)

    def _followed(self, matcher: Matcher, numbers: list[np.ndarray]) -> Iterator[FramePoints]:
        """The points of a few frames at a time; the numbers of their trajectories are added to `numbers`.

        So many frames as leave about as many pairs of rays as may be tried, at least one.
        """
        end = 0
        while end < matcher.count:
            first, links, pairs = end, deepcopy(self.links), 0
            expected, continued = [], []
            while end < matcher.count and pairs < MAX_RAY_PAIRS:
                expected.append(links.expected(end))
                slots, points, left = matcher.continued(end, expected[-1])
                continued.append(slots)
                links.link(points)
                pairs += left**2 // 2
                end += 1
            found = matcher.match(first, end, joined(expected), np.concatenate(continued))
            numbers += [self.links.link(found.points[found.frame == frame]) for frame in range(first, end)]
            yield found

    def matcher(self, views: Sequence[View]) -> Matcher:
        """The blobs of some frames, ready to be matched by what is believed of the capture."""
        return Matcher(views, self.sight, self.cameras.size, self.circumstances)

    def learn_once(self, views: Sequence[View], frames: int = LEARNING_FRAMES):
        """What the capture is like, from so many frames spread over a chunk, each on its own; until it is known."""
        if self.learned:
            return
        full = [view for view in views if view.count]
        sample = full[:: max(len(full) // frames, 1)][:frames]
        for some in (sample[::2], sample) if sample else ():  # what is not known yet costs most
            matched = [self.matcher([view]).match(0, 1) for view in some]
            self.learned |= self._learn(some, joined(matched), 1.0)

    def _learn(self, views: list[View], found: FramePoints, share: float) -> bool:
        """Moves what is believed of the capture by `share` towards what these frames show; whether they could."""
        support, watching = found.support, found.watching
        pixel = _pixel_noise(found.squares, support)
        if not np.isfinite(pixel):
            return False
        blobs = np.sum([view.real.sum(axis=1) for view in views], axis=0)
        used = (found.slots >= 0).sum(axis=0)
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
