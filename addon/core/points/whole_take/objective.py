# SPDX-License-Identifier: GPL-3.0-or-later
"""What makes one naming of a take better than another: the one measure that all of solving climbs.

A naming gives each tracklet i of n_i frames a marker z_i, or none. It is worth

    J(z) = sum_i n_i (d_i(z_i) + v_i(z_i) + l_i(z_i)) + L sum_f clip(s_f(z)) + T / K p(z)

    d  mean log odds, against a ghost, of the tracklet's points by their distances to what z names beside it; how far
       markers are from each other is what training knows, corrected by what z itself shows in this take
    v  what frames on their own say of the tracklet
    l  whether it goes on over a gap as its marker did before and does after
    s  log likelihood of a whole frame f under the shape of the training, of a few frames that show most of the markers
    p  log odds of the mean distances under the training alone, of which all T frames are one of K looks

Of each marker the odds given all others are added up, a pseudo-likelihood: the joint likelihood of all distances counts
one odd pose as hundreds of odd distances. Two namings are only ever compared, so s is their difference, clipped by how
many markers they have elsewhere: far from the poses of training it says nothing. A tracklet without a name brings
nothing and costs nothing; an unmodelled marker has a name of its own, which costs what a marker usually brings.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...data.lanes import PACKING
from ...data.made import Table
from ...data.takes import NO_MARKER, NO_POINT, evenly_spread
from ...geometry.rigid import in_axes, laid_on
from ...geometry.upright import upright_aligned
from ..likelihood.model import Likelihood
from ..likelihood.naming import Settled, settle
from ..models import Model
from ..refusals import NO_FIT, REFUSAL, SetFit
from .layout_odds import LayoutOdds
from .likeness import LIKENESS, likeness, links, worth_of_length
from .pairs import PAIRING, Moments, PairDistances, corrected, moments, trained_pairs, widened, with_unknown
from .tracklets import RULING, FrameLabels, PlacedMarkers, Tracklets, seen_in


@dataclass(frozen=True)
class Freedom:
    """What is allowed for beyond the training: bends and motion_m of the body, layout_m of the markers' places."""

    bend: float  # standard deviation of a distance, over its square, 1/m: what is far from each other is on no one bone
    motion_m: float  # the same of any distance
    layout_m: float  # of a distance's mean
    link: float  # log odds that how a marker went on over gaps may say at most


class OBJECTIVE:
    """What the objective looks at."""

    # whose shape is asked, and sides, out of so many times as many that show most of the markers
    frames: int = 16  # memory
    # markers of a set, and of a frame that is asked: fewer have a place and a facing, and hardly a shape; a fifth is in
    # one place by its distances to four
    min_seen: int = 5  # physical
    # log likelihood of a frame's shape that the point of one marker wins or loses, and by which any frame's names must
    # be ahead to be no question; unclipped, it is for wrong names, by 8 to 228, in eight of ten takes of other labs;
    # exchanged wrists are ahead by 2.9 to 4.7
    max_marker: float = 6.0  # measured
    # L over the frames of the take; at 0.5 no exchange of two or of a limb is worth more than the truth in 26 takes of
    # crowd, frame, lab-1, others and pieces: by 1.85 a frame less at least
    shape: float = 0.5  # measured
    # log odds that an unmodelled marker must bring; with 4 or 8 takes of other labs lose 3 to 5 %
    extra: float = 12.0  # measured


USUAL_FREEDOM = Freedom(0.1, 0.0, 0.0, 8.0)


@dataclass(frozen=True, eq=False)
class Candidate:
    """A naming of N tracklets, and what follows from it."""

    marker: np.ndarray  # (N,) of each, NO_MARKER for none
    placed: np.ndarray  # (F, M + E, 3) m where each marker is in the frames that are looked at, NaN where it is not
    moments: Moments  # of the distances between the markers
    odds: np.ndarray  # (N,) log odds of each name given the others, 0 of none
    # what bears out where training knows the markers to be, and `layout` what the names are worth by it
    slots: LayoutOdds
    layout: float
    total: float  # the first sum of the objective
    settled: Settled | None  # the frames whose shape is asked; None where none shows enough


class Objective:
    """The objective of a take of `tracklets` whose points are (T, L, 3) m, at `rate` frames a second.

    `named` is what these say on their own.
    `extras` is how many markers more than the model's there are. No frame's shape counts before names tell which show
    most of the markers: `look_at`.
    """

    def __init__(self, points: Table, tracklets: Tracklets, named: FrameLabels, model: Model, rate: float):
        self.model, self.rate, self.extras = model, rate, 0
        self.known, self.markers = trained_pairs(model), len(model.markerset)
        # Odds grow less than a tracklet does: its parts would say more than all of it where they are only added up.
        self.weight = tracklets.count / worth_of_length(tracklets, rate)
        spread = evenly_spread(len(points), PACKING.spread_out)
        sampled = tracklets.frame[tracklets.frame >= 0]
        at = np.unique(np.concatenate([spread, sampled, tracklets.first, tracklets.last]))
        frame = np.where(tracklets.frame >= 0, np.searchsorted(at, tracklets.frame), -1)
        self.tracklets = replace(tracklets, frame=frame)
        self._ends = np.searchsorted(at, tracklets.first), np.searchsorted(at, tracklets.last)
        self._spread, self._looked_at, self.length = np.searchsorted(at, spread), len(at), len(points)
        table = tracklets.table[at]
        self._row, lane = np.nonzero(table >= 0)
        self._of = table[self._row, lane]
        order = np.argsort(self._of, kind="stable")  # of two that share a frame at their ends the later has the marker
        self._row, self._of = self._row[order], self._of[order]
        self._at, self._lane, self._named = at, lane[order], named
        self._xyz = points[at[self._row], self._lane].astype(np.float32)
        self._shown = self._spread[:0]

    def look_at(self, marker: np.ndarray):
        """Has the shape count of some of the frames that show most of the markers by names (N,), all over the take."""
        seen = np.isfinite(self.placed(np.where(marker < self.markers, marker, NO_MARKER))[self._spread, :, 0])
        self._shown = self._spread[fullest_frames(seen)]

    @property
    def pairs(self) -> PairDistances:
        """What training knows of the distances between the markers, and nothing of the extras'."""
        return with_unknown(self.known, self.extras)

    def placed(self, marker: np.ndarray) -> np.ndarray:
        """(F, M + E, 3) m where each marker is by names (N,), NaN where it is not."""
        return self._placed(marker[self._of])

    def _placed(self, name: np.ndarray) -> np.ndarray:
        """The same by names of the points that are looked at."""
        every = max(self.markers + self.extras, int(name.max(initial=-1)) + 1)
        found = np.full((self._looked_at, every, 3), np.nan, np.float32)
        there = name != NO_MARKER
        found[self._row[there], name[there]] = self._xyz[there]
        return found

    def every_placed(self, marker: np.ndarray) -> np.ndarray:
        """(F, M + E, 3) m the same in frames evenly spread."""
        return self.placed(marker)[self._spread]

    def moments(self, placed: np.ndarray) -> Moments:
        """Of the distances between markers placed (F, M + E, 3) m."""
        return moments(placed[self._spread])

    def odds(
        self,
        marker: np.ndarray,
        placed: np.ndarray,
        shown: Moments,
        freedom: Freedom,
        rows: np.ndarray | None = None,
        asked: np.ndarray | None = None,
        muted: np.ndarray | None = None,
    ) -> np.ndarray:
        """(K, M + E) log odds of names of some tracklets (K,), the others being named and placed as they are.

        Of names that are not `asked` (K, M + E) they are minus infinity. Of the markers `muted` it does not count
        what frames on their own say. What could not be a marker even if it went on best as one, as most ghosts could
        not, is not asked how it does.
        """
        rows = np.arange(len(marker)) if rows is None else rows
        pairs = corrected(widened(self.pairs, freedom.bend, freedom.motion_m, freedom.layout_m), shown)
        tracklets = self.tracklets.some(rows)
        votes = np.pad(tracklets.votes, ((0, 0), (0, self.extras)))
        if muted is not None:
            votes[:, muted] = np.where(np.abs(votes[:, muted]) >= RULING.odds, votes[:, muted], 0)
        odds = likeness(tracklets, placed, marker[rows], pairs, self.rate, asked) + votes
        if freedom.link:
            given = self.tracklets, self._ends, marker, placed, pairs, self.rate
            some = np.flatnonzero(odds.max(axis=1, initial=-np.inf) > -freedom.link)
            odds[some] += np.clip(links(*given, rows[some], odds[some] > -freedom.link), -freedom.link, freedom.link)
        return odds

    def of(self, marker: np.ndarray) -> Candidate:
        """A naming (N,) with all that follows from it."""
        placed = self.placed(marker)
        shown = self.moments(placed)
        every = np.arange(self.markers + self.extras)
        named = np.flatnonzero(marker != NO_MARKER)
        odds, own = np.zeros(len(marker)), marker[named]
        every_one = self.odds(marker, placed, shown, USUAL_FREEDOM, named, own[:, None] == every)
        odds[named] = every_one[np.arange(len(named)), own]
        worth = odds[named] * self.weight[named]
        worth -= np.where(own < self.markers, 0.0, OBJECTIVE.extra * self.tracklets.count[named])
        slots = self.layout(marker, shown, placed)
        settled = self.settled(placed)
        layout = float(slots.worth(every[None])[0])
        return Candidate(marker, placed, shown, odds, slots, layout, float(worth.sum()), settled)

    def settled(self, placed: np.ndarray) -> Settled | None:
        """The frames whose shape is asked, with markers placed (F, M + E, 3) m."""
        return settled_frames(self.model.learned_likelihood, placed[self._shown])

    def layout(self, marker: np.ndarray, shown: Moments, placed: np.ndarray) -> LayoutOdds:
        """How well what has one name (N,), placed (F, M + E, 3) m, bears out the distances that training expects."""
        sides, some = self.model.learned_likelihood.sides, evenly_spread(len(self._spread), OBJECTIVE.frames)
        return LayoutOdds(self.known, sides, shown, placed[self._spread[some]], self.coverage(marker))

    def coverage(self, marker: np.ndarray) -> np.ndarray:
        """(M + E,) the part of the take in which each marker is, by names (N,)."""
        every = max(self.markers + self.extras, int(marker.max(initial=-1)) + 1)
        own = marker != NO_MARKER
        return np.bincount(marker[own], self.tracklets.count[own], every) / self.length

    def of_frames(self, naming: Candidate) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """Tracklets (K,) of some frames and what these say they are: mostly other than a naming, and likelier by shape.

        Those that are likelier by most come first.
        """
        given, said = (self._placed(self._said), naming.placed), self._said != NO_MARKER
        own, now = (settled_frames(self.model.learned_likelihood, placed[self._spread]) for placed in given)
        if own is None or now is None:
            return
        other = said & (self._said != naming.marker[self._of])
        count, others = (np.bincount(self._row[some], minlength=self._looked_at) for some in (said, other))
        more = np.where(others > REFUSAL.min_half * count, 0.0, -np.inf)[self._spread] + own.score - now.score
        for at in np.argsort(-more, kind="stable")[: np.count_nonzero(more > 0)].tolist():
            row = np.flatnonzero(said & (self._row == self._spread[at]))
            yield self._of[row], self._said[row]

    def said_of_each(self) -> tuple[np.ndarray, np.ndarray]:
        """Tracklets (K,) and what a frame on its own calls each, of frames evenly spread."""
        said = self._said != NO_MARKER
        return self._of[said], self._said[said]

    @cached_property
    def _said(self) -> np.ndarray:
        """(K,) what frames evenly spread say of the points that are looked at, NO_MARKER of those in others."""
        said = np.full((self._looked_at, int(self._lane.max(initial=-1)) + 1), NO_MARKER)
        for row in self._spread.tolist():
            said[row] = self._named[self._at[row] : self._at[row] + 1].marker[0, : said.shape[1]]
        return said[self._row, self._lane]

    def borne_out(self, naming: Candidate) -> np.ndarray:
        """(M,) the mean log odds of each marker where it is, 0 of one that is nowhere."""
        own = np.flatnonzero((naming.marker != NO_MARKER) & (naming.marker < self.markers))
        name = naming.marker[own]
        count = np.bincount(name, self.tracklets.count[own], self.markers)
        total = np.bincount(name, naming.odds[own] * self.weight[own], self.markers)
        return total / np.maximum(count, 1)

    def gain(self, new: Candidate, old: Candidate) -> float:
        """By how much one naming is worth more than another, a frame."""
        gain = (new.total - old.total) / self.length
        gain += (new.layout - old.layout) / LIKENESS.max_samples
        if new.settled is None or old.settled is None:
            return gain
        one, other = (naming.placed[self._shown, : self.markers, 0] for naming in (new, old))
        moved = ((one != other) & (np.isfinite(one) | np.isfinite(other))).sum(axis=1)
        return gain + OBJECTIVE.shape * float(clipped(new.settled.score - old.settled.score, moved))


def lasting(tracklets: Tracklets, rate: float) -> np.ndarray:
    """(N,) the tracklets that show how they move, by their frames or, where there are few a second, by how long."""
    return tracklets.count >= min(PAIRING.min_frames, PAIRING.min_s * rate)


def clipped(each: np.ndarray, moved: np.ndarray | int) -> np.ndarray:
    """What frames (F, ...) win on average by other points of so many markers: none of it more than it can know."""
    most = OBJECTIVE.max_marker * moved
    return np.clip(each, -most, most).mean(axis=0)


def fullest_frames(seen: np.ndarray) -> np.ndarray:
    """(F,) some of the frames that show most of the markers seen (T, M), all over the take."""
    count = seen.sum(axis=1)
    fullest = np.sort(np.argsort(-count, kind="stable")[: OBJECTIVE.frames**2])
    fullest = fullest[count[fullest] >= OBJECTIVE.min_seen]
    return fullest[evenly_spread(len(fullest), OBJECTIVE.frames)]


def settled_frames(likelihood: Likelihood, placed: np.ndarray) -> Settled | None:
    """Frames (F, M + E, 3) m with the names that they have; None where there are none."""
    if not len(placed):
        return None
    points = upright_aligned(placed.astype(float), likelihood.shape.mean)
    present = np.isfinite(points[..., 0])
    naming = np.where(present[:, : len(likelihood)], np.arange(len(likelihood)), NO_POINT)
    known = likelihood.known
    return settle(known.fine, known.constraints, np.where(present[..., None], points, 0), present, naming)


def usual_fit(likelihood: Likelihood, placed: np.ndarray | PlacedMarkers, upright: bool = True) -> SetFit:
    """How markers placed (T, M, 3) m sit as the set has them, in the usual of the frames that show most of them.

    A set that is not the subject's has its markers elsewhere, whatever the pose. Who is not `upright`, but may lie or
    hang, is turned as the set stands first.
    """
    some = placed[fullest_frames(seen_in(placed)[:, : len(likelihood)])].astype(float)
    if not upright:
        some = in_axes(*laid_on(likelihood.shape.mean, some[:, : len(likelihood)]), some)
    now = settled_frames(likelihood, some)
    if now is None:
        return NO_FIT
    count = now.named.sum(axis=1)
    square = (now.left**2).sum(axis=2) / likelihood.known.fine.noise
    return SetFit(float(np.median(square.sum(axis=1) / (3 * count))), float(np.median(now.score / count)))
