# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is who, by how far the markers of a body are from each other; and what may be on several bodies is one's alone.

A body is held against a subject's model, or another presence. Nor does a tracklet last over an absence of everybody:
whose a presence is, is said by who else is there, as two who are there at a time are two; where that leaves more ways
than one, each presence is named on its own, and the distances on it are compared with those of the first presences.
Of a tracklet that may be on several, whoever is surer keeps it; its name is as sure as it is ahead of the other's.
"""

from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations, permutations, product
from typing import Any, Self

import numpy as np

from ...data.lanes import blocks
from ...data.physical import MARKER_LIMITS, SIGMAS
from ...data.takes import NO_MARKER, Labels, evenly_spread
from ..models import Model
from ..rigid_bodies.markers import MARKER_MATCH
from ..whole_take.deciding import least_margin
from ..whole_take.likeness import NO_EVIDENCE, likeness
from ..whole_take.matching import leads
from ..whole_take.pairs import PairDistances, in_take, moments, trained_pairs, widened
from ..whole_take.pipeline import PointOptions
from ..whole_take.solution import Solution
from ..whole_take.solving import MARGINS, ROUNDS
from ..whole_take.tracklets import Tracklets, seen_in, tracklets_of
from .bodies import Crowd, NamedBody
from .parting import NO_BODY, usual_count


class IDENTIFICATION:
    """How the distances of one person differ, and how tracklets are shared out."""

    # log odds, 19 of 20 such are right, by which who is who must be ahead of any other way, and one of two who want a
    # tracklet of the other
    lead: float = MARKER_MATCH.min_lead
    # part of a distance by which it differs in other motions
    bend: float = 0.02  # physical: skin moves over a bent joint
    # log odds, at best, that a tracklet is a marker which the body lacks at the time, for it to be offered: what comes
    # before and after may be stronger evidence; to offer all names two who touch alike, in twice the time
    fitting: float = -4.0  # measured


ROUNDS_OF_SHARING = 3  # of solving those again that lost some; by time
FRAMES_COMPARED = 300  # that are looked at, of all with two markers of somebody
MIN_MET = 10  # frames in which two markers must be there for their distance to say anything
MAX_OVERLAP = 0.1  # part of the shorter of two presences that may be one's: bodies are parted some frames off
MAX_WAYS = 10_000  # that are tried; by time
ONE_LOOK = np.inf  # frames a second: no tracklet is longer than a look


@dataclass(frozen=True, eq=False)
class PersonBuild:
    """How far the markers of somebody are from each other (M, M) m: mean, and variance m²; NaN where unknown."""

    markers: tuple[str, ...]
    mean: np.ndarray
    variance: np.ndarray

    @classmethod
    def of(cls, one: NamedBody) -> Self:
        """That of what was named on a body; nothing where it was not solved."""
        markers = one.model.markerset.markers
        size = len(markers)
        if one.solution is None:
            return cls(markers, *np.full((2, size, size), np.nan))
        sure = np.where(one.solution.margin > 0, one.solution.marker, -1)
        placed = one.solution.tracklets.placed(one.frames.take.xyz, sure, size)
        there = np.flatnonzero(np.isfinite(np.asarray(placed[:])).all(axis=2).any(axis=1))
        return cls.shown(one.model, placed[there[evenly_spread(len(there), FRAMES_COMPARED)]])

    @classmethod
    def shown(cls, model: Model, placed: np.ndarray) -> Self:
        """That of whose markers are placed (F, M, 3) m in some frames, NaN where one is not."""
        shown = moments(placed)
        mean, variance = (np.where(shown.count >= MIN_MET, one, np.nan) for one in (shown.mean, shown.variance))
        return cls(model.markerset.markers, mean, variance)

    @classmethod
    def trained(cls, model: Model) -> Self:
        """That of whoever a model was learned from."""
        known = trained_pairs(model)
        return cls(model.markerset.markers, known.mean, known.within)

    def cost(self, other: Self, varies_m: float) -> float:
        """How badly two go together, negative log likelihood; inf where sets differ, or too little is shown.

        `varies_m` is the standard deviation of a distance between the two.
        """
        if self.markers != other.markers:
            return np.inf
        variance = varies_m**2 + (IDENTIFICATION.bend * self.mean) ** 2 + (self.variance + other.variance) / 2
        known = np.triu(np.isfinite(variance + other.mean), 1)
        if not known.any():
            return np.inf
        # Beyond chance a distance is no worse: one wrong name is in many.
        square = np.minimum((self.mean - other.mean)[known] ** 2 / variance[known], SIGMAS**2)
        # A marker is in many pairs, so these are not as many measurements as they look.
        return float(square.mean() * len(self.markers) / 2)


def costs_of(named: list, models: tuple[Model, ...]) -> list[float]:
    """How badly each model goes with what was named on a body, negative log likelihood; inf where not at all."""
    builds, trained = [PersonBuild.of(one) for one in named], [PersonBuild.trained(model) for model in models]
    varies = MARKER_LIMITS.placed_m  # markers are put on again
    return [min((build.cost(other, varies) for build in builds), default=np.inf) for other in trained]


def likeliest(ways: Sequence[tuple[int, ...]], cost: np.ndarray) -> tuple[tuple[int, ...], np.ndarray]:
    """The best of ways to give each of S one of K, by what that costs (S, K); and how far ahead that is of each, (S,).

    -inf where no way can be; of one the lead is over all ways that give it another.
    """
    given = np.array(ways)
    total = cost[np.arange(given.shape[1]), given].sum(axis=1)
    best = total.argmin()
    if not np.isfinite(total[best]):
        return ways[best], np.full(given.shape[1], -np.inf)
    other = np.where(given == given[best], np.inf, total[:, None])
    return ways[best], other.min(axis=0) - total[best]


def told(ways: Sequence[tuple[int, ...]], cost: np.ndarray, usual: float) -> tuple[int, ...]:
    """Whose each of S presences is, of K people, by `likeliest`; NO_BODY for those of whom that is not clear.

    Who cannot be compared with anybody, S or K, tells nothing by that: it costs as much as is `usual` of one person.
    """
    known = np.isfinite(cost)
    compared = known.any(axis=1, keepdims=True) & known.any(axis=0)
    way, lead = likeliest(ways, np.where(compared, cost, usual))
    return tuple(np.where(lead >= IDENTIFICATION.lead, way, NO_BODY).tolist())


def identified(cost: np.ndarray, kind: Sequence[int]) -> tuple[list[int], float]:
    """Which body (of B) each of S subjects has, by costs (B, S), and by how much that is ahead of any other way.

    Subjects of one `kind` (S,) are not told apart: the first of them has the first body.
    """
    bodies, subjects = cost.shape
    ways = [
        way
        for way in permutations(range(bodies), subjects)
        if all(kind[one] != kind[other] or way[one] < way[other] for one, other in combinations(range(subjects), 2))
    ]
    if not ways:
        return list(range(subjects)), -np.inf
    way, lead = likeliest(ways, cost.T)
    return list(way), float(lead.min())


def spans_of(tracklet: np.ndarray, body: np.ndarray, count: int) -> np.ndarray:
    """(T, K) when each of so many presences is there, by the bodies (N,) of tracklets (T, L)."""
    own = np.append(body, NO_BODY)[tracklet]
    there = np.stack([(own == one).sum(axis=1) for one in range(count)], axis=1)
    return 2 * there >= np.maximum([usual_count(column) for column in there.T], 1)


def ways_of(there: np.ndarray, count: int) -> list[tuple[int, ...]]:
    """All ways in which presences (T, K) after the first `count`, which are somebody each, can be theirs.

    Those of one are not there at the same time. None at all where there are too many.
    """
    both = there.T.astype(int) @ there
    length = np.maximum(np.diag(both), 1)
    apart = both <= MAX_OVERLAP * np.minimum(length[:, None], length)
    may = [np.flatnonzero(apart[one, :count]).tolist() for one in range(count, len(apart))]
    if np.prod([float(len(some)) for some in may]) > MAX_WAYS:
        return []
    pairs = [(one, other) for other in range(count, len(apart)) for one in range(count, other) if not apart[one, other]]
    return [way for way in product(*may) if all(way[one - count] != way[other - count] for one, other in pairs)]


@dataclass(frozen=True, eq=False)
class UnidentifiedPresence:
    """A presence that may be several people's: the frames (T,) in which it is there, its tracklets (N,)."""

    there: np.ndarray
    tracklets: np.ndarray

    def is_open(self, tracklet: np.ndarray, labels: Labels) -> bool:
        """Whether most of it has no name, by the tracklet and label (T, L) of every point of the take."""
        own = np.append(self.tracklets, False)[tracklet]
        return 2 * (~labels.named & own).sum() > own.sum()


def share(crowd: Crowd, people: Sequence[NamedBody], may: np.ndarray) -> Generator[float, None, np.ndarray]:
    """Solves those again, in place, who may have tracklets (N, K) that nobody named, or lose some to another.

    Gives the tracklets (N, K) that each may have in the end.
    """
    wider = _offered(crowd, people, may)
    for _ in range(ROUNDS_OF_SHARING):
        for index in np.flatnonzero((wider != may).any(axis=0)).tolist():
            yield from crowd.solve_again(people[index], wider[:, index])
        may, certainty = wider, np.zeros(wider.shape)
        for index, one in enumerate(people):
            if one.solution is not None:
                certainty[:, index] = certainty_of(one.solution, crowd.tracklet, len(crowd))
        wider = shared_out(may, certainty)
        if (wider == may).all():
            break
    doubt_contested(people, crowd.options)
    return may


@dataclass(frozen=True, eq=False)
class _Named:
    """What a solution of a body names: its tracklets (K,) in these rows of all, and what they are (K,)."""

    body: NamedBody
    solution: Solution
    rows: np.ndarray
    tracklets: Tracklets
    marker: np.ndarray

    @classmethod
    def of(cls, body: NamedBody, solution: Solution) -> Self:
        """That of all it names."""
        rows = np.flatnonzero(solution.marker != NO_MARKER)
        return cls(body, solution, rows, solution.tracklets.some(rows), solution.marker[rows])

    @property
    def said(self) -> np.ndarray:
        """(K,) the tracklets that a person named."""
        return self.tracklets.held != NO_MARKER

    @property
    def size(self) -> int:
        """How many markers its set has."""
        return len(self.body.model.markerset)

    def placed(self, known: np.ndarray) -> Any:
        """(T, M, 3) m, where its markers are by those of its tracklets (K,) that are known."""
        marker = self.solution.marker.copy()
        marker[self.rows[~known]] = NO_MARKER
        return self.solution.tracklets.placed(self.body.frames.take.xyz, marker, self.size)

    def odds_on(self, other: Self, placed: Any, pairs: PairDistances) -> np.ndarray:
        """(K, M) log odds in one look that each is a marker of another body, or of its own the one that it is.

        The body's markers are placed (T, M, 3) m, and as far from each other as `pairs` say.
        """
        if other is self:
            asked = self.marker[:, None] == np.arange(self.size)
            return likeness(self.tracklets, placed, self.marker, pairs, ONE_LOOK, asked)
        odds = likeness(self.tracklets, placed, np.full(len(self.rows), NO_MARKER), pairs, ONE_LOOK)
        # Whoever is not there has none, and what a person named is nobody else's.
        return np.where((odds == NO_EVIDENCE) | self.said[:, None], -np.inf, odds)

    def doubt(self, lead: np.ndarray):
        """Makes the solution no surer of each than by how much its name is ahead (K,)."""
        margin = self.solution.margin.copy()
        margin[self.rows] = np.where(self.said, margin[self.rows], np.minimum(margin[self.rows], lead))
        self.body.solution = replace(self.solution, margin=margin)


def doubt_contested(people: Sequence[NamedBody], options: PointOptions):
    """Makes solutions, in place, as sure of a name as it is ahead of the best in which another body has the tracklet.

    What has been given to a body shows its distances, and bears itself out. So training alone says what is contested,
    not sure enough for the target, and how a body is built is then learned from all else. What a person has named is no
    question, and nobody else's. Nor are points that blobs made: their bodies name the blobs, the better the more names.
    Without it 7 % of a take of two whose hands are in each other (`standing-hands`) have wrong names.
    """
    named = [_Named.of(one, one.solution) for one in people if one.solution is not None]
    if options.traced or len(named) < 2:
        return
    trained = [_trained(one.body.model) for one in named]
    placed = [one.placed(np.ones(len(one.rows), bool)) for one in named]
    clear = [own >= least_margin(options.target) for own in _leads(named, placed, trained)]
    known = [in_take(own, one.placed(sure)) for one, own, sure in zip(named, trained, clear, strict=True)]
    for one, own, sure in zip(named, _leads(named, placed, known), clear, strict=True):
        one.doubt(np.where(sure, np.inf, own))


def _leads(named: Sequence[_Named], placed: Sequence[Any], pairs: Sequence[PairDistances]) -> list[np.ndarray]:
    """(K,) log odds by which the names on each body are ahead, by what is known of the distances on each.

    placed are the places (T, M, 3) m of its markers, by all of its names.
    """
    odds = np.block([[one.odds_on(*other) for other in zip(named, placed, pairs, strict=True)] for one in named])
    before = np.cumsum([0, *(one.size for one in named)]).tolist()
    marker = np.concatenate([one.marker + size for one, size in zip(named, before[:-1], strict=True)])
    first, last = (np.concatenate([getattr(one.tracklets, end) for one in named]) for end in ("first", "last"))
    lead = leads(odds, marker, first, last) * MARGINS.looks
    return np.split(lead, np.cumsum([len(one.rows) for one in named])[:-1])


def _offered(crowd: Crowd, people: Sequence[NamedBody], may: np.ndarray) -> np.ndarray:
    """(N, K) what tracklets may be on, and further bodies that have some affinity to what nobody named."""
    named = np.array([crowd.named_points(one) for one in people])
    left = crowd.firm & (2 * named.sum(axis=0) < crowd.size)
    body = np.where(named.any(axis=0), named.argmax(axis=0), NO_BODY)
    new = left[:, None] & ~may & (crowd.affinity.on(body, len(people)) > 0)
    for index, one in enumerate(people):
        new[:, index] &= _could_be(crowd, one, new[:, index])
    return may | new


def _could_be(crowd: Crowd, one: NamedBody, some: np.ndarray) -> np.ndarray:
    """(N,) whether some of the tracklets (N,) could be one of the body's markers, by how far they are from the others.

    Most ghosts could not; so who is solved already need not be solved again for them.
    """
    if one.solution is None or not some.any():
        return some
    solution, size = one.solution, len(one.model.markerset)
    placed: Any = solution.tracklets.placed(crowd.take.xyz, solution.marker, size)
    own = crowd.tracklets_of(some)
    unnamed = Labels.none(*own.shape)
    tracklets = tracklets_of(crowd.take.xyz, own, unnamed, size)
    nobody = np.full(len(tracklets), NO_MARKER)
    odds = likeness(tracklets, placed, nobody, in_take(_trained(one.model), placed), crowd.take.rate)
    free = lacking(tracklets, seen_in(placed))
    found = np.zeros(len(some), bool)
    found[np.unique(own[own >= 0])] = np.where(free, odds, -np.inf).max(axis=1) >= IDENTIFICATION.fitting
    return found


def _trained(model: Model) -> PairDistances:
    """What training says of distances, of whoever moves and is built otherwise."""
    freedom = ROUNDS.freedoms[-1]
    return widened(trained_pairs(model), freedom.bend, freedom.motion_m, freedom.layout_m)


def lacking(tracklets: Tracklets, seen: np.ndarray) -> np.ndarray:
    """(N, M) which markers are missing in some of the frames that are looked at of each tracklet, seen (T, M).

    Where any is there: whoever is not lacks nothing.
    """
    frame = np.maximum(tracklets.frame, 0)
    there = (tracklets.frame >= 0) & seen.any(axis=1)[frame]
    return (~seen[frame] & there[..., None]).any(axis=1)


def certainty_of(solution: Solution, tracklet: np.ndarray, every: int) -> np.ndarray:
    """(N,) how sure a solution is of a name of each of `every` tracklets (T, L), log odds; 0 where it has none."""
    total, count = np.zeros((2, every))
    margin = np.where(solution.marker != NO_MARKER, np.maximum(solution.margin, 0), 0.0)
    for part in blocks(*tracklet.shape):
        row, lane = np.nonzero(tracklet[part] >= 0)
        number = tracklet[part][row, lane]
        own = solution.tracklets.table[part][row, lane]
        total += np.bincount(number, np.append(margin, 0.0)[own], every)
        count += np.bincount(number, minlength=every)
    return total / np.maximum(count, 1)


def shared_out(may: np.ndarray, certainty: np.ndarray) -> np.ndarray:
    """(N, K) the bodies that tracklets may be on, `may` (N, K) before, by who is surer of them.

    certainty (N, K) is how sure each is of its name of each, 0 for none. Of two that named one the surer has it; where
    neither is surer, nobody. Nothing changes for what only one named.
    """
    if may.shape[1] == 1:
        return may
    certainty = np.where(may, certainty, 0.0)
    order = np.sort(certainty, axis=1)
    wanted = (certainty > 0).sum(axis=1) > 1
    clear = wanted & (order[:, -1] - order[:, -2] >= IDENTIFICATION.lead)
    winner = certainty.argmax(axis=1)[:, None] == np.arange(may.shape[1])
    return np.where(wanted[:, None], clear[:, None] & winner, may)
