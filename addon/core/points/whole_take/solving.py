# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of points solved as a whole: names spread from what is sure, along tracklets and by distances that keep.

Round after round, what is believed shows how far the subject's markers are from each other; that says how likely each
tracklet is each marker; all tracklets are matched with the markers at once; what is far enough ahead is believed in the
next round. Then names that were exchanged for a while, or for all of the take, are put right, what is always there
beside the markers is distinguished from them, and so on with more freedom of motion, until nothing changes.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...data.lanes import blocks
from ...data.takes import NO_MARKER
from ..deciding import Said
from ..models import Model
from .exchanges import undone
from .extras import is_crowd, with_extras
from .layout import LAYOUT_NAMING, Question, named_by_layout, usual_residual
from .likeness import likeness, links, steadiest, worth_of_length
from .matching import margins, matched
from .pairs import PairDistances, in_take, trained_pairs, widened, with_unknown
from .rulings import Rulings
from .tracklets import PlacedMarkers, Tracklets, seen_in, tracklets_of


@dataclass(frozen=True)
class Freedom:
    """What is allowed for beyond the training: bends and motion_m of the body, layout_m of the markers' places.

    bend      standard deviation of a distance, over its square, 1/m: what is far from each other is on no one bone
    motion_m  the same of any distance
    layout_m  of a distance's mean
    link      log odds that how a marker went on over gaps may say at most
    """

    bend: float
    motion_m: float
    layout_m: float
    link: float


@dataclass(frozen=True)
class RoundOptions:
    """How names spread. All reckoned.

    first_margins  log odds that a tracklet's name must be ahead of any other, round after round, to be believed in the
                   next; the last is gone on with until nothing changes
    margins        the same with more freedom
    freedoms       that follow each other
    max_rounds     of each
    max_layouts    times that a freedom is gone on with after names were put right
    min_markers    that a set must have to be known by distances
    beside         markers by which one is known before all others
    min_anchored   part of a marker's points that a person must have named for its name to stay in all of the take
    """

    first_margins: tuple[float, ...] = (12.0, 8.0, 6.0, 4.0)
    margins: tuple[float, ...] = (8.0, 4.0)
    freedoms: tuple[Freedom, ...] = (
        Freedom(0.0, 0.0, 0.0, 0.0),
        Freedom(0.1, 0.0, 0.0, 8.0),
        Freedom(0.25, 0.02, 0.02, 12.0),
        Freedom(0.25, 0.05, 0.05, 12.0),
    )
    max_rounds: int = 8
    max_layouts: int = 3
    min_markers: int = 5
    beside: int = 4
    min_anchored: float = 0.5


ROUNDS = RoundOptions()


@dataclass(frozen=True, eq=False)
class Solution:
    """What a take as a whole says of its N tracklets.

    marker     (N,) of each, NO_MARKER for none
    margin     (N,) log odds by which that is ahead of any other name, or none
    likely     (N,) the name that is likeliest for each on its own, NO_MARKER where that is none
    questions  pairs of markers that may have each other's names in all of the take
    beside     (M, Q) the markers from which each keeps its distance best
    crowd      whether more is on the subject than the set's markers
    residual   in a crowd, the usual square of what is left between markers and where their set has them, over what
               training leaves; 0 where no frame shows enough of them
    """

    tracklets: Tracklets
    marker: np.ndarray
    margin: np.ndarray
    likely: np.ndarray
    questions: tuple[Question, ...]
    beside: np.ndarray
    crowd: bool = False
    residual: float = 0.0


def solve_take(
    points: np.ndarray,
    tracklet: np.ndarray,
    named: Said,
    sure: np.ndarray,
    model: Model,
    rate: float,
    progress: Callable[[float], None] | None = None,
    rulings: Rulings | None = None,
) -> Solution:
    """Names the tracklets (T, P), -1 where there is none, of points (T, P, 3) m at `rate` frames a second.

    named is what frames say on their own, sure (T, P) the markers that are believed of it. The model has a likelihood.
    `progress` hears the share that is done; `rulings` is what a person said, whose tracklets these are.
    """
    tracklets = tracklets_of(points, tracklet, named, len(model.markerset))
    begun = _majority(tracklets, sure, len(model.markerset))
    del tracklet, sure  # a long take's are large
    if rulings is not None:
        tracklets = rulings.of(tracklets)
    return _Solving(points, tracklets, model, rate).solved(begun, progress, rulings)


class _Solving:
    """A take on its way to a solution: `marker` (N,) is what is believed so far, extras after the model's own."""

    def __init__(self, points: np.ndarray, tracklets: Tracklets, model: Model, rate: float):
        self.points, self.tracklets, self.model, self.rate = points, tracklets, model, rate
        self.known = self.trained = trained_pairs(model)
        self.markers = len(model.markerset)
        self.crowd = is_crowd(tracklets, self.markers)
        # Odds grow less than a tracklet does: its parts would say more than all of it where they are only added up.
        self.duration = tracklets.count / worth_of_length(tracklets, rate)
        self.marker = self.best = self.margin = self.odds = np.zeros(0)

    def solved(self, begun: np.ndarray, progress: Callable[[float], None] | None, rulings: Rulings | None) -> Solution:
        self.marker = begun
        if rulings is not None:
            self.marker = rulings.begun(self.tracklets, self._with_held(self.marker))
            self._undo(self.trained)
        questions: tuple[Question, ...] = ()
        looked_at = None
        # Once more at the end where a marker is missing: what nothing else could be may be in its place.
        for number, freedom in enumerate((*ROUNDS.freedoms, ROUNDS.freedoms[-1])):
            if progress is not None:
                progress(number / (len(ROUNDS.freedoms) + 1))
            again = number == len(ROUNDS.freedoms)
            if number and not self._add_extras(again) and again:
                break
            least = ROUNDS.margins if number else ROUNDS.first_margins
            wide = widened(self.trained, freedom.bend, freedom.motion_m, freedom.layout_m)
            for _ in range(ROUNDS.max_layouts):
                self._spread(wide, freedom.link, least)
                if looked_at is not None and (looked_at == self.marker).all():
                    break
                before = self.marker
                questions = self._put_right(wide, absent=freedom.bend > 0)
                looked_at = self.marker
                if (before == self.marker).all():
                    break
                least = ROUNDS.margins
            else:
                self._spread(wide, freedom.link, least)
        # What is likely but not believed has its name here too: how sure it must be is for whoever asks.
        marker = np.where(self.marker == NO_MARKER, self.best, self.marker)
        own = (marker != NO_MARKER) & (marker < self.markers)
        likely = np.where(self.odds.max(axis=1) > 0, self.odds.argmax(axis=1), NO_MARKER)
        likely = np.where(likely < self.markers, likely, NO_MARKER)
        marker = np.where(own, marker, NO_MARKER)
        residual = usual_residual(self.model.likelihood, self._placed()) if self.crowd else 0.0
        beside = steadiest(self.known.variance)[:, : ROUNDS.beside]
        margin = self._seldom_there()
        return Solution(self.tracklets, marker, margin, likely, questions, beside, self.crowd, residual)

    def _seldom_there(self) -> np.ndarray:
        """(N,) by how much the names of markers that are seldom there are ahead: by what frames say on their own.

        Their distances in the take are those of whatever has the name, which thus bears itself out; a ghost is where a
        marker may be for a while. What is there for most of the take, and in a crowd, is as far ahead as it is.
        """
        if self.crowd:
            return self.margin
        frames = seen_in(self._placed())[:, : self.markers].mean(axis=0)
        seldom = np.flatnonzero(frames < LAYOUT_NAMING.min_there)
        there = np.isin(self.best, seldom) & (self.tracklets.held == NO_MARKER)
        said = self.tracklets.votes[np.arange(len(self.best)), self.best]
        return np.where(there, np.minimum(self.margin, said), self.margin)

    def _placed(self) -> np.ndarray | PlacedMarkers:
        return self.tracklets.placed(self.points, self.marker, len(self.trained.mean))

    def _spread(self, wide: PairDistances, link: float, least: tuple[float, ...]):
        """Rounds until nothing changes."""
        same = False
        for number in range(ROUNDS.max_rounds):
            if not same:
                self._match(wide, link)
            # What is believed already needs not be surer than in the end.
            needed = np.where(self.best == self.marker, least[-1], least[min(number, len(least) - 1)])
            after = np.where(self.margin >= needed, self.best, NO_MARKER)
            same = (after == self.marker).all()
            self.marker = after
            if same and number >= len(least) - 1:
                break

    def _match(self, wide: PairDistances, link: float):
        """The best names by what is believed so far."""
        placed = self._placed()
        first, last = self.tracklets.first, self.tracklets.last
        self.odds = self._odds(placed, in_take(wide, placed), link)
        self.best = matched(self.odds * self.duration[:, None], first, last)
        self.margin = margins(self.odds, self.best, first, last)

    def _odds(self, placed: np.ndarray, pairs: PairDistances, most: float) -> np.ndarray:
        """(N, M) log odds of every name of every tracklet; where none is above 0 they may be any others that are not.

        What could not be a marker even if it went on best as one, as most ghosts could not, is not asked how it does.
        """
        given = placed, self.marker, pairs, self.rate
        odds = likeness(self.tracklets, *given) + self.tracklets.votes
        if not most:
            return odds
        above = odds.max(axis=1)
        maybe = np.flatnonzero((above <= 0) & (above > -most))
        asked = links(self.tracklets, maybe, *given, odds[maybe] > -most)
        likely = above > 0
        likely[maybe] = (odds[maybe] + np.clip(asked, -most, most)).max(axis=1, initial=-np.inf) > 0
        likely = np.flatnonzero(likely)
        odds[likely] += np.clip(links(self.tracklets, likely, *given), -most, most)
        return odds

    def _put_right(self, wide: PairDistances, absent: bool) -> tuple[Question, ...]:
        """Takes back exchanges, and gives the questions that are left."""
        self._undo(wide)
        if self.crowd:
            # In a crowd two that may be each other are both unsure of their names, and the layout tells them.
            free = (self.marker == NO_MARKER) & ~np.isin(self.best, self.marker)
            self.marker = np.where(free, self.best, self.marker)
        given = self._placed(), absent, self._anchored(), self.crowd
        name, questions = named_by_layout(self.model.likelihood, *given)
        self.marker = self._with_held(np.where(self.marker != NO_MARKER, name[self.marker], NO_MARKER))
        return questions

    def _undo(self, wide: PairDistances):
        """Takes back exchanges of a while."""
        placed = self._placed()
        marker = undone(self.tracklets, placed, self.marker, self.trained, in_take(wide, placed), self.rate)
        self.marker = self._with_held(marker)

    def _anchored(self) -> np.ndarray:
        """(K,) the markers most of whose points a person named: in all of the take they are what they are called."""
        tracklets, markers = self.tracklets, len(self.trained.mean)
        named, held = (own[own != NO_MARKER] for own in (self.marker, tracklets.held))
        every = np.bincount(named, tracklets.count[self.marker != NO_MARKER], markers)
        own = np.bincount(held, tracklets.count[tracklets.held != NO_MARKER], markers)
        return np.flatnonzero((own > 0) & (own >= ROUNDS.min_anchored * every))

    def _with_held(self, marker: np.ndarray) -> np.ndarray:
        """The markers (N,) with what a person said of some, whose names nothing else has at the time."""
        held, marker = self.tracklets.held, marker.copy()
        first, last = self.tracklets.first, self.tracklets.last
        for index in np.flatnonzero(held != NO_MARKER).tolist():
            beside = (first <= last[index]) & (last >= first[index]) & (held == NO_MARKER)
            marker[beside & (marker == held[index])] = NO_MARKER
            marker[index] = held[index]
        return marker

    def _add_extras(self, missing: bool) -> bool:
        """Has what is there beside the markers compete with them; extras that nothing is any more leave.

        Whether there are new ones. With `missing`, also where one of the markers is.
        """
        before = np.unique(self.marker[self.marker >= self.markers])
        self.marker, count = with_extras(self.tracklets, self.marker, self.markers, missing)
        self.trained = with_unknown(self.known, count)
        votes = np.pad(self.tracklets.votes[:, : self.markers], ((0, 0), (0, count)))
        self.tracklets = replace(self.tracklets, votes=votes)
        return count > len(before)


def _majority(tracklets: Tracklets, sure: np.ndarray, markers: int) -> np.ndarray:
    """(N,) what most of the sure frames (T, P) of each tracklet say."""
    count = np.zeros((len(tracklets), markers), int)
    for part in blocks(*sure.shape):
        row, lane = np.nonzero((sure[part] != NO_MARKER) & (tracklets.table[part] >= 0))
        np.add.at(count, (tracklets.table[part][row, lane], sure[part][row, lane]), 1)
    return np.where(count.max(axis=1, initial=0) > 0, count.argmax(axis=1), NO_MARKER)
