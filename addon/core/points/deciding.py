# SPDX-License-Identifier: GPL-3.0-or-later
"""From what frames say one by one to what is said of the take: tracklets vote, and the rest of the take objects.

It objects to a marker that for some frames is not where its rigid neighbours have it. One subject keeps the distances
between markers on one bone; what they are, the take itself tells best.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol, Self

import numpy as np

from ..data.lanes import PACKING, Lanes, blocks, trajectories_at
from ..data.takes import BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Suspect, Verdict
from ..review.suspects import suspect_ranges
from .likelihood.distances import DistanceConstraints
from .likelihood.model import Likelihood
from .models import Model
from .refusals import REFUSAL
from .tracklets import VOTE, are_lasting, gone_over_between, vote


@dataclass(frozen=True)
class WitnessOptions:
    """Where a vote needs frames that are sure on their own, as its frames may err together.

    min_sure_crowd         of a tracklet's frames must be sure of its name on their own in a crowd,
    min_sure_one_subject   and so many where one subject is all that the model has seen
    """

    min_sure_crowd: float = 0.5
    min_sure_one_subject: float = 0.25


@dataclass(frozen=True)
class ConsistencyOptions:
    """When a take contradicts a name. All reckoned.

    max_sd            standard deviations of a constraint's length that are no contradiction,
    max_off_m         and what is none whatever they are
    max_broken        share of a marker's constraints that may be broken
    min_constraints   of a marker that must be seen
    min_frames        that tell a distance
    max_break_frames  between two findings that are one
    """

    max_sd: float = 4.0
    max_off_m: float = 0.015
    max_broken: float = 0.5
    min_constraints: int = 2
    min_frames: int = 20
    max_break_frames: int = 5


WITNESSES = WitnessOptions()
CONSISTENCY = ConsistencyOptions()


class Said(Protocol):
    """What frames say on their own: `Labels` (T, L) with their `rate`, or what works them out when it is asked."""

    def __getitem__(self, part: slice) -> Labels:
        """The labels of the frames from start to stop."""

    def whole(self) -> Labels:
        """All of them at once."""


@dataclass(frozen=True, eq=False)
class Votes:
    """What the tracklets (T, L) of a take were voted, window by window, and what a person should look at.

    marker   (T, L)
    windows  the frames of each window, with how sure its votes are: the different values (K,) and which of them each is
             (F, L), as there are few; where there are many the values are None, and these (F, L) are it
    """

    marker: np.ndarray
    windows: list[tuple[slice, np.ndarray | None, np.ndarray]]
    suspects: tuple[Suspect, ...]

    @classmethod
    def of(cls, named: Said, tracklet: np.ndarray, names: Sequence[str], first_frame: int) -> Self:
        """The votes of what frames of tracklets (T, L) say on their own; the same where they are too short to vote."""
        if not are_lasting(tracklet):
            said = named.whole()
            return cls(said.marker, [(slice(0, len(tracklet)), None, said.confidence)], ())
        found, suspects = cls(np.full(tracklet.shape, NO_MARKER, np.int16), [], ()), []
        size = VOTE.window_frames
        edges = [*range(0, max(len(tracklet) - size // 2, 1), size), len(tracklet)]
        for first, after in pairwise(edges):
            frames, border = slice(first, after), slice(first - 1, first + 1)
            part = vote(named[frames], tracklet[frames], names, first_frame + first)
            found.marker[frames] = part.labels.marker
            found.windows.append((frames, *_few(part.labels.confidence, tracklet.size)))
            suspects += part.suspects
            if first:
                suspects += gone_over_between(found.marker[border], tracklet[border], first + first_frame, names)
        return replace(found, suspects=tuple(sorted(suspects, key=lambda suspect: suspect.first)))

    def parts(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Some frames at a time, and how sure their votes are (F, L)."""
        for frames, values, which in self.windows:
            for own in blocks(*which.shape):
                part = slice(frames.start + own.start, frames.start + own.stop)
                yield part, which[own].copy() if values is None else values[which[own]]


def _few(values: np.ndarray, cells: int) -> tuple[np.ndarray | None, np.ndarray]:
    """Values (F, L) as `Votes` keeps them: of a table of so many cells, where it is large and they are few, narrow."""
    if cells <= PACKING.whole_cells:
        return None, values
    some, which = np.unique(values, return_inverse=True)
    if len(some) > np.iinfo(np.uint16).max:
        return None, values
    return some, which.reshape(values.shape).astype(np.uint16)


def decide(
    named: Said, tracklet: np.ndarray, model: Model, target: float, first_frame: int, lanes: Lanes | None = None
) -> Verdict:
    """Lets the tracklets (T, P) vote and keeps what is sure enough that a part `target` of it is right.

    named are the labels (T, P) of frames on their own, with their `rate`. Where the vote says what the frame said, the
    frame's own step stays.
    """
    votes = Votes.of(named, tracklet, model.markerset.markers, first_frame)
    decided = Labels.none(*tracklet.shape)
    for part, own in _decided(votes, named, tracklet, model, target, lanes):
        decided.marker[part], decided.step[part], decided.confidence[part] = own.marker, own.step, own.confidence
    return Verdict(decided, votes.suspects)


def decided_markers(
    named: Said, tracklet: np.ndarray, model: Model, target: float, lanes: Lanes | None = None
) -> np.ndarray:
    """(T, P) the markers alone of what `decide` gives: a long take's labels are large."""
    votes = Votes.of(named, tracklet, model.markerset.markers, 0)
    decided = np.empty(tracklet.shape, np.int16)
    for part, own in _decided(votes, named, tracklet, model, target, lanes):
        decided[part] = own.marker
    return decided


def _decided(
    votes: Votes, named: Said, tracklet: np.ndarray, model: Model, target: float, lanes: Lanes | None
) -> Iterator[tuple[slice, Labels]]:
    """What is decided of some frames at a time."""
    needed = _needed(model, tracklet)
    count = int(tracklet.max(initial=-1)) + 1
    backed = np.ones(count + 1, bool)
    if needed > 0:
        backed = np.append(_part_sure(votes.marker, named, tracklet, target, count) >= needed, False)
    for part, chance in votes.parts():
        own, marker = named[part], votes.marker[part].copy()
        enough = (chance >= target) & backed[tracklet[part]]
        alone = marker == own.marker
        np.maximum(chance, own.confidence, out=chance, where=alone)
        step = np.where(alone, own.step, BY_TRAJECTORY)
        marker[~(enough | (alone & (own.rate >= target)))] = NO_MARKER
        marker = once(marker, chance, len(model.markerset), lanes, part.start)
        nothing = marker == NO_MARKER
        step[nothing], chance[nothing] = NO_STEP, 0.0
        yield part, Labels(marker, step, chance)


def _needed(model: Model, tracklet: np.ndarray) -> float:
    """The part of a tracklet's frames that must be sure of its name for its vote to count.

    A vote takes frames for so many witnesses. They are not where they err together: among many more points than
    markers one that is no marker sits like one through the whole take, and a model of one subject knows nothing of how
    the next one differs.
    """
    likelihood, markers = model.likelihood, len(model.markerset)
    if (tracklet >= 0).sum() >= REFUSAL.crowd * markers * len(tracklet):
        return WITNESSES.min_sure_crowd
    few = likelihood is not None and likelihood.subjects == 1 and likelihood.rigid_bodies is None
    return WITNESSES.min_sure_one_subject if few else 0.0


def _part_sure(marker: np.ndarray, named: Said, tracklet: np.ndarray, target: float, count: int) -> np.ndarray:
    """(N,) the part of each of `count` tracklets' frames that are sure of the marker (T, L) that it was voted."""
    frames, sure = np.zeros((2, count))
    for part in blocks(*tracklet.shape):
        own, there, said = tracklet[part], tracklet[part] >= 0, named[part]
        frames += np.bincount(own[there], minlength=count)
        there &= (marker[part] == said.marker) & (said.rate >= target)
        sure += np.bincount(own[there], minlength=count)
    return sure / np.maximum(frames, 1)


def consistent(verdict: Verdict, points: np.ndarray, likelihood: Likelihood | None, first_frame: int) -> Verdict:
    """Takes back names of points (T, P, 3) m that contradict the rest of the take, and says so."""
    if likelihood is None:
        return verdict
    labels = verdict.labels
    stray = strays(MarkerPlaces(points, labels.marker, len(likelihood)), likelihood.constraints)
    kept = np.ones(labels.marker.shape, bool)
    for part in blocks(*kept.shape):
        frame, column = np.nonzero(labels.marker[part] != NO_MARKER)
        kept[part][frame, column] = ~stray[part][frame, labels.marker[part][frame, column]]
    suspects = verdict.suspects + stray_suspects(stray, likelihood.markers, first_frame)
    return Verdict(labels.kept(kept), suspects)


def consistent_markers(marker: np.ndarray, points: np.ndarray, likelihood: Likelihood) -> np.ndarray:
    """The markers (T, P) of points (T, P, 3) m without those that contradict the rest of the take."""
    stray, kept = strays(MarkerPlaces(points, marker, len(likelihood)), likelihood.constraints), marker.copy()
    for part in blocks(*marker.shape):
        frame, column = np.nonzero(marker[part] != NO_MARKER)
        off = stray[part][frame, marker[part][frame, column]]
        kept[part][frame[off], column[off]] = NO_MARKER
    return kept


class MarkerPlaces:
    """Where each of M markers (T, L) of points (T, L, 3) m is, some at a time: all at once would be large."""

    def __init__(self, points: np.ndarray, marker: np.ndarray, markers: int):
        self.points, self.shape = points, (len(marker), markers, 3)
        self.lane = np.full((len(marker), markers), -1, np.int16)
        for part in blocks(*marker.shape):
            frame, lane = np.nonzero(marker[part] != NO_MARKER)
            self.lane[part][frame, marker[part][frame, lane]] = lane

    def of(self, some: np.ndarray, frames: slice) -> np.ndarray:
        """(K, F, 3) m of some markers (K,) in the frames from start to stop, NaN where one is not."""
        lane = self.lane[frames, some].T
        there = lane >= 0
        found = np.full((*lane.shape, 3), np.nan)
        _, frame = np.nonzero(there)
        found[there] = self.points[frames][frame, lane[there]]
        return found

    def apart(self, pair: np.ndarray) -> np.ndarray:
        """(K, T) m between the two markers of some pairs (K, 2), NaN where one is not."""
        which, place = np.unique(pair, return_inverse=True)
        one, other = place.reshape(pair.shape).T
        found = np.empty((len(pair), len(self.lane)))
        for part in blocks(len(self.lane), 3 * len(pair)):
            places = self.of(which, part)
            found[:, part] = np.linalg.norm(places[one] - places[other], axis=2)
        return found


def strays(
    markers: MarkerPlaces, constraints: DistanceConstraints, options: ConsistencyOptions = CONSISTENCY
) -> np.ndarray:
    """(T, M) True where a marker is off most of those that it moves with."""
    count, size = markers.shape[:2]
    dtype = np.uint8 if size <= np.iinfo(np.uint8).max else np.int16
    broken, asked = np.zeros((count, size), dtype), np.zeros((size, size))
    limits = np.maximum(options.max_sd * constraints.sd, options.max_off_m)
    for some in blocks(len(limits), max(count, 1)):
        one, two = constraints.pair[some].T
        distance, limit = markers.apart(constraints.pair[some]), limits[some]
        known = np.isfinite(distance)
        often = known.sum(axis=1) >= max(min(options.min_frames, count), 1)
        asked[one[often], two[often]] = asked[two[often], one[often]] = 1
        # What stays within the limit is nowhere off its median.
        most, least = (np.where(known, distance, none) for none in (-np.inf, np.inf))
        apart = most.max(axis=1, initial=-np.inf) - least.min(axis=1, initial=np.inf)
        for row in np.flatnonzero(often & (apart > limit)).tolist():
            off = np.abs(distance[row] - np.median(distance[row, known[row]])) > limit[row]
            broken[:, [one[row], two[row]]] += off[:, None]
    found = np.zeros((count, size), bool)
    if not broken.any():
        return found
    for part in blocks(count, size):
        seen = (markers.lane[part] >= 0).astype(float)
        known = seen * (seen @ asked)
        found[part] = (known >= options.min_constraints) & (broken[part] > options.max_broken * known)
    return found


def stray_suspects(stray: np.ndarray, names, first_frame: int) -> tuple[Suspect, ...]:
    """What a person should look at: ranges of frames by marker, short interruptions bridged."""
    frames, found = first_frame + np.arange(len(stray)), []
    for marker, name in enumerate(names):
        words = f"{name} was off the markers that it moves with, and lost its name"
        found += suspect_ranges(frames, stray[:, marker], words, CONSISTENCY.max_break_frames, (name,))
    return tuple(found)


def once(marker: np.ndarray, sure: np.ndarray, markers: int, lanes: Lanes | None = None, start: int = 0) -> np.ndarray:
    """Labels (T, L) of which each frame has every marker once: the surest, of equals the first in the file.

    They begin with the frame `start` of the take.
    """
    kept = marker.copy()
    for part in blocks(*marker.shape):
        frame, lane = np.nonzero(marker[part] != NO_MARKER)
        key = frame * markers + marker[part][frame, lane]
        more = np.flatnonzero(np.bincount(key)[key] > 1)
        frame, lane, key = frame[more] + part.start, lane[more], key[more]
        number = trajectories_at(lanes, frame + start, lane)
        order = np.lexsort((number, -sure[frame, lane], key))
        again = order[1:][np.diff(key[order]) == 0]
        kept[frame[again], lane[again]] = NO_MARKER
    return kept
