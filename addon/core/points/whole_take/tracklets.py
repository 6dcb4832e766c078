# SPDX-License-Identifier: GPL-3.0-or-later
"""The tracklets of a take as things to name: when each is there, where it is in some frames, and what frames say."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...data.takes import NO_MARKER, Labels
from ..tracklets import VOTE, frame_log_odds


@dataclass(frozen=True)
class VotingOptions:
    """What of a tracklet's frames is looked at. Both reckoned.

    max_votes  log odds that all frames that were named on their own can say
    samples    frames whose distances are asked
    """

    max_votes: float = 8.0
    samples: int = 12


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
    column, row = np.nonzero((tracklet >= 0).T)
    number = tracklet[row, column]
    order = np.lexsort((row, number))
    row, column, number = row[order], column[order], number[order]
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
