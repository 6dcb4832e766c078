# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels in which things are renamed one after the other, so that no row ever has a name twice.

A row is what is seen at one time: a frame of points, or an image. A cell is one thing that is seen there. What the
program named lies below, what a person said above it; of what a later edit overrides nothing is left behind, so a name
that was taken by mistake and then given up is its old owner's again.
"""

from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, Self

import numpy as np

from ..data.takes import BY_EDIT, NO_MARKER, NO_STEP, Labels

Change = tuple[str, Any, Any]  # a former value: the name of an array of `Replay`, an index of it, what was there

FREE = -1  # a cell of which no edit says anything
NOBODY, ANYBODY = -2, -1  # of a marker in a row: nothing is it; no edit says what is


@dataclass(frozen=True, eq=False)
class Edited:
    """Labels (T, P) as the edits have them, and what these say, for whoever labels again.

    labels   with the step BY_EDIT and confidence 1 where a person gave the name
    rule     (T, P) FREE; a marker, which the cell then is; M, which is none whoever asks; M + 1, which has no name
    refused  (T, P) the marker that a cell certainly is not, NO_MARKER where nobody said so
    claim    (T, M) the column that is each marker by an edit, NOBODY, or ANYBODY
    swaps    rows and the two markers of each exchange, in their order
    """

    labels: Labels
    rule: np.ndarray
    refused: np.ndarray
    claim: np.ndarray
    swaps: tuple[tuple[slice, int, int], ...]

    @property
    def named(self) -> np.ndarray:
        """(T, P) True where a person gave the name."""
        return (self.rule >= 0) & (self.rule < self.claim.shape[1])

    @property
    def deleted(self) -> np.ndarray:
        """(T, P) True for what is no marker, whoever asks."""
        return self.rule == self.claim.shape[1]

    def below(self, before: Labels, again: Labels) -> Labels:
        """What to call the program's own labels, so that the same edits of them give those that were labelled `again`.

        `before` are the labels (T, P) that the edits were of. What the edits decide stays as it was in them; everything
        else is as labelled again, in the names that it had before markers were exchanged.
        """
        marker = np.where(self.rule == FREE, again.marker, NO_MARKER)
        row, column = np.nonzero(marker != NO_MARKER)
        taken = self.claim[row, marker[row, column]] != ANYBODY
        marker[row[taken], column[taken]] = NO_MARKER
        for rows, one, other in reversed(self.swaps):
            marker[rows] = _exchanged(marker[rows], one, other)
        row, column = np.nonzero(marker != NO_MARKER)
        has = np.zeros(self.claim.shape, bool)
        has[row, marker[row, column]] = True
        # What an edit renamed, or took a name from, has that name below it still, unless another has it now.
        row, column = np.nonzero((marker == NO_MARKER) & (before.marker != NO_MARKER))
        kept = self._decides(row, column, before) & ~has[row, before.marker[row, column]]
        row, column = row[kept], column[kept]
        marker[row, column] = before.marker[row, column]
        back = np.zeros(marker.shape, bool)
        back[row, column] = True
        whole = Labels(marker, again.step, again.confidence)
        whole = whole.kept(marker != NO_MARKER)
        return whole.replaced(back, before)

    def _decides(self, row: np.ndarray, column: np.ndarray, before: Labels) -> np.ndarray:
        """Which cells (K,) lost or changed their names by an edit."""
        after = self.labels.marker[row, column]
        return (self.rule[row, column] != FREE) | (after != before.marker[row, column])


class Replay:
    """N cells in T rows, named by M markers, while edits are applied; each method gives how many labels it is about.

    own      (M, T) the cell that the program calls each marker in each row, NO_MARKER where none is
    below    (N,) what it calls each cell, NO_MARKER where it has no name
    claim    (M, T) the cell that is a marker by an edit, NOBODY or ANYBODY, and
    rule     (N,) what is said of a cell, as in `Edited`
    refused  (N,) likewise
    images   rows of a frame: 1 of points; of blobs as many as there are cameras, and a place is beside their names
    places   where markers were placed, by frame and marker
    changes  former values of all that was changed, the last one last; nothing is noted where it is None

    A marker's rows lie side by side, as most edits are of one or two markers and many rows. Where a method takes rows
    (K,) and cells (K,), each row is there once, and a cell is of its row.
    """

    def __init__(self, below: np.ndarray, own: np.ndarray, images: int = 1):
        self.below, self.own, self.images = below, own, images
        self.claim = np.full(own.shape, ANYBODY, np.int32)
        self.rule = np.full(below.shape, FREE, np.int32)
        self.refused = np.full(below.shape, NO_MARKER, np.int32)
        self.places: dict[tuple[int, int], np.ndarray] = {}
        self.swaps: list[tuple[slice, int, int]] = []
        self.changes: list[Change] | None = None

    @classmethod
    def of_table(cls, labels: Labels, markers: int, images: int = 1) -> Self:
        """That of a table of labels (T, P), whose cells are numbered row after row."""
        own = np.full((markers, len(labels.marker)), NO_MARKER, np.int32)
        row, column = np.nonzero(labels.marker != NO_MARKER)
        own[labels.marker[row, column], row] = row * labels.marker.shape[1] + column
        return cls(labels.marker.ravel().astype(np.int32), own, images)

    @property
    def markers(self) -> int:
        """How many markers there are."""
        return len(self.own)

    def assign(self, at: np.ndarray, cell: np.ndarray, marker: int) -> int:
        """In some rows (K,) cells (K,) are the marker; it is placed no more where they are a point."""
        self._let_go(at, cell)
        self._take_away(at, marker)
        self._claim(at, cell, marker)
        for frame in {*(at // self.images).tolist()} if self.places else ():
            rows = slice(frame * self.images, (frame + 1) * self.images)
            if (self.holder(rows, marker) >= 0).sum() >= min(self.images, 2):
                self._taken_up(rows, (marker,))
        return len(at)

    def unlabel_marker(self, rows: slice, marker: int) -> int:
        """Nothing is the marker."""
        at = self._all(rows)
        holder = self.holder(at, marker)
        held = holder >= 0
        self._set("refused", holder[held], marker)
        self._take_away(at, marker)
        self._set("claim", (marker, rows), NOBODY)
        return int(held.sum()) + len(self._taken_up(rows, (marker,)))

    def unlabel(self, at: np.ndarray, cell: np.ndarray) -> int:
        """In some rows (K,) cells (K,) have no name, and are not the markers that they were taken for."""
        named = self._name(at, cell)
        self._let_go(at, cell)
        self._set("rule", cell, self.markers + 1)
        self._set("refused", cell, np.where(named != NO_MARKER, named, self.refused[cell]))
        return int((named != NO_MARKER).sum())

    def delete(self, at: np.ndarray, cell: np.ndarray) -> int:
        """In some rows (K,) cells (K,) are no markers."""
        self._let_go(at, cell)
        self._set("rule", cell, self.markers)
        return len(at)

    def swap(self, rows: slice, one: int, other: int) -> int:
        """What is named either of two markers has the other's name."""
        at = self._all(rows)
        holders = [self.holder(at, marker) for marker in (one, other)]
        moved = self._taken_up(rows, (one, other))
        pair = [one, other]
        for name in ("own", "claim"):
            self._set(name, (pair, rows), getattr(self, name)[pair[::-1], rows])
        for marker in pair:
            own = self.own[marker, rows]
            self._set("below", own[own >= 0], marker)
        for holder, marker in zip(holders, pair[::-1], strict=True):
            held = holder >= 0
            self._claim(at[held], holder[held], marker)
        for (frame, marker), xyz in moved.items():
            self.places[frame, one + other - marker] = xyz
        self.swaps.append((rows, one, other))
        return int(sum((holder >= 0).sum() for holder in holders)) + len(moved)

    def place(self, rows: slice, marker: int, xyz: tuple[float, float, float]) -> int:
        """The marker is at a place in a frame, so no point is it; blobs are what they were."""
        if self.images == 1:
            self._take_away(self._all(rows), marker)
            self._set("claim", (marker, rows), NOBODY)
        self._note_places()
        self.places[rows.start // self.images, marker] = np.array(xyz)
        return 1

    def lock(self, rows: slice, marker: int) -> int:
        """What is the marker, or that nothing is, was looked at."""
        at = self._all(rows)
        holder = self.holder(at, marker)
        held = holder >= 0
        self._claim(at[held], holder[held], marker)
        self._set("claim", (marker, at[~held]), NOBODY)
        return len(at)

    def accept(self, rows: slice) -> int:
        """The labels of some rows are right; how many frames these are."""
        return (rows.stop - rows.start) // self.images

    def holder(self, at: np.ndarray | slice, marker: int) -> np.ndarray:
        """(K,) the cell that is a marker in some rows, below 0 where none is."""
        own, claim = self.own[marker, at], self.claim[marker, at]
        free = own >= 0
        free[free] = self.rule[own[free]] == FREE
        return np.where(claim != ANYBODY, claim, np.where(free, own, NO_MARKER))

    def take_back(self, changes: Iterable[Change]):
        """Makes everything as it was before these changes, which are the last ones."""
        for name, index, before in reversed(list(changes)):
            if index is None:
                setattr(self, name, before)
            else:
                getattr(self, name)[index] = before

    def done(self, labels: Labels) -> Edited:
        """The table of labels (T, P) that all began with as it is now."""
        shape, width = labels.marker.shape, labels.marker.shape[1]
        marker, step, sure = self.below.copy(), labels.step.ravel().copy(), labels.confidence.ravel().copy()
        name, at = np.nonzero((self.claim != ANYBODY) & (self.own != NO_MARKER))
        cell = self.own[name, at]
        free = self.rule[cell] == FREE
        name, cell = name[free], cell[free]
        self.refused[cell] = name  # whose it was: another is, or nothing
        for values, nothing in ((marker, NO_MARKER), (step, NO_STEP), (sure, 0.0)):
            values[cell] = nothing
        said = np.flatnonzero(self.rule != FREE)
        given = self.rule[said] < self.markers
        marker[said] = np.where(given, self.rule[said], NO_MARKER)
        step[said] = np.where(given, BY_EDIT, NO_STEP)
        sure[said] = np.where(given, 1.0, 0.0)
        return Edited(
            Labels(marker.reshape(shape).astype(labels.marker.dtype), step.reshape(shape), sure.reshape(shape)),
            self.rule.reshape(shape),
            self.refused.reshape(shape),
            np.where(self.claim >= 0, self.claim % max(width, 1), self.claim).T,
            tuple(self.swaps),
        )

    def _all(self, rows: slice) -> np.ndarray:
        return np.arange(*rows.indices(self.own.shape[1]))

    def _set(self, name: str, index, value):
        """Changes some values of an array, and notes what they were."""
        values = getattr(self, name)
        if self.changes is not None:
            self.changes.append((name, index, np.array(values[index])))
        values[index] = value

    def _note_places(self):
        if self.changes is not None:
            self.changes.append(("places", None, dict(self.places)))

    def _taken_up(self, rows: slice, markers: tuple[int, ...]) -> dict[tuple[int, int], np.ndarray]:
        """The places of some markers in the frames of some rows, which are no places any more."""
        inside = range(rows.start // self.images, rows.stop // self.images)
        found = {key: xyz for key, xyz in self.places.items() if key[1] in markers and key[0] in inside}
        if found:
            self._note_places()
            for key in found:
                del self.places[key]
        return found

    def _name(self, at: np.ndarray, cell: np.ndarray) -> np.ndarray:
        """(K,) what cells (K,) are called in some rows (K,)."""
        rule, below = self.rule[cell], self.below[cell]
        given = (rule >= 0) & (rule < self.markers)
        own = (rule == FREE) & (below != NO_MARKER) & (self.claim[below, at] == ANYBODY)
        return np.where(given, rule, np.where(own, below, NO_MARKER))

    def _claim(self, at: np.ndarray, cell: np.ndarray, marker: int):
        self._set("rule", cell, marker)
        self._set("refused", cell, NO_MARKER)
        self._set("claim", (marker, at), cell)

    def _let_go(self, at: np.ndarray, cell: np.ndarray):
        """What an edit gave cells (K,) they give up; whoever the program named so is that marker again."""
        rule = self.rule[cell]
        given = (rule >= 0) & (rule < self.markers)
        if given.any():
            self._set("claim", (rule[given], at[given]), ANYBODY)

    def _take_away(self, at: np.ndarray, marker: int):
        """Whoever has a marker by an edit loses it; what a person named otherwise before has no name then."""
        holder = self.claim[marker, at]
        held = holder >= 0
        row, cell = at[held], holder[held]
        self._set("rule", cell, np.where(self.own[marker, row] == cell, FREE, self.markers + 1))


def _exchanged(marker: np.ndarray, one: int, other: int) -> np.ndarray:
    return np.where(marker == one, other, np.where(marker == other, one, marker))
