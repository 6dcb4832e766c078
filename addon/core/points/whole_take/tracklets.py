# SPDX-License-Identifier: GPL-3.0-or-later
"""The tracklets of a take as things to name: when each is there, where it is in some frames, and what frames say."""

from dataclasses import dataclass, replace
from typing import Protocol, Self

import numpy as np

from ...data.lanes import PACKING, LaneOptions, blocks
from ...data.made import Made, Table
from ...data.takes import BY_TRAJECTORY, NO_MARKER, Labels
from ..tracklets import VOTE, frame_log_odds


class VOTING:
    """What of a tracklet's frames is looked at."""

    # log odds that all frames that were named on their own can say; half loses 7 % of still trials
    max_votes: float = 8.0  # measured
    samples: int = 12  # memory: frames whose distances are asked


class RULING:
    """How much edits say."""

    odds: float = 1000.0  # format: log odds of what a person said: more than all frames and distances together


@dataclass(frozen=True, eq=False)
class Tracklets:
    """N tracklets of a take."""

    # (N,) their first and last frame, 0-based, both included
    first: np.ndarray
    last: np.ndarray
    count: np.ndarray  # (N,) frames in which they have a point
    frame: np.ndarray  # (N, S) frames that are looked at, -1 beyond those that a tracklet has
    xyz: np.ndarray  # (N, S, 3) m, the points there
    votes: np.ndarray  # (N, M) log odds that frames add up to, of each marker
    lane: np.ndarray  # (N,) in which each stands
    table: np.ndarray  # (T, L) which tracklet every point of the take is of, -1 where there is none
    held: np.ndarray  # (N,) the marker that a person says each is, NO_MARKER where nobody does

    def __len__(self) -> int:
        return len(self.first)

    def some(self, rows: np.ndarray) -> Self:
        """Some of them (K,)."""
        names = "first", "last", "count", "frame", "xyz", "votes", "lane", "held"
        return replace(self, **{name: getattr(self, name)[rows] for name in names})

    def spread(self, values: np.ndarray, nothing: float, frames: slice) -> np.ndarray:
        """(F, L) the value (N,) of each tracklet at its points in some frames, `nothing` where there is none."""
        return np.append(values, np.array(nothing, values.dtype))[self.table[frames]]

    def with_held(self, marker: np.ndarray) -> np.ndarray:
        """The markers (N,) with what a person said of some, whose names nothing else has at the time."""
        held, marker = self.held, marker.copy()
        for index in np.flatnonzero(held != NO_MARKER).tolist():
            beside = (self.first <= self.last[index]) & (self.last >= self.first[index])
            marker[beside & (held == NO_MARKER) & (marker == held[index])] = NO_MARKER
            marker[index] = held[index]
        return marker

    def placed(
        self, points: Table, marker: np.ndarray, markers: int, options: LaneOptions = PACKING
    ) -> "np.ndarray | PlacedMarkers":
        """(T, M, 3) m, where each marker is when the tracklets are so named (N,); NaN where it is not.

        Of a long take they are looked up in the points of the frames that are asked for.
        """
        found = PlacedMarkers(points, np.full((len(points), markers), -1, np.int16))
        names = np.append(marker, NO_MARKER)
        for part in blocks(len(self.table), self.table.shape[1]):
            own = names[self.table[part]]
            row, column = np.nonzero(own != NO_MARKER)
            # Of two that share a frame at their ends the later tracklet has the marker.
            last = np.full((part.stop - part.start, markers), -1, np.int32)
            np.maximum.at(last, (row, own[row, column]), self.table[part][row, column])
            row, name = np.nonzero(last >= 0)
            found.lane[part.start + row, name] = self.lane[last[row, name]]
        return found if found.lane.size > options.whole_cells else found[:]


class PlacedMarkers(Made):
    """Where each of M markers is in any frames, as an array (F, M, 3) m, NaN where it is not.

    points (T, L, 3) m; lane (T, M) is where each marker stands in a frame, -1 where it does not.
    """

    def __init__(self, points: Table, lane: np.ndarray):
        self.points, self.lane = points, lane
        super().__init__((*lane.shape, 3), self._placed)

    def _placed(self, frames: slice | np.ndarray) -> np.ndarray:
        frames = np.arange(len(self))[frames]
        found = np.full((len(frames), *self.shape[1:]), np.nan, np.float32)
        for part in blocks(len(found), found.shape[1]):
            lane = self.lane[frames[part]]
            row, name = np.nonzero(lane >= 0)
            found[part][row, name] = self.points[frames[part][row], lane[row, name]]
        return found


def seen_in(placed: "np.ndarray | PlacedMarkers") -> np.ndarray:
    """(T, M) where each marker is there, of markers placed (T, M, 3) m."""
    return placed.lane >= 0 if isinstance(placed, PlacedMarkers) else np.isfinite(placed[..., 0])


class FrameLabels(Protocol):
    """What frames say on their own: `Labels` (T, L) with their `rate`, or what works them out when it is asked."""

    def __getitem__(self, part: slice) -> Labels:
        """The labels of the frames from start to stop."""

    def whole(self) -> Labels:
        """All of them at once."""


def tracklets_of(points: Table, tracklet: np.ndarray, named: FrameLabels, markers: int) -> Tracklets:
    """The tracklets (T, L), -1 where there is none, of points (T, L, 3) m, with what frames on their own say.

    A tracklet stands in one lane, and no other in the same lane between its ends.
    """
    table, first, last, count, lane = _numbered(tracklet)
    place = np.linspace(0, 1, VOTING.samples)[None] * (count - 1)[:, None]
    place = place.round().astype(int)
    again = np.zeros(place.shape, bool)
    again[:, 1:] = np.diff(place, axis=1) == 0
    once = np.argsort(again, axis=1, kind="stable")
    place, again = np.take_along_axis(place, once, axis=1), np.take_along_axis(again, once, axis=1)
    frame = first[:, None] + place
    for one in np.flatnonzero(count < last - first + 1).tolist():  # those with gaps
        own = np.flatnonzero(table[first[one] : last[one] + 1, lane[one]] == one)
        frame[one] = first[one] + own[place[one]]
    xyz = np.where(again[..., None], np.nan, points[frame, lane[:, None]]).astype(np.float32)
    votes = np.zeros((len(count), markers))
    for part in blocks(*table.shape):
        alone = named[part]
        row, column = np.nonzero((alone.marker != NO_MARKER) & (table[part] >= 0))
        marker, sure = alone.marker[row, column], alone.confidence[row, column]
        np.add.at(votes, (table[part][row, column], marker), frame_log_odds(sure) * VOTE.frame_weight)
    votes = np.minimum(votes, VOTING.max_votes)
    held = np.full(len(count), NO_MARKER)
    return Tracklets(first, last, count, np.where(again, -1, frame), xyz, votes, lane, table, held)


def _numbered(tracklet: np.ndarray) -> tuple[np.ndarray, ...]:
    """Tracklets (T, L) numbered from 0 on, none left out; first and last frame, count and lane of each (N,)."""
    every = int(tracklet.max(initial=-1)) + 1
    first, last = np.full(every, len(tracklet)), np.full(every, -1)
    count, lane = np.zeros((2, every), int)
    for part in blocks(*tracklet.shape):
        row, column = np.nonzero(tracklet[part] >= 0)
        number = tracklet[part][row, column]
        lane[number] = column
        count += np.bincount(number, minlength=every)
        np.minimum.at(first, number, row + part.start)
        np.maximum.at(last, number, row + part.start)
    there = np.flatnonzero(count)
    again = np.full(every + 1, -1, np.int32)
    again[there] = np.arange(len(there))
    # Where no number is left out the tracklets are as they were, and their table, which is large, is not made again.
    table = tracklet if len(there) == every else again[tracklet]
    return table, first[there], last[there], count[there], lane[there]


@dataclass(frozen=True, eq=False)
class LabelsBetween:
    """What all frames of tracklets say, where only some were asked: worked out for the frames that are looked at."""

    asked: Labels  # (F, L) labels of the frames that were asked, with their `rate`
    frames: np.ndarray  # (F,) which they are, ascending
    tracklet: np.ndarray  # (T, L)
    # (F, L) the last of those frames, up to each of them, in which a lane has a point, and the first from it on; by
    # their places in `frames`, -1 where there is none
    before: np.ndarray
    after: np.ndarray

    @classmethod
    def of(cls, asked: Labels, frames: np.ndarray, tracklet: np.ndarray) -> Self:
        """That of labels (F, L) of some frames (F,) of tracklets (T, L)."""
        count, there = len(frames), np.empty((len(frames), tracklet.shape[1]), bool)
        for part in blocks(*there.shape):
            there[part] = tracklet[frames[part]] >= 0
        place = np.arange(count, dtype=np.int32)[:, None]
        before, after = np.where(there, place, np.int32(-1)), np.where(there, place, np.int32(count))
        np.maximum.accumulate(before, axis=0, out=before)
        np.minimum.accumulate(after[::-1], axis=0, out=after[::-1])
        after[after == count] = -1
        return cls(asked, frames, tracklet, before, after)

    @property
    def shape(self) -> tuple[int, int]:
        """As many frames and lanes as there are."""
        return self.tracklet.shape

    def __getitem__(self, part: slice) -> Labels:
        """The labels of the frames from start to stop."""
        start, stop, _ = part.indices(len(self.tracklet))
        found, rate = Labels.none(stop - start, self.shape[1]), np.zeros((stop - start, self.shape[1]))
        row, lane = np.nonzero(self.tracklet[start:stop] >= 0)
        at, between = self._nearest(row + start, lane)
        own = self.asked[at, lane]
        found.marker[row, lane], found.confidence[row, lane], rate[row, lane] = own.marker, own.confidence, own.rate
        found.step[row, lane] = np.where(between & own.named, BY_TRAJECTORY, own.step)
        return replace(found, rate=rate)

    def whole(self) -> Labels:
        """All of them at once."""
        parts = list(blocks(*self.shape)) or [slice(0, 0)]
        return Labels.join(self[part] for part in parts)

    def _nearest(self, row: np.ndarray, lane: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """For points by frame and lane (K,), which frame that was asked is nearest on their tracklet, and if another.

        Of two as near it is the one before.
        """
        number, last = self.tracklet[row, lane], len(self.frames) - 1
        ahead = np.searchsorted(self.frames, row)
        here = self.frames[np.minimum(ahead, last)] == row
        before = np.where(here | (ahead > 0), self.before[np.maximum(ahead - ~here, 0), lane], -1)
        after = np.where(ahead <= last, self.after[np.minimum(ahead, last), lane], -1)
        apart = []
        for at in (before, after):
            frame = self.frames[at]
            own = (at >= 0) & (self.tracklet[frame, lane] == number)
            apart.append(np.where(own, np.abs(frame - row), len(self.tracklet)))
        return np.where(apart[1] < apart[0], after, np.maximum(before, 0)), ~here


def labels_between(asked: Labels, frames: np.ndarray, tracklet: np.ndarray) -> Labels | LabelsBetween:
    """What all frames of tracklets (T, P) say, where only some of them, (F,), were `asked` (F, P) on their own.

    A point has the name that its tracklet has in the nearest of those. Of a long take it is worked out when it is
    asked for, some frames at a time.
    """
    between = LabelsBetween.of(asked, frames, tracklet)
    return between if tracklet.size > PACKING.whole_cells else between.whole()
