# SPDX-License-Identifier: GPL-3.0-or-later
"""What pictures of a labelled take are drawn from, added up chunk by chunk: memory does not grow with the take."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..data.takes import Blobs, EditOutcome, LabelledChunk, PointRows
from ..edits.applying import joined
from ..edits.kinds import NO_EDITS, Edits
from ..geometry.cameras import NO_CAMERAS, Cameras
from .answering import unanswered
from .moments import MomentKeeper
from .provenance import by_hand
from .suspects import find_suspects

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
            part = slice(max(doubt.first - first, 0), max(doubt.last - first + 1, 0))
            markers = [words[name] for name in doubt.markers if name in words]
            cells[part, markers] = np.where(cells[part, markers] == NAMED_CELL, DOUBTFUL_CELL, cells[part, markers])
        cells[present & (motion.residual == 0)] = FILLED_CELL
        cells[by_hand(rows, chunk, self.edits, words)] = EDITED_CELL
        return cells
