# SPDX-License-Identifier: GPL-3.0-or-later
"""Distance constraints: pairs of markers whose distance a subject's movement hardly changes, such as two on one bone.

The shape's Gaussian is linear, so a head or a foot that turns far looks to it like one that changes its form. The
distances know better: a constraint adds to a naming's log likelihood how well the distance between its two points fits.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...data.errors import InputError
from ...geometry.rigid import pairwise_distances
from .shape import SUBJECT_PRIOR


class CONSTRAINING:
    """Which distances are constraints, and how strong the evidence of one is."""

    # standard deviation of a length in one subject
    max_sd_radii: float = 0.05  # physical: 4 cm, more than skin moves over bone
    # that a length has at least on another subject
    min_sd_radii: float = 0.006  # physical: 5 mm, as markers are put on by hand
    min_frames: int = 20  # that a length is learned from
    # log likelihood that a broken one takes, before its weight
    max_cost: float = 6.0  # measured: with half people of other labs lose 4 %, with twice 6 %
    # that one counts with
    max_weight: float = 0.5  # measured: with 0.25 or 1 names of 1 % of people of other labs are wrong
    # that all of a marker's count for together, as most share a marker
    total_of_marker: float = 4.0  # measured: with half or twice names of 0.7 % of people of other labs are wrong
    # logarithm of a distance over its length, from which it says nothing of the subject's size
    max_size_ratio: float = 0.4  # physical: nobody is half as large again
    min_size_sd: float = 0.05  # of the logarithm of subjects' size; physical: grown people's heights differ by 5 %


MAX_OF_MARKER = 12  # the surest constraints of a marker, beyond which more say the same again; by time


@dataclass(frozen=True, eq=False)
class DistanceConstraints:
    """E distance constraints of a subject of mean size."""

    pair: np.ndarray  # (E, 2) markers
    length: np.ndarray  # (E,) m, and its standard deviation sd (E,) m on a subject never seen, but for its size
    sd: np.ndarray
    size_sd: float  # how much subjects differ in size, as a standard deviation of its logarithm

    def __len__(self) -> int:
        return len(self.length)

    @cached_property
    def weight(self) -> np.ndarray:
        """(E,) how much each distance constraint counts."""
        ends = np.bincount(self.pair.ravel())[self.pair] if len(self) else np.ones((0, 2))
        return np.minimum(CONSTRAINING.max_weight, CONSTRAINING.total_of_marker / np.sqrt(ends.prod(axis=1)))

    @property
    def limits(self) -> tuple[float, float]:
        """What a broken one takes at most, and the most that a length may be off to say anything of the size."""
        return CONSTRAINING.max_cost, CONSTRAINING.max_size_ratio

    def joined(self, markers: int) -> np.ndarray:
        """(M, M) index of the distance constraint between two of so many markers, -1 without one."""
        joined = np.full((markers, markers), -1)
        one, other = self.pair.T
        joined[one, other] = joined[other, one] = np.arange(len(self))
        return joined

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

    @property
    def usual_sizes(self) -> tuple[float, float, float]:
        """The sizes of the smallest and the largest of twenty subjects, and of the mean one between them."""
        far = float(np.exp(2 * self.size_sd))
        return 1 / far, 1.0, far

    def size(self, apart: np.ndarray, known: np.ndarray, markers: int) -> np.ndarray:
        """(N,) the size of the subject of each naming of so many markers; 1 is the mean.

        apart (N, E) m between the ends of each constraint, known (N, E) where both are named.
        """
        ratio = np.log(np.maximum(apart, 1e-6) / self.length)
        weight = np.where(known & (np.abs(ratio) < CONSTRAINING.max_size_ratio), (self.length / self.sd) ** 2, 0)
        # A marker is in several distance constraints, so these are not as many measurements as they look.
        weight = weight * (2 / markers)
        return np.exp((weight * ratio).sum(axis=1) / (weight.sum(axis=1) + self.size_sd**-2))


def learn_constraints(
    subjects: Sequence[np.ndarray], radius: float, images: Sequence[np.ndarray] = ()
) -> DistanceConstraints:
    """The constraints of labelled clouds, one array (T, M, 3) m a subject, NaN where missing; of mirror images too.

    `radius` is the shape's. InputError where no two markers keep their distance.
    """
    pair = np.array(np.triu_indices(subjects[0].shape[1], 1)).T
    lengths, spreads = np.array(
        [lengths_of(points, CONSTRAINING.min_frames) for points in (*subjects, *images)]
    ).transpose(1, 0, 2)
    count = np.isfinite(lengths).sum(axis=0)
    within = np.sqrt(mean_seen(spreads))
    apart = (lengths != 0).all(axis=0)  # two names of one place, be it of a single subject, keep no distance
    stiff = (count > 0) & apart & (within < CONSTRAINING.max_sd_radii * radius)
    if not stiff.any():
        raise InputError(
            "no two markers keep their distance; expected labels that stay on one marker for all of a take"
        )
    pair, lengths, within, count = pair[stiff], lengths[:, stiff], within[stiff], count[stiff]
    ratio = np.log(lengths / mean_seen(lengths))
    size = np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else 0.0 for row in ratio])
    sized = lengths / np.exp(size)[:, None]
    length = mean_seen(sized)
    between = mean_seen((sized - length) ** 2) * count / np.maximum(count - 1, 1)
    # Mirror images show no other subject.
    own = np.isfinite(lengths).reshape(-1, len(subjects), len(pair)).any(axis=0)
    others = np.maximum(own.sum(axis=0) - 1, 0)
    prior = SUBJECT_PRIOR
    guess = (prior.marker_sd_radii * radius) ** 2 + (prior.length_sd * length) ** 2
    between = (others * prior.between**2 * between + guess) / (others + 1)
    sd = np.sqrt(within**2 + between + (CONSTRAINING.min_sd_radii * radius) ** 2)
    kept = surest(pair, sd, MAX_OF_MARKER)
    return DistanceConstraints(pair[kept], length[kept], sd[kept], max(float(np.std(size)), CONSTRAINING.min_size_sd))


def surest(pair: np.ndarray, sd: np.ndarray, count: int) -> np.ndarray:
    """Indices of the constraints that are among the `count` surest of one of their ends."""
    order = np.argsort(sd, kind="stable")
    kept = np.zeros(len(sd), dtype=bool)
    for marker in np.unique(pair):
        kept[order[(pair[order] == marker).any(axis=1)][:count]] = True
    return np.flatnonzero(kept)


def mean_seen(values: np.ndarray) -> np.ndarray:
    """Mean over subjects (S, E), of those who have it; 0 where none has."""
    seen = np.isfinite(values)
    return np.where(seen, values, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)


def lengths_of(points: np.ndarray, min_frames: int) -> np.ndarray:
    """(2, E) median distance, m, and its variance, m², of one subject's pairs of markers, NaN where too seldom seen.

    points (T, M, 3) m, NaN where missing; the pairs are in the order of `np.triu_indices`.
    """
    frames, markers = points.shape[:2]
    # One marker's frames side by side: what is worked on at once stays small, and medians are taken along memory.
    along, found = np.ascontiguousarray(points.transpose(1, 2, 0)), []
    for one in range(markers - 1):
        away = along[one] - along[one + 1 :]
        distance = np.sqrt(np.einsum("mit,mit->mt", away, away))
        known = np.isfinite(distance)
        count = known.sum(axis=1)
        enough = np.flatnonzero(count >= max(min(min_frames, frames), 1))
        distance, known = distance[enough], known[enough]
        middle = np.nanmedian(distance, axis=1) if len(enough) else np.zeros(0)
        row = np.full((2, markers - 1 - one), np.nan)
        row[0, enough] = middle
        row[1, enough] = (np.where(known, distance - middle[:, None], 0) ** 2).sum(axis=1) / count[enough]
        found.append(row)
    return np.concatenate(found, axis=1)


def pulls(constraints: DistanceConstraints, points: np.ndarray, naming: np.ndarray, size: np.ndarray) -> np.ndarray:
    """(N, M, P) what each marker's distance constraints say of it at each point, their other ends as they are named.

    Of namings (N, M) of points (N, P, 3) m of subjects of such a size (N,).
    """
    markers = naming.shape[1]
    one, other = np.concatenate([constraints.pair, constraints.pair[:, ::-1]]).T
    constraint = np.tile(np.arange(len(constraints)), 2)
    distance = pairwise_distances(points) / size[:, None, None]
    # Differences of squares leave a little between a point and itself.
    np.einsum("nii->ni", distance)[...] = 0
    rows = np.arange(len(naming))[:, None]
    fit = constraints.fit(distance[rows, np.maximum(naming[:, other], 0)], constraint[:, None])
    fit *= (naming[:, other] >= 0)[..., None]
    return (one == np.arange(markers)[:, None]).astype(fit.dtype) @ fit


def size_and_fit(
    constraints: DistanceConstraints, points: np.ndarray, naming: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """The subjects' size (N,), and what all distance constraints with both ends named say (N,) of such namings."""
    first, second = naming[:, constraints.pair[:, 0]], naming[:, constraints.pair[:, 1]]
    rows, known = np.arange(len(points))[:, None], (first >= 0) & (second >= 0)
    along = points[rows, np.maximum(first, 0)] - points[rows, np.maximum(second, 0)]
    apart = np.sqrt(np.einsum("nei,nei->ne", along, along))
    size = constraints.size(apart, known, naming.shape[1])
    apart /= size[:, None]
    return size, (constraints.fit(apart, np.arange(len(constraints))) * known).sum(axis=1)
