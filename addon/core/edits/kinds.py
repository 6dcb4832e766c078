# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person can say of a labelled take: a few kinds of small values, and the ordered list of them.

A take is its recording, what the program named, and a list of edits. Undo is a shorter list, redo the longer one
again: an editor keeps an `Edits` and shows `applying.apply_to_points` of it, which touches nothing it was given. Frames
are the source's own numbers, both included, None for the whole take; a scope such as "from here on" or "this
trajectory" is a range of frames once it is chosen.
"""

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import Self

import numpy as np


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One thing that a person said; `more` is what its file says beside, such as who said it, and is let be."""

    more: Mapping[str, object] = field(default_factory=dict, hash=False)


@dataclass(frozen=True)
class RangeEdit(Edit):
    """An edit of some frames: the first and the last, both included; None for the whole take."""

    frames: tuple[int, int] | None = field(default=None, kw_only=True)


@dataclass(frozen=True)
class AssignPoint(RangeEdit):
    """A trajectory, by its index in the file, is a marker."""

    point: int
    marker: str


@dataclass(frozen=True)
class BlobEdit(RangeEdit):
    """An edit of the blob at x, y px of a camera's image in a frame; with `frames`, of its track in that camera there.

    trail  (K, 3) frame, x and y px of the other blobs of that track, made of the take by `blob_tracks.followed`; it is
           no part of what was said and is kept nowhere
    """

    camera: str
    frame: int
    x: float
    y: float
    trail: np.ndarray | None = field(default=None, compare=False, repr=False, kw_only=True)


@dataclass(frozen=True)
class AssignBlob(BlobEdit):
    """A blob is a marker."""

    marker: str


@dataclass(frozen=True)
class UnlabelBlob(BlobEdit):
    """A blob is not what it is named, and has no name."""


@dataclass(frozen=True)
class DeleteBlob(BlobEdit):
    """A blob is no marker, whoever asks."""


@dataclass(frozen=True)
class UnlabelMarker(RangeEdit):
    """Nothing that is seen is this marker."""

    marker: str


@dataclass(frozen=True)
class UnlabelPoint(RangeEdit):
    """A trajectory is not what it is named, and has no name."""

    point: int


@dataclass(frozen=True)
class Swap(RangeEdit):
    """Two markers have each other's names."""

    markers: tuple[str, str]


@dataclass(frozen=True)
class Delete(RangeEdit):
    """A trajectory is no marker, whoever asks: another person's, a prop's, or nothing."""

    point: int


@dataclass(frozen=True)
class Place(Edit):
    """A marker is here in a frame, x y z in m, though no point or blob is."""

    marker: str
    frame: int
    xyz: tuple[float, float, float]


@dataclass(frozen=True)
class Right(RangeEdit):
    """A marker was looked at: its labels are right, and so are its gaps."""

    marker: str


@dataclass(frozen=True)
class Accepted(RangeEdit):
    """What a review says, word for word, was looked at: it is all right as it is."""

    doubt: str


@dataclass(frozen=True)
class Edits:
    """Edits in the order in which they are applied: a later one wins over an earlier one.

    more  what the file says beside its edits, let be
    """

    items: tuple[Edit, ...] = ()
    more: Mapping[str, object] = field(default_factory=dict, hash=False)

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Edit]:
        return iter(self.items)

    def __getitem__(self, index: int) -> Edit:
        return self.items[index]

    def added(self, *edits: Edit) -> Self:
        """The list with more edits behind the others."""
        return replace(self, items=(*self.items, *edits))

    def without(self, *indices: int) -> Self:
        """The list without those at some indices, such as the last, -1, for undo."""
        gone = {range(len(self.items))[index] for index in indices}
        return self.of(edit for index, edit in enumerate(self.items) if index not in gone)

    def of(self, edits: Iterable[Edit]) -> Self:
        """The same list with other edits in it."""
        return replace(self, items=tuple(edits))


NO_EDITS = Edits()
EDIT_KINDS: dict[type[Edit], str] = {
    AssignPoint: "assign",
    AssignBlob: "assign",
    UnlabelMarker: "unlabel",
    UnlabelPoint: "unlabel",
    UnlabelBlob: "unlabel",
    Swap: "swap",
    Delete: "delete",
    DeleteBlob: "delete",
    Place: "place",
    Right: "right",
    Accepted: "right",
}


def kind_of(edit: Edit) -> str:
    """The word that files and reports have for what an edit does."""
    return EDIT_KINDS[type(edit)]


def frames_of(edit: Edit) -> tuple[int, int] | None:
    """The first and last frame that an edit is about, None for all."""
    if isinstance(edit, Place) or (isinstance(edit, BlobEdit) and edit.frames is None):
        return edit.frame, edit.frame
    return edit.frames if isinstance(edit, RangeEdit) else None


def markers_of(edit: Edit) -> tuple[str, ...]:
    """The markers that an edit names."""
    if isinstance(edit, Swap):
        return edit.markers
    return (edit.marker,) if isinstance(edit, AssignPoint | AssignBlob | UnlabelMarker | Place | Right) else ()
