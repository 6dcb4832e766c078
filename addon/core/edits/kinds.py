# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person can say of a labelled take: a few kinds of small values, and the ordered list of them.

An edit is a verb of a target in some frames. All that it means is here: its file's keys are its fields, its verb says
how it reads and what it does to labels, as a method of `Replay`. Those who apply, write or show edits know no kinds.

A take is its recording, what the program named, and a list of edits. Undo is a shorter list, redo the longer one
again: an editor keeps an `Edits` and shows `applying.apply_edits` of it, which touches nothing it was given. Frames are
the source's own numbers, both included, None for the whole take.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Self

import numpy as np

from ..data.wording import words_of_frames
from .replay import Replay

BLOB_RADIUS_PX = 2.0  # format: px from where an edit says that its blob is, the contract's


@dataclass(frozen=True)
class Verb:
    """What is done to a target."""

    kind: str  # the word of files and reports
    words: str  # how an edit reads: `{target}`, with a capital `{Target}`, `{marker}`
    missing: str  # how it reads where it found nothing
    change: Callable[..., int]  # applies it: a method of `Replay`, which gives how many labels or frames it is about


ASSIGNS = Verb("assign", "{marker} is {target}", "{target} is not seen", Replay.assign)
UNLABELS = Verb("unlabel", "{Target} has no name", "{target} has no name", Replay.unlabel)
DELETES = Verb("delete", "{Target} is no marker", "{target} is not seen", Replay.delete)


@dataclass(frozen=True, kw_only=True)
class Edit:
    """One thing that a person said."""

    verb: ClassVar[Verb]
    frames: tuple[int, int] | None = None  # the first and the last, both included; None for the whole take
    # what its file says beside, such as who said it, and is let be
    more: Mapping[str, object] = field(default_factory=dict, hash=False)

    @property
    def span(self) -> tuple[int, int] | None:
        """The first and last frame that it is about, None for all."""
        return self.frames

    @property
    def target(self) -> str:
        """What it is of, in a sentence."""
        return " and ".join(self.names)

    @property
    def names(self) -> tuple[str, ...]:
        """The markers that it names."""
        marker = getattr(self, "marker", None)
        return () if marker is None else (marker,)


@dataclass(frozen=True)
class PointEdit(Edit):
    """An edit of a trajectory, by its index in the file."""

    point: int

    @property
    def target(self) -> str:
        """What it is of, in a sentence."""
        return f"trajectory {self.point}"


@dataclass(frozen=True)
class BlobEdit(Edit):
    """An edit of the blob at x, y px of a camera's image in a frame; with `frames`, of its track there."""

    camera: str
    frame: int
    x: float
    y: float
    # (K, 3) frame, x and y px of the other blobs of that track, made of the take by `blob_tracks.followed`; it is no
    # part of what was said and is kept nowhere
    trail: np.ndarray | None = field(default=None, compare=False, repr=False, kw_only=True)

    @property
    def span(self) -> tuple[int, int]:
        """The first and last frame that it is about."""
        return self.frames or (self.frame, self.frame)

    @property
    def target(self) -> str:
        """What it is of, in a sentence."""
        return f"the blob at {self.x:.0f} {self.y:.0f} of {self.camera}"


@dataclass(frozen=True)
class AssignPoint(PointEdit):
    """A trajectory is a marker."""

    verb: ClassVar[Verb] = ASSIGNS
    marker: str


@dataclass(frozen=True)
class AssignBlob(BlobEdit):
    """A blob is a marker."""

    verb: ClassVar[Verb] = ASSIGNS
    marker: str


@dataclass(frozen=True)
class UnlabelPoint(PointEdit):
    """A trajectory is not what it is named, and has no name."""

    verb: ClassVar[Verb] = UNLABELS


@dataclass(frozen=True)
class UnlabelBlob(BlobEdit):
    """A blob is not what it is named, and has no name."""

    verb: ClassVar[Verb] = UNLABELS


@dataclass(frozen=True)
class Delete(PointEdit):
    """A trajectory is no marker, whoever asks: another person's, a prop's, or nothing."""

    verb: ClassVar[Verb] = DELETES


@dataclass(frozen=True)
class DeleteBlob(BlobEdit):
    """A blob is no marker, whoever asks."""

    verb: ClassVar[Verb] = DELETES


@dataclass(frozen=True)
class UnlabelMarker(Edit):
    """Nothing that is seen is this marker."""

    verb: ClassVar[Verb] = Verb("unlabel", "Nothing is {target}", "{target} is not named", Replay.unlabel_marker)
    marker: str


@dataclass(frozen=True)
class Swap(Edit):
    """Two markers have each other's names."""

    verb: ClassVar[Verb] = Verb("swap", "{target} swapped", "neither of {target} is named", Replay.swap)
    markers: tuple[str, str]

    @property
    def names(self) -> tuple[str, ...]:
        """The markers that it names."""
        return self.markers


@dataclass(frozen=True)
class Place(Edit):
    """A marker is here in a frame, x y z in m, though no point or blob is."""

    verb: ClassVar[Verb] = Verb("place", "{target} is placed by hand", "{target} is not placed", Replay.place)
    marker: str
    frame: int
    xyz: tuple[float, float, float]

    @property
    def span(self) -> tuple[int, int]:
        """The frame that it is about, twice."""
        return self.frame, self.frame


@dataclass(frozen=True)
class Right(Edit):
    """A marker was looked at: its labels are right, and so are its gaps."""

    verb: ClassVar[Verb] = Verb("right", "{target} is right", "{target} is not named", Replay.lock)
    marker: str


@dataclass(frozen=True)
class Accepted(Edit):
    """What a review says, word for word, was looked at: it is all right as it is."""

    verb: ClassVar[Verb] = Verb(
        "right", "It is right that {target}", "nothing to look at says {target!r}", Replay.accept
    )
    doubt: str

    @property
    def target(self) -> str:
        """What it is of, in a sentence."""
        return self.doubt


@dataclass(frozen=True)
class Edits:
    """Edits in the order in which they are applied: a later one wins over an earlier one."""

    items: tuple[Edit, ...] = ()
    more: Mapping[str, object] = field(default_factory=dict, hash=False)  # what the file says beside its edits, let be

    def __len__(self) -> int:
        return len(self.items)

    def __iter__(self) -> Iterator[Edit]:
        return iter(self.items)

    def __getitem__(self, index: int) -> Edit:
        return self.items[index]

    def added(self, *edits: Edit) -> Self:
        """The list with more edits behind the others."""
        return replace(self, items=(*self.items, *edits))

    def without(self, index: int) -> Self:
        """The list without the one at an index, such as the last, -1, for undo."""
        items = list(self.items)
        del items[index]
        return self.of(items)

    def of(self, edits: Iterable[Edit]) -> Self:
        """The same list with other edits in it."""
        return replace(self, items=tuple(edits))


NO_EDITS = Edits()
# In the order in which a row's keys are tried: the first that has all of them is meant.
EDIT_KINDS: tuple[type[Edit], ...] = (
    *(AssignPoint, AssignBlob, UnlabelMarker, UnlabelPoint, UnlabelBlob, Swap),
    *(Delete, DeleteBlob, Place, Right, Accepted),
)
# Frames in a sentence: one, or the first and last of some. How many there are is said before the word.
FRAMES_IN_WORDS = re.compile(r"\bframes? -?\d+(?:–-?\d+)?")


def words_of(edit: Edit, counted: Callable[[int], int] = int) -> str:
    """What an edit says, and of which frames, such as "LKNE is trajectory 12, frame 7", each `counted` otherwise."""
    target = edit.target
    words = edit.verb.words.format(
        target=target, Target=target[:1].upper() + target[1:], marker="".join(edit.names[:1])
    )
    if edit.span is None:
        return f"{words}, all frames"
    first, last = map(counted, edit.span)
    return f"{words}, {words_of_frames(first, last)}"


def counted_on(words: str, counted: Callable[[int], int]) -> str:
    """A sentence with the frames that it names `counted` otherwise than the source does."""

    def moved(found: re.Match) -> str:
        return re.sub(r"-?\d+", lambda number: str(counted(int(number[0]))), found[0])

    return FRAMES_IN_WORDS.sub(moved, words)
