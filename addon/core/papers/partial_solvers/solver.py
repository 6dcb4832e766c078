# SPDX-License-Identifier: GPL-3.0-or-later
"""The tree search for every labelling that a strong classifier accepts (the paper's section 3.4).

One marker after another is given a point; a labelling that a weak classifier rejects is dropped at once with all that
would follow from it. The paper goes depth first through one frame; this goes through many frames side by side, level by
level, and finds the same.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .masks import TOLERANCE, Bounds, Masks, pair_bounds
from .model import KIND_ANGLE, KIND_RATIO, KIND_TURN, Classifiers

MAX_ROWS = 100_000  # labellings that are followed side by side; what is beyond waits its turn, which saves memory
FIRST_LOOKED, GROWTH = 4, 4  # classifiers looked up in one go while many labellings are left, and times as many after


def newly_judged(classifiers: Classifiers, placed: list[int]) -> np.ndarray:
    """Indices of the classifiers that can vote once the last of `placed` has its point."""
    has_last = (classifiers.points == placed[-1]).any(axis=1)
    return np.flatnonzero(classifiers.within(placed) & has_last)


@dataclass(frozen=True, eq=False)
class Level:
    """What is looked up when the marker at one depth gets its point."""

    # (depth, bounds) of each earlier marker that a two-point classifier judges with it, earlier one first
    pairs: list[tuple[int, Bounds]]
    # of the three- and four-point classifiers of each kind, what they look up (K, ·) and their bounds (2, K): rows of
    # the `sides` of `PartialLabellings` (of an angle, whose bounds are cosines, those of the angle and the third),
    # before them for turns the depths of the three markers
    looks: dict[int, tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True, eq=False)
class PartialLabellings:
    """R labellings under way at one depth d.

    cloud (R,), chosen (d, R) the points, used (R, W) their bits, sides (d (d - 1) / 2, R) the distances between them
    """

    cloud: np.ndarray
    chosen: np.ndarray
    used: np.ndarray
    sides: np.ndarray

    def __len__(self) -> int:
        return len(self.cloud)

    def __getitem__(self, rows) -> "PartialLabellings":
        return PartialLabellings(self.cloud[rows], self.chosen[:, rows], self.used[rows], self.sides[:, rows])


class TreeSearch:
    """The tree search of one partial solver, through many clouds side by side.

    markers (s,) of the solver; classifiers: those that its strong classifier chose, the most telling first.
    """

    def __init__(self, markers, classifiers: Classifiers):
        self.markers = [int(marker) for marker in markers]
        self.classifiers = classifiers
        self._bounds = pair_bounds(classifiers)
        self._plans: dict[tuple[int, ...], list[Level]] = {}

    def __call__(self, masks: Masks) -> tuple[np.ndarray, np.ndarray]:
        """Every feasible labelling of every cloud: cloud (R,) ascending, point of each marker (R, s)."""
        found = list(self.blocks(masks))
        cloud = np.concatenate([np.empty(0, dtype=np.intp), *(part[0] for part in found)])
        chosen = np.concatenate([np.empty((0, len(self.markers)), dtype=np.intp), *(part[1] for part in found)])
        by_cloud = np.argsort(cloud, kind="stable")
        return cloud[by_cloud], chosen[by_cloud]

    def blocks(self, masks: Masks) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The same in parts that stay small however many there are."""
        order = self._order(masks)
        if order not in self._plans:
            sequence = [self.markers[place] for place in order]
            self._plans[order] = [self._level(sequence, depth) for depth in range(len(sequence))]
        cloud, point = np.nonzero(masks.clouds.present)
        start = PartialLabellings(cloud, point[None], masks.bit[point], np.empty((0, len(cloud))))
        back = np.argsort(order)
        for rows in self._descend(start, 1, self._plans[order], masks):
            yield rows.cloud, rows.chosen[back].T

    def _descend(
        self, rows: PartialLabellings, depth: int, plan: list[Level], masks: Masks
    ) -> Iterator[PartialLabellings]:
        """Places the markers from `depth` on."""
        if depth == len(plan):
            yield rows
            return
        for first in range(0, len(rows), MAX_ROWS):
            part = rows if len(rows) <= MAX_ROWS else rows[first : first + MAX_ROWS]
            grown = judged(grow(part, allowed(part, plan[depth].pairs, masks), masks), plan[depth], masks)
            if len(grown):
                yield from self._descend(grown, depth + 1, plan, masks)

    def _order(self, masks: Masks) -> tuple[int, ...]:
        """The markers, the most telling first, as places in `markers`."""
        count = len(self.markers)
        fill = np.ones((count, count))
        place = {marker: at for at, marker in enumerate(self.markers)}
        for (first, second), bounds in self._bounds.items():
            fill[place[first], place[second]] = masks.fill(bounds)
        np.fill_diagonal(fill, np.inf)
        chosen = [int(at) for at in np.unravel_index(fill.argmin(), fill.shape)][:count]
        np.fill_diagonal(fill, 1.0)
        left = fill[:, chosen].prod(axis=1)
        while len(chosen) < count:
            waiting = np.setdiff1d(np.arange(count), chosen)
            chosen.append(int(waiting[left[waiting].argmin()]))
            left = left * fill[:, chosen[-1]]
        return tuple(chosen)

    def _level(self, sequence: list[int], depth: int) -> Level:
        new = self.classifiers[newly_judged(self.classifiers, sequence[: depth + 1])]
        place = np.full(max(sequence) + 1, 0)
        place[sequence] = np.arange(len(sequence))
        pairs = [(at, self._bounds.get((sequence[at], sequence[depth]))) for at in range(depth)]
        return Level([(at, bounds) for at, bounds in pairs if bounds], look_ups(new, place))


def look_ups(classifiers: Classifiers, place: np.ndarray) -> dict[int, tuple[np.ndarray, np.ndarray]]:
    """The three- and four-point classifiers as `Level` has them; place (M,) the depth of each marker."""
    found = {}
    for kind in (KIND_TURN, KIND_ANGLE, KIND_RATIO):
        some = classifiers[classifiers.kind == kind]
        a, b, c, d = place[some.points].T
        low, high = some.low, some.high
        looked: tuple[np.ndarray, ...]
        if kind == KIND_TURN:
            looked = (a, b, c, _side(a, b), _side(a, c))
        elif kind == KIND_ANGLE:
            looked = (_side(a, b), _side(a, c), _side(b, c))
            low, high = np.cos(some.high), np.cos(some.low)
        else:
            looked = (_side(a, b), _side(c, d))
        found[kind] = np.stack(looked, axis=1), np.stack([low - TOLERANCE, high + TOLERANCE])
    return found


def _side(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Where the distance between the markers at two depths stands in `PartialLabellings.sides`."""
    low, high = np.minimum(one, other), np.maximum(one, other)
    return high * (high - 1) // 2 + low


def allowed(rows: PartialLabellings, pairs: list[tuple[int, Bounds]], masks: Masks) -> np.ndarray:
    """(R, W) the points left for the next marker by the two-point classifiers and by those already taken."""
    left = masks.everyone[rows.cloud] & ~rows.used
    for earlier, bounds in pairs:
        left &= masks.allowed(bounds)[rows.cloud, rows.chosen[earlier]]
    return left


def grow(rows: PartialLabellings, left: np.ndarray, masks: Masks) -> PartialLabellings:
    """Every row once for every point that is left for the next marker."""
    flags = np.unpackbits(left.view(np.uint8), axis=1, bitorder="little", count=masks.points)
    parent, point = np.nonzero(flags)
    cloud, chosen = rows.cloud[parent], rows.chosen[:, parent]
    new = masks.clouds.distance.reshape(-1)[(cloud * masks.points + point) * masks.points + chosen]
    return PartialLabellings(
        cloud,
        np.concatenate([chosen, point[None]]),
        rows.used[parent] | masks.bit[point],
        np.concatenate([rows.sides[:, parent], new]),
    )


def judged(rows: PartialLabellings, level: Level, masks: Masks) -> PartialLabellings:
    """The rows that every three- and four-point classifier of a level accepts.

    A feature that is a fraction is compared with both sides multiplied out.
    """
    for kind, (looked, bounds) in level.looks.items():
        first, size = 0, FIRST_LOOKED
        while first < len(looked) and len(rows):
            part = slice(first, first + size)
            above, below = _fraction(kind, rows, looked[part].T, masks)
            low, high = bounds[:, part, None]
            kept = ((above >= low * below) & (above <= high * below)).all(axis=0)
            rows = rows if kept.all() else rows[kept]
            first, size = first + size, GROWTH * size
    return rows


def _fraction(kind: int, rows: PartialLabellings, looked: np.ndarray, masks: Masks) -> tuple[np.ndarray, np.ndarray]:
    """Numerator and denominator (K, R) of the features of K classifiers; of angles, of their cosines."""
    if kind == KIND_TURN:
        pivot, near, far, one, two = looked
        at = masks.clouds.ground[rows.cloud, rows.chosen]
        ab, ac = at[near] - at[pivot], at[far] - at[pivot]
        return ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0], rows.sides[one] * rows.sides[two]
    sides = [rows.sides[side] for side in looked]
    if kind == KIND_RATIO:
        one, two = sides
        return 2.0 * (one - two), one + two
    one, two, across = sides
    return one * one + two * two - across * across, 2.0 * one * two
