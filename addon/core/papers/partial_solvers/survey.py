# SPDX-License-Identifier: GPL-3.0-or-later
"""The hit rates of every partial solver of a marker set at once.

A labelling of a subset is feasible only if it is feasible without its last marker. So the labellings of all subsets
form one tree, and each is found by adding one marker to one that is known: the 2^15 - 1 solvers of fifteen markers
cost little more than their feasible labellings, where the paper gives up exhaustive search as out of reach.
The weak classifiers of a subset are all of the pool's that its markers allow. Only wrong labellings are followed: on
frames that the intervals were learned from, the right one is feasible by construction.
"""

from collections.abc import Generator

import numpy as np

from .assess import tally
from .masks import Masks, pair_bounds
from .model import Classifiers, Record
from .solver import Level, PartialLabellings, allowed, grow, judged, look_ups


class Survey:
    """The records of every solver over a group of G markers, each a subset: a whole number with one bit a place in it.

    group                   the markers, in the order of their places
    hits, failures, answers (2^G, G), as in `Record`, zero where a marker is not in a subset; samples drawn for each
    """

    def __init__(self, group: list[int], samples: int):
        self.group = group
        self.hits, self.failures, self.answers = np.zeros((3, 1 << len(group), len(group)), dtype=np.int32)
        self.samples = samples

    def keep(self, places: list[int], record: Record):
        """Notes the record of one subset."""
        subset = sum(1 << place for place in places)
        self.hits[subset, places] = record.hits
        self.failures[subset, places] = record.failures
        self.answers[subset, places] = record.answers

    def record(self, places: list[int]) -> Record:
        """The record of one subset."""
        at = (sum(1 << place for place in places), places)
        return Record(self.hits[at], self.failures[at], self.answers[at], self.samples)


def survey(
    pool: Classifiers, masks: Masks, removed: np.ndarray, group: list[int] | None = None, rooted: bool = False
) -> Generator[float, None, Survey]:
    """Goes through all subsets of the P markers of labelled clouds (point m is marker m), or of a group of them.

    pool: most telling first; removed (T, D, W) occlusions; rooted: only subsets with the first of the group. Yields the
    share done.
    """
    group = list(range(masks.points)) if group is None else group
    result = Survey(group, removed.shape[0] * removed.shape[1])
    levels = _Levels(pool, group)
    known = np.ones(len(removed), dtype=bool)
    starts = range(1 if rooted else len(group))
    stack: list[tuple[tuple[int, ...], PartialLabellings]] = []
    stack += [((place,), _singles(masks, group[place])) for place in reversed(starts)]
    done, all_of_them = 0, 1 << len(group) - rooted
    while stack:
        places, wrong = stack.pop()
        members = [group[place] for place in places]
        result.keep(list(places), tally(members, known, wrong.cloud, wrong.chosen.T, masks, removed))
        done += 1
        if done % 256 == 0:
            yield done / all_of_them
        if places[-1] + 1 < len(group):
            rows = _with_truth(members, wrong, masks)
            added = range(len(group) - 1, places[-1], -1)
            stack.extend(((*places, new), _step(rows, places, new, levels, masks)) for new in added)
    return result


def _singles(masks: Masks, marker: int) -> PartialLabellings:
    """Every wrong point for one marker."""
    cloud, point = np.nonzero(masks.clouds.present)
    wrong = point != marker
    cloud, point = cloud[wrong], point[wrong]
    return PartialLabellings(cloud, point[None], masks.bit[point], np.empty((0, len(cloud))))


def _step(
    rows: PartialLabellings, places: tuple[int, ...], new: int, levels: "_Levels", masks: Masks
) -> PartialLabellings:
    """The wrong labellings with one marker more, from `rows`: the right ones of all clouds, then the wrong ones."""
    level = levels.of(places, new)
    left = allowed(rows, level.pairs, masks)
    left[: len(masks.everyone)] &= ~masks.bit[levels.group[new]]
    some = left.any(axis=1)
    grown = judged(grow(rows[some], left[some], masks), level, masks)
    by_cloud = np.argsort(grown.cloud, kind="stable")
    return grown[by_cloud]


def _with_truth(members: list[int], wrong: PartialLabellings, masks: Masks) -> PartialLabellings:
    """The right labelling of `members` in every cloud, then the wrong ones."""
    at, clouds = np.array(members), np.arange(len(masks.everyone))
    high, low = np.tril_indices(len(at), -1)
    bits = np.bitwise_or.reduce(masks.bit[at], axis=0)
    return PartialLabellings(
        np.concatenate([clouds, wrong.cloud]),
        np.concatenate([np.repeat(at[:, None], len(clouds), axis=1), wrong.chosen], axis=1),
        np.concatenate([np.repeat(bits[None], len(clouds), axis=0), wrong.used]),
        np.concatenate([masks.clouds.distance[:, at[low], at[high]].T, wrong.sides], axis=1),
    )


class _Levels:
    """The look-ups for adding a marker of the group to a subset of those in earlier places."""

    def __init__(self, pool: Classifiers, group: list[int]):
        self.group = group
        pool = pool[pool.within(group)]
        self._bounds = pair_bounds(pool)
        place = np.full(max(group) + 2, -1)
        place[group] = np.arange(len(group))
        last = place[pool.points].max(axis=1)
        self._by_last = [pool[last == at] for at in range(len(group))]

    def of(self, places: tuple[int, ...], new: int) -> Level:
        members, marker = [self.group[place] for place in places], self.group[new]
        judges = self._by_last[new]
        judges = judges[judges.within((*members, marker))]
        depth = np.zeros(max(self.group) + 1, dtype=np.intp)
        depth[[*members, marker]] = np.arange(len(members) + 1)
        pairs = [(at, self._bounds.get((member, marker))) for at, member in enumerate(members)]
        return Level([(at, bounds) for at, bounds in pairs if bounds], look_ups(judges, depth))
