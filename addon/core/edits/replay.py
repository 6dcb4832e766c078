# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels in which things are renamed one after the other, so that no row ever has a name twice.

A row is what is seen at one time: a frame of points, or an image. A cell is one thing that is seen there. What the
program named lies below, what a person said above it; of what a later edit overrides nothing is left behind, so a name
that was taken by mistake and then given up is its old owner's again.
"""

from dataclasses import dataclass

import numpy as np

from ..data.takes import BY_EDIT, NO_MARKER, NO_STEP, Labels

FREE = -1  # a cell of which no edit says anything
NOBODY, ANYBODY = -2, -1  # of a marker in a row: nothing is it; no edit says what is


@dataclass(frozen=True, eq=False)
class Edited:
    """Labels of cells as the edits have them, and what these say, for whoever labels again; all in one shape."""

    labels: Labels  # with the step BY_EDIT and confidence 1 where a person gave the name
    row: np.ndarray  # which of T rows each cell is of
    rule: np.ndarray  # FREE; a marker, which the cell then is; M, which is none whoever asks; M + 1, which has no name
    refused: np.ndarray  # the marker that a cell certainly is not, NO_MARKER where nobody said so
    claim: np.ndarray  # (T, M) the cell that is each marker by an edit, NOBODY, or ANYBODY
    swaps: tuple[tuple[slice, int, int], ...]  # rows and the two markers of each exchange, in their order

    @property
    def named(self) -> np.ndarray:
        """True where a person gave the name."""
        return (self.rule >= 0) & (self.rule < self.claim.shape[1])

    @property
    def deleted(self) -> np.ndarray:
        """True for what is no marker, whoever asks."""
        return self.rule == self.claim.shape[1]

    def below(self, before: Labels, again: Labels) -> Labels:
        """What to call the program's own labels, so that the same edits of them give those that were labelled `again`.

        `before` are the labels that the edits were of. What the edits decide stays as it was in them; everything else
        is as labelled again, in the names that it had before markers were exchanged.
        """
        marker = np.where(self.rule == FREE, again.marker, NO_MARKER)
        at = np.nonzero(marker != NO_MARKER)
        taken = self.claim[self.row[at], marker[at]] != ANYBODY
        marker[tuple(index[taken] for index in at)] = NO_MARKER
        for rows, one, other in reversed(self.swaps):
            inside = (self.row >= rows.start) & (self.row < rows.stop)
            marker = np.where(inside & (marker == one), other, np.where(inside & (marker == other), one, marker))
        at = np.nonzero(marker != NO_MARKER)
        has = np.zeros(self.claim.shape, bool)
        has[self.row[at], marker[at]] = True
        # What an edit renamed, or took a name from, has that name below it still, unless another has it now.
        back = (self.rule != FREE) | (self.labels.marker != before.marker)
        back &= (marker == NO_MARKER) & (before.marker != NO_MARKER)
        at = np.nonzero(back)
        back[at] = ~has[self.row[at], before.marker[at]]
        marker[back] = before.marker[back]
        whole = Labels(marker, again.step, again.confidence).kept(marker != NO_MARKER)
        return whole.replaced(back, before)


class Replay:
    """N cells in T rows, named by M markers, while edits are applied; each method gives how many labels it is about.

    row      (N,) the row of each cell
    own      (M, T) the cell that the program calls each marker in each row, NO_MARKER where none is
    below    (N,) what it calls each cell, NO_MARKER where it has no name
    claim    (M, T) the cell that is a marker by an edit, NOBODY or ANYBODY, and
    rule     (N,) what is said of a cell, as in `Edited`
    refused  (N,) likewise
    images   rows of a frame: 1 of points; of blobs as many as there are cameras, and a place is beside their names
    places   where markers were placed, by frame and marker
    touched  the markers that may be other cells by now, and in which rows

    A marker's rows lie side by side, as most edits are of one or two markers and many rows. Where a method takes cells
    (K,), each is of another row.
    """

    def __init__(self, marker: np.ndarray, row: np.ndarray, shape: tuple[int, int], images: int = 1):
        """The program's names of cells and the row of each, in whatever shape; `shape` is M and T."""
        self.below, self.row, self.images = marker.ravel().astype(np.int32), row.ravel(), images
        self.own = np.full(shape, NO_MARKER, np.int32)
        named = np.flatnonzero(self.below != NO_MARKER)
        self.own[self.below[named], self.row[named]] = named
        self.claim = np.full(shape, ANYBODY, np.int32)
        self.rule = np.full(self.below.shape, FREE, np.int32)
        self.refused = np.full(self.below.shape, NO_MARKER, np.int32)
        self.places: dict[tuple[int, int], np.ndarray] = {}
        self.swaps: list[tuple[slice, int, int]] = []
        self.touched: dict[int, slice] = {}

    @property
    def markers(self) -> int:
        """How many markers there are."""
        return len(self.own)

    def assign(self, cell: np.ndarray, marker: int) -> int:
        """Some cells (K,) are the marker; it is placed no more where they are a point."""
        at = self.row[cell]
        self._let_go(cell)
        self._take_away(at, marker)
        self._claim(cell, marker)
        for frame in {*(at // self.images).tolist()} if self.places else ():
            rows = slice(frame * self.images, (frame + 1) * self.images)
            if (self.holder(rows, marker) >= 0).sum() >= min(self.images, 2):
                self._taken_up(rows, (marker,))
        return len(at)

    def unlabel_marker(self, rows: slice, marker: int) -> int:
        """Nothing is the marker."""
        holder = self.holder(rows, marker)
        held = holder[holder >= 0]
        self.refused[held] = marker
        self._take_away(rows, marker)
        self._say(marker, rows, NOBODY)
        return len(held) + len(self._taken_up(rows, (marker,)))

    def unlabel(self, cell: np.ndarray) -> int:
        """Some cells (K,) have no name, and are not the markers that they were taken for."""
        named = self._name(cell)
        self._let_go(cell)
        self._rule(cell, self.markers + 1)
        self.refused[cell] = np.where(named != NO_MARKER, named, self.refused[cell])
        return int((named != NO_MARKER).sum())

    def delete(self, cell: np.ndarray) -> int:
        """Some cells (K,) are no markers."""
        self._let_go(cell)
        self._rule(cell, self.markers)
        return len(cell)

    def swap(self, rows: slice, one: int, other: int) -> int:
        """What is named either of two markers has the other's name."""
        pair = [one, other]
        holders = [self.holder(rows, marker) for marker in pair]
        moved = self._taken_up(rows, (one, other))
        for values in (self.own, self.claim):
            values[pair, rows] = values[pair[::-1], rows]
        for marker in pair:
            own = self.own[marker, rows]
            self.below[own[own >= 0]] = marker
            self._touch(marker, rows.start, rows.stop)
        for holder, marker in zip(holders, pair[::-1], strict=True):
            self._claim(holder[holder >= 0], marker)
        for (frame, marker), xyz in moved.items():
            self.places[frame, one + other - marker] = xyz
        self.swaps.append((rows, one, other))
        return int(sum((holder >= 0).sum() for holder in holders)) + len(moved)

    def place(self, rows: slice, marker: int, xyz: tuple[float, float, float]) -> int:
        """The marker is at a place in a frame, so no point is it; blobs are what they were."""
        if self.images == 1:
            self._take_away(rows, marker)
            self._say(marker, rows, NOBODY)
        self.places[rows.start // self.images, marker] = np.array(xyz)
        return 1

    def lock(self, rows: slice, marker: int) -> int:
        """What is the marker, or that nothing is, was looked at."""
        holder = self.holder(rows, marker)
        self._claim(holder[holder >= 0], marker)
        self._say(marker, rows.start + np.flatnonzero(holder < 0), NOBODY)
        return len(holder)

    def accept(self, rows: slice) -> int:
        """The labels of some rows are right; how many frames these are."""
        return (rows.stop - rows.start) // self.images

    def holder(self, at: np.ndarray | slice, marker: int) -> np.ndarray:
        """(K,) the cell that is a marker in some rows, below 0 where none is."""
        own, claim = self.own[marker, at], self.claim[marker, at]
        free = own >= 0
        free[free] = self.rule[own[free]] == FREE
        return np.where(claim != ANYBODY, claim, np.where(free, own, NO_MARKER))

    def done(self, labels: Labels) -> Edited:
        """The labels of all cells that all began with as they are now."""
        shape = labels.marker.shape
        marker, step, sure = self.below.copy(), labels.step.ravel().copy(), labels.confidence.ravel().copy()
        name, at = np.nonzero((self.claim != ANYBODY) & (self.own != NO_MARKER))
        cell = self.own[name, at]
        free = self.rule[cell] == FREE
        name, cell = name[free], cell[free]
        self.refused[cell] = name  # whose it was: another is, or nothing
        for values, nothing in ((marker, NO_MARKER), (step, NO_STEP), (sure, 0.0)):
            values[cell] = nothing
        ruled = np.flatnonzero(self.rule != FREE)
        given = self.rule[ruled] < self.markers
        marker[ruled] = np.where(given, self.rule[ruled], NO_MARKER)
        step[ruled] = np.where(given, BY_EDIT, NO_STEP)
        sure[ruled] = np.where(given, 1.0, 0.0)
        own = Labels(marker.reshape(shape).astype(labels.marker.dtype), step.reshape(shape), sure.reshape(shape))
        row, rule, refused = (values.reshape(shape) for values in (self.row, self.rule, self.refused))
        return Edited(own, row, rule, refused, self.claim.T, tuple(self.swaps))

    def _touch(self, marker: int, first: int, stop: int):
        """Notes that a marker may be other cells in rows from `first` up to, not including, `stop`."""
        own = self.touched.get(marker, slice(first, stop))
        self.touched[marker] = slice(min(own.start, first), max(own.stop, stop))

    def _rule(self, cell: np.ndarray, value: int | np.ndarray):
        """Says something of cells, so that what the program calls them may be another or nothing."""
        self.rule[cell] = value
        if len(cell):
            at = self.row[cell]
            for marker in np.flatnonzero(np.bincount(self.below[cell] + 1)[1:]).tolist():
                self._touch(marker, int(at.min()), int(at.max()) + 1)

    def _say(self, marker: int, at: np.ndarray | slice, cell: int | np.ndarray):
        """Says which cell a marker is in some rows, or NOBODY or ANYBODY."""
        self.claim[marker, at] = cell
        if isinstance(at, slice):
            self._touch(marker, at.start, at.stop)
        elif len(at):
            self._touch(marker, int(at.min()), int(at.max()) + 1)

    def _taken_up(self, rows: slice, markers: tuple[int, ...]) -> dict[tuple[int, int], np.ndarray]:
        """The places of some markers in the frames of some rows, which are no places any more."""
        inside = range(rows.start // self.images, rows.stop // self.images)
        found = [key for key in self.places if key[1] in markers and key[0] in inside]
        return {key: self.places.pop(key) for key in found}

    def _name(self, cell: np.ndarray) -> np.ndarray:
        """(K,) what cells (K,) are called."""
        rule, below = self.rule[cell], self.below[cell]
        given = (rule >= 0) & (rule < self.markers)
        own = (rule == FREE) & (below != NO_MARKER) & (self.claim[below, self.row[cell]] == ANYBODY)
        return np.where(given, rule, np.where(own, below, NO_MARKER))

    def _claim(self, cell: np.ndarray, marker: int):
        self._rule(cell, marker)
        self.refused[cell] = NO_MARKER
        self._say(marker, self.row[cell], cell)

    def _let_go(self, cell: np.ndarray):
        """What an edit gave cells (K,) they give up; whoever the program named so is that marker again."""
        rule = self.rule[cell]
        for marker in np.unique(rule[(rule >= 0) & (rule < self.markers)]).tolist():
            self._say(marker, self.row[cell[rule == marker]], ANYBODY)

    def _take_away(self, at: np.ndarray | slice, marker: int):
        """Whoever has a marker by an edit loses it; what a person named otherwise before has no name then."""
        cell = self.claim[marker, at]
        cell = cell[cell >= 0]
        self._rule(cell, np.where(self.own[marker, self.row[cell]] == cell, FREE, self.markers + 1))
