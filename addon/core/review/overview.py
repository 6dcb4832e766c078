# SPDX-License-Identifier: GPL-3.0-or-later
"""All of a labelled take at a glance: what every marker is over time, and its worst moments, kept as they are found."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING

import numpy as np

from ..data.takes import Blobs, EditOutcome, LabelledChunk, Motion, PointRows, Suspect, part_of_take, rows_in_frame
from ..edits.applying import joined
from ..edits.kinds import NO_EDITS, Edits
from ..geometry.cameras import NO_CAMERAS, Cameras
from .answering import unanswered
from .summary import by_hand
from .suspects import MAX_OFF_BODY_M, find_suspects

MOST_MOMENTS = 6  # format: pictures on a page, and kept of one kind of doubt, each of other markers
# physical: m, from the middle of the markers to unnamed points that are kept; a body with arms held out
AROUND_M = 1.5  # physical


@dataclass(frozen=True, eq=False)
class Moment:
    """A frame that a person should look at."""

    suspect: Suspect  # why, and of which frames
    frame: int  # by the source's number, the one of these in which it shows most
    badness: float  # m s: how far its markers are from where the body has them, for how long
    doubtful: tuple[int, ...]  # indices of its markers
    markers: np.ndarray  # (M, 3) m, NaN where missing
    expected: np.ndarray  # (M, 3) m, where the body has them
    joints: np.ndarray  # (J, 3) m
    heading: np.ndarray  # (2,) where the subject faces, seen from above
    others: np.ndarray  # (U, 3) m, points without a name around
    asked: np.ndarray  # (3,) m, the one of them that it is about, NaN where it is none


class MomentKeeper:
    """Keeps the worst moments of a take while its chunks come; `rate` is in frames a second."""

    def __init__(self, rate: float):
        self.rate = rate
        self.kinds: dict[str, list[Moment]] = {}

    def add(self, rows: Blobs | PointRows, chunk: LabelledChunk, doubts: Sequence[Suspect], words: Mapping[str, int]):
        """Adds the doubts about markers of a chunk."""
        off = np.linalg.norm(chunk.motion.markers - chunk.motion.expected, axis=-1)
        # Where the body has no such marker, or nothing is named, it counts like one that is just too far away.
        summed = np.cumsum(np.nan_to_num(off, nan=MAX_OFF_BODY_M), axis=0)
        summed = np.concatenate([np.zeros((1, off.shape[1])), summed]) / self.rate
        first, kind_of = int(chunk.motion.frames[0]), cache(_kind_of)
        worst: dict[tuple, tuple[float, slice, Suspect]] = {}
        for doubt in doubts:
            doubtful = tuple(words[name] for name in doubt.markers if name in words)
            part = slice(max(doubt.first - first, 0), min(doubt.last - first + 1, len(off)))
            if part.start >= part.stop or not doubtful:
                continue
            badness = sum(float(summed[part.stop, index] - summed[part.start, index]) for index in doubtful)
            key = kind_of(doubt.words, doubt.markers), doubtful
            if key not in worst or worst[key][0] < badness:
                worst[key] = badness, part, doubt
        for (kind, doubtful), (badness, part, doubt) in sorted(worst.items(), key=lambda item: -item[1][0]):
            kept = self.kinds.get(kind, [])
            same = [one for one in kept if one.doubtful == doubtful]
            kept = [one for one in kept if one.doubtful != doubtful]
            if any(one.badness >= badness for one in (*same, *kept[MOST_MOMENTS - 1 :])):
                continue
            # The frame in which most of its markers are there and, of these, they are farthest off the body.
            far = off[part][:, doubtful]
            seen = np.isfinite(far).sum(axis=1)
            most = int(np.where(seen == seen.max(), np.nan_to_num(far).sum(axis=1), -1.0).argmax())
            kept.append(_moment(doubt, badness, doubtful, part.start + most, rows, chunk))
            self.kinds[kind] = sorted(kept, key=lambda one: -one.badness)[:MOST_MOMENTS]

    def worst(self) -> list[Moment]:
        """The worst of each kind first, then the next of each."""
        kinds = sorted(self.kinds.values(), key=lambda kept: -kept[0].badness)
        return [kept[turn] for turn in range(MOST_MOMENTS) for kept in kinds if turn < len(kept)][:MOST_MOMENTS]


def _kind_of(words: str, markers: tuple[str, ...]) -> str:
    """What is said, without of whom."""
    return " ".join(word for word in words.split() if word.rstrip(",:") not in markers)


def _moment(
    doubt: Suspect, badness: float, doubtful: tuple[int, ...], index: int, rows: Blobs | PointRows, chunk: LabelledChunk
) -> Moment:
    motion = chunk.motion
    markers = motion.markers[index]
    others, asked = np.zeros((0, 3)), np.full(3, np.nan)
    if isinstance(rows, PointRows):
        part = rows_in_frame(rows, index)
        xyz, named = rows.xyz[part], chunk.labels.named[part]
        middle = np.nanmedian(np.concatenate([markers, xyz]), axis=0)
        near = np.linalg.norm(xyz - middle, axis=1) < AROUND_M
        others = xyz[~named & near]
        own = rows.trajectory[part] == doubt.trajectory
        asked = xyz[own][0] if own.any() else asked
    return Moment(
        doubt,
        int(motion.frames[index]),
        badness,
        doubtful,
        markers.copy(),  # a view would keep the whole chunk
        motion.expected[index].copy(),
        motion.joints[index].copy(),
        _heading(motion, index),
        others,
        asked,
    )


def _heading(motion: Motion, index: int) -> np.ndarray:
    """(2,) where the root's x axis points, seen from above; without a body, across the markers."""
    ahead = motion.rotations[index, 0, :2, 0]
    size = float(np.linalg.norm(ahead))
    if np.isfinite(motion.joints[index, 0]).all() and size > 0:
        return ahead / size
    flat = motion.markers[index, :, :2]
    flat = flat[np.isfinite(flat).all(axis=1)]
    if len(flat) < 2:
        return np.array([1.0, 0.0])
    return np.linalg.svd(flat - flat.mean(axis=0), full_matrices=False)[2][-1]


if TYPE_CHECKING:  # it is looked at, and none is made
    from ..data.markersets import Worn

# What is known of a marker in a frame: nothing, its place by a name that the program gave and, of these, where a person
# should look; that it was filled, and that a person said so.
CELL_STATES = ("gap", "named", "doubtful", "filled", "edited")
GAP_CELL, NAMED_CELL, DOUBTFUL_CELL, FILLED_CELL, EDITED_CELL = range(len(CELL_STATES))


@dataclass(frozen=True, eq=False)
class OverviewSubject:
    """Whose take it is."""

    markers: tuple[str, ...]  # M names, in the order of everything that is written
    words: Mapping[str, int]  # index of each marker by its name, aliases too
    # (J,) the skeleton's tree, -1 for the root, of several one after the other; empty where nobody knows
    parents: tuple[int, ...] = ()

    @classmethod
    def of(cls, markerset: "Worn") -> "OverviewSubject":
        """Whoever wears the markers of a set, or of several side by side."""
        parents: list[int] = []
        for _, own in markerset.worn:
            first = len(parents)
            parents += [first + parent if parent >= 0 else parent for parent in own.skeleton.parents.tolist()]
        return cls(markerset.markers, markerset.by_name, tuple(parents))


# format: spans of time at most that a page shows, an even number; they get longer as the take does
OVERVIEW_COLUMNS = 1000  # format


class TimeBins:
    """Values (F, …) of frames one after the other, added up in so many columns of equal length at most.

    values  (columns, …), of which `used` hold something; width is how many frames a column is of
    """

    def __init__(self, *shape: int):
        self.width, self.frames = 1, 0
        self.values = np.zeros((OVERVIEW_COLUMNS, *shape))

    @property
    def used(self) -> int:
        """How many columns hold a frame."""
        return -(-self.frames // self.width)

    def add(self, values: np.ndarray):
        """Adds the next frames."""
        if not len(values):
            return
        while self.frames + len(values) > self.width * len(self.values):
            half = self.values[::2] + self.values[1::2]
            self.values[: len(half)], self.values[len(half) :] = half, 0
            self.width *= 2
        column = (self.frames + np.arange(len(values))) // self.width
        starts = np.flatnonzero(np.diff(column, prepend=-1))
        at = column[starts]
        self.values[at] += np.add.reduceat(values, starts, axis=0, dtype=float)
        self.frames += len(values)


class TakeOverview:
    """What a page about a take shows beside its report.

    cells       counts of CELL_STATES by time, marker and state
    outcomes    what became of each edit
    """

    def __init__(self, subject: OverviewSubject, rate: float, cameras: Cameras = NO_CAMERAS, edits: Edits = NO_EDITS):
        self.subject, self.rate, self.cameras, self.edits = subject, rate, cameras, edits
        self.first: int | None = None
        self.cells = TimeBins(len(subject.markers), len(CELL_STATES))
        self.outcomes: tuple[EditOutcome, ...] = ()
        self.keeper = MomentKeeper(rate)

    @property
    def frames(self) -> int:
        """How many there are."""
        return self.cells.frames

    @property
    def last(self) -> int:
        """The source's number of the last frame."""
        return (self.first or 0) + self.frames - 1

    def add(self, rows: Blobs | PointRows, chunk: LabelledChunk):
        """Adds a chunk, whose labels are row for row, and which follows the last without a break."""
        motion = chunk.motion
        if self.first is None:
            self.first = int(motion.frames[0])
        found = unanswered(find_suspects(motion, self.subject.markers, self.rate), self.edits, self.subject.words)
        doubts = [one for one in dict.fromkeys((*found, *chunk.suspects)) if one.markers and one.doubtful is None]
        cells = self._cells(rows, chunk, doubts)
        self.cells.add(cells[..., None] == np.arange(len(CELL_STATES)))
        if chunk.outcomes:
            self.outcomes = joined([self.outcomes, chunk.outcomes]) if self.outcomes else chunk.outcomes
        self.keeper.add(rows, chunk, doubts, self.subject.words)

    def fill(self, marker: str, first: int, last: int):
        """Notes that a marker's gap from frame `first` to `last`, by the source's numbers, was filled."""
        index, width = self.subject.words[marker], self.cells.width
        start, stop = first - (self.first or 0), last - (self.first or 0) + 1
        columns = np.arange(start // width, -(-stop // width))
        count = np.minimum((columns + 1) * width, stop) - np.maximum(columns * width, start)
        count = np.minimum(count, self.cells.values[columns, index, GAP_CELL])
        self.cells.values[columns, index, GAP_CELL] -= count
        self.cells.values[columns, index, FILLED_CELL] += count

    def _cells(self, rows: Blobs | PointRows, chunk: LabelledChunk, doubts: list) -> np.ndarray:
        """(F, M) the state of every marker in every frame."""
        motion, words = chunk.motion, self.subject.words
        present = np.isfinite(motion.markers).all(axis=2)
        cells = np.where(present, NAMED_CELL, GAP_CELL)
        first = int(motion.frames[0])
        for doubt in doubts:
            part = part_of_take(doubt.first, doubt.last, first)
            markers = [words[name] for name in doubt.markers if name in words]
            cells[part, markers] = np.where(cells[part, markers] == NAMED_CELL, DOUBTFUL_CELL, cells[part, markers])
        cells[present & (motion.residual == 0)] = FILLED_CELL
        cells[by_hand(rows, chunk, self.edits, words)] = EDITED_CELL
        return cells
