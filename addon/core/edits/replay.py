# SPDX-License-Identifier: GPL-3.0-or-later
"""A table of labels in which things are renamed one after the other, so that no row ever has a name twice.

A row is what is seen at one time: a frame of points, or an image. What the program named lies below, what a person said
above it; of what a later edit overrides nothing is left behind, so a name that was taken by mistake and then given up
is its old owner's again.
"""

from dataclasses import dataclass

import numpy as np

from ..data.takes import BY_EDIT, NO_MARKER, NO_STEP, Labels

FREE = -1  # a cell of which no edit says anything
NOBODY, ANYBODY = -2, -1  # of a marker in a row: nothing is it; no edit says what is


@dataclass(frozen=True, eq=False)
class Edited:
    """Labels (T, P) as the edits have them, and what these say, for whoever labels again.

    labels   with the step BY_EDIT and confidence 1 where a person gave the name
    rule     (T, P) FREE; a marker, which the cell then is; M, which is none whoever asks; M + 1, which has no name
    refused  (T, P) the marker that a cell certainly is not, NO_MARKER where nobody said so
    claim    (T, M) the column that is each marker by an edit, NOBODY, or ANYBODY
    right    (T, M) True where the marker was looked at
    places   (K, 2) row and marker of each that was placed, and
    xyz      (K, 3) m, where
    swaps    rows and the two markers of each exchange, in their order
    """

    labels: Labels
    rule: np.ndarray
    refused: np.ndarray
    claim: np.ndarray
    right: np.ndarray
    places: np.ndarray
    xyz: np.ndarray
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
    """Labels (T, P) of M markers while edits are applied to them; each method gives how many labels it is about."""

    def __init__(self, labels: Labels, present: np.ndarray, markers: int):
        self.labels, self.present, self.markers = labels, present, markers
        shape = (len(present), markers)
        self.own = np.full(shape, NO_MARKER, np.int32)
        row, column = np.nonzero(labels.marker != NO_MARKER)
        self.own[row, labels.marker[row, column]] = column
        self.claim = np.full(shape, ANYBODY, np.int32)
        self.right = np.zeros(shape, bool)
        self.rule = np.full(present.shape, FREE, np.int32)
        self.refused = np.full(present.shape, NO_MARKER, np.int32)
        self.places: dict[tuple[int, int], np.ndarray] = {}
        self.swaps: list[tuple[slice, int, int]] = []
        self._touched: set[int] = set()

    def assign(self, rows: slice, column: int, marker: int) -> int:
        """The column is the marker wherever it is there."""
        at = self._there(rows, column)
        return self.assign_cells(at, np.full(len(at), column), marker)

    def assign_cells(self, at: np.ndarray, column: np.ndarray, marker: int) -> int:
        """In some rows (K,), each once, a column (K,) is the marker."""
        self._let_go(at, column)
        self._take_away(at, marker)
        self._claim(at, column, marker)
        return len(at)

    def unlabel_marker(self, rows: slice, marker: int) -> int:
        """Nothing is the marker."""
        at = np.arange(*rows.indices(len(self.claim)))
        holder = self._holder(at, marker)
        held = holder >= 0
        self.refused[at[held], holder[held]] = marker
        gone = self._take_away(at, marker)
        self.claim[at, marker] = NOBODY
        return int(held.sum()) + gone

    def unlabel_column(self, rows: slice, column: int) -> int:
        """The column has no name, and is not the marker that it was taken for."""
        at = self._there(rows, column)
        return self.unlabel_cells(at, np.full(len(at), column))

    def unlabel_cells(self, at: np.ndarray, column: np.ndarray) -> int:
        """In some rows (K,), each once, a column (K,) has no name, and is not the marker that it was taken for."""
        named = self._name(at, column)
        self._let_go(at, column)
        self.rule[at, column] = self.markers + 1
        self.refused[at, column] = np.where(named != NO_MARKER, named, self.refused[at, column])
        return int((named != NO_MARKER).sum())

    def delete(self, rows: slice, column: int) -> int:
        """The column is no marker."""
        at = self._there(rows, column)
        return self.delete_cells(at, np.full(len(at), column))

    def delete_cells(self, at: np.ndarray, column: np.ndarray) -> int:
        """In some rows (K,), each once, a column (K,) is no marker."""
        self._let_go(at, column)
        self.rule[at, column] = self.markers
        return len(at)

    def swap(self, rows: slice, one: int, other: int) -> int:
        """What is named either of two markers has the other's name."""
        at = np.arange(*rows.indices(len(self.claim)))
        holders = [self._holder(at, marker) for marker in (one, other)]
        places = {
            (row, m): self.places.pop((row, m)) for row, m in list(self.places) if m in (one, other) and row in at
        }
        pair = [one, other]
        self.own[rows, pair] = self.own[rows, pair[::-1]]
        self.claim[rows, pair] = self.claim[rows, pair[::-1]]
        self.right[rows, pair] = False
        for holder, marker in zip(holders, pair[::-1], strict=True):
            held = holder >= 0
            self._claim(at[held], holder[held], marker)
        for (row, marker), xyz in places.items():
            self.places[row, one + other - marker] = xyz
        self.swaps.append((rows, one, other))
        self._touched |= {one, other}
        return int(sum((holder >= 0).sum() for holder in holders)) + len(places)

    def place(self, row: int, marker: int, xyz: np.ndarray) -> int:
        """The marker is at a place, so no column is it."""
        at = np.array([row])
        self._take_away(at, marker)
        self.claim[row, marker] = NOBODY
        self.right[row, marker] = False
        self.places[row, marker] = xyz
        return 1

    def lock(self, rows: slice, marker: int) -> int:
        """What is the marker, or that nothing is, was looked at."""
        at = np.arange(*rows.indices(len(self.claim)))
        holder = self._holder(at, marker)
        held = holder >= 0
        self._claim(at[held], holder[held], marker)
        self.claim[at[~held], marker] = NOBODY
        self.right[at, marker] = True
        return len(at)

    def seen(self, at: np.ndarray, marker: int) -> int:
        """In how many of some rows (K,) a column is the marker."""
        return int((self._holder(at, marker) >= 0).sum())

    def done(self) -> Edited:
        """The labels as they are now."""
        labels, rules = self.labels, (np.flatnonzero((self.rule != FREE).any(axis=0)))
        marker, step, sure = (getattr(labels, name).copy() for name in ("marker", "step", "confidence"))
        for name in self._touched:  # the names below, where markers were exchanged
            at = np.flatnonzero(self.own[:, name] != NO_MARKER)
            marker[at, self.own[at, name]] = name
        for name in np.flatnonzero((self.claim != ANYBODY).any(axis=0)).tolist():
            at = np.flatnonzero((self.claim[:, name] != ANYBODY) & (self.own[:, name] != NO_MARKER))
            at = at[self.rule[at, self.own[at, name]] == FREE]
            self.refused[at, self.own[at, name]] = name  # whose it was: another is, or nothing
            for values, nothing in ((marker, NO_MARKER), (step, NO_STEP), (sure, 0.0)):
                values[at, self.own[at, name]] = nothing
        own = self.rule[:, rules]
        given = own < self.markers
        marker[:, rules] = np.where(own == FREE, marker[:, rules], np.where(given, own, NO_MARKER))
        step[:, rules] = np.where(own == FREE, step[:, rules], np.where(given, BY_EDIT, NO_STEP))
        sure[:, rules] = np.where(own == FREE, sure[:, rules], np.where(given, 1.0, 0.0))
        places = np.array(list(self.places), int).reshape(-1, 2)
        xyz = np.array(list(self.places.values()), float).reshape(-1, 3)
        return Edited(
            Labels(marker, step, sure),
            self.rule,
            self.refused,
            self.claim,
            self.right,
            places,
            xyz,
            tuple(self.swaps),
        )

    def _there(self, rows: slice, column: int) -> np.ndarray:
        """The rows in which a column is there."""
        return np.flatnonzero(self.present[rows, column]) + rows.indices(len(self.present))[0]

    def _holder(self, at: np.ndarray, marker: int) -> np.ndarray:
        """(K,) the column that is a marker in some rows, below 0 where none is."""
        own, claim = self.own[at, marker], self.claim[at, marker]
        mine = np.where((own >= 0) & (self.rule[at, own] == FREE), own, NO_MARKER)
        return np.where(claim == ANYBODY, mine, claim)

    def _name(self, at: np.ndarray, column: np.ndarray) -> np.ndarray:
        """(K,) what columns (K,) are called in some rows (K,)."""
        found = np.full(len(at), NO_MARKER)
        rule = self.rule[at, column]
        given = (rule >= 0) & (rule < self.markers)
        found[given] = rule[given]
        row, marker = np.nonzero((self.own[at] == column[:, None]) & (self.claim[at] == ANYBODY))
        free = rule[row] == FREE
        found[row[free]] = marker[free]
        return found

    def _claim(self, at: np.ndarray, column: np.ndarray, marker: int):
        self.rule[at, column] = marker
        self.refused[at, column] = NO_MARKER
        self.claim[at, marker] = column

    def _let_go(self, at: np.ndarray, column: np.ndarray):
        """What an edit gave columns (K,) they give up; whoever the program named so is that marker again."""
        rule = self.rule[at, column]
        given = (rule >= 0) & (rule < self.markers)
        self.claim[at[given], rule[given]] = ANYBODY
        self.right[at[given], rule[given]] = False

    def _take_away(self, at: np.ndarray, marker: int) -> int:
        """Whoever has a marker by an edit loses it; what a person named otherwise before has no name then.

        How many of them were places.
        """
        holder = self.claim[at, marker]
        held = holder >= 0
        row, column = at[held], holder[held]
        programs = self.own[row, marker] == column
        self.rule[row, column] = np.where(programs, FREE, self.markers + 1)
        self.right[at, marker] = False
        gone = [row for row in at.tolist() if (row, marker) in self.places] if self.places else []
        for row in gone:
            del self.places[row, marker]
        return len(gone)


def _exchanged(marker: np.ndarray, one: int, other: int) -> np.ndarray:
    return np.where(marker == one, other, np.where(marker == other, one, marker))
