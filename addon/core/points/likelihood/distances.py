# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance constraints: pairs of markers whose distance a subject's movement hardly changes, such as two on one bone.

The shape's Gaussian is linear, so a head or a foot that turns far looks to it like one that changes its form. The
distances know better: a constraint adds to a naming's log likelihood how well the distance between its two points fits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from ...geometry.rigid import pairwise_distances
from .shape import SUBJECT_PRIOR, SubjectPrior


@dataclass(frozen=True)
class ConstraintOptions:
    """Which distances are constraints, and how much one says. All reckoned.

    max_sd_radii       standard deviation of a length in one subject
    min_sd_radii       that a length has at least on another subject
    min_frames         that a length is learned from
    max_of_marker      the surest of a marker, beyond which more say the same again
    max_cost           log likelihood that a broken one takes, before its weight
    max_weight         that one counts with
    total_of_marker    constraints that all of a marker's count for together: they say partly the same
    max_size_ratio     logarithm of a distance over its length, from which it says nothing of the subject's size
    min_size_sd        of the logarithm of subjects' size
    """

    max_sd_radii: float = 0.05
    min_sd_radii: float = 0.006
    min_frames: int = 20
    max_of_marker: int = 12
    max_cost: float = 6.0
    max_weight: float = 0.5
    total_of_marker: float = 4.0
    max_size_ratio: float = 0.4
    min_size_sd: float = 0.05


CONSTRAINING = ConstraintOptions()


@dataclass(frozen=True, eq=False)
class DistanceConstraints:
    """E distance constraints of a subject of mean size.

    pair    (E, 2) markers
    length  (E,) m, and its standard deviation sd (E,) m on a subject never seen, but for its size
    size_sd how much subjects differ in size, as a standard deviation of its logarithm
    """

    pair: np.ndarray
    length: np.ndarray
    sd: np.ndarray
    size_sd: float

    def __len__(self) -> int:
        return len(self.length)

    @cached_property
    def weight(self) -> np.ndarray:
        """(E,) how much each distance constraint counts."""
        ends = np.bincount(self.pair.ravel())[self.pair] if len(self) else np.ones((0, 2))
        return np.minimum(CONSTRAINING.max_weight, CONSTRAINING.total_of_marker / np.sqrt(ends.prod(axis=1)))

    def fit(self, distance: np.ndarray, constraint: np.ndarray) -> np.ndarray:
        """What distances, m for a subject of mean size, add to the log likelihood of naming the ends of constraints."""
        fit = distance - self.length[constraint]
        # In place and in few passes: with many distance constraints most of the time is spent here.
        fit /= self.sd[constraint]
        fit *= fit
        fit *= -0.5
        fit += 0.5
        np.maximum(fit, -CONSTRAINING.max_cost, out=fit)
        fit *= self.weight[constraint]
        return fit

    def size(self, points: np.ndarray, naming: np.ndarray) -> np.ndarray:
        """(N,) the size of the subject of each naming (N, M) of points (N, P, 3) m; 1 is the mean."""
        ends = naming[:, self.pair]
        first, second = (
            np.take_along_axis(points, np.maximum(end, 0)[..., None], axis=1) for end in np.moveaxis(ends, 2, 0)
        )
        ratio = np.log(np.maximum(np.linalg.norm(first - second, axis=-1), 1e-6) / self.length)
        weight = np.where(
            (ends >= 0).all(axis=2) & (np.abs(ratio) < CONSTRAINING.max_size_ratio), (self.length / self.sd) ** 2, 0
        )
        # A marker is in several distance constraints, so these are not as many measurements as they look.
        weight = weight * (2 / points.shape[1])
        return np.exp((weight * ratio).sum(axis=1) / (weight.sum(axis=1) + self.size_sd**-2))


def learn_constraints(
    subjects: Sequence[np.ndarray],
    radius: float,
    images: Sequence[np.ndarray] = (),
    options: ConstraintOptions = CONSTRAINING,
    prior: SubjectPrior = SUBJECT_PRIOR,
) -> DistanceConstraints:
    """The constraints of labelled clouds, one array (T, M, 3) m a subject, NaN where missing; of mirror images too.

    `radius` is the shape's.
    """
    pair = np.array(np.triu_indices(subjects[0].shape[1], 1)).T
    lengths, spreads = np.array(
        [_lengths(points, pair, options.min_frames) for points in (*subjects, *images)]
    ).transpose(1, 0, 2)
    count = np.isfinite(lengths).sum(axis=0)
    within = np.sqrt(_mean_seen(spreads))
    stiff = (count > 0) & (within < options.max_sd_radii * radius)
    pair, lengths, within, count = pair[stiff], lengths[:, stiff], within[stiff], count[stiff]
    ratio = np.log(lengths / _mean_seen(lengths))
    size = np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else 0.0 for row in ratio])
    sized = lengths / np.exp(size)[:, None]
    length = _mean_seen(sized)
    between = _mean_seen((sized - length) ** 2) * count / np.maximum(count - 1, 1)
    # Mirror images show no other subject.
    others = np.maximum(count * len(subjects) / (len(subjects) + len(images)) - 1, 0)
    guess = (prior.marker_sd_radii * radius) ** 2 + (prior.length_sd * length) ** 2
    between = (others * prior.between**2 * between + prior.weight * guess) / (others + prior.weight)
    sd = np.sqrt(within**2 + between + (options.min_sd_radii * radius) ** 2)
    kept = surest(pair, sd, options.max_of_marker)
    return DistanceConstraints(pair[kept], length[kept], sd[kept], max(float(np.std(size)), options.min_size_sd))


def surest(pair: np.ndarray, sd: np.ndarray, count: int) -> np.ndarray:
    """Indices of the constraints that are among the `count` surest of one of their ends."""
    order = np.argsort(sd, kind="stable")
    kept = np.zeros(len(sd), dtype=bool)
    for marker in np.unique(pair):
        kept[order[(pair[order] == marker).any(axis=1)][:count]] = True
    return np.flatnonzero(kept)


def _mean_seen(values: np.ndarray) -> np.ndarray:
    """Mean over subjects (S, E), of those who have it; 0 where none has."""
    seen = np.isfinite(values)
    return np.where(seen, values, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)


def _lengths(points: np.ndarray, pair: np.ndarray, min_frames: int) -> tuple[np.ndarray, np.ndarray]:
    """Median distance (E,) and its variance (E,) of one subject; NaN where too seldom seen together."""
    distance = np.linalg.norm(points[:, pair[:, 0]] - points[:, pair[:, 1]], axis=-1)
    known = np.isfinite(distance)
    enough = known.sum(axis=0) >= min(min_frames, len(points))
    middle = np.full(len(pair), np.nan)
    middle[enough] = np.nanmedian(distance[:, enough], axis=0)
    squares = np.where(known, distance - np.where(enough, middle, 0), 0) ** 2
    return middle, np.where(enough, squares.sum(axis=0) / np.maximum(known.sum(axis=0), 1), np.nan)


@dataclass(frozen=True, eq=False)
class Pulls:
    """What the distance constraints say of N namings.

    total   (N,) of all distance constraints with both ends named
    at      (N, M, P) of each marker's distance constraints if it were at each point, its other ends as they are named
    joined  (M, M) index of the distance constraint between two markers, -1 without one
    between (N, P, P) the points' distances, m for a subject of mean size
    """

    total: np.ndarray
    at: np.ndarray
    joined: np.ndarray = field(metadata={"rows": False})
    between: np.ndarray


def pulls(constraints: DistanceConstraints, points: np.ndarray, naming: np.ndarray) -> Pulls:
    """What the distance constraints say of namings (N, M) of points (N, P, 3) m."""
    markers = naming.shape[1]
    joined = np.full((markers, markers), -1)
    one, other = np.concatenate([constraints.pair, constraints.pair[:, ::-1]]).T
    constraint = np.tile(np.arange(len(constraints)), 2)
    joined[one, other] = constraint
    distance = pairwise_distances(points) / constraints.size(points, naming)[:, None, None]
    rows = np.arange(len(naming))[:, None]
    fit = constraints.fit(distance[rows, np.maximum(naming[:, other], 0)], constraint[:, None])
    fit *= (naming[:, other] >= 0)[..., None]
    at = (one == np.arange(markers)[:, None]).astype(fit.dtype) @ fit
    own = np.take_along_axis(at, np.maximum(naming, 0)[..., None], axis=2)[..., 0]
    return Pulls(0.5 * np.where(naming >= 0, own, 0).sum(axis=1), at, joined, distance)


def total_fit(constraints: DistanceConstraints, points: np.ndarray, naming: np.ndarray) -> np.ndarray:
    """(N,) what all distance constraints with both ends named say of namings (N, M) of points (N, P, 3) m."""
    ends = naming[:, constraints.pair]
    first, second = (
        np.take_along_axis(points, np.maximum(end, 0)[..., None], axis=1) for end in np.moveaxis(ends, 2, 0)
    )
    distance = np.linalg.norm(first - second, axis=-1) / constraints.size(points, naming)[:, None]
    return (constraints.fit(distance, np.arange(len(constraints))) * (ends >= 0).all(axis=2)).sum(axis=1)
