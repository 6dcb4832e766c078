# SPDX-License-Identifier: GPL-3.0-or-later
"""How ambiguous a marker set is: for each marker, each pair and the whole, how far the true naming stands out.

Three kinds of wrong names are looked at: two markers exchange their points; a marker is hidden and a
neighbour's point passes for it; a whole limb, or the whole body turned round, passes for the other side's.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ..geometry.rigid import MIN_POINTS
from .layout import MarkerLayout
from .overlap import covariance_of, pair_overlaps, renaming_overlap
from .renamings import Renaming, renamings

JUDGING_TRIALS = 7  # that overlaps are averaged over, all markers seen in the first
HIDDEN_SHARE = 0.25  # of the markers, hidden in each of the others: a body hides a quarter


@dataclass(frozen=True, eq=False)
class Ambiguity:
    """How much namings of a set of M markers look alike, as overlaps: 0 never mistaken, 1 always.

    markers   M names
    seen      (M, M) with every marker seen: the pair exchanged, by itself or with the whole limb or body
    hidden    (M, M) with a part of the markers hidden, a neighbour's point that passes for a hidden marker included
    whole     the renamings of limbs and of the whole body that were tried
    overlaps  of each of these, with every marker seen
    """

    markers: tuple[str, ...]
    seen: np.ndarray
    hidden: np.ndarray
    whole: tuple[Renaming, ...]
    overlaps: np.ndarray

    @property
    def of_markers(self) -> np.ndarray:
        """(M,) of each marker with all others, any of which it may be taken for."""
        return 1 - np.prod(1 - self.hidden, axis=1)

    @property
    def total(self) -> float:
        """The sum of all pairs."""
        return float(np.triu(self.hidden).sum())

    def worst(self) -> list[tuple[int, int]]:
        """All pairs of markers, the most ambiguous first."""
        one, two = np.triu_indices(len(self.markers), 1)
        order = np.argsort(-self.hidden[one, two], kind="stable")
        return list(zip(one[order].tolist(), two[order].tolist(), strict=True))


def judge(layout: MarkerLayout, whole: Sequence[Renaming] | None = None) -> Ambiguity:
    """How ambiguous the layout of a marker set is; the same every time.

    `whole` are the renamings of limbs and of the whole body to judge, those of `renamings` unless given.
    """
    whole = renamings(layout.markerset, layout.shape) if whole is None else whole
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        return _judged(layout, whole)


def _judged(layout: MarkerLayout, whole: Sequence[Renaming]) -> Ambiguity:
    shape, count = layout.shape, len(layout.markerset)
    covariance = covariance_of(shape)

    def limbs(there: np.ndarray) -> np.ndarray:
        found = (renaming_overlap(shape, covariance, r.order, there, r.yaw) for r in whole)
        return np.fromiter(found, float, len(whole))

    everyone = np.ones(count, dtype=bool)
    overlaps = limbs(everyone)
    seen = 1 - (1 - pair_overlaps(shape, covariance, everyone)[0]) * _left(whole, overlaps, count)
    swapped, passed, met = np.zeros((3, count, count))
    some = []
    for there in _trials(count):
        for table, more in zip((swapped, passed), pair_overlaps(shape, covariance, there), strict=True):
            table += more
        met += there[:, None] & there
        some.append(limbs(there))
    known = np.isfinite(some)
    part = np.where(known, some, 0).sum(axis=0) / np.maximum(known.sum(axis=0), 1)
    # Any of the three will do for a wrong name, so what is left is what none of them takes.
    hidden = 1 - (1 - swapped / met) * (1 - passed / met) * _left(whole, part, count)
    for table in (seen, hidden):
        np.fill_diagonal(table, 0)
    return Ambiguity(layout.markerset.markers, seen, hidden, tuple(whole), overlaps)


def _trials(count: int) -> np.ndarray:
    """(trials, M) which markers are seen: all in the first trial, then each hidden as often as any other."""
    generator = np.random.default_rng(0)
    gone = min(max(round(HIDDEN_SHARE * count), 1), max(count - MIN_POINTS, 0))
    order = np.concatenate([generator.permutation(count) for _ in range(JUDGING_TRIALS)])
    masks = np.ones((JUDGING_TRIALS, count), dtype=bool)
    for row, mask in enumerate(masks[1:]):
        mask[order[row * gone : (row + 1) * gone]] = False
    return masks


def separation(overlap: np.ndarray) -> np.ndarray:
    """An overlap as the distance of two equal bell curves that have it, in their standard deviations.

    Such curves are mistaken for each other in a part Φ(-d/2) of all cases: 31 % at 1, 2.3 % at 4, 0.1 % at 6.
    """
    logs = np.log(np.clip(overlap, np.finfo(float).tiny, 1))
    return np.sqrt(-8 * logs) + 0.0


def _left(whole: Sequence[Renaming], overlaps: np.ndarray, count: int) -> np.ndarray:
    """(M, M) what renamings leave of the pairs that they exchange: 1 where they exchange none."""
    table = np.ones((count, count))
    for renaming, overlap in zip(whole, overlaps, strict=True):
        moved = renaming.moved
        pairs = np.zeros((count, count), dtype=bool)
        pairs[moved, renaming.order[moved]] = pairs[renaming.order[moved], moved] = True
        table = np.where(pairs, table * (1 - overlap), table)
    return table
