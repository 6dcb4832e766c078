# SPDX-License-Identifier: GPL-3.0-or-later
"""The hit rates of every partial solver of a marker set at once.

A labelling of a subset is feasible only if it is feasible without its last marker. So the labellings of all subsets
form one tree, and each is found by adding one marker to one that is known: the 2^15 - 1 solvers of fifteen markers
cost little more than their feasible labellings, where the paper gives up exhaustive search as out of reach.
The weak classifiers of a subset are all of the pool's that its markers allow. Only wrong labellings are followed: on
frames that the intervals were learned from, the right one is feasible by construction.
"""

from collections.abc import Iterator

import numpy as np

from .assess import tally
from .masks import Masks, pair_bounds
from .model import Classifiers, Record
from .solver import Level, Rows, allowed, grow, judged, look_ups


class Survey:
    """The records of every solver of M markers, each a subset: a whole number with one bit a marker.

    hits, failures, answers (2^M, M), as in `Record`; samples drawn for each
    """

    def __init__(self, markers: int, samples: int):
        self.hits, self.failures, self.answers = np.zeros((3, 1 << markers, markers), dtype=np.int32)
        self.samples = samples

    def keep(self, members: list[int], record: Record):
        """Notes the record of one subset."""
        subset = sum(1 << marker for marker in members)
        self.hits[subset, members] = record.hits
        self.failures[subset, members] = record.failures
        self.answers[subset, members] = record.answers

    @property
    def everything(self) -> Record:
        """All records at once; arrays (2^M, M), zero where a marker is not in a subset."""
        return Record(self.hits, self.failures, self.answers, self.samples)

    def record(self, members: list[int]) -> Record:
        """The record of one subset."""
        at = (sum(1 << marker for marker in members), members)
        return Record(self.hits[at], self.failures[at], self.answers[at], self.samples)


def survey(pool: Classifiers, masks: Masks, removed: np.ndarray) -> Iterator[tuple[float, Survey]]:
    """Goes through all subsets of the P markers of labelled clouds (point m is marker m).

    pool: most telling first; removed (T, D, W) occlusions. Yields the share done and the survey, whole with the last.
    """
    count = masks.points
    result = Survey(count, removed.shape[0] * removed.shape[1])
    levels = _Levels(pool, count)
    known = np.ones(len(removed), dtype=bool)
    truth = _Truth(masks)
    stack = [((marker,), _singles(masks, marker)) for marker in reversed(range(count))]
    done = 0
    while stack:
        members, wrong = stack.pop()
        record = tally(members, known, wrong.cloud, wrong.chosen.T, masks, removed)
        result.keep(list(members), record)
        done += 1
        if done % 256 == 0:
            yield done / (1 << count), result
        if members[-1] + 1 < count:
            rows = truth.joined(members, wrong)
            children = [
                ((*members, new), _step(rows, members, new, levels, masks)) for new in range(members[-1] + 1, count)
            ]
            stack.extend(reversed(children))
    yield 1.0, result


def _singles(masks: Masks, marker: int) -> Rows:
    """Every wrong point for one marker."""
    cloud, point = np.nonzero(masks.clouds.present)
    wrong = point != marker
    cloud, point = cloud[wrong], point[wrong]
    return Rows(cloud, point[None], masks.bit[point], np.empty((0, len(cloud))))


def _step(rows: Rows, members: tuple[int, ...], new: int, levels: "_Levels", masks: Masks) -> Rows:
    """The wrong labellings with one marker more, from `rows`: the right ones of all clouds, then the wrong ones."""
    level = levels.of(members, new)
    left = allowed(rows, level.pairs, masks)
    left[: len(masks.everyone)] &= ~masks.bit[new]
    some = left.any(axis=1)
    grown = judged(grow(rows[some], left[some], masks), level, masks)
    by_cloud = np.argsort(grown.cloud, kind="stable")
    return grown[by_cloud]


class _Truth:
    """The right labellings as rows."""

    def __init__(self, masks: Masks):
        self._masks = masks
        self._clouds = np.arange(len(masks.everyone))
        self._distance = np.ascontiguousarray(masks.clouds.distance.transpose(1, 2, 0))

    def joined(self, members: tuple[int, ...], wrong: Rows) -> Rows:
        """The right labelling of `members` in every cloud, then the wrong ones."""
        at = np.array(members)
        high, low = np.tril_indices(len(at), -1)
        bits = np.bitwise_or.reduce(self._masks.bit[at], axis=0)
        return Rows(
            np.concatenate([self._clouds, wrong.cloud]),
            np.concatenate([np.repeat(at[:, None], len(self._clouds), axis=1), wrong.chosen], axis=1),
            np.concatenate([np.repeat(bits[None], len(self._clouds), axis=0), wrong.used]),
            np.concatenate([self._distance[at[low], at[high]], wrong.sides], axis=1),
        )


class _Levels:
    """The look-ups for adding a marker to a subset of smaller ones."""

    def __init__(self, pool: Classifiers, markers: int):
        self._bounds = pair_bounds(pool)
        last = pool.points.max(axis=1)
        self._by_last = [pool[last == marker] for marker in range(markers)]
        self._markers = markers

    def of(self, members: tuple[int, ...], new: int) -> Level:
        mine = self._by_last[new]
        place = np.zeros(self._markers, dtype=np.intp)
        place[[*members, new]] = np.arange(len(members) + 1)
        pairs = [(at, self._bounds.get((member, new))) for at, member in enumerate(members)]
        judges = mine[mine.within((*members, new))]
        return Level([(at, bounds) for at, bounds in pairs if bounds], *look_ups(judges, place))
