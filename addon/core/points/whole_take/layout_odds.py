# SPDX-License-Identifier: GPL-3.0-or-later
"""How well a naming bears out where training knows the markers to sit: the same in all frames of a take.

By how far they are from each other and, as distances are the same in a mirror, on which side of others they are.
"""

import numpy as np

from ...data.physical import MARKER_LIMITS
from ..likelihood.sides import Sides, heights
from .likeness import LIKENESS, steadiest, worth_of_each
from .pairs import PAIRING, Moments, PairDistances, sized


class LayoutOdds:
    """How well slots, each all that has one name so far, bear out the distances that training expects of other names.

    Odds are unlimited: a plate that sits elsewhere has all of its markers off by as much, and turned round it has some
    of them off by twice that. known are those of M markers, and `sides` of which others they are on; shown is what the
    take shows of M + E slots, placed (F, M + E, 3) m in some frames, which are there for a part `coverage` (M + E,).
    """

    def __init__(self, known: PairDistances, sides: Sides, shown: Moments, placed: np.ndarray, coverage: np.ndarray):
        self.markers = len(known.mean)
        size = sized(known, shown)
        self.sides, self.size, self.placed = sides, size, placed
        self.near = steadiest(known.variance)
        rows = np.arange(self.markers)[:, None]
        self.expected = size * known.mean[rows, self.near]
        self.variance = known.variance[rows, self.near] + MARKER_LIMITS.lab_m**2
        self.apart = size * known.mean
        self.shown, self.spread, self.coverage = shown.mean, shown.variance, coverage
        self._code, self._height = np.zeros(0, int), np.zeros(0)

    def worth(self, orders: np.ndarray, most: float = np.inf) -> np.ndarray:
        """(K,) what slots are worth by names in orders (K, M + E)."""
        return self.odds(orders, most).sum(axis=1)

    def of_each(self) -> np.ndarray:
        """(M,) log odds of each marker as it is named, while it is there; NaN of one with too few others beside it."""
        order = np.arange(len(self.coverage))[None]
        return (self._of_distances(order, np.inf) + self._of_sides(order, np.inf))[0]

    def mean(self) -> float:
        """Log odds of a marker as it is named, on average of those that are there, for as long as each is."""
        odds = self.odds(np.arange(len(self.coverage))[None])[0]
        return float(odds.sum() / max(self.coverage[: self.markers].sum(), 1e-9))

    def odds(self, orders: np.ndarray, most: float = np.inf) -> np.ndarray:
        """(K, M) log odds of each marker by names in orders (K, M + E): order[m] is the slot that is marker m.

        Squares are `most` at most, and a side costs half of it.
        """
        own = orders[:, : self.markers]
        odds = np.nan_to_num(self._of_distances(orders, most)) + self._of_sides(orders, most)
        return odds * self.coverage[own]

    def _of_distances(self, orders: np.ndarray, most: float) -> np.ndarray:
        """(K, M) the same by distances alone; NaN where too few are known."""
        own, beside = orders[:, : self.markers], orders[:, self.near]
        away, spread = self.shown[own[..., None], beside], self.spread[own[..., None], beside]
        there = np.isfinite(away) & np.isfinite(self.expected) & np.isfinite(self.variance)
        there &= np.cumsum(there, axis=-1) <= LIKENESS.neighbours
        asked = there.sum(axis=-1)
        square = np.where(there, ((away - self.expected) ** 2 + spread) / self.variance, 0)
        share = worth_of_each(asked)
        square = np.minimum(square, most).sum(axis=-1) * share
        precision = share * np.where(there, 1 / self.variance, 0).sum(axis=-1) / 3 + LIKENESS.wide_m**-2
        odds = 1.5 * np.log(precision) - 1.5 * np.log(2 * np.pi) - 0.5 * square - np.log(LIKENESS.ghost_density)
        return np.where(asked >= LIKENESS.min_neighbours, odds, np.nan)

    def _of_sides(self, orders: np.ndarray, most: float) -> np.ndarray:
        """(K, M) log likelihood of the side on which each marker is, by names in orders (K, M + E)."""
        found, sides = np.zeros((len(orders), self.markers)), self.sides
        if not len(sides):
            return found
        height = self._heights(orders[:, sides.markers].reshape(-1, 4)).reshape(-1, len(sides))
        odds = np.maximum(sides.odds(height, self.size, MARKER_LIMITS.lab_m), -0.5 * most)
        np.add.at(found.T, sides.markers[:, 0], (odds * sides.share(np.isfinite(height))).T)
        return found

    def _heights(self, slots: np.ndarray) -> np.ndarray:
        """(K,) m the mean height of the first of four slots (K, 4) over the others' plane, NaN where it is not seen.

        Each is worked out once: orders differ by few slots.
        """
        code = np.ravel_multi_index(tuple(slots.T), (len(self.coverage),) * 4)
        every, first, again = np.unique(code, return_index=True, return_inverse=True)
        new = ~np.isin(every, self._code, assume_unique=True)
        if new.any():
            height = heights(self.placed[:, slots[first[new]]])
            seen = np.isfinite(height)
            count = seen.sum(axis=0)
            mean = np.where(seen, height, 0).sum(axis=0) / np.maximum(count, 1)
            code = np.concatenate([self._code, every[new]])
            order = np.argsort(code)
            self._code = code[order]
            self._height = np.concatenate([self._height, np.where(count > 0, mean, np.nan)])[order]
        return self._height[np.searchsorted(self._code, every)][again]

    def chains(self, holes: np.ndarray, width: int, length: int) -> np.ndarray:
        """(K, M + E) the orders worth most, by chains of exchanges from any of the markers `holes` (K,).

        Whoever has lost its slot takes that of another that is near to it, or an extra's, and leaves it its own: a
        limb one place off is such a chain, of which every link but the last may be worth less.
        """
        every = np.arange(len(self.coverage))
        near = (self.apart < PAIRING.max_confused_m) & ~np.eye(self.markers, dtype=bool)
        near = np.pad(near, ((0, 0), (0, len(every) - self.markers)), constant_values=True)
        orders, ends, found = np.tile(every, (len(holes), 1)), holes, []
        for _ in range(length):
            row, other = np.nonzero(near[ends])
            tried, end = orders[row].copy(), ends[row]
            one, rows = tried[np.arange(len(row)), end], np.arange(len(row))
            tried[rows, end] = tried[rows, other]
            tried[rows, other] = one
            used = (self.coverage[tried[rows, end]] > 0) & (tried[rows, end] != end)
            tried, end = tried[used], other[used]
            tried, first = np.unique(tried, axis=0, return_index=True)
            end, worth = end[first], self.worth(tried, LIKENESS.max_square)
            likely = np.argsort(-worth, kind="stable")[:width]
            found += [(float(worth[k]), tried[k]) for k in likely]
            going = likely[end[likely] < self.markers]
            orders, ends = tried[going], end[going]
            if not len(going):
                break
        found.sort(key=lambda one: -one[0])
        every_one = np.array(list({order.tobytes(): order for _, order in found}.values()), int).reshape(-1, len(every))
        every_one = two_at_once(every_one, width)
        # By either measure, in turn.
        best = [np.argsort(-self.worth(every_one, most), kind="stable") for most in (LIKENESS.max_square, np.inf)]
        return every_one[list(dict.fromkeys(np.stack(best, axis=1).ravel().tolist()))]


class Unmoved:
    """How well distances bear out that markers are where they were when the set was learned, as exactly as points are.

    So are those of who stood for the set, unless they were put on again. In how large a `part` of the steady distances
    on one bone it is so is what a naming, whose distances are `shown`, makes likeliest; of other people that is hardly
    any. known is what training has of M markers, `bone` (M,) whose each is.
    """

    def __init__(self, known: PairDistances, bone: np.ndarray, shown: Moments):
        self._known, self._size = known, sized(known, shown)
        self._place = np.arange(len(bone))[:, None], steadiest(known.variance)
        self._rigid = bone[self._place[0]] == bone[self._place[1]]
        odds, steady = self._of_pairs(shown)
        parts = np.arange(100) / 100
        self.part = float(parts[_mixed(odds[steady][:, None], parts).sum(axis=0).argmax()])

    def odds(self, shown: Moments) -> float:
        """Log odds of a naming, whose distances are `shown`, against that all markers may be elsewhere."""
        each, asked = self.of_each(shown)
        coverage = np.diagonal(shown.count)[: len(each)] / max(shown.frames, 1)
        return float((each * coverage)[asked >= LIKENESS.min_neighbours].sum())

    def of_each(self, shown: Moments) -> tuple[np.ndarray, np.ndarray]:
        """(M,) the same of each marker while it is there, and (M,) by how many steady distances."""
        odds, steady = self._of_pairs(shown)
        asked = steady.sum(axis=1)
        return np.where(steady, _mixed(odds, self.part), 0).sum(axis=1) * worth_of_each(asked), asked

    def _of_pairs(self, shown: Moments) -> tuple[np.ndarray, np.ndarray]:
        """(M, Q) log odds that the distance to each neighbour is the one that was learned, and which are steady."""
        away, spread, count = (part[self._place] for part in (shown.mean, shown.variance, shown.count))
        mean, variance = self._known.mean[self._place], self._known.variance[self._place]
        exact = MARKER_LIMITS.noise_m**2
        steady = self._rigid & (count > 1) & np.isfinite(away + mean + variance) & (spread <= exact)
        variance = np.where(steady, variance, exact)
        square = (away - self._size * mean) ** 2 / variance - (away - mean) ** 2 / exact
        return np.where(steady, 0.5 * (square + np.log(variance / exact)), 0), steady


def _mixed(odds: np.ndarray, part: np.ndarray | float) -> np.ndarray:
    """Log odds of what is one of two in such a part of all."""
    return np.logaddexp(np.log(np.maximum(part, 1e-9)) + odds, np.log1p(-np.asarray(part)))


def two_at_once(orders: np.ndarray, first: int) -> np.ndarray:
    """(K, S) orders, and any two of the first at once that move no slot both, such as a plate turned round.

    Without them stairs in plates have 3 % more of their names wrong, and half a second of a walk in pieces is taken for
    another set.
    """
    some = orders[:first]
    moved = some != np.arange(orders.shape[1])
    one, other = np.nonzero(np.triu(~(moved.astype(int) @ moved.T.astype(int) > 0), 1))
    return np.concatenate([orders, np.where(moved[one], some[one], some[other])])
