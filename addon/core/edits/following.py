# SPDX-License-Identifier: GPL-3.0-or-later
"""The labels of a take of points while a person corrects them: one more edit costs what it is about and no more.

`applying` works all edits out at once on a table of frames and trajectories. Here the take's own rows are the cells of
the same `Replay`, which goes on from edit to edit, and back where edits are taken away; what comes of it is the same.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass

import numpy as np

from ..data.copies import Copies
from ..data.takes import BY_EDIT, NO_MARKER, NO_POINT, NO_STEP, EditOutcome, Labels, PointRows
from .applying import apply_edit
from .kinds import BlobEdit, Edit, Edits, PointEdit
from .replay import Change, Replay


@dataclass(frozen=True)
class FollowingOptions:
    """What is kept to go back.

    most_kept  memory: former values, in all edits together, for taking the last ones back: 120 MB, of some 35 edits of
               the whole of 20,000 frames. Where edits farther back are taken away, all are applied again
    """

    most_kept: int = 10_000_000


FOLLOWING = FollowingOptions()


@dataclass(frozen=True, eq=False)
class Held:
    """Which row of a take is each of M markers in each of F frames.

    rows     (M, F), NO_POINT where none is, and
    program  (M, F) as the program named them
    by_edit  (M, F) True where a person said that it is
    places   the markers that a person placed, by frame index and marker, (3,) m; no row is these
    """

    rows: np.ndarray
    program: np.ndarray
    by_edit: np.ndarray
    places: Mapping[tuple[int, int], np.ndarray]

    def differs(self, other: "Held | None") -> np.ndarray:
        """(M, F) True where a marker is another row, or at another place; None for a take that was not edited."""
        found = self.rows != (self.program if other is None else other.rows)
        places = {} if other is None else other.places
        for key in self.places.keys() | places.keys():
            if key not in self.places or key not in places or not np.array_equal(self.places[key], places[key]):
                found[key[::-1]] = True
        return found


def moved_frames(before: Held | None, after: Held | None) -> dict[int, slice]:
    """The markers that are elsewhere, with the frames, by their index, from the first to the last in which they are."""
    one, other = (after, before) if after is not None else (before, after)
    return {} if one is None else _spans(one.differs(other))


def changed_frames(before: Held | None, after: Held | None) -> dict[int, slice]:
    """The same of markers that are elsewhere, or of which something else is said."""
    one, other = (after, before) if after is not None else (before, after)
    if one is None:
        return {}
    return _spans(one.differs(other) | (one.by_edit if other is None else one.by_edit != other.by_edit))


def _spans(differs: np.ndarray) -> dict[int, slice]:
    """From the first to the last of the frames that are flagged (M, F), of each marker that has some."""
    last = differs.shape[1]
    return {
        marker: slice(int(differs[marker].argmax()), last - int(differs[marker, ::-1].argmax()))
        for marker in np.flatnonzero(differs.any(axis=1)).tolist()
    }


@dataclass(frozen=True, eq=False)
class FollowedEdits:
    """A take of N points in F frames as its edits have it.

    labels    of the points (N,)
    held      which of them is each marker
    outcomes  of each edit
    """

    labels: Labels
    held: Held
    outcomes: tuple[EditOutcome, ...]


class Following:
    """A take of points with the labels that the program gave, ready to be edited again and again."""

    def __init__(self, rows: PointRows, labels: Labels, names: Mapping[str, int], count: int):
        """Names are the indices of the `count` markers, aliases too."""
        # Narrow columns, as each edit makes new ones of the whole take.
        self._program = Labels(labels.marker.astype(np.int32), labels.step.astype(np.int8), labels.confidence)
        self.rows, self.names = rows, names
        named = np.flatnonzero(labels.named)
        self._own = np.full((count, len(rows.frames)), NO_POINT, np.int32)
        self._own[labels.marker[named], rows.frame[named]] = named
        self._trajectories: dict[int, np.ndarray] = {}
        self._begin()

    def rows_of(self, point: int) -> np.ndarray:
        """(K,) the rows of a trajectory, in the order of the frames."""
        if point not in self._trajectories:
            self._trajectories[point] = np.flatnonzero(self.rows.trajectory == point)
        return self._trajectories[point]

    def apply(self, edits: Edits) -> FollowedEdits:
        """The take with the edits applied in their order; those that the last call began with are applied already."""
        same = 0
        for one, (other, *_) in zip(edits, self._done, strict=False):
            if one is not other and one != other:
                break
            same += 1
        self._go_back(same)
        for edit in edits.items[same:]:
            self._go_on(edit)
        *columns, rows, by_edit = self._copies.copy()
        held = Held(rows, self._own, by_edit, dict(self._replay.places))
        outcomes = tuple(outcome for _, outcome, _ in self._done)
        return FollowedEdits(Labels(*columns), held, outcomes)

    def _begin(self) -> None:
        """Makes everything as it is without edits."""
        program = self._program
        self._replay = Replay(program.marker.copy(), self._own.copy())
        columns = [getattr(program, name).copy() for name in ("marker", "step", "confidence")]
        self._copies = Copies(*columns, self._own.copy(), np.zeros(self._own.shape, bool))
        self._done: list[tuple[Edit, EditOutcome, list[Change] | None]] = []
        self._kept = 0

    def _go_on(self, edit: Edit):
        """Applies one more edit."""
        changes: list[Change] = []
        self._replay.changes = changes
        outcome = apply_edit(self._replay, edit, self)
        self._done.append((edit, outcome, changes))
        self._kept += _size(changes)
        for index, (one, said, oldest) in enumerate(self._done):
            if self._kept <= FOLLOWING.most_kept:
                break
            self._kept -= _size(oldest)
            self._done[index] = one, said, None
        self._look_again(changes)

    def _go_back(self, count: int):
        """Takes the last edits back, to so many."""
        if any(changes is None for *_, changes in self._done[count:]):
            edits = [edit for edit, *_ in self._done[:count]]
            self._begin()
            for edit in edits:
                self._go_on(edit)
        while len(self._done) > count:
            *_, changes = self._done.pop()
            self._kept -= _size(changes)
            self._replay.take_back(changes or ())
            self._look_again(changes or ())

    @property
    def first_frame(self) -> int:
        """The source's number of the first frame."""
        return int(self.rows.frames[0]) if len(self.rows.frames) else 0

    @property
    def frame_count(self) -> int:
        """How many frames there are."""
        return len(self.rows.frames)

    def meant_by(self, edit: PointEdit | BlobEdit, frames: slice) -> tuple[np.ndarray, np.ndarray, str]:
        """(K,) the frames of some in which a trajectory has a point, and (K,) its rows in them."""
        own = self.rows_of(edit.point) if isinstance(edit, PointEdit) else np.zeros(0, int)
        own = own[slice(*np.searchsorted(self.rows.frame[own], [frames.start, frames.stop]).tolist())]
        return self.rows.frame[own], own, ""

    def _look_again(self, changes: Iterable[Change]):
        """Makes labels and what is held follow from some changes of the replay."""
        names, steps, sure, rows, by_edit = self._copies.arrays
        for marker, frames in self._about(changes).items():
            own, was = rows[marker, frames].copy(), by_edit[marker, frames].copy()
            now = np.maximum(self._replay.holder(frames, marker), NO_POINT)
            said = self._replay.claim[marker, frames] >= 0
            rows[marker, frames], by_edit[marker, frames] = now, said
            lost = own[(own != now) & (own >= 0)]
            # Another marker may have it by now.
            lost = lost[names[lost] == marker]
            fresh = np.flatnonzero((now >= 0) & ((own != now) | (was != said)))
            fresh, said = now[fresh], said[fresh]
            names[lost], steps[lost], sure[lost] = NO_MARKER, NO_STEP, 0.0
            names[fresh] = marker
            steps[fresh] = np.where(said, BY_EDIT, self._program.step[fresh])
            sure[fresh] = np.where(said, 1.0, self._program.confidence[fresh])
            for which, index in ((0, lost), (0, fresh), (1, lost), (1, fresh), (2, lost), (2, fresh)):
                self._copies.note(which, index)
            self._copies.note(3, (marker, frames))
            self._copies.note(4, (marker, frames))

    def _about(self, changes: Iterable[Change]) -> dict[int, slice]:
        """The markers whose rows may be others after some changes of the replay, and the frames in which they may."""
        about: dict[int, slice] = {}

        def meet(markers: Iterable[int], first: int, last: int):
            for marker in markers:
                own = about.get(marker, slice(first, last + 1))
                about[marker] = slice(min(own.start, first), max(own.stop, last + 1))

        for name, index, _ in changes:
            if name in ("own", "claim"):
                frames = (
                    np.arange(*index[1].indices(len(self.rows.frames))) if isinstance(index[1], slice) else index[1]
                )
                frames = np.atleast_1d(frames)
                if len(frames):
                    meet(np.unique(index[0]).tolist(), int(frames.min()), int(frames.max()))
            elif name == "rule" and len(index):
                names = np.bincount(self._replay.below[index] + 1)[1:]
                frames = self.rows.frame[index]
                meet(np.flatnonzero(names).tolist(), int(frames.min()), int(frames.max()))
        return about


def _size(changes: Iterable[Change] | None) -> int:
    """How many former values there are."""
    return sum(np.size(before) for _, _, before in changes or ())
