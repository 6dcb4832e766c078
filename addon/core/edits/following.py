# SPDX-License-Identifier: GPL-3.0-or-later
"""The labels of a take while a person corrects them: one more edit costs what it is about and no more.

`applying` works all edits out at once. Here the same `Replay` goes on from edit to edit; where edits are taken away it
begins again.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..data.made import Copies
from ..data.takes import BY_EDIT, NO_MARKER, NO_STEP, EditOutcome, Labels
from .applying import Cells, apply_edit
from .kinds import Edit, Edits


@dataclass(frozen=True, eq=False)
class Held:
    """Which point or blob of a take is each of M markers in each of T rows, frames or images."""

    cells: np.ndarray  # (M, T), NO_MARKER where none is, and
    program: np.ndarray  # (M, T) as the program named them
    by_edit: np.ndarray  # (M, T) True where a person said that it is
    places: Mapping[tuple[int, int], np.ndarray]  # the markers that a person placed, by frame index and marker, (3,) m
    images: int  # rows of a frame


def changed_frames(before: Held | None, after: Held | None, by_hand: bool = True) -> dict[int, slice]:
    """The markers that are elsewhere, or, with `by_hand`, of which something else is said, by their index.

    With the frames, by index, from the first to the last in which they are. None is a take that was not edited.
    """
    one, other = (after, before) if after is not None else (before, after)
    if one is None:
        return {}
    differs = one.cells != (one.program if other is None else other.cells)
    if by_hand:
        differs |= one.by_edit if other is None else one.by_edit != other.by_edit
    differs = differs.reshape(len(differs), differs.shape[1] // one.images, one.images).any(axis=2)
    places = {} if other is None else other.places
    for key in one.places.keys() | places.keys():
        if key not in one.places or key not in places or not np.array_equal(one.places[key], places[key]):
            differs[key[::-1]] = True
    last = differs.shape[1]
    return {
        marker: slice(int(differs[marker].argmax()), last - int(differs[marker, ::-1].argmax()))
        for marker in np.flatnonzero(differs.any(axis=1)).tolist()
    }


@dataclass(frozen=True, eq=False)
class FollowedEdits:
    """A take as its edits have it: labels (N,), which point or blob is each marker, and what became of each edit."""

    labels: Labels
    held: Held
    outcomes: tuple[EditOutcome, ...]


class Following:
    """A take with the labels (N,) that the program gave, ready to be edited again and again."""

    def __init__(self, labels: Labels, cells: Cells):
        # Narrow columns, as each edit makes new ones of the whole take.
        self._program = Labels(labels.marker.astype(np.int32), labels.step.astype(np.int8), labels.confidence)
        self._cells = cells
        self._begin()

    def apply(self, edits: Edits) -> FollowedEdits:
        """The take with the edits applied in their order; those that the last call began with are applied already."""
        begun = len(self._done) <= len(edits)
        if not begun or any(one != other for one, (other, _) in zip(edits, self._done, strict=False)):
            self._begin()
        for edit in edits.items[len(self._done) :]:
            self._done.append((edit, apply_edit(self._replay, edit, self._cells)))
        self._look_again()
        *columns, cells, by_edit = self._copies.copy()
        held = Held(cells, self._own, by_edit, dict(self._replay.places), self._cells.images)
        return FollowedEdits(Labels(*columns), held, tuple(outcome for _, outcome in self._done))

    def _begin(self):
        """Makes everything as it is without edits."""
        self._replay = self._cells.replay(self._program)
        self._own = self._replay.own.copy()
        columns = [getattr(self._program, name).copy() for name in ("marker", "step", "confidence")]
        self._copies = Copies(*columns, self._own.copy(), np.zeros(self._own.shape, bool))
        self._done: list[tuple[Edit, EditOutcome]] = []

    def _look_again(self):
        """Makes labels and what is held follow from what the replay touched."""
        names, steps, sure, cells, by_edit = self._copies.arrays
        for marker, rows in self._replay.touched.items():
            own, was = cells[marker, rows].copy(), by_edit[marker, rows].copy()
            now = np.maximum(self._replay.holder(rows, marker), NO_MARKER)
            by_hand = self._replay.claim[marker, rows] >= 0
            cells[marker, rows], by_edit[marker, rows] = now, by_hand
            lost = own[(own != now) & (own >= 0)]
            # Another marker may have it by now.
            lost = lost[names[lost] == marker]
            fresh = np.flatnonzero((now >= 0) & ((own != now) | (was != by_hand)))
            fresh, by_hand = now[fresh], by_hand[fresh]
            names[lost], steps[lost], sure[lost] = NO_MARKER, NO_STEP, 0.0
            names[fresh] = marker
            steps[fresh] = np.where(by_hand, BY_EDIT, self._program.step[fresh])
            sure[fresh] = np.where(by_hand, 1.0, self._program.confidence[fresh])
            for which, index in ((0, lost), (0, fresh), (1, lost), (1, fresh), (2, lost), (2, fresh)):
                self._copies.note(which, index)
            self._copies.note(3, (marker, rows))
            self._copies.note(4, (marker, rows))
        self._replay.touched = {}
