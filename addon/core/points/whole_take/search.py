# SPDX-License-Identifier: GPL-3.0-or-later
"""Looking for a naming of a take that is worth more: one kind of move, on groups of markers, and one rule.

A group of markers loses its names. They are given again, to all that has none, by the distances to everything else that
is named; or they are exchanged within the group. What frames said of the group does not count for what is proposed: it
is what may be wrong. It counts for what is kept, which is what the objective prefers. Last, single frames are asked
that call most of it otherwise: where few are right, no group leads from what the others begin with to what those say.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Literal

import numpy as np

from ...data.takes import NO_MARKER, NO_POINT
from ..likelihood.naming import Settled, name_odds, score_of, settle
from ..likelihood.solving import alternatives, own_odds
from ..refusals import REFUSAL
from ..tracklets import VOTE
from .layout_odds import LayoutOdds, two_at_once
from .likeness import LIKENESS
from .matching import margins, matched
from .objective import (
    OBJECTIVE,
    USUAL_FREEDOM,
    Candidate,
    Freedom,
    Objective,
    clipped,
    lasting,
)
from .pairs import without_markers
from .tracklets import RULING


class SEARCH:
    """Which moves are tried."""

    # of a neighbourhood, a marker and those nearest to it: a hand, a forearm, a foot with its shank
    sizes: tuple[int, ...] = (5, 9, 14)  # physical
    # nats in all of the take by which a naming must be worth more: rounding must not choose of equals
    least: float = 5.0  # format
    # of the odds a frame of the usual marker, with less of which one is in doubt; in takes that are right 0.68 at
    # least, and where limbs are one place off some marker has less
    borne_out: float = 0.6  # measured
    sweeps: int = 3  # measured: over all groups; with one 2 % of plates and of people of other labs are lost
    chains: int = 48  # measured: that are tried; with 16 a turned plate of S02 is not found
    links: int = 5  # physical: of a chain: a shoulder, an elbow and a hand's three
    width: int = 30  # memory: chains that are gone on with


Moves = Literal["all", "exchanges", "none"]


@dataclass(frozen=True, eq=False)
class Slots:
    """What may have a marker's name: all that has one name so far, and what has none and is usually there."""

    # (N,) the slot of each tracklet, NO_MARKER for none; those without a name follow on the M + E names
    own: np.ndarray
    layout: LayoutOdds  # what bears out where training knows the markers to be
    settled: Settled | None  # the frames whose shape is asked; None where none shows enough

    def __len__(self) -> int:
        return len(self.layout.coverage)


class Search:
    """A search that stands at `best`; `others` are the namings that were tried and are worth less.

    Of a take that was solved, and is `edited` since, what a person named in a part of a trajectory may have that name
    in more of it, in exchange for another; nothing else changes.
    """

    def __init__(self, objective: Objective, start: np.ndarray, wide: Freedom, edited: bool = False):
        self.objective, self._wide = objective, wide
        self._edited, held = edited, objective.tracklets.held != NO_MARKER
        self._given = self._called(objective.tracklets.held)[held]
        objective.look_at(start)
        self.best = objective.of(start)
        self._tried = {start.tobytes()}
        self.others: list[Candidate] = []
        apart = np.nan_to_num(objective.known.mean, nan=np.inf)
        np.fill_diagonal(apart, -1.0)
        self.near = np.argsort(apart, axis=1, kind="stable")

    def climb(self, moves: Moves = "all"):
        """Tries all groups until none is worth more; where only exchanges are tried, which are soon done, once."""
        for _ in range({"all": SEARCH.sweeps, "exchanges": 1, "none": 0}[moves]):
            before = self.best
            for marker in self._moves(moves):
                self.propose(marker)
            if self.best is before:
                break

    def _moves(self, moves: Moves) -> Iterator[np.ndarray]:
        """Namings (N,) that are tried, each made of what is best when it is asked for."""
        for group in self._neighbourhoods():
            if moves == "all":
                yield self._opened(group, self.best)
            yield self._by_shape(group)
        if moves == "all":
            yield from self._shifted()
        for tracklet in self._unsure():
            yield from self._of_one(tracklet)
        yield from self._chains()
        yield from self._exchanges()
        yield from self._alone()
        if moves == "all":
            yield from self._as_said()
            yield from self._of_frames()

    def propose(self, marker: np.ndarray) -> bool:
        """Goes over to the naming (N,) if it is worth more, and if nobody has said otherwise."""
        key, held = marker.tobytes(), self.objective.tracklets.held
        if key in self._tried or (marker != held)[held != NO_MARKER].any():
            return False
        self._tried.add(key)
        new = self.objective.of(marker)
        better = bool(self.objective.gain(new, self.best) * self.objective.length > SEARCH.least)
        if better and self._edited:
            changed = marker != self.best.marker
            touched = np.setdiff1d([marker[changed], self.best.marker[changed]], NO_MARKER)
            better = len(touched) <= 2 and bool(np.isin(self._called(marker)[changed], self._given).any())
        self.others.append(self.best if better else new)
        if better:
            self.best = new
            for name in ("_slots", "_odds", "_said"):  # known of what was best
                vars(self).pop(name, None)
        return better

    def _called(self, marker: np.ndarray) -> np.ndarray:
        """(N,) a number for each name (N,) in its lane."""
        return self.objective.tracklets.lane * (self.objective.markers + self.objective.extras + 1) + marker

    def _neighbourhoods(self) -> Iterator[np.ndarray]:
        """Each marker with those that are nearest to it, where one of them is in doubt; none twice."""
        seen, doubted = set(), self._doubted()
        for size in SEARCH.sizes:
            for near in self.near[:, :size]:
                group = np.sort(near)
                if group.tobytes() not in seen and doubted[group].any():
                    seen.add(group.tobytes())
                    yield group

    def _doubted(self) -> np.ndarray:
        """(M,) the markers that are seldom there, or that what is named beside them hardly bears out."""
        objective, marker = self.objective, self.best.marker
        borne_out = objective.borne_out(self.best)
        doubted = self.seldom()[: objective.markers] | (borne_out < SEARCH.borne_out * np.median(borne_out))
        every = np.arange(objective.markers + objective.extras)
        doubted |= self.best.slots.odds(every[None])[0] < 0
        doubted[marker[[one for one in self._unsure() if marker[one] < objective.markers]]] = True
        return doubted

    @cached_property
    def _slots(self) -> Slots:
        """What may have the names of markers as they are best."""
        objective, best = self.objective, self.best
        free = (best.marker == NO_MARKER) & (objective.tracklets.count >= REFUSAL.min_half * objective.length)
        if not free.any():
            return Slots(best.marker, best.slots, best.settled)
        own = np.where(free, objective.markers + objective.extras + np.cumsum(free) - 1, best.marker)
        placed = objective.placed(own)
        return Slots(own, objective.layout(own, objective.moments(placed), placed), objective.settled(placed))

    @cached_property
    def _odds(self) -> np.ndarray:
        """(N, M + E) log odds of every name of every tracklet, the others being as they are best."""
        return self.objective.odds(self.best.marker, self.best.placed, self.best.moments, USUAL_FREEDOM)

    def _unsure(self) -> list[int]:
        """The tracklets that are named and nearly as likely something else, the least sure first."""
        tracklets, weight = self.objective.tracklets, self.objective.weight
        margin = margins(self._odds, self.best.marker, tracklets.first, tracklets.last) * weight / tracklets.count
        some = np.flatnonzero((self.best.marker != NO_MARKER) & (margin < OBJECTIVE.max_marker))
        return some[np.argsort(margin[some], kind="stable")].tolist()

    def _of_one(self, tracklet: int) -> Iterator[np.ndarray]:
        """Namings (N,) in which a tracklet that has a name has another's for a while or from it on, or none.

        An extra that is usually there stays: what has no name takes no part in exchanges, and a limb whose markers all
        are extras could not be given its names.
        """
        if self.best.marker[tracklet] == NO_MARKER:
            return
        yield self._turned(tracklet)
        yield self._turned(tracklet, on=True)
        name = self.best.marker[tracklet]
        if name < self.objective.markers or self.seldom()[name]:
            yield self._renamed(tracklet, NO_MARKER)

    def seldom(self) -> np.ndarray:
        """(M + E,) the names that are there for less than half as long as those of the usual marker."""
        part = self.best.slots.coverage
        return part < REFUSAL.min_half * np.median(part[: self.objective.markers])

    def _turned(self, tracklet: int, on: bool = False) -> np.ndarray:
        """(N,) the names with that of a tracklet and its likeliest other exchanged, for as long as they hang together.

        One of two is exchanged with the other until a moment comes at which neither is there, or from there `on`.
        """
        marker, tracklets = self.best.marker.copy(), self.objective.tracklets
        odds = self._odds[tracklet].copy()
        one = marker[tracklet]
        odds[one] = -np.inf
        other = odds.argmax()
        own = np.flatnonzero(((marker == one) | (marker == other)) & (tracklets.held == NO_MARKER))
        own = own[np.argsort(tracklets.first[own], kind="stable")]
        ends = np.maximum.accumulate(tracklets.last[own])
        part = np.cumsum(np.append(False, tracklets.first[own][1:] > ends[:-1] - VOTE.max_overlap_frames))
        here = part[own == tracklet]  # of what a person named there is none
        turned = own[(part == here) | (on & (part > here))] if len(here) else own[:0]
        marker[turned] = one + other - marker[turned]
        return marker

    def _opened(self, group: np.ndarray, now: Candidate) -> np.ndarray:
        """(N,) the names with those of a group given again; extras may take part in it."""
        objective, marker = self.objective, now.marker
        inside, held = np.isin(marker, group), objective.tracklets.held != NO_MARKER
        free = np.flatnonzero((inside | (marker == NO_MARKER) | (marker >= objective.markers)) & ~held)
        first, last = objective.tracklets.first[free], objective.tracklets.last[free]
        tried = np.where(inside & ~held, NO_MARKER, marker)
        placed, shown = now.placed.copy(), without_markers(now.moments, group)
        placed[:, group] = np.nan
        asked = np.zeros((len(free), placed.shape[1]), bool)
        asked[:, group] = True
        if held.any():
            placed = objective.placed(tried)
            shown = objective.moments(placed)
        for freedom in (USUAL_FREEDOM, self._wide, self._wide):
            odds = objective.odds(tried, placed, shown, freedom, free, asked, group)[:, group]
            odds *= objective.weight[free, None]
            found = matched(odds, first, last, exact=False)
            before, tried = tried, tried.copy()
            left = np.where(marker[free] >= objective.markers, marker[free], NO_MARKER)
            tried[free] = np.where(found == NO_MARKER, left, group[found])
            if (tried == before).all():
                break
            placed = objective.placed(tried)
            shown = objective.moments(placed)
        return self._with_left(marker, tried, group)

    def _shifted(self) -> Iterator[np.ndarray]:
        """Namings (N,) in which one that is seldom there is what one near to it was, whose name is given again, or not.

        Without them a squat among 59 markers loses 23 % of its names, and 4 % are wrong. What is taken off after a
        standing trial is not there.
        """
        seldom = (self.seldom() & (self.best.slots.coverage > 0))[: self.objective.markers]
        for name in np.flatnonzero(seldom).tolist():
            for other in self.near[name, 1 : SEARCH.sizes[0]].tolist():
                if not self.seldom()[other]:
                    exchanged = self._of_pair(name, other, self._slots)
                    yield np.where(exchanged == other, NO_MARKER, exchanged)
                    yield self._opened(np.array([other]), self.objective.of(exchanged))

    def _with_left(self, marker: np.ndarray, tried: np.ndarray, group: np.ndarray) -> np.ndarray:
        """(N,) names in which what a marker of the group was is the extra that it has become, which else is none."""
        markers = self.objective.markers
        for name in group.tolist() if self.objective.extras else ():
            taken = marker[(tried == name) & (marker >= markers)]
            if len(taken):
                tried = np.where((marker == name) & (tried == NO_MARKER), np.bincount(taken).argmax(), tried)
        return tried

    def _as_said(self) -> Iterator[np.ndarray]:
        """Namings (N,) in which a marker and those nearest to it are what most frames on their own call so.

        Names that spread may have left a limb that has more on it than the set's markers, from plate to plate. Of what
        is seldom there frames say too little. Without them 8 % of a take as recorded (`freeform`) lose their names.
        """
        markers = self.objective.markers
        for size in range(2, SEARCH.sizes[-1] + 1):
            for group in np.unique(np.sort(self.near[:, :size], axis=1), axis=0):
                slots, said = self._slots, self._said
                other = said.argmax(axis=0) != np.arange(markers)
                if other[group].any() and not self.seldom()[group].any():
                    free = np.append(group, np.arange(markers, len(slots)))
                    yield self._assigned(group, free, said[np.ix_(free, group)].T, slots)

    @cached_property
    def _said(self) -> np.ndarray:
        """(S, M) how many frames on their own call each slot so; of as many, and of none, what has the name has it."""
        slots, markers = self._slots, self.objective.markers
        tracklet, name = self.objective.said_of_each()
        said, own = np.zeros((len(slots), markers)), slots.own[tracklet]
        np.add.at(said, (own[own != NO_MARKER], name[own != NO_MARKER]), 1.0)
        said[np.arange(markers), np.arange(markers)] += 0.5
        return said

    def _by_shape(self, group: np.ndarray) -> np.ndarray:
        """(N,) the names with a group's given again by where the shape of frames has them."""
        slots, known = self._slots, self.objective.model.learned_likelihood.known
        now, every = slots.settled, np.arange(len(slots))
        if now is None:
            return self.best.marker
        free = np.append(group, every[self.objective.markers :])
        naming = now.naming.copy()
        naming[:, group] = NO_POINT
        rest = settle(known.fine, known.constraints, now.points, now.present, naming)
        odds = name_odds(known.fine, known.constraints, rest)[:, group][:, :, free]
        usual = np.where(now.present[:, None, free], np.maximum(odds, -OBJECTIVE.max_marker), 0.0).mean(axis=0)
        return self._assigned(group, free, usual, slots)

    def _assigned(self, group: np.ndarray, free: np.ndarray, odds: np.ndarray, slots: Slots) -> np.ndarray:
        """(N,) the names with a group's (G,) given to the free slots (F,) for which odds (G, F) are highest."""
        from scipy.optimize import linear_sum_assignment

        column, order = free[linear_sum_assignment(odds, maximize=True)[1]], np.arange(len(slots))
        order[column] = group
        order[np.setdiff1d(group, column)] = np.setdiff1d(column, group)
        return self._exchanged(order, slots)

    def _of_frames(self) -> Iterator[np.ndarray]:
        """Namings (N,) in which all is called as one frame on its own has it.

        Without them a head and trunk alone, of which few frames are right, are refused.
        """
        slots, seen = self._slots, set()
        for tracklet, name in self.objective.of_frames(self.best):
            slot, order = slots.own[tracklet], np.arange(len(slots))
            order[name[slot != NO_MARKER]] = NO_MARKER
            order[slot[slot != NO_MARKER]] = name[slot != NO_MARKER]
            if order.tobytes() not in seen:
                yield self._exchanged(order, slots)
            seen.add(order.tobytes())
            if len(seen) == OBJECTIVE.frames:
                break

    def _chains(self) -> Iterator[np.ndarray]:
        """Namings (N,) by chains of exchanges from markers in doubt, the likeliest by how far markers are apart.

        Then the likeliest of them by the shape, too.
        """
        doubted, slots = np.flatnonzero(self._doubted()), self._slots
        if not len(doubted):
            return
        orders = slots.layout.chains(doubted, SEARCH.width, SEARCH.links)
        by_shape = two_at_once(self._by_gain(orders), SEARCH.width)
        for order in np.concatenate([orders[: SEARCH.chains], self._by_gain(by_shape)[: SEARCH.width]]):
            called = np.empty_like(order)
            called[order] = np.arange(len(order))
            yield self._exchanged(called, slots)

    def _by_gain(self, orders: np.ndarray) -> np.ndarray:
        """Orders (K, S) of slots, those first that are worth most by where training knows markers, and by the shape."""
        slots, known = self._slots, self.objective.model.learned_likelihood.known
        now, own = slots.settled, orders[:, : self.objective.markers]
        gain = slots.layout.worth(orders) / LIKENESS.max_samples
        if now is not None:
            naming = np.where(now.present[:, own], own, NO_POINT)
            points, worth = (np.repeat(each, len(orders), axis=0) for each in (now.points, now.worth))
            score = score_of(known.fine, known.constraints, points, worth, naming.reshape(-1, own.shape[1]))
            moved = (naming != now.naming[:, None]).sum(axis=2)
            gain = gain + OBJECTIVE.shape * clipped(score.reshape(len(naming), -1) - now.score[:, None], moved)
        return orders[np.argsort(-gain, kind="stable")]

    def _alone(self) -> Iterator[np.ndarray]:
        """Namings (N,) in which a tracklet without a marker's name has one, or one whose marker is seldom there none.

        The marker is not there at the time or, where the tracklet is no extra, what is called so then is worth less as
        it. An extra may be any in doubt whatever its distances say: these are what is wrong where a marker has the name
        for a part of the take only. What lasts and has no name may be any that is usually there.
        """
        marker, tracklets, markers = self.best.marker, self.objective.tracklets, self.objective.markers
        own = (marker != NO_MARKER) & (marker < markers)
        likely = self._odds[:, :markers] > -OBJECTIVE.max_marker
        likely |= (marker >= markers)[:, None] & self._doubted()
        free = (marker == NO_MARKER) & lasting(tracklets, self.objective.rate)
        likely |= free[:, None] & ~self.seldom()[:markers]
        tracklet, name = np.nonzero(likely & ~own[:, None])
        taken = self._beside(tracklet) & (marker[:, None] == name)
        worth = self._odds * self.objective.weight[:, None]
        lost = np.where(taken, worth[np.arange(len(marker)), marker][:, None], 0.0).sum(axis=0)
        free = ~taken.any(axis=0) | ((marker[tracklet] == NO_MARKER) & (worth[tracklet, name] > lost))
        seldom = np.flatnonzero(own)[self.seldom()[marker[own]]]
        one = np.concatenate([tracklet[free], seldom])
        other = np.concatenate([name[free], np.full(len(seldom), NO_MARKER)])
        some = np.argsort(-tracklets.count[one], kind="stable")[: SEARCH.chains]
        for tracklet, name in zip(one[some].tolist(), other[some].tolist(), strict=True):
            yield self._renamed(tracklet, name)

    def _renamed(self, tracklet: int, name: int) -> np.ndarray:
        """(N,) the names with another one of a tracklet, which nothing else has at the time."""
        marker = self.best.marker.copy()
        marker[self._beside(tracklet) & (marker == name)] = NO_MARKER
        marker[tracklet] = name
        return marker

    def _beside(self, some: np.ndarray | int) -> np.ndarray:
        """(N, K) True for the tracklets that are there while some (K,) are; (N,) of one."""
        first, end = self.objective.tracklets.first, self.objective.tracklets.last - VOTE.max_overlap_frames
        return np.less_equal.outer(first, end[some]) & np.greater_equal.outer(end, first[some])

    def _exchanged(self, order: np.ndarray, slots: Slots) -> np.ndarray:
        """(N,) the names with each slot called as `order` has it, but where a person has said otherwise.

        What has got a name since the slots were made up has that name's.
        """
        marker, votes = self.best.marker, self.objective.tracklets.votes
        every = self.objective.markers + self.objective.extras
        slot = np.where((marker == NO_MARKER) & (slots.own >= every), slots.own, marker)
        called = np.where(slot == NO_MARKER, NO_MARKER, order[slot])
        called[called >= every] = NO_MARKER
        own = np.flatnonzero((called != NO_MARKER) & (called < self.objective.markers))
        refused = own[votes[own, called[own]] <= -RULING.odds]
        called[refused] = marker[refused]
        return called

    def _of_pair(self, one: int, other: int, slots: Slots) -> np.ndarray:
        """(N,) the names with those of two slots exchanged."""
        order = np.arange(len(slots))
        order[[one, other]] = other, one
        return self._exchanged(order, slots)

    def _exchanges(self) -> Iterator[np.ndarray]:
        """Namings (N,) by exchanges of limbs, two markers, and one with an extra, that the shape of frames allows.

        The rest of the objective may make up for what one marker can lose there, and not for more.
        """
        slots, known = self._slots, self.objective.model.learned_likelihood.known
        now, markers, every = slots.settled, self.objective.markers, len(slots)
        if now is None:
            return
        for limb in known.exchanges:
            naming = np.where(now.present[:, limb], limb, NO_POINT)
            score = score_of(known.fine, known.constraints, now.points, now.worth, naming)
            if clipped(score - now.score, 2) > -OBJECTIVE.max_marker:
                yield self._exchanged(np.append(limb, np.arange(markers, every)), slots)
        one, other = np.nonzero(self._of_two(now) > -OBJECTIVE.max_marker)
        for pair in zip(one.tolist(), other.tolist(), strict=True):
            exchanged = self._of_pair(*pair, slots)
            yield exchanged
            # What had the marker's name may be no marker of anything, which as an extra costs.
            if markers <= pair[1] < markers + self.objective.extras:
                yield np.where(exchanged == pair[1], NO_MARKER, exchanged)

    def _of_two(self, now: Settled) -> np.ndarray:
        """(M, M + E) what frames `now` win if two exchange names; each two once, minus infinity elsewhere."""
        known, markers = self.objective.model.learned_likelihood.known, self.objective.markers
        found = alternatives(known.fine, known.constraints, now)
        there, rest = now.named[:, :, None] & now.named[:, None], now.named[:, :, None] | now.named[:, None]
        moved = np.where(now.named[:, :, None], found.move, found.move.swapaxes(1, 2))
        each = np.where(there, np.maximum(found.swap, found.swap.swapaxes(1, 2)), np.where(rest, moved, 0.0))
        named = now.named.any(axis=0)
        gain = np.where(np.triu(named | named[:, None], 1), clipped(each, 2), -np.inf)
        odds = name_odds(known.fine, known.constraints, now)
        extra = odds[:, :, markers:] - own_odds(now, odds)[..., None]
        return np.concatenate([gain, clipped(extra, 2)], axis=1)
