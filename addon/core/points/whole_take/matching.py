# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracklets and markers matched over a take at once: the most likely naming in which no marker is twice anywhere.

A linear programme: a variable for each name that a tracklet may have; a tracklet has one at most, and of the tracklets
that are there at a time one at most has each name. Hardly any of it is ever open: a name that is worth more than all
that it stands in the way of is given, and what is left falls apart into a few tracklets each.
"""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_MARKER
from ..tracklets import VOTE


class TAKE_MATCHING:
    """How what is open is decided."""

    # names that hang together of which all choices are tried one by one; of more SciPy's solver takes less, but it
    # takes long to load
    max_tried: int = 20  # memory and time
    # log odds by which one naming is better than another: rounding must not choose between equals, of which the first
    # tracklets have the first markers
    least: float = 1e-6  # format
    # log odds that of more names the first of the tracklets loses by being the last of the markers
    order: float = 0.01  # format


@dataclass(frozen=True, eq=False)
class Names:
    """K names that tracklets may have, in the order of the tracklets."""

    tracklet: np.ndarray  # (K,) whose, and
    marker: np.ndarray  # (K,) which
    worth: np.ndarray  # (K,) log odds, above 0
    rivals: np.ndarray  # (2, R) any two of one tracklet, and
    # (2, C) any two of one marker that are there at a time, of which one at most can be right; each two both ways round
    clashes: np.ndarray

    @property
    def choices(self) -> list[range]:
        """The names of each tracklet."""
        begin = np.flatnonzero(np.diff(self.tracklet, prepend=-1))
        return [range(start, after) for start, after in zip(begin, [*begin[1:], len(self.tracklet)], strict=True)]

    @property
    def barred(self) -> list[set[int]]:
        """Those that each clashes with."""
        barred: list[set[int]] = [set() for _ in self.worth]
        for one, other in self.clashes.T.tolist():
            barred[one].add(other)
        return barred

    def part(self, open_ones: np.ndarray) -> "Names":
        """Some of them (K,)."""
        number = np.cumsum(open_ones) - 1
        pairs = (number[each[:, open_ones[each].all(axis=0)]] for each in (self.rivals, self.clashes))
        return Names(self.tracklet[open_ones], self.marker[open_ones], self.worth[open_ones], *pairs)


def matched(odds: np.ndarray, first: np.ndarray, last: np.ndarray, exact: bool = True) -> np.ndarray:
    """(N,) the marker of every tracklet, NO_MARKER for none, of the highest total log odds (N, M).

    first, last (N,) are the tracklets' frames, both included. If it need not be `exact`, what is not clear is what
    the likeliest names leave, one after the other.
    """
    found = np.full(len(odds), NO_MARKER)
    tracklet, marker = np.nonzero(odds > 0)
    begin, end = first[tracklet], _ends(first, last)[tracklet]
    long = int(end.max(initial=0)) + 1  # one marker after the other, so that those of two never meet
    clashes = _meeting(begin + long * marker, end + long * marker)
    names = Names(tracklet, marker, odds[tracklet, marker], _meeting(tracklet, tracklet), clashes)
    names = _given_what_is_clear(names, found)
    if not exact:
        chosen = _one_after_another(names)
        found[names.tracklet[chosen]] = names.marker[chosen]
        return found
    part = _hanging_together(names)
    for one in np.unique(part):
        own = names.part(part == one)
        few = len(own.worth) <= TAKE_MATCHING.max_tried
        chosen = _best_tried(own) if few else _solved(own, first, _ends(first, last))
        found[own.tracklet[chosen]] = own.marker[chosen]
    return found


def _meeting(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(2, P) any two of the spans from `first` to `last` (K,) that meet, both ways round, sorted."""
    order = np.argsort(first, kind="stable")
    after = np.searchsorted(first[order], last[order], side="right")
    place = np.arange(len(order))
    count = after - place - 1
    one = np.repeat(place, count)
    other = np.arange(len(one)) - np.repeat(np.cumsum(count) - count, count) + one + 1
    pairs = order[np.stack([np.concatenate([one, other]), np.concatenate([other, one])])]
    return pairs[:, np.lexsort(pairs[::-1])]


def _given_what_is_clear(names: Names, found: np.ndarray) -> Names:
    """Gives the names (N,) that are worth more than all that they stand in the way of; those that stay open.

    Whatever else is chosen, with such a name in place of all that it clashes with it would be more. A name of a
    tracklet that is worth less than another brings, less all that clashes with that, is not chosen for the same reason.
    """
    while True:
        worth, count = names.worth, len(names.worth)
        lost = np.bincount(names.clashes[0], worth[names.clashes[1]], count)
        one, other = names.rivals
        best, brings = np.zeros(count), np.full(count, -np.inf)
        np.maximum.at(best, one, worth[other])
        np.maximum.at(brings, one, (worth - lost)[other])
        clear = worth > lost + best + TAKE_MATCHING.least
        found[names.tracklet[clear]] = names.marker[clear]
        shut = clear | (brings > worth + TAKE_MATCHING.least)
        for pairs in (names.rivals, names.clashes):
            shut[pairs[0, clear[pairs[1]]]] = True
        if not shut.any():
            return names
        names = names.part(~shut)


def _hanging_together(names: Names) -> np.ndarray:
    """(K,) the number of the part of each name, which nothing in other parts stands in the way of."""
    part = np.arange(len(names.worth))
    one, other = np.concatenate([names.rivals, names.clashes], axis=1)
    while True:
        before = part.copy()
        np.minimum.at(part, one, before[other])
        part = part[part]
        if (part == before).all():
            return part


def _best_tried(names: Names) -> list[int]:
    """Which of a few names are chosen: tracklet after tracklet, all choices that may yet be the best."""
    worth, choices, barred = names.worth.tolist(), names.choices, names.barred
    # What the tracklets from each on bring at most.
    most = np.append(np.cumsum([max(worth[one] for one in each) for each in choices][::-1])[::-1], 0.0).tolist()
    best: tuple[float, list[int]] = (0.0, [])

    def go_on(place: int, total: float, chosen: list[int]):
        nonlocal best
        if total > best[0] + TAKE_MATCHING.least:
            best = total, chosen
        if place == len(choices) or total + most[place] <= best[0] + TAKE_MATCHING.least:
            return
        for one in choices[place]:
            if barred[one].isdisjoint(chosen):
                go_on(place + 1, total + worth[one], [*chosen, one])
        go_on(place + 1, total, chosen)

    go_on(0, 0.0, [])
    return best[1]


def _one_after_another(names: Names) -> list[int]:
    """Which names are chosen, each the likeliest that those before it leave."""
    barred = names.barred
    chosen: list[int] = []
    for one, other in names.rivals.T.tolist():
        barred[one].add(other)
    shut: set[int] = set()
    for one in np.argsort(-names.worth, kind="stable").tolist():
        if one not in shut:
            chosen.append(one)
            shut |= barred[one]
    return chosen


def _solved(names: Names, first: np.ndarray, end: np.ndarray) -> list[int]:
    """Which names are chosen, of tracklets from `first` to `end` (N,): a whole-number programme."""
    from scipy.optimize import LinearConstraint, milp
    from scipy.sparse import csr_array

    every = np.arange(len(names.worth))
    groups = [every[names.tracklet == one] for one in np.unique(names.tracklet)]
    for marker in np.unique(names.marker):
        own = every[names.marker == marker]
        groups += [own[clique] for clique in cliques(first[names.tracklet[own]], end[names.tracklet[own]])]
    row = np.repeat(np.arange(len(groups)), [len(group) for group in groups])
    once = csr_array((np.ones(len(row)), (row, np.concatenate(groups))), shape=(len(groups), len(every)))
    # Of equals the first tracklets have the first markers: the first loses most by having the last marker.
    lost = names.tracklet / (names.tracklet.max() + 1) - 1
    solved = milp(
        -names.worth - TAKE_MATCHING.order * lost * names.marker / (names.marker.max() + 1),
        integrality=np.ones(len(every)),
        bounds=(0, 1),
        constraints=LinearConstraint(once, ub=1),
        options={"mip_rel_gap": 0.0},
    )
    return np.flatnonzero(solved.x > 0.5).tolist()


def cliques(first: np.ndarray, end: np.ndarray) -> list[np.ndarray]:
    """The sets of spans (K,), by index, that are there when one of them begins; those of one are left out."""
    found: list[np.ndarray] = []
    for start in np.unique(first):
        there = np.flatnonzero((first <= start) & (end >= start))
        if len(there) > 1:
            found.append(there)
    return found


def _ends(first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(N,) the last frames of tracklets that are shortened, so that those that hardly overlap do not meet."""
    return np.maximum(last - VOTE.max_overlap_frames, first)


def margins(odds: np.ndarray, marker: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(N,) by how much the names (N,) are ahead of the next best naming in which the tracklet has another, or none."""
    index = np.flatnonzero(marker != NO_MARKER)
    own = np.zeros(len(odds))
    own[index] = odds[index, marker[index]]
    # What has no name and could have none takes none over either; of most ghosts that is so.
    likely = np.flatnonzero((marker != NO_MARKER) | (odds.max(axis=1, initial=-np.inf) > 0))
    one, other = likely[_meeting(first[likely], _ends(first, last)[likely])]
    named, beside = marker[one] != NO_MARKER, np.zeros(odds.shape)
    np.add.at(beside, (other[named], marker[one[named]]), own[one[named]])
    one, other = one[named], other[named]
    instead = odds[other, marker[one]]
    # Without its name, which another tracklet of the time may take over from all that have it while that is there.
    free = np.zeros(len(odds))
    np.maximum.at(free, one, instead - own[other] - beside[other, marker[one]] + own[one])
    # With another name, for which whoever has it gives it up, or takes this one in exchange.
    rest = odds.copy()
    held = marker[other] != NO_MARKER
    given_up = np.maximum(instead, 0) - own[other]
    np.add.at(rest, (one[held], marker[other[held]]), given_up[held])
    rest[index, marker[index]] = -np.inf
    found = np.zeros(len(odds))
    found[index] = own[index] - np.maximum(free[index], rest[index].max(axis=1, initial=-np.inf))
    return found


def leads(odds: np.ndarray, marker: np.ndarray, first: np.ndarray, last: np.ndarray) -> np.ndarray:
    """(N,) by how much the names (N,), which all have, are ahead of the best in which a tracklet has another instead.

    While others have that, they take its own in exchange: each counts by the part of its time that it is there.
    """
    every, end = np.arange(len(odds)), _ends(first, last)
    own, rest = odds[every, marker], odds.copy()
    one, other = _meeting(first, end)
    both = np.minimum(end[one], end[other]) - np.maximum(first[one], first[other]) + 1
    part = both / (end - first + 1)[one]
    np.add.at(rest, (one, marker[other]), (odds[other, marker[one]] - own[other]) * part)
    rest[every, marker] = -np.inf
    return own - rest.max(axis=1, initial=-np.inf)


def leading(odds: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of each row of odds (N, M) the best column (N,), its odds (N,), and the best of all others of row and column."""
    rows, best = np.arange(len(odds)), odds.argmax(axis=1)
    own, others, rows_beside = odds[rows, best], odds.copy(), odds[:, best]
    others[rows, best] = rows_beside[rows, rows] = -np.inf
    return best, own, np.maximum(others.max(axis=1, initial=-np.inf), rows_beside.max(axis=0, initial=-np.inf))
