# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of points solved as a whole: names spread from what is sure, and a search mends what they came to.

What frames say most of each tracklet is begun with. Round after round, what is believed shows how far the subject's
markers are from each other; that says how likely each tracklet is each marker; all tracklets are matched with the
markers at once; what is far enough ahead is believed in the next round, with more and more freedom of motion. From
there the `search` climbs the `objective`, in which what is always there beside the markers competes with them.
"""

from collections.abc import Generator
from dataclasses import replace

import numpy as np

from ...data.made import Table
from ...data.takes import NO_MARKER
from ..models import Model
from ..refusals import REFUSAL
from .layout import Question, named_by_layout
from .layout_odds import LayoutOdds, Unmoved
from .likeness import LIKENESS
from .matching import margins, matched
from .objective import USUAL_FREEDOM, Freedom, Objective, fullest_frames, lasting, usual_fit
from .pairs import in_take, stood
from .rulings import Rulings
from .search import SEARCH, Moves, Search
from .solution import Solution
from .tracklets import RULING, FrameLabels, Tracklets, tracklets_of


class ROUNDS:
    """How names spread."""

    # log odds that a tracklet's name must be ahead of any other to be believed in the next
    margin: float = 4.0  # measured: twice loses 4 % of takes of other labs, half nothing
    # that follow each other; with the last alone takes of other labs lose 1 %, without the first a crowd of which
    # frames know the trunk only loses a third
    freedoms: tuple[Freedom, ...] = (Freedom(0.0, 0.0, 0.0, 0.0), USUAL_FREEDOM, Freedom(0.25, 0.05, 0.05, 12.0))
    max_rounds: int = 8  # memory and time: of each; with half a plate of others is named as another


class MARGINS:
    """How sure a name is, by what else was tried."""

    # independent looks that a take is worth for a group of markers: its layout is off in all frames alike; with 1 known
    # people lose 4 to 9 % of their labels, with 2.75 takes of other labs have wrong ones
    looks: float = 1.5  # measured
    there: float = 3.0  # measured: log odds of a marker that is worn to be there: gaps are 2 to 7 % of recorded takes


def solve_take(
    points: Table,
    tracklet: np.ndarray,
    named: FrameLabels,
    model: Model,
    rate: float,
    rulings: Rulings | None = None,
    occupied: int | None = None,
    sure: bool = True,
    search: Moves = "all",
    shown: np.ndarray | None = None,
) -> Generator[float, None, Solution]:
    """Names the tracklets (T, P), -1 where there is none, of points (T, P, 3) m at `rate` frames a second.

    named is what frames say on their own, of which the likeliest names are begun with. The model has a likelihood.
    Yields the share that is done. `rulings` is what a person said, whose tracklets these are: it begins with what the
    take was solved to without them. `occupied` is in how many frames the subject may be, all of them without it. Frames
    that are not `sure` on their own know no crowd by the shape alone. `search` says which moves are tried on what has
    spread. `shown` (K, M, 3) m is where the subject's markers were in other frames, NaN where one was not: their
    distances are known by that.
    """
    tracklets = tracklets_of(points, tracklet, named, len(model.markerset))
    del tracklet  # a long take's is large
    begun = _likeliest(tracklets)
    if rulings is not None:
        tracklets = rulings.of(tracklets)
        begun = rulings.begun(tracklets)
    solving = _Solving(points, tracklets, named, model, rate, begun, sure)
    if shown is not None:
        solving.objective.known = in_take(solving.objective.known, shown)
    if occupied is not None:
        solving.objective.length = occupied
    if rulings is None:
        return (yield from solving.solved(search))
    solving.objective.extras = rulings.extras
    solution = solving.solved_again(rulings)
    return replace(solution, margin=rulings.sure(tracklets, solution.marker, solution.margin))


class _Solving:
    """A take on its way to a solution: `marker` (N,) is what is believed so far, extras after the model's own."""

    def __init__(
        self,
        points: Table,
        tracklets: Tracklets,
        named: FrameLabels,
        model: Model,
        rate: float,
        begun: np.ndarray,
        sure: bool,
    ):
        self.tracklets, self.marker, self.markers = tracklets, begun, len(model.markerset)
        self.crowd = sure and is_crowd(tracklets, self.markers, rate)
        self.objective = Objective(points, tracklets, named, model, rate)
        self.best = self.margin = self.odds = np.zeros(0)

    def solved(self, moves: Moves) -> Generator[float, None, Solution]:
        """What frames came to spread over the take, and mended by some moves."""
        questions: tuple[Question, ...] = ()
        for number, freedom in enumerate(ROUNDS.freedoms):
            yield number / len(ROUNDS.freedoms)
            if number and self.crowd:
                self._add_extras()
            self._spread(freedom)
            if self.crowd:
                questions = self._put_in_place()
        if self.crowd:
            return self._solution(self._filled(), questions)
        if self._add_extras():
            self._spread(freedom)
        search = Search(self.objective, self._filled(), freedom)
        search.climb(moves)
        return self._solution(search.best.marker, (), search)

    def solved_again(self, rulings: Rulings) -> Solution:
        """What the take was solved to, changed as edits say."""
        self._match(ROUNDS.freedoms[-1])
        begun = self.tracklets.with_held(np.where(self.marker == NO_MARKER, self.best, self.marker))
        search = Search(self.objective, begun, ROUNDS.freedoms[-1], edited=True)
        search.climb()
        for rival in rulings.rivals(self.tracklets, search.best.marker):
            search.propose(rival)
        return self._solution(search.best.marker, (), search)

    def _put_in_place(self) -> tuple[Question, ...]:
        """Names the markers of a crowd by where training knows them to sit; the questions that are left.

        All that is on one body keeps its distances, whatever it is called. Two that may be each other are both unsure
        of their names, and the layout tells them.
        """
        free = (self.marker == NO_MARKER) & ~np.isin(self.best, self.marker)
        self.marker = np.where(free, self.best, self.marker)
        placed = self.objective.every_placed(self.marker)
        shown = placed[fullest_frames(np.isfinite(placed[:, : self.markers, 0]))]
        held = np.unique(self.tracklets.held[self.tracklets.held != NO_MARKER])
        name, questions = named_by_layout(self.objective.model.learned_likelihood, shown, held)
        self.marker = self.tracklets.with_held(np.where(self.marker != NO_MARKER, name[self.marker], NO_MARKER))
        return tuple(replace(question, odds=question.odds * MARGINS.looks) for question in questions)

    def _spread(self, freedom: Freedom):
        """Rounds until nothing changes."""
        for _ in range(ROUNDS.max_rounds):
            self._match(freedom)
            before, self.marker = self.marker, np.where(self.margin >= ROUNDS.margin, self.best, NO_MARKER)
            if (before == self.marker).all():
                break

    def _match(self, freedom: Freedom):
        """The best names by what is believed so far."""
        placed = self.objective.placed(self.marker)
        self.odds = self.objective.odds(self.marker, placed, self.objective.moments(placed), freedom)
        first, last = self.tracklets.first, self.tracklets.last
        self.best = matched(self.odds * self.objective.weight[:, None], first, last)
        self.margin = margins(self.odds, self.best, first, last)

    def _filled(self) -> np.ndarray:
        """(N,) the names, with the best of what has none that is believed."""
        best = np.where(self.best < self.markers, self.best, NO_MARKER)
        return self.tracklets.with_held(np.where(self.marker == NO_MARKER, best, self.marker))

    def _add_extras(self) -> bool:
        """Has what is there beside the markers compete with them; extras that nothing is any more leave.

        Whether there are new ones: those without a name that are there in the frame in which most of them are become
        one each. The rest of their tracklets is for the take to find.
        """
        marker, tracklets = self.marker, self.tracklets
        before, number = np.unique(marker[marker >= self.markers], return_inverse=True)
        marker[marker >= self.markers] = self.markers + number
        self.objective.extras = len(before)
        refused = (tracklets.votes <= -RULING.odds).any(axis=1)
        free = np.flatnonzero((marker == NO_MARKER) & lasting(tracklets, self.objective.rate) & ~refused)
        if not len(free):
            return False
        first, last = tracklets.first[free], tracklets.last[free]
        count = np.searchsorted(np.sort(first), first, side="right") - np.searchsorted(np.sort(last), first)
        fullest = first[count.argmax()]
        together = free[(first <= fullest) & (fullest <= last)]
        together = together[np.argsort(-tracklets.count[together], kind="stable")]
        marker[together] = self.markers + len(before) + np.arange(len(together))
        self.objective.extras += len(together)
        return True

    def _solution(self, marker: np.ndarray, questions: tuple[Question, ...], search: Search | None = None) -> Solution:
        """What is said of names (N,), by the widest freedom, and by what a search has tried."""
        objective = self.objective
        placed = objective.placed(marker)
        shown = objective.moments(placed)
        odds = objective.odds(marker, placed, shown, ROUNDS.freedoms[-1])
        slots = objective.layout(marker, shown, placed)
        own = np.where(marker < self.markers, marker, NO_MARKER)
        margin = margins(odds, marker, self.tracklets.first, self.tracklets.last)
        rivals: tuple[np.ndarray, ...] = ()
        near = None
        if search is not None:
            near = search.near[:, 1 : SEARCH.sizes[-1]]
            alone = np.minimum(margin, self._of_seldom(own))
            unmoved = Unmoved(objective.known, objective.model.markerset.attachment, shown)
            alone[self._unlikely(own, slots, unmoved.of_each(shown)[0]) | self._lonely(own, search)] = 0.0
            of_others, questions, rivals = self._of_others(search, alone, unmoved)
            margin = np.minimum(alone, of_others)
        likely = np.where(odds.max(axis=1) > 0, odds.argmax(axis=1), NO_MARKER)
        likely = np.where(likely < self.markers, likely, NO_MARKER)
        fit = usual_fit(objective.model.learned_likelihood, placed[:, : self.markers])
        fit = replace(fit, residual=fit.residual if self.crowd else 0.0, layout=slots.mean())
        return Solution(
            self.tracklets, own, marker, objective.extras, margin, rivals, likely, questions, self.crowd, fit, near
        )

    def _of_seldom(self, own: np.ndarray) -> np.ndarray:
        """(N,) what frames on their own say of markers that are seldom there, by names (N,); no limit for all others.

        Their distances in the take are those of whatever has the name, which thus bears itself out; a ghost is where a
        marker may be for a while. Frames expect a marker as often as training has it, and the take shows it less often.
        """
        tracklets, coverage = self.tracklets, self.objective.coverage(own)[own]
        of_seldom = (own != NO_MARKER) & (coverage < REFUSAL.min_half) & (tracklets.held == NO_MARKER)
        there = np.where(of_seldom, coverage, REFUSAL.min_half)
        less = MARGINS.there - np.log(there / (1 - there))
        return np.where(of_seldom, tracklets.votes[np.arange(len(own)), own] - less, np.inf)

    def _unlikely(self, own: np.ndarray, slots: LayoutOdds, unmoved: np.ndarray) -> np.ndarray:
        """(N,) True for names (N,) of what is likelier a ghost by where training alone knows the markers to sit.

        Of a set whose people stood only: the take alone shows how distances vary, so what is always there bears out
        whatever it is called. What somebody holds may be anywhere, and if its markers were not put on again they are as
        far from each other as they were, for which the log odds are `unmoved` (M,).
        """
        if not stood(self.objective.model):
            return np.zeros(len(own), bool)
        ghost = (slots.of_each() < 0) & (unmoved <= 0)
        return (own != NO_MARKER) & ghost[own] & (self.tracklets.held == NO_MARKER)

    def _lonely(self, own: np.ndarray, search: Search) -> np.ndarray:
        """(N,) True for names (N,) of markers of whose nearest none is there at the time, mostly.

        Nobody wears one marker of a limb, and who has left leaves none behind. Without it 2 % of a take of two who come
        back (`returning`) have wrong names.
        """
        tracklets, frame = self.objective.tracklets, self.objective.tracklets.frame
        near = search.near[np.maximum(own, 0), 1 : LIKENESS.min_neighbours + 1][:, None]
        beside = np.isfinite(search.best.placed[np.maximum(frame, 0)[..., None], near, 0]).any(axis=2)
        asked = frame >= 0
        lonely = (beside & asked).sum(axis=1) < REFUSAL.min_half * asked.sum(axis=1)
        return (own != NO_MARKER) & lonely & (tracklets.held == NO_MARKER)

    def _of_others(
        self, search: Search, alone: np.ndarray, unmoved: Unmoved
    ) -> tuple[np.ndarray, tuple[Question, ...], tuple[np.ndarray, ...]]:
        """(N,) what it would lose to go over to another naming that the search tried, of what it changes.

        With questions, which say how sure names are `alone` (N,), and the nearest rivals. Whether two have each
        other's names is no question where a person has named either of them at any time.
        """
        questions: dict[tuple[int, int], Question] = {}
        nearest = np.full(len(self.tracklets), -1)
        best, count, found = search.best.marker, self.tracklets.count, np.full(len(self.tracklets), np.inf)
        held = self.tracklets.held
        known = np.isin(best, held[held != NO_MARKER])
        as_learned = unmoved.odds(search.best.moments)
        for number, other in enumerate(search.others):
            changed = np.flatnonzero((best != other.marker) & (best != NO_MARKER) & (best < self.markers))
            if len(changed) and not (known[changed].any() and len(np.unique(best[changed])) == 2):
                frames = np.bincount(best[changed], count[changed]).max()
                gain = self.objective.gain(other, search.best)
                odds = max(-gain * self.objective.length / frames, 0.0) * MARGINS.looks
                odds = max(odds + as_learned - unmoved.odds(other.moments), 0.0)
                nearer = changed[odds < found[changed]]
                found[nearer], nearest[nearer] = odds, number
                pair = self._exchanged(best, other.marker)
                if len(pair) == 2 and odds < questions.get(pair, Question(*pair, np.inf)).odds:
                    questions[pair] = Question(*pair, odds, float(alone[changed].max()))
        rivals = tuple(search.others[number].marker for number in np.unique(nearest[nearest >= 0]).tolist())
        return found, tuple(questions.values()), rivals

    def _exchanged(self, best: np.ndarray, other: np.ndarray) -> tuple[int, ...]:
        """The names that are others in other names (N,), where that is the same all the time, and no two are one."""
        order = np.arange(self.markers + self.objective.extras)
        named = best != NO_MARKER
        order[best[named]] = other[named]
        there = np.unique(best[named])
        same = (other == np.where(named, order[best], NO_MARKER)).all() and (order >= 0).all()
        if not same or len(np.unique(order[there])) < len(there):
            return ()
        moved = np.flatnonzero(order != np.arange(len(order)))
        return tuple(sorted({*moved.tolist(), *order[moved].tolist()}))


def is_crowd(tracklets: Tracklets, markers: int, rate: float) -> bool:
    """Whether many more tracklets than markers are there in the usual frame, of so many a second."""
    long = lasting(tracklets, rate)
    frames = np.arange(int(tracklets.last.max(initial=0)) + 1)
    begun = np.searchsorted(np.sort(tracklets.first[long]), frames, side="right")
    ended = np.searchsorted(np.sort(tracklets.last[long]), frames, side="left")
    return float(np.median(begun - ended)) >= REFUSAL.crowd * markers


def _likeliest(tracklets: Tracklets) -> np.ndarray:
    """(N,) what frames on their own say of each tracklet, NO_MARKER where that is not more than all else they say."""
    votes, best = tracklets.votes, tracklets.votes.argmax(axis=1)
    most = votes[np.arange(len(votes)), best]
    return np.where(2 * most > votes.sum(axis=1), best, NO_MARKER)
