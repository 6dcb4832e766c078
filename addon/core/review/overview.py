# SPDX-License-Identifier: GPL-3.0-or-later
"""What pictures of a labelled take are drawn from, added up chunk by chunk: memory does not grow with the take."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from ..data.takes import BY_EDIT, NO_MARKER, Blobs, EditOutcome, LabelledChunk, PointRows
from ..edits.applying import joined
from ..edits.kinds import NO_EDITS, Edits, Place
from ..geometry.cameras import NO_CAMERAS, Cameras
from .answering import unanswered_of_blobs
from .moments import Moment, MomentKeeper
from .suspects import find_suspects

if TYPE_CHECKING:  # it is looked at, and none is made
    from ..data.markersets import Worn

# What is known of a marker in a frame: nothing, its place by a name that the program gave and, of these, where a person
# should look; that it was filled, and that a person said so.
CELL_STATES = ("gap", "named", "doubtful", "filled", "edited")
GAP_CELL, NAMED_CELL, DOUBTFUL_CELL, FILLED_CELL, EDITED_CELL = range(len(CELL_STATES))


@dataclass(frozen=True)
class OverviewOptions:
    """How finely a take is kept; reckoned, by what a page shows and may weigh, and by memory.

    columns      spans of time at most, an even number; they get longer as the take does
    per_decade   classes of a histogram in which a value grows tenfold: its quantiles are known to 6 %
    min_mm       the smallest length that is distinguished from others, and
    decades      in which all lengths are
    min_px, pixel_decades  the same of reprojection errors
    at_once      frames whose markers are projected into all cameras at a time
    """

    columns: int = 1000
    per_decade: int = 40
    min_mm: float = 0.001
    decades: int = 7
    min_px: float = 0.001
    pixel_decades: int = 5
    at_once: int = 500


OVERVIEW = OverviewOptions()


class TimeBins:
    """Values (F, …) of frames one after the other, `join`ed over so many columns of equal length at most.

    values  (columns, …), of which `used` hold something; width is how many frames a column is of
    """

    def __init__(self, *shape: int, join: np.ufunc = np.add, columns: int = OVERVIEW.columns):
        self.join, self.width, self.frames = join, 1, 0
        self.values = np.zeros((columns, *shape))

    @property
    def used(self) -> int:
        """How many columns hold a frame."""
        return -(-self.frames // self.width)

    def add(self, values: np.ndarray):
        """Adds the next frames."""
        if not len(values):
            return
        while self.frames + len(values) > self.width * len(self.values):
            half = self.join(self.values[::2], self.values[1::2])
            self.values[: len(half)], self.values[len(half) :] = half, 0
            self.width *= 2
        column = (self.frames + np.arange(len(values))) // self.width
        starts = np.flatnonzero(np.diff(column, prepend=-1))
        at = column[starts]
        self.values[at] = self.join(self.values[at], self.join.reduceat(values, starts, axis=0, dtype=float))
        self.frames += len(values)


class Lengths:
    """How values above zero are spread: in logarithmic classes from `least` on, each of `of` kinds on its own."""

    def __init__(self, least: float, decades: int, of: int = 1):
        self.least = least
        self.counts = np.zeros((of, decades * OVERVIEW.per_decade), np.int64)

    def add(self, values: np.ndarray, kind: np.ndarray | int = 0):
        """Adds values (N,), each of a kind; those that are not finite or not above zero are left out."""
        known = np.isfinite(values) & (values > 0)
        classes = np.floor(OVERVIEW.per_decade * np.log10(values[known] / self.least)).astype(int)
        classes = np.clip(classes, 0, self.counts.shape[1] - 1)
        kind = np.broadcast_to(kind, values.shape)[known]
        flat = np.bincount(kind * self.counts.shape[1] + classes, minlength=self.counts.size)
        self.counts += flat.reshape(self.counts.shape)

    def quantile(self, share: float, kind: int = 0) -> float:
        """The value below which a share of those of a kind lie; NaN where there are none."""
        counts = self.counts[kind]
        if not counts.any():
            return float("nan")
        place = int(np.searchsorted(np.cumsum(counts), share * counts.sum()))
        return float(self.least * 10 ** ((min(place, len(counts) - 1) + 0.5) / OVERVIEW.per_decade))


class LengthLog:
    """One kind of length over a take, such as residuals, mm: how they are spread, and by time."""

    def __init__(self):
        self.spread = Lengths(OVERVIEW.min_mm, OVERVIEW.decades)
        self.sums, self.largest = TimeBins(2), TimeBins(join=np.maximum)

    def add(self, lengths: np.ndarray):
        """Adds frames (F, M) of lengths, m; what is not above zero was not measured."""
        millimetres = 1000 * np.where(lengths > 0, lengths, np.nan)
        self.spread.add(millimetres.ravel())
        known = np.isfinite(millimetres)
        filled = np.where(known, millimetres, 0.0)
        self.sums.add(np.column_stack([filled.sum(axis=1), known.sum(axis=1)]))
        self.largest.add(filled.max(axis=1, initial=0.0))

    @property
    def any(self) -> bool:
        """Whether anything was measured."""
        return bool(self.spread.counts.any())

    @property
    def means(self) -> np.ndarray:
        """(columns,) mm, NaN where nothing was measured."""
        total, count = self.sums.values[: self.sums.used].T
        return np.where(count > 0, total / np.maximum(count, 1), np.nan)


@dataclass(frozen=True, eq=False)
class OverviewSubject:
    """Whose take it is.

    markers  M names, in the order of everything that is written
    words    index of each marker by its name, aliases too
    parents  (J,) the skeleton's tree, -1 for the root, of several one after the other; empty where nobody knows
    """

    markers: tuple[str, ...]
    words: Mapping[str, int]
    parents: tuple[int, ...] = ()

    @classmethod
    def of(cls, markerset: "Worn") -> "OverviewSubject":
        """Whoever wears the markers of a set, or of several side by side."""
        parents: list[int] = []
        for _, own in markerset.worn:
            first = len(parents)
            parents += [first + parent if parent >= 0 else parent for parent in own.skeleton.parents.tolist()]
        return cls(markerset.markers, markerset.by_name, tuple(parents))


class TakeOverview:
    """What a page about a take shows beside its report.

    cells       counts of CELL_STATES by time, marker and state
    residual    of measured samples, as `Motion` has it, and
    off_body    how far markers are from where the fitted body has them
    pixels      reprojection errors of named blobs, px, by camera
    blobs       (C, 2) how many blobs each camera has, and how many of them have a name
    outcomes    what became of each edit
    """

    def __init__(self, subject: OverviewSubject, rate: float, cameras: Cameras = NO_CAMERAS, edits: Edits = NO_EDITS):
        self.subject, self.rate, self.cameras, self.edits = subject, rate, cameras, edits
        self.first: int | None = None
        self.cells = TimeBins(len(subject.markers), len(CELL_STATES))
        self.residual, self.off_body = LengthLog(), LengthLog()
        self.pixels = Lengths(OVERVIEW.min_px, OVERVIEW.pixel_decades, max(len(cameras), 1))
        self.blobs = np.zeros((len(cameras), 2), np.int64)
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
        found = find_suspects(motion, self.subject.markers, self.rate)
        found = unanswered_of_blobs(found, self.edits, self.subject.words)
        doubts = [one for one in dict.fromkeys((*found, *chunk.suspects)) if one.markers and one.doubtful is None]
        cells = self._cells(rows, chunk, doubts)
        self.cells.add(cells[..., None] == np.arange(len(CELL_STATES)))
        measured = cells != FILLED_CELL
        self.residual.add(np.where(measured, motion.residual, np.nan))
        self.off_body.add(np.where(measured, np.linalg.norm(motion.markers - motion.expected, axis=-1), np.nan))
        if isinstance(rows, Blobs):
            self._add_blobs(rows, chunk)
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

    def moments(self) -> tuple[Moment, ...]:
        """The worst moments, those of other kinds before more of one kind."""
        return self.keeper.worst()

    def _cells(self, rows: Blobs | PointRows, chunk: LabelledChunk, doubts: list) -> np.ndarray:
        """(F, M) the state of every marker in every frame."""
        motion, labels, words = chunk.motion, chunk.labels, self.subject.words
        present = np.isfinite(motion.markers).all(axis=2)
        cells = np.where(present, NAMED_CELL, GAP_CELL)
        first = int(motion.frames[0])
        for doubt in doubts:
            part = slice(max(doubt.first - first, 0), max(doubt.last - first + 1, 0))
            markers = [words[name] for name in doubt.markers if name in words]
            cells[part, markers] = np.where(cells[part, markers] == NAMED_CELL, DOUBTFUL_CELL, cells[part, markers])
        cells[present & (motion.residual == 0)] = FILLED_CELL
        edited = (labels.step == BY_EDIT) & (labels.marker != NO_MARKER)
        by_hand = np.zeros_like(present)
        by_hand[rows.frame[edited], labels.marker[edited]] = True
        for edit in self.edits:
            if isinstance(edit, Place) and first <= edit.frame < first + len(cells):
                by_hand[edit.frame - first, words[edit.marker]] = True
        cells[present & by_hand] = EDITED_CELL
        return cells

    def _add_blobs(self, rows: Blobs, chunk: LabelledChunk):
        labels, count = chunk.labels, len(self.cameras)
        named = np.flatnonzero(labels.named)
        camera, frame, marker = rows.camera[named], rows.frame[named], labels.marker[named]
        self.blobs[:, 0] += np.bincount(rows.camera, minlength=count)
        self.blobs[:, 1] += np.bincount(camera, minlength=count)
        for first in range(0, len(chunk.motion.markers), OVERVIEW.at_once):
            seen = self.cameras.project(chunk.motion.markers[first : first + OVERVIEW.at_once])
            part = slice(*np.searchsorted(frame, [first, first + OVERVIEW.at_once]).tolist())
            off = rows.xy[named[part]] - seen[camera[part], frame[part] - first, marker[part]]
            self.pixels.add(np.linalg.norm(off, axis=1), camera[part])
