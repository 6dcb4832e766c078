# SPDX-License-Identifier: GPL-3.0-or-later
"""The tracklets of a take as things to name: when each is there, where it is in some frames, and what frames say."""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from ...data.takes import BY_TRAJECTORY, NO_MARKER, Labels
from ..tracklets import VOTE, frame_log_odds


@dataclass(frozen=True)
class VotingOptions:
    """What of a tracklet's frames is looked at. Both reckoned.

    max_votes   log odds that all frames that were named on their own can say
    samples     frames whose distances are asked
    asked_rate  frames a second that are named on their own: those between them show the same pose, and err with them
    """

    max_votes: float = 8.0
    samples: int = 12
    asked_rate: float = 30.0


VOTING = VotingOptions()


@dataclass(frozen=True, eq=False)
class Tracklets:
    """N tracklets of a take.

    first, last  (N,) their first and last frame, 0-based, both included
    count        (N,) frames in which they have a point
    frame        (N, S) frames that are looked at, -1 beyond those that a tracklet has
    xyz          (N, S, 3) m, the points there
    votes        (N, M) log odds that frames add up to, of each marker
    row, column  (K,) frame and column of every point of the take, sorted by tracklet, and
    begin        (N + 1,) where each tracklet's begin in them
    held         (N,) the marker that a person says each is, NO_MARKER where nobody does
    """

    first: np.ndarray
    last: np.ndarray
    count: np.ndarray
    frame: np.ndarray
    xyz: np.ndarray
    votes: np.ndarray
    row: np.ndarray
    column: np.ndarray
    begin: np.ndarray
    held: np.ndarray

    def __len__(self) -> int:
        return len(self.first)

    @cached_property
    def owner(self) -> np.ndarray:
        """(K,) the tracklet of every point."""
        return np.repeat(np.arange(len(self)), self.count)

    def spread(self, marker: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
        """(T, P) the marker (N,) of each tracklet, at all of its points."""
        found = np.full(shape, NO_MARKER)
        found[self.row, self.column] = marker[self.owner]
        return found

    def placed(self, points: np.ndarray, marker: np.ndarray, markers: int) -> np.ndarray:
        """(T, M, 3) m, where each marker is when the tracklets are so named (N,); NaN where it is not."""
        found = np.full((len(points), markers, 3), np.nan, dtype=np.float32)
        own = marker[self.owner]
        named = own != NO_MARKER
        found[self.row[named], own[named]] = points[self.row[named], self.column[named]]
        return found


def tracklets_of(points: np.ndarray, tracklet: np.ndarray, named: Labels, markers: int) -> Tracklets:
    """The tracklets (T, P), -1 where there is none, of points (T, P, 3) m, with what frames on their own say."""
    row, column, number = _by_tracklet(tracklet)
    _, begin, owner, count = np.unique(number, return_index=True, return_inverse=True, return_counts=True)
    begin = np.append(begin, len(number))
    place = np.linspace(0, 1, VOTING.samples)[None] * (count - 1)[:, None]
    place = place.round().astype(int)
    again = np.zeros(place.shape, bool)
    again[:, 1:] = np.diff(place, axis=1) == 0
    at = begin[:-1, None] + place
    frame = np.where(again, -1, row[at])
    xyz = np.where(again[..., None], np.nan, points[row[at], column[at]]).astype(np.float32)
    said, sure = named.marker[row, column], named.confidence[row, column]
    odds = frame_log_odds(sure) * VOTE.frame_weight
    votes = np.zeros((len(count), markers))
    some = said != NO_MARKER
    np.add.at(votes, (owner[some], said[some]), odds[some])
    votes = np.minimum(votes, VOTING.max_votes)
    held = np.full(len(count), NO_MARKER)
    return Tracklets(row[begin[:-1]], row[begin[1:] - 1], count, frame, xyz, votes, row, column, begin, held)


def asked_frames(tracklet: np.ndarray, rate: float) -> np.ndarray:
    """(F,) the frames to name on their own, of tracklets (T, P) at `rate` frames a second: no tracklet has none."""
    chosen = np.zeros(len(tracklet), dtype=bool)
    chosen[:: max(round(rate / VOTING.asked_rate), 1)] = True
    row, column = np.nonzero(tracklet >= 0)
    number = tracklet[row, column]
    last = np.full(int(number.max(initial=-1)) + 1, -1)
    np.maximum.at(last, number, row)
    seen = last < 0
    seen[number[chosen[row]]] = True
    for one in np.argsort(last, kind="stable").tolist():
        if not seen[one]:
            chosen[last[one]] = True
            here = tracklet[last[one]]
            seen[here[here >= 0]] = True
    return np.flatnonzero(chosen)


def said_between(asked: Labels, frames: np.ndarray, tracklet: np.ndarray) -> Labels:
    """What all frames of tracklets (T, P) say, where only some of them, (F,), were `asked` (F, P) on their own.

    A point has the name that its tracklet has in the nearest of those.
    """
    row, column, number = _by_tracklet(tracklet)
    known, place = np.isin(row, frames), np.arange(len(row))
    before = np.maximum.accumulate(np.where(known, place, 0))
    after = np.minimum.accumulate(np.where(known, place, len(row) - 1)[::-1])[::-1]
    apart = np.stack(
        [
            np.where((number[end] == number) & known[end], np.abs(row[end] - row), len(tracklet))
            for end in (before, after)
        ]
    )
    source = np.where(apart[1] < apart[0], after, before)
    at = np.searchsorted(frames, row[source]), column[source]
    between = (source != place) & (asked.marker[at] != NO_MARKER)
    found, rate = Labels.none(*tracklet.shape), np.zeros(tracklet.shape)
    found.marker[row, column], found.confidence[row, column] = asked.marker[at], asked.confidence[at]
    found.step[row, column] = np.where(between, BY_TRAJECTORY, asked.step[at])
    rate[row, column] = asked.rate[at]
    return replace(found, rate=rate)


def _by_tracklet(tracklet: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Row, column and number (K,) of every point of tracklets (T, P), sorted by tracklet and then by frame."""
    column, row = np.nonzero((tracklet >= 0).T)
    number = tracklet[row, column]
    order = np.lexsort((row, number))
    return row[order], column[order], number[order]
