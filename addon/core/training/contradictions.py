# SPDX-License-Identifier: GPL-3.0-or-later
"""Labelled takes that contradict the others: two markers that have each other's names there.

How much nearer one of two markers is to a third than the other, on the whole over a take, hardly changes from take to
take, however the subject moves and turns. Where the two have been exchanged it has the opposite sign, for every third.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..data.takes import evenly_spread


@dataclass(frozen=True)
class ContradictionOptions:
    """When two markers of a take are said to have each other's names; reckoned.

    Tried on the thirty recordings of the ten people at McGill, six of which have exchanged names.

    frames            of a take, spread over it: leads hardly change within one
    max_others        takes that each is compared with: more would say the same
    min_lead_sd       sizes, what a lead is taken to differ by between takes that agree
    sd_per_deviation  a normal distribution's standard deviation is so many medians of its deviations
    min_likely_share  of the way from as it should be to exchanged, from where a pair is tried together with another
    min_share         of that way, from where a pair is tried by itself, and two pairs together
    max_tried_pairs   that are tried two at a time
    max_rounds        exchanges in one take that are put right one after the other
    good_square       variances, on average, that leads are off at most once they are right; an unusual subject's are
                      off more
    max_left          of what they were off before, which they must come below once they are right,
    max_unusual_left  and those of an unusual subject
    max_square        variances, the most that one lead counts: a single wild one proves nothing
    """

    frames: int = 60
    max_others: int = 40
    min_lead_sd: float = 0.01
    sd_per_deviation: float = 1.48
    min_likely_share: float = 0.15
    min_share: float = 0.7
    max_tried_pairs: int = 24
    max_rounds: int = 8
    good_square: float = 1.5
    max_left: float = 0.5
    max_unusual_left: float = 0.2
    max_square: float = 9.0


CONTRADICTING = ContradictionOptions()


@dataclass(frozen=True, eq=False)
class Leads:
    """How much farther marker a is from c than b is, over the frames of a take, in sizes of the subject.

    mean  (M, M, M) by a, b and c; NaN where the three were never seen together
    var   (M, M, M) its variance
    """

    mean: np.ndarray
    var: np.ndarray


def leads(points: np.ndarray) -> Leads:
    """The leads of a labelled take of points (T, M, 3) m, NaN where missing."""
    some = points[evenly_spread(len(points), CONTRADICTING.frames)]
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
    found = []
    for index, take in enumerate(takes):
        others = [other for place, other in enumerate(takes) if place != index]
        step = -(-len(others) // CONTRADICTING.max_others)
        found.append(_exchanged(take, others[::step]))
    return found


def _exchanged(take: Leads, others: Sequence[Leads]) -> list[tuple[int, ...]]:
    """The groups that are exchanged in `take` against `others`."""
    usual, weight = _usual(others)
    order = np.arange(len(usual))
    least = _chi_square(take.mean, usual, weight)
    for _ in range(CONTRADICTING.max_rounds):
        tried = []
        for pairs in _candidates(take.mean[np.ix_(order, order, order)], usual, weight):
            changed = order.copy()
            for one, two in pairs:
                changed[[one, two]] = changed[[two, one]]
            tried.append((_chi_square(take.mean[np.ix_(changed, changed, changed)], usual, weight), changed))
        best, changed = min(tried, key=lambda row: row[0], default=(least, order))
        if best >= least:
            break
        least, order = best, changed
    right = take.mean[np.ix_(order, order, order)]
    return [group for group in _cycles(order) if _fits(group, take.mean, right, usual, weight)]


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
        float((weight[one, two, known] * (either[one, two, known] - usual[one, two, known]) ** 2).mean())
        for either in (mean, right)
    )
    usual_subject = after < CONTRADICTING.good_square
    return after < (CONTRADICTING.max_left if usual_subject else CONTRADICTING.max_unusual_left) * before


def _chi_square(mean: np.ndarray, usual: np.ndarray, weight: np.ndarray) -> float:
    """How far leads are from the usual ones on the whole; no single one counts for much."""
    known = np.isfinite(mean)
    return float(np.minimum(weight[known] * (mean[known] - usual[known]) ** 2, CONTRADICTING.max_square).sum())


def _cycles(order: np.ndarray) -> list[tuple[int, ...]]:
    """The groups that a permutation (M,) moves round."""
    left, found = set(np.flatnonzero(order != np.arange(len(order))).tolist()), []
    while left:
        group = [min(left)]
        while int(order[group[-1]]) != group[0]:
            group.append(int(order[group[-1]]))
        found.append(tuple(group))
        left -= set(group)
    return found


def _usual(others: Sequence[Leads]) -> tuple[np.ndarray, np.ndarray]:
    """What leads are in most takes (M, M, M), and what a deviation from that counts; 0 where nothing is known."""
    means, known = np.stack([other.mean for other in others]), np.stack([np.isfinite(other.mean) for other in others])
    seen = known.any(axis=0)
    usual = np.zeros(seen.shape, np.float32)
    spread = np.zeros(seen.shape, np.float32)
    usual[seen] = np.nanmedian(means[:, seen], axis=0)
    spread[seen] = CONTRADICTING.sd_per_deviation * np.nanmedian(np.abs(means[:, seen] - usual[seen]), axis=0)
    variance = np.where(known, np.stack([other.var for other in others]), 0)
    within = variance.sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    return usual, np.where(seen, 1 / (within + spread**2 + CONTRADICTING.min_lead_sd**2), 0)


def _candidates(mean: np.ndarray, usual: np.ndarray, weight: np.ndarray) -> list[tuple[tuple[int, int], ...]]:
    """The pairs, and two pairs at once, that leads `mean` (M, M, M) show to be exchanged."""
    away = np.nan_to_num(mean - usual) * np.isfinite(mean)
    weight = weight * np.isfinite(mean)
    one, two = np.triu_indices(len(mean), 1)
    third = np.ones((len(one), len(mean)), dtype=bool)
    third[np.arange(len(one)), one] = third[np.arange(len(one)), two] = False
    counts, expected = weight[one, two] * third, -2 * usual[one, two]
    along, full = (counts * expected * away[one, two]).sum(axis=1), (counts * expected**2).sum(axis=1)
    share = np.where(full > 0, along / np.maximum(full, 1e-12), 0)
    singles = [((int(one[pair]), int(two[pair])),) for pair in np.flatnonzero(share > CONTRADICTING.min_share)]
    # A head that is turned round has two pairs exchanged, of which neither alone makes it right.
    likely = [
        (int(one[pair]), int(two[pair]))
        for pair in np.argsort(-share)[: CONTRADICTING.max_tried_pairs]
        if share[pair] > CONTRADICTING.min_likely_share
    ]
    doubles = [pairs for pairs in combinations(likely, 2) if len({*pairs[0], *pairs[1]}) == 4]
    return singles + [
        pairs for pairs in doubles if _exchanged_share(pairs, away, usual, weight) > CONTRADICTING.min_share
    ]


def _exchanged_share(
    pairs: tuple[tuple[int, int], ...], away: np.ndarray, usual: np.ndarray, weight: np.ndarray
) -> float:
    """How far the leads of these pairs are on the way from the usual ones (0) to those of exchanged names (1)."""
    order = np.arange(len(usual))
    for one, two in pairs:
        order[[one, two]] = two, one
    along = full = 0.0
    for one, two in pairs:
        third = np.setdiff1d(order, (one, two))
        expected = usual[order[one], order[two], order[third]] - usual[one, two, third]
        counts = weight[one, two, third]
        along += float((counts * expected * away[one, two, third]).sum())
        full += float((counts * expected**2).sum())
    return along / full if full > 0 else 0.0
