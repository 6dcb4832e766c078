# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance constraints: pairs of markers whose distance a subject's movement hardly changes, such as two on one bone.

The shape's Gaussian is linear, so a head or a foot that turns far looks to it like one that changes its form. The
distances know better: a distance constraint adds to a naming's log likelihood how well the distance between its two points fits.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from .shape import BUILDS, GUESSED

STIFF = 0.05  # radii: largest standard deviation of a distance constraint's length in one subject
LEAST_SD = 0.006  # radii
STRANGE = 1.3  # a handful of subjects shows less than the true spread between people
BUILDS_SHARE = 0.03  # of a length, that others differ by besides where their markers sit: taken for granted too
LIMIT = 6.0  # the most a broken distance constraint costs, before trust
TRUST = 0.5  # the most that a distance constraint counts, and
SAID = 4.0  # distance constraints that all of a marker's count for together: they say partly the same
WILD = 0.4  # log ratio from which a distance says nothing of the subject's size
LEAST_SIZE_SD = 0.05
FEWEST = 20  # frames that a length is learned from
ENOUGH = 12  # distance constraints of a marker, the surest, beyond which more say the same again


@dataclass(frozen=True, eq=False)
class DistanceConstraints:
    """E distance constraints of a subject of mean size.

    pair    (E, 2) markers
    length  (E,) m, and its standard deviation sd (E,) m on a subject never seen, size apart
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
        return np.minimum(TRUST, SAID / np.sqrt(ends.prod(axis=1)))

    def fit(self, distance: np.ndarray, constraint: np.ndarray) -> np.ndarray:
        """What distances, m for a subject of mean size, add to the log likelihood of naming the ends of these distance constraints."""
        told = distance - self.length[constraint]
        # In place and in few passes: with many distance constraints most of the time is spent here.
        told /= self.sd[constraint]
        told *= told
        told *= -0.5
        told += 0.5
        np.maximum(told, -LIMIT, out=told)
        told *= self.weight[constraint]
        return told

    def size(self, points: np.ndarray, naming: np.ndarray) -> np.ndarray:
        """(N,) the size of the subject of each naming (N, M) of points (N, P, 3) m; 1 is the mean."""
        ends = naming[:, self.pair]
        first, second = (
            np.take_along_axis(points, np.maximum(end, 0)[..., None], axis=1) for end in np.moveaxis(ends, 2, 0)
        )
        ratio = np.log(np.maximum(np.linalg.norm(first - second, axis=-1), 1e-6) / self.length)
        weight = np.where((ends >= 0).all(axis=2) & (np.abs(ratio) < WILD), (self.length / self.sd) ** 2, 0)
        # A marker is in several distance constraints, so these are not as many measurements as they look.
        weight = weight * (2 / points.shape[1])
        return np.exp((weight * ratio).sum(axis=1) / (weight.sum(axis=1) + self.size_sd**-2))


def learn_constraints(
    subjects: Sequence[np.ndarray], radius: float, images: Sequence[np.ndarray] = ()
) -> DistanceConstraints:
    """The distance constraints of labelled clouds, one array (T, M, 3) m a subject, NaN where missing; of their mirror images too.

    `radius` is the shape's.
    """
    pair = np.array(np.triu_indices(subjects[0].shape[1], 1)).T
    lengths, spreads = np.array([_lengths(points, pair) for points in (*subjects, *images)]).transpose(1, 0, 2)
    count = np.isfinite(lengths).sum(axis=0)
    within = np.sqrt(_mean_seen(spreads))
    stiff = (count > 0) & (within < STIFF * radius)
    pair, lengths, within, count = pair[stiff], lengths[:, stiff], within[stiff], count[stiff]
    ratio = np.log(lengths / _mean_seen(lengths))
    size = np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else 0.0 for row in ratio])
    sized = lengths / np.exp(size)[:, None]
    length = _mean_seen(sized)
    between = _mean_seen((sized - length) ** 2) * count / np.maximum(count - 1, 1)
    # Mirror images tell of no other subject.
    others = np.maximum(count * len(subjects) / (len(subjects) + len(images)) - 1, 0)
    guess = (BUILDS * radius) ** 2 + (BUILDS_SHARE * length) ** 2
    between = (others * STRANGE**2 * between + GUESSED * guess) / (others + GUESSED)
    sd = np.sqrt(within**2 + between + (LEAST_SD * radius) ** 2)
    kept = _surest(pair, sd)
    return DistanceConstraints(pair[kept], length[kept], sd[kept], max(float(np.std(size)), LEAST_SIZE_SD))


def _surest(pair: np.ndarray, sd: np.ndarray) -> np.ndarray:
    """Indices of the distance constraints that are among the ENOUGH surest of one of their ends."""
    order = np.argsort(sd, kind="stable")
    kept = np.zeros(len(sd), dtype=bool)
    for marker in np.unique(pair):
        kept[order[(pair[order] == marker).any(axis=1)][:ENOUGH]] = True
    return np.flatnonzero(kept)


def _mean_seen(values: np.ndarray) -> np.ndarray:
    """Mean over subjects (S, E), of those who have it; 0 where none has."""
    seen = np.isfinite(values)
    return np.where(seen, values, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)


def _lengths(points: np.ndarray, pair: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Median distance (E,) and its variance (E,) of one subject; NaN where too seldom seen together."""
    distance = np.linalg.norm(points[:, pair[:, 0]] - points[:, pair[:, 1]], axis=-1)
    known = np.isfinite(distance)
    enough = known.sum(axis=0) >= min(FEWEST, len(points))
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
    apart   (N, P, P) the points' distances, m for a subject of mean size
    """

    total: np.ndarray
    at: np.ndarray
    joined: np.ndarray = field(metadata={"rows": False})
    apart: np.ndarray


def pulls(constraints: DistanceConstraints, points: np.ndarray, naming: np.ndarray) -> Pulls:
    """What the distance constraints say of namings (N, M) of points (N, P, 3) m."""
    markers = naming.shape[1]
    joined = np.full((markers, markers), -1)
    joined[constraints.pair[:, 0], constraints.pair[:, 1]] = joined[constraints.pair[:, 1], constraints.pair[:, 0]] = (
        np.arange(len(constraints))
    )
    one, other = np.concatenate([constraints.pair, constraints.pair[:, ::-1]]).T
    constraint = np.tile(np.arange(len(constraints)), 2)
    distance = _distances(points) / constraints.size(points, naming)[:, None, None]
    rows = np.arange(len(naming))[:, None]
    told = constraints.fit(distance[rows, np.maximum(naming[:, other], 0)], constraint[:, None])
    told *= (naming[:, other] >= 0)[..., None]
    at = (one == np.arange(markers)[:, None]).astype(told.dtype) @ told
    own = np.take_along_axis(at, np.maximum(naming, 0)[..., None], axis=2)[..., 0]
    return Pulls(0.5 * np.where(naming >= 0, own, 0).sum(axis=1), at, joined, distance)


def told_by(constraints: DistanceConstraints, points: np.ndarray, naming: np.ndarray) -> np.ndarray:
    """(N,) what all distance constraints with both ends named say of namings (N, M) of points (N, P, 3) m."""
    ends = naming[:, constraints.pair]
    first, second = (
        np.take_along_axis(points, np.maximum(end, 0)[..., None], axis=1) for end in np.moveaxis(ends, 2, 0)
    )
    distance = np.linalg.norm(first - second, axis=-1) / constraints.size(points, naming)[:, None]
    return (constraints.fit(distance, np.arange(len(constraints))) * (ends >= 0).all(axis=2)).sum(axis=1)


def _distances(points: np.ndarray) -> np.ndarray:
    square = (points**2).sum(axis=2)
    apart = square[:, :, None] + square[:, None] - 2 * (points @ points.transpose(0, 2, 1))
    return np.sqrt(np.maximum(apart, 0))
