# SPDX-License-Identifier: GPL-3.0-or-later
"""Labelled takes that contradict the others: two markers that have each other's names there.

How much nearer one of two markers is to a third than the other, on the whole over a take, hardly changes from take to
take, however the subject moves and turns. Where the two have been exchanged it has the opposite sign, for every third.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..data.takes import MEDIAN_SD
from ..review.camera_order import cycles_of
from .spread import some_of


class CONTRADICTING:
    """When two markers of a take have each other's names."""

    # sizes, that leads of the same subject differ by between takes; 1 % of a body, as skin gives. Twice as much loses
    # one of the nine exchanges at McGill, half as much none
    lead_sd: float = 0.01  # physical
    # the likeliest ones, which are tried alone and two at a time
    pairs: int = 12  # measured: 12 and 24 find the same at McGill
    # part of its squared deviations that may be left of an exchange
    better: float = 0.5  # measured: 0.5 and 0.8 find all nine at McGill and nothing else, 0.2 five


@dataclass(frozen=True, eq=False)
class Leads:
    """How much farther marker a is from c than b is, over the frames of a take, in sizes of the subject."""

    mean: np.ndarray  # (M, M, M) by a, b and c; NaN where the three were never seen together
    var: np.ndarray  # (M, M, M) its variance


def leads(points: np.ndarray) -> Leads:
    """The leads of a labelled take of points (T, M, 3) m, NaN where missing."""
    some = some_of(points)
    distance = np.linalg.norm(some[:, :, None] - some[:, None], axis=-1)
    known = distance[np.isfinite(distance) & (distance > 0)]
    distance = (distance / (np.median(known) if len(known) else 1.0)).astype(np.float32)
    shape = (points.shape[1],) * 3
    total, squares, count = np.zeros(shape, np.float32), np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    for frame in distance:
        lead = frame[:, None] - frame[None]
        there = np.isfinite(lead)
        lead = np.where(there, lead, 0)
        total += lead
        squares += lead**2
        count += there
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = total / count
        return Leads(mean, np.maximum(squares / count - mean**2, 0))


def contradictions(takes: Sequence[Leads]) -> list[list[tuple[int, ...]]]:
    """For each take the markers that have each other's names there, if all the other takes are right.

    Each group of markers is in the order in which the names went round; mostly there are two.
    """
    if len(takes) < 2:
        return [[] for _ in takes]
    return [_exchanged(take, [*takes[:index], *takes[index + 1 :]]) for index, take in enumerate(takes)]


def _exchanged(take: Leads, others: Sequence[Leads]) -> list[tuple[int, ...]]:
    """The groups that are exchanged in `take` against `others`."""
    usual, weight = _usual(others)
    order, mean = np.arange(len(usual)), take.mean
    least = _chi_square(mean, usual, weight)
    while True:
        tried = []
        for pairs in _candidates(mean, usual, weight):
            changed = _with_exchanged(order, pairs)
            tried.append((_chi_square(take.mean[np.ix_(changed, changed, changed)], usual, weight), changed))
        best, changed = min(tried, key=lambda row: row[0], default=(least, order))
        if best >= least:
            return [group for group in cycles_of(order) if _fits(group, take.mean, mean, usual, weight)]
        least, order, mean = best, changed, take.mean[np.ix_(changed, changed, changed)]


def _with_exchanged(order: np.ndarray, pairs: Sequence[tuple[int, int]]) -> np.ndarray:
    changed = order.copy()
    for one, two in pairs:
        changed[[one, two]] = changed[[two, one]]
    return changed


def _fits(group: tuple[int, ...], mean: np.ndarray, right: np.ndarray, usual: np.ndarray, weight: np.ndarray) -> bool:
    """Whether the leads of a group are as usual once they are put `right`, and were much less so in `mean`.

    A subject whose markers sit quite otherwise fits neither way.
    """
    one, two = group[:2]
    known = np.isfinite(mean[one, two]) & np.isfinite(right[one, two]) & (weight[one, two] > 0)
    known[list(group)] = False
    if not known.any():
        return True
    before, after = (
        (weight[one, two, known] * (either[one, two, known] - usual[one, two, known]) ** 2).mean()
        for either in (mean, right)
    )
    return bool(after < CONTRADICTING.better * before)


def _chi_square(mean: np.ndarray, usual: np.ndarray, weight: np.ndarray) -> float:
    """How far leads are from the usual ones on the whole."""
    known = np.isfinite(mean)
    return float((weight[known] * (mean[known] - usual[known]) ** 2).sum())


def _usual(others: Sequence[Leads]) -> tuple[np.ndarray, np.ndarray]:
    """What leads are in most takes (M, M, M), and what a deviation from that counts; 0 where nothing is known."""
    means, known = np.stack([other.mean for other in others]), np.stack([np.isfinite(other.mean) for other in others])
    seen = known.any(axis=0)
    usual, spread = np.zeros((2, *seen.shape), np.float32)
    usual[seen] = np.nanmedian(means[:, seen], axis=0)
    spread[seen] = MEDIAN_SD * np.nanmedian(np.abs(means[:, seen] - usual[seen]), axis=0)
    variance = np.where(known, np.stack([other.var for other in others]), 0)
    within = variance.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return usual, np.where(seen, 1 / (within + spread**2 + CONTRADICTING.lead_sd**2), 0)


def _candidates(mean: np.ndarray, usual: np.ndarray, weight: np.ndarray) -> list[tuple[tuple[int, int], ...]]:
    """The pairs, and two pairs at once, whose leads `mean` (M, M, M) are farthest on the way to those of an exchange.

    A head that is turned round has two pairs exchanged, of which neither alone makes it right.
    """
    known = np.isfinite(mean)
    away, weight = np.where(known, mean - usual, 0), np.where(known, weight, 0)
    one, two = np.triu_indices(len(mean), 1)
    third = np.ones((len(one), len(mean)), dtype=bool)
    third[np.arange(len(one)), one] = third[np.arange(len(one)), two] = False
    counts, expected = weight[one, two] * third, -2 * usual[one, two]
    along, full = (counts * expected * away[one, two]).sum(axis=1), (counts * expected**2).sum(axis=1)
    part = np.where(full > 0, along / np.maximum(full, 1e-12), 0)
    likely = [pair for pair in np.argsort(-part)[: CONTRADICTING.pairs] if part[pair] > 0]
    pairs = [(int(one[pair]), int(two[pair])) for pair in likely]
    doubles = [both for both in combinations(pairs, 2) if len({*both[0], *both[1]}) == 4]
    return [*((pair,) for pair in pairs), *doubles]
