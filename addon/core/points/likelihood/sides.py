# SPDX-License-Identifier: GPL-3.0-or-later
"""On which side of three others a marker is: what distances, which are the same in a mirror, cannot tell.

Thumb and little finger's side of a wrist, front and back of a plate, left and right are as far from all else if they
are exchanged as before. They are not on the same side of it.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from ...data.physical import SIGMAS
from ...data.takes import evenly_spread
from .distances import CONSTRAINING, MAX_OF_MARKER, lengths_of, mean_seen
from .shape import SHAPE_FRAMES, SUBJECT_PRIOR


class SIDES:
    """Which sides are learned."""

    near: int = 8  # memory and time: of a marker, whose distances keep best, that make its planes
    planes: int = 3  # memory and time: of a marker that count, those that tell its side best of what a take shows


@dataclass(frozen=True, eq=False)
class Sides:
    """How high the first of four markers is over the plane of the others, as its right-hand screw points."""

    markers: np.ndarray  # (Q, 4), of a marker those first that tell its side best
    height: np.ndarray  # (Q,) m
    variance: np.ndarray  # (Q,) m², of all frames of all subjects

    def __len__(self) -> int:
        return len(self.markers)

    @cached_property
    def _of_marker(self) -> list[np.ndarray]:
        """Where those of each one's marker begin (Q,), and where they end (Q,)."""
        return [np.searchsorted(self.markers[:, 0], self.markers[:, 0], side) for side in ("left", "right")]

    def share(self, seen: np.ndarray) -> np.ndarray:
        """(K, Q) of its marker's one voice that each has of those that are seen (K, Q): more say the same again."""
        first, end = self._of_marker
        before = np.cumsum(seen, axis=1) - seen
        asked = seen & (before - before[:, first] < SIDES.planes)
        return asked / np.minimum(end - first, SIDES.planes)

    def odds(self, height: np.ndarray, size: float, layout_m: float) -> np.ndarray:
        """(..., Q) by how much likelier a marker as high is on this side than on any, as a logarithm: at most log 2.

        height (..., Q) m as seen on a subject of that size, whose markers sit elsewhere by `layout_m`; NaN is unknown.
        """
        odds = np.nan_to_num(2 * height * size * self.height / (self.variance + layout_m**2))
        return np.log(2) - np.logaddexp(0, -odds)


NO_SIDES = Sides(np.zeros((0, 4), int), np.zeros(0), np.zeros(0))


def heights(points: np.ndarray) -> np.ndarray:
    """(...) m, how high the first of four points (..., 4, 3) m is over the others' plane; NaN where one is missing."""
    (ax, ay, az), (bx, by, bz), up = (np.moveaxis(points[..., one, :] - points[..., 1, :], -1, 0) for one in (2, 3, 0))
    # NumPy's cross product takes three times as long.
    normal = np.stack([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])
    with np.errstate(invalid="ignore", divide="ignore"):
        return (normal * up).sum(axis=0) / np.sqrt((normal**2).sum(axis=0))


def learn_sides(subjects: Sequence[np.ndarray], radius: float) -> Sides:
    """The sides that labelled clouds show best, one array (T, M, 3) m a subject, NaN where missing.

    Mirror images, with the sides' names exchanged, are subjects like others. `radius` is the shape's.
    """
    some = [points[evenly_spread(len(points), SHAPE_FRAMES)] for points in subjects]
    markers, keep = _fours(_steadiness(some), CONSTRAINING.max_sd_radii * radius)
    if not len(markers):
        return NO_SIDES
    mean, variance = (np.stack(each) for each in zip(*(_moments(points, markers) for points in some), strict=True))
    height, count = mean_seen(mean), np.isfinite(mean).sum(axis=0)
    variance = mean_seen(variance + (mean - height) ** 2)
    known = (count > 0) & (keep | (height**2 > SIGMAS**2 * variance))
    markers, height, variance = markers[known], height[known], variance[known]
    clear = height**2 / (variance + (SUBJECT_PRIOR.marker_sd_radii * radius) ** 2)
    order = np.lexsort((-clear, markers[:, 0]))
    first = np.searchsorted(markers[order, 0], markers[order, 0])
    kept = order[np.arange(len(order)) - first < MAX_OF_MARKER]
    return Sides(markers[kept], height[kept], variance[kept])


def _steadiness(subjects: Sequence[np.ndarray]) -> np.ndarray:
    """(M, M) m, standard deviation of each distance in frames of one subject, infinity where that is not known.

    NaN of each from itself.
    """
    count = subjects[0].shape[1]
    spreads = np.stack([lengths_of(points, CONSTRAINING.min_frames)[1] for points in subjects])
    every = np.full((count, count), np.inf)
    every[np.triu_indices(count, 1)] = np.where(np.isfinite(spreads).any(axis=0), np.sqrt(mean_seen(spreads)), np.inf)
    np.fill_diagonal(every, np.nan)  # nothing is near itself
    return np.minimum(every, every.T)


def _fours(varies: np.ndarray, most: float) -> tuple[np.ndarray, np.ndarray]:
    """Each marker with every three of those whose distances keep best (Q, 4), and whether all six distances keep (Q,).

    Three of four keep theirs. The last may be across a joint: a shank is always above its foot.
    """
    near = np.argsort(varies, axis=1, kind="stable")[:, : min(SIDES.near, len(varies) - 1)]
    three = np.array(list(combinations(range(near.shape[1]), 3)), int).reshape(-1, 3)
    every = np.arange(len(varies))
    fours = np.concatenate([np.repeat(every, len(three))[:, None], near[:, three].reshape(-1, 3)], axis=1)
    away = ~(varies[fours[:, :, None], fours[:, None]] < most) & ~np.eye(4, dtype=bool)
    bends = np.stack([away.sum(axis=(1, 2)) - 2 * away[:, last].sum(axis=1) for last in range(4)])
    some = (bends == 0).any(axis=0)
    return fours[some], ~away[some].any(axis=(1, 2))


def _moments(points: np.ndarray, markers: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(Q,) m the mean height, and (Q,) m² its variance, in frames (T, M, 3) m; NaN where too few show it."""
    total, squares, count = np.zeros((3, len(markers)))
    for frame in points.astype(float):
        height = heights(frame[markers])
        seen = np.isfinite(height)
        height = np.where(seen, height, 0)
        total += height
        squares += height**2
        count += seen
    enough = count >= max(min(CONSTRAINING.min_frames, len(points)), 1)
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(enough, total / count, np.nan)
        return mean, np.where(enough, np.maximum(squares / count - mean**2, 0), np.nan)
