# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits applied to the labels of points or of blobs: pure functions, fast enough to be called at every click.

An editor keeps the labels that the program gave and an `Edits`, and shows `apply_to_points` of the two; nothing that is
given is changed. When the take was labelled again, it keeps `LabelledChunk.unedited`, of which the same edits give the
new labels.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..data.errors import InputError
from ..data.lanes import Lanes
from ..data.markersets import MarkerSet
from ..data.takes import Blobs, EditOutcome, Labels, Points
from .kinds import (
    EDIT_KINDS,
    Accepted,
    AssignBlob,
    AssignPoint,
    BlobEdit,
    Delete,
    DeleteBlob,
    Edit,
    Edits,
    Place,
    Right,
    Swap,
    UnlabelBlob,
    UnlabelMarker,
    UnlabelPoint,
    frames_of,
    kind_of,
    markers_of,
)
from .replay import Edited, Replay

OF_POINTS = (AssignPoint, UnlabelPoint, Delete)
# The rows (K,) in which a trajectory is there, of some of them, and its cells (K,) in a `Replay`.
CellsOf = Callable[[int, slice], tuple[np.ndarray, np.ndarray]]


@dataclass(frozen=True)
class SentenceOptions:
    """What a sentence about edits lists; reckoned.

    max_names  of markers or cameras: as many as a person takes in at a glance
    """

    max_names: int = 8


SENTENCES = SentenceOptions()


@dataclass(frozen=True)
class BlobEditOptions:
    """How a blob is found again.

    max_distance_px  from where an edit says that it is; the contract's
    """

    max_distance_px: float = 2.0


BLOB_EDITING = BlobEditOptions()


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
    def of(cls, take: Points, markerset: MarkerSet) -> "PointCells":
        """Those of a take."""
        columns = np.arange(len(take.standing)) if take.columns is None else take.columns
        return cls(markerset.by_name, len(markerset), take.first_frame, take.present, columns, take.lanes)

    def own(self, place: int, rows: slice) -> tuple[slice, int]:
        """The frames, of those from start to stop, in which a trajectory by its place in `columns` stands, and where.

        None of them are some of no length.
        """
        if self.lanes is None:
            return rows, place
        first, after = int(self.lanes.first[place]), int(self.lanes.last[place]) + 1
        start = min(max(rows.start, first), rows.stop)
        return slice(start, max(min(rows.stop, after), start)), int(self.lanes.lane[place])

    def of_trajectory(self, number: int, rows: slice) -> tuple[np.ndarray, np.ndarray]:
        """(K,) the rows of some in which a trajectory has a point, and (K,) its cells in them."""
        own, lane = self.own(int(np.flatnonzero(self.columns == number)[0]), rows)
        at = np.flatnonzero(self.present[own, lane]) + own.start
        return at, at * self.present.shape[1] + lane


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
    def of(cls, blobs: Blobs, cameras: tuple[str, ...], markerset: MarkerSet) -> "BlobCells":
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

    def cells_of(self, blobs: np.ndarray) -> np.ndarray:
        """(K,) the cells of some blobs (K,) in a `Replay` of the table."""
        return self.image[blobs] * self.present.shape[1] + self.slot[blobs]

    def table(self, labels: Labels) -> Labels:
        """The labels (N,) of the blobs, (R, K)."""
        return labels.spread((self.image, self.slot), *self.present.shape)

    def rows(self, table: Labels) -> Labels:
        """The labels (R, K) of the blobs, (N,)."""
        return table[self.image, self.slot]


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
    points, cameras = (None if known is None else set(known) for known in (points, cameras))
    for number, edit in enumerate(edits, 1):
        for name in markers_of(edit):
            if name not in names:
                some = ", ".join(list(names)[: SENTENCES.max_names])
                raise InputError(f"edit {number} names {name!r}; expected a marker of the model, such as {some}")
        if isinstance(edit, Swap) and len({names[name] for name in edit.markers}) == 1:
            raise InputError(f"edit {number} swaps a marker with itself; expected two markers")
        if points is not None:
            _refuse_point(edit, number, points)
        if cameras is not None:
            _refuse_camera(edit, number, cameras)
        own = frames_of(edit)
        if frames is not None and own is not None and not frames[0] <= own[0] <= own[1] <= frames[1]:
            outside = own[0] if not frames[0] <= own[0] <= frames[1] else own[1]
            words = f"edit {number} is about frame {outside}"
            raise InputError(f"{words}; expected frames of the take, {frames[0]} to {frames[1]}")


def _refuse_point(edit: Edit, number: int, points: set[int]):
    if isinstance(edit, BlobEdit):
        raise InputError(f"edit {number} is of a blob in a take of points; expected one with a point")
    if isinstance(edit, OF_POINTS) and edit.point not in points:
        words = f"edit {number} is of trajectory {edit.point}, which the take does not have"
        raise InputError(f"{words}; expected one of its {len(points)}, up to {max(points, default=0)}")


def _refuse_camera(edit: Edit, number: int, cameras: set[str]):
    if isinstance(edit, OF_POINTS):
        raise InputError(f"edit {number} is of a point in a take of blobs; expected one with camera, frame, x and y")
    if isinstance(edit, BlobEdit) and edit.camera not in cameras:
        some = ", ".join(sorted(cameras)[: SENTENCES.max_names])
        raise InputError(f"edit {number} is of the camera {edit.camera!r}; expected one of {some}")


def apply_to_points(labels: Labels, edits: Edits, cells: PointCells) -> AppliedEdits:
    """The labels (T, P) with the edits applied in their order, of a take that `refuse_unknown` lets pass."""
    replay, frames = Replay.of_table(labels, cells.count), (cells.first_frame, len(cells.present))
    outcomes = [apply_edit(replay, edit, frames, cells.names, cells.of_trajectory) for edit in edits]
    edited = replay.done(labels)
    return AppliedEdits(edited.labels, edited, tuple(outcomes), dict(replay.places))


def apply_edit(
    replay: Replay, edit: Edit, frames: tuple[int, int], names: Mapping[str, int], cells_of: CellsOf
) -> EditOutcome:
    """Applies an edit of points to a take whose rows are its frames: the first one's number, and how many."""
    rows = _rows(edit, *frames)
    return _outcome(edit, 0 if rows is None else _applied(replay, edit, rows, names, cells_of), rows is None)


def _applied(replay: Replay, edit: Edit, rows: slice, names: Mapping[str, int], cells_of: CellsOf) -> int:
    """Applies an edit of points to some frames; how many labels it is about."""
    marker = [names[name] for name in markers_of(edit)]
    if isinstance(edit, AssignPoint):
        return replay.assign(*cells_of(edit.point, rows), *marker)
    if isinstance(edit, UnlabelPoint):
        return replay.unlabel(*cells_of(edit.point, rows))
    if isinstance(edit, Delete):
        return replay.delete(*cells_of(edit.point, rows))
    if isinstance(edit, Accepted):
        return rows.stop - rows.start
    if isinstance(edit, Place):
        return replay.place(rows.start, *marker, np.array(edit.xyz))
    return _of_markers(replay, edit, rows, marker)


def _of_markers(replay: Replay, edit: Edit, rows: slice, marker: list[int]) -> int:
    """Applies an edit that goes by what has a marker's name."""
    work = {UnlabelMarker: replay.unlabel_marker, Swap: replay.swap, Right: replay.lock}[type(edit)]
    return work(rows, *marker)


def _rows(edit: Edit, first_frame: int, count: int) -> slice | None:
    """The frames of `count` from `first_frame` on that an edit is about, None for none of them."""
    first, last = frames_of(edit) or (first_frame, first_frame + count - 1)
    first, after = max(first - first_frame, 0), min(last - first_frame + 1, count)
    return slice(first, after) if first < after else None


def unless_heard(outcomes: Sequence[EditOutcome], edits: Edits, heard: Collection[Accepted]) -> tuple[EditOutcome, ...]:
    """The outcomes, where whoever accepts what no review says found nothing; `heard` are those that one says."""
    told = list(outcomes)
    for index, edit in enumerate(edits if told else ()):
        if isinstance(edit, Accepted) and edit not in heard and told[index].labels:
            told[index] = EditOutcome(kind_of(edit), 0, f"nothing to look at says {edit.doubt[:60]!r}")
    return tuple(told)


def found_outside(edit: Edit) -> EditOutcome:
    """What became of an edit that is of no frame of the take."""
    return _outcome(edit, 0, True)


def _outcome(edit: Edit, count: int, outside: bool) -> EditOutcome:
    """What became of an edit."""
    if count:
        return EditOutcome(kind_of(edit), count)
    first, last = frames_of(edit) or (None, None)
    when = "the take" if first is None else f"frame {first}" if first == last else f"frames {first} to {last}"
    if outside:
        verb = "is" if first == last else "are"
        return EditOutcome(kind_of(edit), 0, f"{when} {verb} not among what is labelled")
    if isinstance(edit, AssignPoint | Delete):
        what = f"trajectory {edit.point} has no point"
    elif isinstance(edit, UnlabelPoint):
        what = f"trajectory {edit.point} has no name"
    elif isinstance(edit, BlobEdit):
        what = f"the blob at {edit.x:g}, {edit.y:g} of {edit.camera} has no name"
    elif isinstance(edit, Swap):
        what = f"neither {edit.markers[0]} nor {edit.markers[1]} is named"
    else:
        what = f"{markers_of(edit)[0]} is not named"
    return EditOutcome(kind_of(edit), 0, f"{what} in {when}")


def apply_to_blobs(labels: Labels, edits: Edits, cells: BlobCells) -> AppliedEdits:
    """The labels (N,) of a chunk's blobs with the edits applied in their order, those of other frames passed over.

    Take what became of the edits of all chunks together with `joined`.
    """
    table = cells.table(labels)
    replay = Replay.of_table(table, cells.count)
    places: dict[tuple[int, int], np.ndarray] = {}
    outcomes = []
    for edit in edits:
        rows, reason, done = _rows(edit, int(cells.blobs.frames[0]), len(cells.blobs.frames)), "", 0
        if rows is not None and isinstance(edit, Place):
            places[rows.start, cells.names[edit.marker]], done = np.array(edit.xyz), 1
        elif rows is not None and isinstance(edit, BlobEdit):
            found, reason = blobs_of(edit, cells)
            done = _of_blobs(replay, edit, cells.image[found], cells.cells_of(found), cells.names)
            if isinstance(edit, AssignBlob):
                _give_up_places(places, replay, cells.names[edit.marker], cells.blobs.frame[found], len(cells.cameras))
        elif rows is not None and isinstance(edit, Accepted):
            done = rows.stop - rows.start
        elif rows is not None:
            images = slice(rows.start * len(cells.cameras), rows.stop * len(cells.cameras))
            done = _of_markers(replay, edit, images, [cells.names[name] for name in markers_of(edit)])
            done += _move_places(places, edit, rows, cells.names)
        outcomes.append(replace(_outcome(edit, done, rows is None), **({"reason": reason} if reason else {})))
    edited = replay.done(table)
    return AppliedEdits(cells.rows(edited.labels), edited, tuple(outcomes), places)


def _move_places(places: dict, edit: Edit, rows: slice, names: Mapping[str, int]) -> int:
    """Takes away places whose marker an edit takes, or exchanges them; how many."""
    if isinstance(edit, Right):
        return 0
    marker = [names[name] for name in markers_of(edit)]
    moved = {key: places.pop(key) for key in list(places) if rows.start <= key[0] < rows.stop and key[1] in marker}
    if isinstance(edit, Swap):
        places.update({(frame, sum(marker) - name): xyz for (frame, name), xyz in moved.items()})
    return len(moved)


def _give_up_places(places: dict, replay: Replay, marker: int, frames: np.ndarray, cameras: int):
    """Takes away where a marker was placed in some frames (K,), once blobs of two cameras say where it is."""
    for frame in frames.tolist():
        if (frame, marker) in places and replay.seen(np.arange(frame * cameras, (frame + 1) * cameras), marker) >= 2:
            del places[frame, marker]


def _of_blobs(replay: Replay, edit: BlobEdit, image: np.ndarray, cell: np.ndarray, names: Mapping[str, int]) -> int:
    """Applies an edit of blobs, by image and cell (K,), one of an image at most; how many labels it is about."""
    if isinstance(edit, AssignBlob):
        return replay.assign(image, cell, names[edit.marker])
    work = {UnlabelBlob: replay.unlabel, DeleteBlob: replay.delete}[type(edit)]
    return work(image, cell)


def blobs_of(edit: BlobEdit, cells: BlobCells) -> tuple[np.ndarray, str]:
    """(K,) the rows of the blobs of a chunk that an edit is of, one of a frame; and why, where there is none."""
    first, count = int(cells.blobs.frames[0]), len(cells.blobs.frames)
    own = np.array([[edit.frame, edit.x, edit.y]], dtype=float)
    meant = own if edit.trail is None else np.concatenate([edit.trail, own])
    meant = meant[(meant[:, 0] >= first) & (meant[:, 0] < first + count)]
    where = np.full((count, 2), np.nan)
    where[meant[:, 0].astype(int) - first] = meant[:, 1:]
    blobs = cells.blobs
    of_camera = blobs.camera == cells.cameras.index(edit.camera)
    there = np.flatnonzero(of_camera & np.isfinite(where[blobs.frame, 0]))
    off = np.hypot(*(blobs.xy[there] - where[blobs.frame[there]]).T)
    order = np.lexsort((off, blobs.frame[there]))
    there, off = there[order], off[order]
    nearest = np.diff(blobs.frame[there], prepend=-1) != 0
    there, off = there[nearest], off[nearest]
    near = off <= BLOB_EDITING.max_distance_px
    return there[near], "" if near.any() or not len(meant) else _no_blob(edit, off)


def _no_blob(edit: BlobEdit, off: np.ndarray) -> str:
    """Why an edit finds no blob, of which the nearest are so far `off` (K,) px."""
    words = f"{edit.camera} has no blob within {BLOB_EDITING.max_distance_px:g} px of {edit.x:g}, {edit.y:g}"
    words += f" in frame {edit.frame}"
    return f"{words}, the nearest is {off.min():.3g} px off" if len(off) else words


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
    outside = "not among what is labelled"
    return two if outside not in two.reason else one


def summary_of(outcomes: Iterable[EditOutcome]) -> dict:
    """What a report says of edits: how many of each kind found something, and of each of the others why it did not."""
    outcomes = tuple(outcomes)
    kinds = [kind for kind in dict.fromkeys(EDIT_KINDS.values()) if any(one.kind == kind for one in outcomes)]
    done = {kind: sum(one.kind == kind and one.labels > 0 for one in outcomes) for kind in kinds}
    missed = [
        {"edit": number, "kind": one.kind, "reason": one.reason}
        for number, one in enumerate(outcomes, 1)
        if not one.labels
    ]
    return {"applied": done, "found_nothing": missed}
