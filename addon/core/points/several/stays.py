# SPDX-License-Identifier: GPL-3.0-or-later
"""Whoever leaves and comes back: whose a stay is, by who else is there, and by how far markers are from each other.

Nothing holds on to anything over an absence of everybody. Two who are there at a time are two; where that leaves more
ways than one, each stay is named on its own, and the distances on it are held against those of the first stays.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ...data.takes import Labels, evenly_spread
from .places import NO_BODY
from .telling import MIN_MET, OnBody, distances_in


@dataclass(frozen=True)
class StayOptions:
    """How stays are joined. All reckoned.

    fullest   part of the points of a stay at its fullest that must be there for it to be there
    overlap   part of the shorter of two stays in which both may be there, if they are one's
    lead      log odds by which whose stays are whose must be ahead of any other way
    max_ways  that are tried
    frames    of a stay that are looked at
    sd_m      by which the mean of a distance differs from stay to stay, and
    bend      part of it by which it does, as people move otherwise
    max_square  standard deviations², beyond which a distance is no worse
    unnamed   part of the points of a stay above which nobody has said whose it is
    """

    fullest: float = 0.5
    overlap: float = 0.1
    lead: float = 3.0
    max_ways: int = 10_000
    frames: int = 300
    sd_m: float = 0.003
    bend: float = 0.02
    max_square: float = 25.0
    unnamed: float = 0.5


STAYS = StayOptions()


def spans_of(tracklet: np.ndarray, body: np.ndarray, count: int) -> np.ndarray:
    """(T, K) when each of so many stays is there, by the bodies (N,) of tracklets (T, L)."""
    own = np.append(body, NO_BODY)[tracklet]
    there = np.stack([(own == one).sum(axis=1) for one in range(count)], axis=1)
    usual = [np.quantile(column[column > 0], 0.75) if column.any() else 1 for column in there.T]
    return there >= STAYS.fullest * np.array(usual)


def ways_of(there: np.ndarray, count: int) -> list[tuple[int, ...]]:
    """All ways in which stays (T, K) after the first `count`, which are somebody each, can be theirs.

    Stays of one are not there at the same time. None at all where there are too many.
    """
    both = there.T.astype(int) @ there
    length = np.maximum(np.diag(both), 1)
    apart = both <= STAYS.overlap * np.minimum(length[:, None], length)
    may = [np.flatnonzero(apart[stay, :count]).tolist() for stay in range(count, len(apart))]
    if np.prod([float(len(some)) for some in may]) > STAYS.max_ways:
        return []
    pairs = [(one, other) for other in range(count, len(apart)) for one in range(count, other) if not apart[one, other]]
    return [way for way in product(*may) if all(way[one - count] != way[other - count] for one, other in pairs)]


@dataclass(frozen=True, eq=False)
class UntoldStay:
    """A stay of which it cannot be told whose it is: the frames (T,) in which it is there, its tracklets (N,)."""

    there: np.ndarray
    tracklets: np.ndarray

    def is_open(self, tracklet: np.ndarray, labels: Labels) -> bool:
        """Whether nobody has named it, by the tracklet and label (T, L) of every point of the take."""
        own = np.append(self.tracklets, False)[tracklet]
        return (~labels.named & own).sum() > STAYS.unnamed * own.sum()


@dataclass(frozen=True, eq=False)
class StayBuild:
    """How far the markers of somebody are from each other in a stay (M, M) m: mean, and variance; NaN where unknown."""

    markers: tuple[str, ...]
    mean: np.ndarray
    variance: np.ndarray

    @classmethod
    def of(cls, one: OnBody) -> "StayBuild":
        """That of what was named on a body; nothing where it was not solved."""
        markers = one.model.markerset.markers
        size = len(markers)
        if one.solution is None:
            return cls(markers, *np.full((2, size, size), np.nan))
        sure = np.where(one.solution.margin > 0, one.solution.marker, -1)
        placed = one.solution.tracklets.placed(one.frames.take.xyz, sure, size)
        there = np.flatnonzero(np.isfinite(np.asarray(placed[:])).all(axis=2).any(axis=1))
        mean, spread, count = distances_in(placed[there[evenly_spread(len(there), STAYS.frames)]].astype(float))
        known = count >= MIN_MET
        return cls(markers, np.where(known, mean, np.nan), np.where(known, spread, np.nan))

    def cost(self, other: "StayBuild") -> float:
        """How badly two go together, negative log likelihood; inf where sets differ, or too little is shown."""
        if self.markers != other.markers:
            return np.inf
        variance = 2 * STAYS.sd_m**2 + (STAYS.bend * self.mean) ** 2 + (self.variance + other.variance) / 2
        known = np.triu(np.isfinite(variance + other.mean), 1)
        if not known.any():
            return np.inf
        square = np.minimum((self.mean - other.mean)[known] ** 2 / variance[known], STAYS.max_square)
        # A marker is in many pairs, so these are not as many measurements as they look.
        return float(square.mean() * len(self.markers) / 2)
