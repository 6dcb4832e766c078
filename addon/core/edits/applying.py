# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits applied to the labels of points or of blobs: pure functions, fast enough to be called at every click.

An editor keeps the labels that the program gave and an `Edits`, and shows `apply_to_points` of the two; nothing that is
given is changed. When the take was labelled again, it keeps `LabelledChunk.unedited`, of which the same edits give the
new labels.
"""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from typing import Protocol

import numpy as np

from ..data.errors import InputError
from ..data.lanes import Lanes
from ..data.markersets import Worn
from ..data.takes import Blobs, EditOutcome, Labels, Points
from ..data.wording import listed
from .kinds import EDIT_KINDS, BlobEdit, Edit, Edits, Place, PointEdit, Swap
from .replay import Edited, Replay


@dataclass(frozen=True)
class BlobEditOptions:
    """How a blob is found again.

    max_distance_px  from where an edit says that it is: format, the contract's
    """

    max_distance_px: float = 2.0


BLOB_EDITING = BlobEditOptions()
NOT_AMONG = "not among what is labelled"


class Cells(Protocol):
    """What edits of a take go by: the index of each marker by its name, aliases too, and what is seen."""

    @property
    def names(self) -> Mapping[str, int]:
        """The index of each marker by its name."""

    @property
    def first_frame(self) -> int:
        """The source's number of the first frame."""

    @property
    def frame_count(self) -> int:
        """How many frames there are."""

    def meant_by(self, edit: PointEdit | BlobEdit, frames: slice) -> tuple[np.ndarray, np.ndarray, str]:
        """(K,) the rows of some frames in which a target is, (K,) its cells in a `Replay`; and why there are none."""


@dataclass(frozen=True, eq=False)
class PointCells:
    """What edits of a take of points go by.

    names        index of each marker by its name, aliases too
    count        how many markers
    first_frame  the source's number of the first of T frames
    present      (T, L) True where there is a point
    columns      (P,) the index of each trajectory in its file
    lanes        which trajectory stands where; None where each has a lane of its own, in their order
    """

    names: Mapping[str, int]
    count: int
    first_frame: int
    present: np.ndarray
    columns: np.ndarray
    lanes: Lanes | None = None

    @classmethod
    def of(cls, take: Points, markerset: Worn) -> "PointCells":
        """Those of a take."""
        columns = np.arange(len(take.standing)) if take.columns is None else take.columns
        return cls(markerset.by_name, len(markerset), take.first_frame, take.present, columns, take.lanes)

    @property
    def frame_count(self) -> int:
        """How many frames there are."""
        return len(self.present)

    def meant_by(self, edit: PointEdit | BlobEdit, frames: slice) -> tuple[np.ndarray, np.ndarray, str]:
        """(K,) the frames of some in which a trajectory has a point, and (K,) its cells in them."""
        place = int(np.flatnonzero(self.columns == edit.point)[0]) if isinstance(edit, PointEdit) else -1
        start, stop, lane = frames.start, frames.stop, place
        if self.lanes is not None:
            start = min(max(start, int(self.lanes.first[place])), stop)
            stop = max(min(stop, int(self.lanes.last[place]) + 1), start)
            lane = int(self.lanes.lane[place])
        at = start + np.flatnonzero(self.present[start:stop, lane])
        return at, at * self.present.shape[1] + lane, ""


@dataclass(frozen=True, eq=False)
class BlobCells:
    """What edits of a chunk of blobs go by: a table of them, a row for every image, R, camera after camera in a frame.

    names    index of each marker by its name, aliases too
    count    how many markers
    cameras  the cameras' names
    image    (N,) the row of each blob, and
    slot     (N,) its column
    present  (R, K) True where there is a blob
    """

    names: Mapping[str, int]
    count: int
    cameras: tuple[str, ...]
    blobs: Blobs
    image: np.ndarray
    slot: np.ndarray
    present: np.ndarray

    @classmethod
    def of(cls, blobs: Blobs, cameras: tuple[str, ...], markerset: Worn) -> "BlobCells":
        """Those of a chunk."""
        return cls.named(blobs, cameras, markerset.by_name, len(markerset))

    @classmethod
    def named(cls, blobs: Blobs, cameras: tuple[str, ...], names: Mapping[str, int], count: int) -> "BlobCells":
        """Those of a chunk, by the indices of the `count` markers by their names."""
        image = blobs.frame * len(cameras) + blobs.camera
        counts = np.bincount(image, minlength=len(blobs.frames) * len(cameras))
        order = np.argsort(image, kind="stable")
        slot = np.empty(len(blobs), int)
        slot[order] = np.arange(len(blobs)) - np.repeat(np.cumsum(counts) - counts, counts)
        present = np.arange(max(int(counts.max(initial=0)), 1)) < counts[:, None]
        return cls(names, count, cameras, blobs, image, slot, present)

    @property
    def first_frame(self) -> int:
        """The source's number of the first frame."""
        return int(self.blobs.frames[0])

    @property
    def frame_count(self) -> int:
        """How many frames there are."""
        return len(self.blobs.frames)

    @property
    def cell(self) -> np.ndarray:
        """(N,) the cell of each blob in a `Replay` of the table."""
        return self.image * self.present.shape[1] + self.slot

    def table(self, labels: Labels) -> Labels:
        """The labels (N,) of the blobs, (R, K)."""
        return labels.spread((self.image, self.slot), *self.present.shape)

    def rows(self, table: Labels) -> Labels:
        """The labels (R, K) of the blobs, (N,)."""
        return table[self.image, self.slot]

    def meant_by(self, edit: PointEdit | BlobEdit, frames: slice) -> tuple[np.ndarray, np.ndarray, str]:
        """(K,) the images of some frames in which an edit's blob or its track is, (K,) its cells; why there is none."""
        found, why = self.blobs_of(edit, frames) if isinstance(edit, BlobEdit) else (np.zeros(0, int), "")
        return self.image[found], self.cell[found], why

    def blobs_of(self, edit: BlobEdit, frames: slice) -> tuple[np.ndarray, str]:
        """(K,) the blobs that an edit is of in some frames, one of a frame; and why, where there is none."""
        own = np.array([[edit.frame, edit.x, edit.y]], dtype=float)
        meant = own if edit.trail is None else np.concatenate([edit.trail, own])
        index = meant[:, 0].astype(int) - self.first_frame
        inside = (index >= frames.start) & (index < frames.stop)
        where = np.full((self.frame_count, 2), np.nan)
        where[index[inside]] = meant[inside, 1:]
        blobs = self.blobs
        of_camera = blobs.camera == self.cameras.index(edit.camera)
        there = np.flatnonzero(of_camera & np.isfinite(where[blobs.frame, 0]))
        off = np.hypot(*(blobs.xy[there] - where[blobs.frame[there]]).T)
        order = np.lexsort((off, blobs.frame[there]))
        there, off = there[order], off[order]
        nearest = np.diff(blobs.frame[there], prepend=-1) != 0
        there, off = there[nearest], off[nearest]
        near = off <= BLOB_EDITING.max_distance_px
        if near.any() or not inside.any():
            return there[near], ""
        words = f"{edit.camera} has no blob within {BLOB_EDITING.max_distance_px:g} px of {edit.x:g}, {edit.y:g}"
        words += f" in frame {edit.frame}"
        return there[near], f"{words}, the nearest is {off.min():.3g} px off" if len(off) else words


@dataclass(frozen=True, eq=False)
class AppliedEdits:
    """Labels as the edits have them.

    labels    of the points (T, P), or of the blobs (N,)
    edited    what the edits say, for whoever labels again: of points, or of blobs a row for every image of a frame
    outcomes  of each edit
    places    markers by frame index and marker, and where they were placed (3,) m
    """

    labels: Labels
    edited: Edited
    outcomes: tuple[EditOutcome, ...]
    places: Mapping[tuple[int, int], np.ndarray]


def refuse_unknown(
    edits: Edits,
    names: Mapping[str, int],
    frames: tuple[int, int] | None = None,
    points: Iterable[int] | None = None,
    cameras: Iterable[str] | None = None,
):
    """Raises InputError with the number of an edit whose words are not of this take.

    names are those of its markers; frames the first and last of the take; points the trajectories of a take of points;
    cameras the cameras of a take of blobs. What is None is not looked at.
    """
    trajectories = None if points is None else set(points)
    views = None if cameras is None else set(cameras)
    for number, edit in enumerate(edits, 1):
        for name in edit.names:
            if name not in names:
                words = f"edit {number} names {name!r}"
                raise InputError(f"{words}; expected a marker of the model, such as {listed(names)}")
        if isinstance(edit, Swap) and len({names[name] for name in edit.names}) == 1:
            raise InputError(f"edit {number} swaps a marker with itself; expected two markers")
        if trajectories is not None:
            _refuse_point(edit, number, trajectories)
        if views is not None:
            _refuse_camera(edit, number, views)
        for frame in edit.span or ():
            if frames is not None and not frames[0] <= frame <= frames[1]:
                words = f"edit {number} is about frame {frame}"
                raise InputError(f"{words}; expected frames of the take, {frames[0]} to {frames[1]}")


def _refuse_point(edit: Edit, number: int, points: set[int]):
    if isinstance(edit, BlobEdit):
        raise InputError(f"edit {number} is of a blob in a take of points; expected one with a point")
    if isinstance(edit, PointEdit) and edit.point not in points:
        words = f"edit {number} is of trajectory {edit.point}, which the take does not have"
        raise InputError(f"{words}; expected one of its {len(points)}, up to {max(points, default=0)}")


def _refuse_camera(edit: Edit, number: int, cameras: set[str]):
    if isinstance(edit, PointEdit):
        raise InputError(f"edit {number} is of a point in a take of blobs; expected one with camera, frame, x and y")
    if isinstance(edit, BlobEdit) and edit.camera not in cameras:
        raise InputError(f"edit {number} is of the camera {edit.camera!r}; expected one of {listed(sorted(cameras))}")


def apply_to_points(labels: Labels, edits: Edits, cells: PointCells) -> AppliedEdits:
    """The labels (T, P) with the edits applied in their order, of a take that `refuse_unknown` lets pass."""
    return _applied(labels, edits, cells, Replay.of_table(labels, cells.count))


def apply_to_blobs(labels: Labels, edits: Edits, cells: BlobCells) -> AppliedEdits:
    """The labels (N,) of a chunk's blobs with the edits applied in their order, those of other frames passed over.

    Take what became of the edits of all chunks together with `joined`.
    """
    table = cells.table(labels)
    applied = _applied(table, edits, cells, Replay.of_table(table, cells.count, len(cells.cameras)))
    return replace(applied, labels=cells.rows(applied.labels))


def _applied(labels: Labels, edits: Edits, cells: Cells, replay: Replay) -> AppliedEdits:
    outcomes = tuple([apply_edit(replay, edit, cells) for edit in edits])
    edited = replay.done(labels)
    return AppliedEdits(edited.labels, edited, outcomes, dict(replay.places))


def apply_edit(replay: Replay, edit: Edit, cells: Cells) -> EditOutcome:
    """Applies an edit to a take; what became of it."""
    first, last = edit.span or (cells.first_frame, cells.first_frame + cells.frame_count - 1)
    frames = slice(max(first - cells.first_frame, 0), min(last - cells.first_frame + 1, cells.frame_count))
    if frames.start >= frames.stop:
        return found_outside(edit)
    rows, why = slice(frames.start * replay.images, frames.stop * replay.images), ""
    marker, change = [cells.names[name] for name in edit.names], edit.verb.change
    if isinstance(edit, PointEdit | BlobEdit):
        at, cell, why = cells.meant_by(edit, frames)
        count = change(replay, at, cell, *marker)
    elif isinstance(edit, Place):
        count = change(replay, rows, *marker, edit.xyz)
    else:
        count = change(replay, rows, *marker)
    return EditOutcome(edit.verb.kind, count, "" if count else why or f"{_missing(edit)} in {_when(edit)}")


def found_outside(edit: Edit) -> EditOutcome:
    """What became of an edit that is of no frame of the take."""
    first, last = edit.span or (None, None)
    return EditOutcome(edit.verb.kind, 0, f"{_when(edit)} {'is' if first == last else 'are'} {NOT_AMONG}")


def _missing(edit: Edit) -> str:
    return edit.verb.missing.format(target=edit.target)


def _when(edit: Edit) -> str:
    """The frames that an edit is about, in a sentence about what it did not find."""
    first, last = edit.span or (None, None)
    return "the take" if first is None else f"frame {first}" if first == last else f"frames {first} to {last}"


def joined(chunks: Iterable[tuple[EditOutcome, ...]]) -> tuple[EditOutcome, ...]:
    """What became of edits over the chunks of a take: the labels of all, and of an edit that found none why."""
    found: tuple[EditOutcome, ...] = ()
    for outcomes in chunks:
        found = tuple(map(both, found, outcomes)) if found else outcomes
    return found


def both(one: EditOutcome, two: EditOutcome) -> EditOutcome:
    """What became of an edit in two parts of a take."""
    count = one.labels + two.labels
    if count:
        return EditOutcome(one.kind, count)
    return one if NOT_AMONG in two.reason else two


def summary_of(outcomes: Iterable[EditOutcome]) -> dict:
    """What a report says of edits: how many of each kind found something, and of each of the others why it did not."""
    outcomes = tuple(outcomes)
    kinds = dict.fromkeys(kind.verb.kind for kind in EDIT_KINDS)
    there = {one.kind for one in outcomes}
    done = {kind: sum(one.kind == kind and one.labels > 0 for one in outcomes) for kind in kinds if kind in there}
    missed = [
        {"edit": number, "kind": one.kind, "reason": one.reason}
        for number, one in enumerate(outcomes, 1)
        if not one.labels
    ]
    return {"applied": done, "found_nothing": missed}
