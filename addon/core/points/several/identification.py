# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is who, by how far the markers of a body are from each other: against a subject's model, or another presence.

Nor does a tracklet last over an absence of everybody: whose a presence is, is said by who else is there, as two who are
there at a time are two; where that leaves more ways than one, each presence is named on its own, and the distances on
it are compared with those of the first presences.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations, product
from typing import Self

import numpy as np

from ...data.physical import SIGMAS
from ...data.takes import Labels, evenly_spread
from ..models import Model
from ..whole_take.pairs import trained_pairs
from .bodies import NamedBody
from .counting import usual_count
from .places import NO_BODY


@dataclass(frozen=True)
class IdentificationOptions:
    """How the distances of one person differ.

    lead        physical: log odds, 19 of 20 such are right, by which who is who must be ahead of any other way, and one
                of two who want a tracklet of the other
    put_on_m    by which a distance of the same person differs from take to take; physical: markers are put on again
    bend        part of a distance by which it differs in other motions; physical: skin moves over a bent joint
    """

    lead: float = 3.0
    put_on_m: float = 0.008
    bend: float = 0.02


IDENTIFICATION = IdentificationOptions()
FRAMES_COMPARED = 300  # that are looked at, of all with two markers of somebody
MIN_MET = 10  # frames in which two markers must be there for their distance to say anything
MAX_OVERLAP = 0.1  # part of the shorter of two presences that may be one's: bodies are parted some frames off
MAX_WAYS = 10_000  # that are tried; by time


@dataclass(frozen=True, eq=False)
class PersonBuild:
    """How far the markers of somebody are from each other (M, M) m: mean, and variance m²; NaN where unknown."""

    markers: tuple[str, ...]
    mean: np.ndarray
    variance: np.ndarray

    @classmethod
    def of(cls, one: NamedBody) -> Self:
        """That of what was named on a body; nothing where it was not solved."""
        markers = one.model.markerset.markers
        size = len(markers)
        if one.solution is None:
            return cls(markers, *np.full((2, size, size), np.nan))
        sure = np.where(one.solution.margin > 0, one.solution.marker, -1)
        placed = one.solution.tracklets.placed(one.frames.take.xyz, sure, size)
        there = np.flatnonzero(np.isfinite(np.asarray(placed[:])).all(axis=2).any(axis=1))
        mean, spread, count = distances_in(placed[there[evenly_spread(len(there), FRAMES_COMPARED)]].astype(float))
        known = count >= MIN_MET
        return cls(markers, np.where(known, mean, np.nan), np.where(known, spread, np.nan))

    @classmethod
    def trained(cls, model: Model) -> Self:
        """That of whoever a model was learned from."""
        known = trained_pairs(model)
        return cls(model.markerset.markers, known.mean, known.within)

    def cost(self, other: Self, varies_m: float) -> float:
        """How badly two go together, negative log likelihood; inf where sets differ, or too little is shown.

        `varies_m` is the standard deviation of a distance between the two.
        """
        if self.markers != other.markers:
            return np.inf
        variance = varies_m**2 + (IDENTIFICATION.bend * self.mean) ** 2 + (self.variance + other.variance) / 2
        known = np.triu(np.isfinite(variance + other.mean), 1)
        if not known.any():
            return np.inf
        # Beyond chance a distance is no worse: one wrong name is in many.
        square = np.minimum((self.mean - other.mean)[known] ** 2 / variance[known], SIGMAS**2)
        # A marker is in many pairs, so these are not as many measurements as they look.
        return float(square.mean() * len(self.markers) / 2)


def costs_of(named: list, models: tuple[Model, ...]) -> list[float]:
    """How badly each model goes with what was named on a body, negative log likelihood; inf where not at all."""
    builds, trained = [PersonBuild.of(one) for one in named], [PersonBuild.trained(model) for model in models]
    varies = IDENTIFICATION.put_on_m
    return [min((build.cost(other, varies) for build in builds), default=np.inf) for other in trained]


def distances_in(markers: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of every two of M markers in frames (F, M, 3) m: mean distance m, its variance m², and in how many (M, M)."""
    distance = np.linalg.norm(markers[:, :, None] - markers[:, None], axis=3)
    seen = np.isfinite(distance)
    count = seen.sum(axis=0)
    mean = np.where(seen, distance, 0).sum(axis=0) / np.maximum(count, 1)
    spread = np.where(seen, (distance - mean) ** 2, 0).sum(axis=0) / np.maximum(count, 1)
    return mean, spread, count


def likeliest(ways: Sequence[tuple[int, ...]], cost: np.ndarray) -> tuple[tuple[int, ...], float]:
    """The best of ways to give each of S one of K, by what that costs (S, K), and by how much it is ahead."""
    order = sorted((float(sum(cost[given, one] for given, one in enumerate(way))), way) for way in ways)
    lead = order[1][0] - order[0][0] if len(order) > 1 else np.inf
    return order[0][1], lead if np.isfinite(order[0][0]) else -np.inf


def identified(cost: np.ndarray, kind: Sequence[int]) -> tuple[list[int], float]:
    """Which body (of B) each of S subjects has, by costs (B, S), and by how much that is ahead of any other way.

    Subjects of one `kind` (S,) are not told apart: the first of them has the first body.
    """
    bodies, subjects = cost.shape
    ways = [
        way
        for way in permutations(range(bodies), subjects)
        if all(kind[one] != kind[other] or way[one] < way[other] for one, other in combinations(range(subjects), 2))
    ]
    if not ways:
        return list(range(subjects)), -np.inf
    way, lead = likeliest(ways, cost.T)
    return list(way), lead


def spans_of(tracklet: np.ndarray, body: np.ndarray, count: int) -> np.ndarray:
    """(T, K) when each of so many presences is there, by the bodies (N,) of tracklets (T, L)."""
    own = np.append(body, NO_BODY)[tracklet]
    there = np.stack([(own == one).sum(axis=1) for one in range(count)], axis=1)
    return 2 * there >= np.maximum([usual_count(column) for column in there.T], 1)


def ways_of(there: np.ndarray, count: int) -> list[tuple[int, ...]]:
    """All ways in which presences (T, K) after the first `count`, which are somebody each, can be theirs.

    Those of one are not there at the same time. None at all where there are too many.
    """
    both = there.T.astype(int) @ there
    length = np.maximum(np.diag(both), 1)
    apart = both <= MAX_OVERLAP * np.minimum(length[:, None], length)
    may = [np.flatnonzero(apart[one, :count]).tolist() for one in range(count, len(apart))]
    if np.prod([float(len(some)) for some in may]) > MAX_WAYS:
        return []
    pairs = [(one, other) for other in range(count, len(apart)) for one in range(count, other) if not apart[one, other]]
    return [way for way in product(*may) if all(way[one - count] != way[other - count] for one, other in pairs)]


@dataclass(frozen=True, eq=False)
class UnidentifiedPresence:
    """A presence that may be several people's: the frames (T,) in which it is there, its tracklets (N,)."""

    there: np.ndarray
    tracklets: np.ndarray

    def is_open(self, tracklet: np.ndarray, labels: Labels) -> bool:
        """Whether most of it has no name, by the tracklet and label (T, L) of every point of the take."""
        own = np.append(self.tracklets, False)[tracklet]
        return 2 * (~labels.named & own).sum() > own.sum()
