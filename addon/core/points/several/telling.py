# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is who, where each subject has a model of their own: by how far the markers of a body are from each other."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations
from typing import Protocol

import numpy as np

from ...data.takes import evenly_spread
from ..models import Model
from ..whole_take.pairs import trained_pairs
from ..whole_take.solving import Solution


@dataclass(frozen=True)
class TellingOptions:
    """How people are told apart. All reckoned.

    lead     log odds by which who is who must be ahead of any other way round
    frames   that are looked at
    sd_m     by which a distance of the same person differs from take to take, as markers are put on again
    bend     part of a distance by which it does, in other motions
    max_square  standard deviations², beyond which a distance is no worse
    """

    lead: float = 3.0
    frames: int = 300
    sd_m: float = 0.008
    bend: float = 0.02
    max_square: float = 25.0


TELLING = TellingOptions()
MIN_MET = 10  # frames in which two markers must be there for their distance to say anything


class OnBody(Protocol):
    """What was named on a body."""

    model: Model
    frames: object
    solution: Solution | None


def costs_of(named: list, models: tuple[Model, ...]) -> list[float]:
    """How badly each model goes with what was named on a body, negative log likelihood; inf where not at all."""
    return [min((_cost(one, model) for one in named), default=np.inf) for model in models]


def _cost(named: OnBody, model: Model) -> float:
    if named.model.markerset.markers != model.markerset.markers or named.solution is None:
        return np.inf
    solution, size = named.solution, len(model.markerset)
    placed = solution.tracklets.placed(named.frames.take.xyz, solution.marker, size)
    mean, spread, count = distances_in(placed[evenly_spread(len(placed), TELLING.frames)].astype(float))
    known = trained_pairs(model)
    variance = TELLING.sd_m**2 + (TELLING.bend * mean) ** 2 + (known.within + spread) / 2
    usable = np.triu((count >= MIN_MET) & np.isfinite(known.mean) & np.isfinite(variance), 1)
    if not usable.any():
        return np.inf
    square = np.minimum((mean - known.mean)[usable] ** 2 / variance[usable], TELLING.max_square)
    # A marker is in many pairs, so these are not as many measurements as they look.
    return float(square.sum() / size)


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


def told(cost: np.ndarray, kind: Sequence[int]) -> tuple[list[int], float]:
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
