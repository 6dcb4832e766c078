# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories packed into lanes: those that are not there at the same time stand one after the other.

A raw take has thousands of short trajectories, and at any time as many of them as there are points in a frame. An array
with a column for each would be nearly empty, and grow with their number times the length of the take.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from heapq import heappop, heappush
from typing import Self

import numpy as np


@dataclass(frozen=True)
class LaneOptions:
    """How tables (T, L) are worked on."""

    block_cells: int = 100_000  # memory: at once, a few megabytes of whatever is made of them, and
    block_frames: int = 4096  # memory: at most
    # frames of a take or a subject that distances and forms are learned from, and that a model keeps of a subject
    spread_out: int = 600  # memory
    # beyond which what follows from other tables is not kept, but worked out block by block
    whole_cells: int = 2_000_000  # memory


PACKING = LaneOptions()


@dataclass(frozen=True, eq=False)
class Lanes:
    """Where each of P trajectories of a take stands: in one lane, from its first point to its last."""

    lane: np.ndarray  # (P,) which
    first: np.ndarray  # (P,) frame, 0-based, and
    last: np.ndarray  # (P,) the same, included; -1 of a trajectory without a point

    @classmethod
    def each(cls, count: int, frames: int) -> Self:
        """Those of `count` trajectories over so many frames that each have a lane of their own."""
        return cls(np.arange(count), np.zeros(count, int), np.full(count, frames - 1))

    @classmethod
    def packed(cls, first: np.ndarray, last: np.ndarray, always: bool = False) -> Self:
        """As few lanes as there are trajectories at a time, by their first and last frames (P,).

        Lanes stand in the order of their earliest trajectories in the file. Where they are not half as many as the
        trajectories, each trajectory has a lane of its own, in the order of the file, unless they `always` share.
        """
        lane, count = np.zeros(len(first), int), 0
        free: list[int] = []
        busy: list[tuple[int, int]] = []
        there = np.flatnonzero(last >= first)
        for one in there[np.argsort(first[there], kind="stable")].tolist():
            while busy and busy[0][0] < first[one]:
                heappush(free, heappop(busy)[1])
            if not free:
                free.append(count)
                count += 1
            lane[one] = heappop(free)
            heappush(busy, (int(last[one]), int(lane[one])))
        if 2 * count > len(first) and not always:
            return cls(np.arange(len(first)), first, last)
        _, begin = np.unique(lane[there], return_index=True)
        place = np.empty(count, int)
        place[np.argsort(begin, kind="stable")] = np.arange(count)
        lane[there] = place[lane[there]]
        return cls(lane, first, last)

    def __len__(self) -> int:
        return len(self.lane)

    @property
    def count(self) -> int:
        """How many lanes there are, one at least where there are trajectories."""
        return int(self.lane.max(initial=-1)) + 1

    def between(self, start: int, stop: int) -> Self:
        """The same of the frames from `start` to `stop`, which count from 0 on."""
        first, last = np.maximum(self.first, start) - start, np.minimum(self.last, stop - 1) - start
        gone = last < first
        return type(self)(self.lane, np.where(gone, 0, first), np.where(gone, -1, last))

    def each_alone(self) -> Iterator[tuple[int, slice, int]]:
        """Every trajectory that has a point, in the order of the file: its number, its frames and its lane."""
        spans = zip(self.first.tolist(), self.last.tolist(), self.lane.tolist(), strict=True)
        for number, (first, last, lane) in enumerate(spans):
            if last >= first:
                yield number, slice(first, last + 1), lane

    def at(self, frame: np.ndarray, lane: np.ndarray) -> np.ndarray:
        """(N,) the trajectories of points, by frame and lane (N,) of each."""
        keys, number, stride = self._begins
        return number[np.searchsorted(keys, np.asarray(lane, np.int64) * stride + frame, side="right") - 1]

    def table(self, frames: slice) -> np.ndarray:
        """(F, L) the trajectory of each place in the frames from start to stop, -1 where none stands."""
        start, stop = frames.start, frames.stop
        found = np.full((stop - start, self.count), -1, np.int32)
        here = np.flatnonzero((self.last >= start) & (self.first < stop) & (self.last >= self.first))
        first, last = np.maximum(self.first[here], start) - start, np.minimum(self.last[here], stop - 1) - start
        for number, begin, end, lane in zip(
            here.tolist(), first.tolist(), last.tolist(), self.lane[here].tolist(), strict=True
        ):
            found[begin : end + 1, lane] = number
        return found

    @cached_property
    def _begins(self) -> tuple[np.ndarray, np.ndarray, int]:
        """Where trajectories begin, lane after lane, and their numbers; a lane is so far from the next."""
        there = np.flatnonzero(self.last >= self.first)
        stride = int(self.last.max(initial=0)) + 1
        keys = self.lane[there].astype(np.int64) * stride + self.first[there]
        order = np.argsort(keys)
        return keys[order], there[order], stride


def standing_in(lanes: Lanes | None, shape: tuple[int, ...]) -> Lanes:
    """Which trajectory stands where in a table (T, L); unless said, each has a lane of its own, in their order."""
    frames, width = shape[:2]
    return Lanes.each(width, frames) if lanes is None else lanes


def trajectories_at(lanes: Lanes | None, frame: np.ndarray, lane: np.ndarray) -> np.ndarray:
    """(N,) the trajectories of points, by frame and lane (N,) of each; unless said, each has a lane of its own."""
    return lane if lanes is None else lanes.at(frame, lane)


def blocks(frames: int, width: int) -> Iterator[slice]:
    """The frames of a table (T, L) block by block, so that what is made of each is small."""
    size = min(max(PACKING.block_cells // max(width, 1), 1), PACKING.block_frames)
    for start in range(0, frames, size):
        yield slice(start, min(start + size, frames))
