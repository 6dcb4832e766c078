# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits applied to the labels of points or of blobs: nothing that is given is changed.

An editor keeps the labels that the program gave and an `Edits`, and shows `apply_edits` of the two. When the take was
labelled again, it keeps `LabelledChunk.unedited`, of which the same edits give the new labels.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..data.errors import InputError
from ..data.takes import Blobs, EditOutcome, Labels, PointRows, Points
from ..data.wording import listed, words_of_frames
from .kinds import BLOB_RADIUS_PX, EDIT_KINDS, BlobEdit, Edit, Edits, Place, PointEdit, Swap
from .replay import Edited, Replay

NOT_AMONG = "not among what is labelled"


@dataclass(frozen=True, eq=False)
class Cells:
    """What edits of a take go by: N cells, each a point or a blob, in rows that are frames or images."""

    names: Mapping[str, int]  # index of each marker by its name, aliases too
    count: int  # how many markers
    first_frame: int  # the source's number of the first frame
    frame_count: int  # how many frames there are
    row: np.ndarray  # the row of each cell, in the shape of the labels
    images: int  # rows of a frame: 1, or the cameras one after the other
    # gives of some frames, from start to stop, the cells (K,) that an edit's target is there, each of another row,
    # and why there are none
    meant_by: Callable[[Any, slice], tuple[np.ndarray, str]]

    def replay(self, labels: Labels) -> Replay:
        """The cells with their labels, to be edited."""
        return Replay(labels.marker, self.row, (self.count, self.frame_count * self.images), self.images)


def cells_of_take(take: Points, names: Mapping[str, int], count: int) -> Cells:
    """Those of a take whose labels are a table (T, L): a row a frame, and of each trajectory one place or a part."""
    present, width = take.present, take.present.shape[1]
    columns = np.arange(len(take.standing)) if take.columns is None else take.columns

    def meant_by(edit: PointEdit, frames: slice) -> tuple[np.ndarray, str]:
        place = lane = int(np.flatnonzero(columns == edit.point)[0])
        start, stop = frames.start, frames.stop
        if take.lanes is not None:
            start = min(max(start, int(take.lanes.first[place])), stop)
            stop = max(min(stop, int(take.lanes.last[place]) + 1), start)
            lane = int(take.lanes.lane[place])
        return (start + np.flatnonzero(present[start:stop, lane])) * width + lane, ""

    row = np.broadcast_to(np.arange(len(present), dtype=np.int32)[:, None], present.shape)
    return Cells(names, count, take.first_frame, len(present), row, 1, meant_by)


def cells_of_points(rows: PointRows, names: Mapping[str, int], count: int) -> Cells:
    """Those of points one after the other."""

    def meant_by(edit: PointEdit, frames: slice) -> tuple[np.ndarray, str]:
        own = np.flatnonzero(rows.trajectory == edit.point)
        return own[slice(*np.searchsorted(rows.frame[own], [frames.start, frames.stop]).tolist())], ""

    return Cells(names, count, int(rows.frames[:1].sum()), len(rows.frames), rows.frame, 1, meant_by)


def cells_of_blobs(blobs: Blobs, cameras: tuple[str, ...], names: Mapping[str, int], count: int) -> Cells:
    """Those of blobs: a row for every image, camera after camera in a frame."""
    first = int(blobs.frames[:1].sum())

    def meant_by(edit: BlobEdit, frames: slice) -> tuple[np.ndarray, str]:
        own = np.array([[edit.frame, edit.x, edit.y]], dtype=float)
        meant = own if edit.trail is None else np.concatenate([edit.trail, own])
        index = meant[:, 0].astype(int) - first
        inside = (index >= frames.start) & (index < frames.stop)
        index, meant = index[inside], meant[inside, 1:]
        if not len(index):
            return np.zeros(0, int), ""
        begin, end = int(index.min()), int(index.max()) + 1
        where = np.full((end - begin, 2), np.nan)
        where[index - begin] = meant
        part = slice(*np.searchsorted(blobs.frame, [begin, end]).tolist())
        there = part.start + np.flatnonzero(blobs.camera[part] == cameras.index(edit.camera))
        off = np.hypot(*(blobs.xy[there] - where[blobs.frame[there] - begin]).T)
        near = np.flatnonzero(off <= BLOB_RADIUS_PX)
        if not len(near):
            words = f"{edit.camera} has no blob within {BLOB_RADIUS_PX:g} px of {edit.x:g}, {edit.y:g}"
            words += f" in frame {edit.frame}"
            there_is = np.isfinite(off).any()
            return near, f"{words}, the nearest is {np.nanmin(off):.3g} px off" if there_is else words
        near = near[np.lexsort((off[near], blobs.frame[there[near]]))]
        return there[near[np.diff(blobs.frame[there[near]], prepend=-1) != 0]], ""

    row = blobs.frame * len(cameras) + blobs.camera
    return Cells(names, count, first, len(blobs.frames), row, len(cameras), meant_by)


@dataclass(frozen=True, eq=False)
class AppliedEdits:
    """Labels as the edits have them."""

    labels: Labels  # of the cells
    edited: Edited  # what the edits say of them, for whoever labels again
    outcomes: tuple[EditOutcome, ...]  # of each edit
    places: Mapping[tuple[int, int], np.ndarray]  # markers by frame index and marker, and where they were placed (3,) m


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
        _refuse_target(edit, number, trajectories, views)
        for frame in edit.span or ():
            if frames is not None and not frames[0] <= frame <= frames[1]:
                words = f"edit {number} is about frame {frame}"
                raise InputError(f"{words}; expected frames of the take, {frames[0]} to {frames[1]}")


def _refuse_target(edit: Edit, number: int, points: set[int] | None, cameras: set[str] | None):
    if points is not None and isinstance(edit, BlobEdit):
        raise InputError(f"edit {number} is of a blob in a take of points; expected one with a point")
    if points is not None and isinstance(edit, PointEdit) and edit.point not in points:
        words = f"edit {number} is of trajectory {edit.point}, which the take does not have"
        raise InputError(f"{words}; expected one of its {len(points)}, up to {max(points, default=0)}")
    if cameras is not None and isinstance(edit, PointEdit):
        raise InputError(f"edit {number} is of a point in a take of blobs; expected one with camera, frame, x and y")
    if cameras is not None and isinstance(edit, BlobEdit) and edit.camera not in cameras:
        raise InputError(f"edit {number} is of the camera {edit.camera!r}; expected one of {listed(sorted(cameras))}")


def apply_edits(labels: Labels, edits: Edits, cells: Cells) -> AppliedEdits:
    """The labels with the edits applied in their order, of a take, or chunk of blobs, that `refuse_unknown` lets pass.

    Those of other frames are passed over. What became of the edits of all chunks together, `joined` says.
    """
    replay = cells.replay(labels)
    outcomes = tuple([apply_edit(replay, edit, cells) for edit in edits])
    edited = replay.done(labels)
    return AppliedEdits(edited.labels, edited, outcomes, replay.places)


def apply_edit(replay: Replay, edit: Edit, cells: Cells) -> EditOutcome:
    """Applies an edit to a take; what became of it."""
    first, last = edit.span or (cells.first_frame, cells.first_frame + cells.frame_count - 1)
    words = words_of_frames(first, last) if edit.span else "the take"
    frames = slice(max(first - cells.first_frame, 0), min(last - cells.first_frame + 1, cells.frame_count))
    if frames.start >= frames.stop:
        return EditOutcome(edit.verb.kind, 0, f"{words} {'is' if first == last else 'are'} {NOT_AMONG}")
    rows, why = slice(frames.start * cells.images, frames.stop * cells.images), ""
    marker, change = [cells.names[name] for name in edit.names], edit.verb.change
    if isinstance(edit, PointEdit | BlobEdit):
        cell, why = cells.meant_by(edit, frames)
        count = change(replay, cell, *marker)
    elif isinstance(edit, Place):
        count = change(replay, rows, *marker, edit.xyz)
    else:
        count = change(replay, rows, *marker)
    missing = edit.verb.missing.format(target=edit.target)
    return EditOutcome(edit.verb.kind, count, "" if count else why or f"{missing} in {words}")


def joined(chunks: Iterable[tuple[EditOutcome, ...]]) -> tuple[EditOutcome, ...]:
    """What became of edits over the chunks of a take: the labels of all, and of an edit that found none why."""
    found = []
    for outcomes in zip(*chunks, strict=True):
        count, told = sum(one.labels for one in outcomes), [one for one in outcomes if NOT_AMONG not in one.reason]
        found.append(EditOutcome(outcomes[0].kind, count) if count else (told or outcomes[:1])[-1])
    return tuple(found)


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
