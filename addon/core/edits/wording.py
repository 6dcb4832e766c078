# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits in words, for the list that a person reads."""

import re

from ..data.wording import words_of_frames
from .kinds import (
    Accepted,
    AssignBlob,
    AssignPoint,
    BlobEdit,
    Delete,
    DeleteBlob,
    Edit,
    Place,
    Right,
    Swap,
    UnlabelBlob,
    UnlabelMarker,
    UnlabelPoint,
    frames_of,
)

# Frames in a sentence: one, or the first and last of some. How many there are is said before the word.
FRAMES_SAID = re.compile(r"\bframes? -?\d+(?:(?:–| to )-?\d+)?")


def words_of(edit: Edit, shift: int = 0) -> str:
    """What an edit says, and of which frames, such as "LKNE is trajectory 12, frame 7"; `shift` is added to these."""
    said = _said(edit)
    frames = frames_of(edit)
    if frames is None:
        return f"{said}, all frames"
    first, last = (number + shift for number in frames)
    return f"{said}, {words_of_frames(first, last)}"


def _said(edit: Edit) -> str:
    if isinstance(edit, BlobEdit):
        return _said_of_blob(edit)
    match edit:
        case AssignPoint():
            return f"{edit.marker} is trajectory {edit.point}"
        case UnlabelMarker():
            return f"Nothing is {edit.marker}"
        case UnlabelPoint():
            return f"Trajectory {edit.point} has no name"
        case Swap():
            return f"{edit.markers[0]} and {edit.markers[1]} swapped"
        case Delete():
            return f"Trajectory {edit.point} is no marker"
        case Place():
            return f"{edit.marker} is placed by hand"
        case Right():
            return f"{edit.marker} is right"
        case Accepted():
            return f"It is right that {edit.doubt}"
    raise TypeError(f"{type(edit).__name__}; expected a kind of edit")


def counted_on(words: str, shift: int) -> str:
    """A sentence with `shift` added to the frames that it names: for who counts them otherwise than the source."""

    def moved(found: re.Match) -> str:
        return re.sub(r"-?\d+", lambda number: str(int(number[0]) + shift), found[0])

    return FRAMES_SAID.sub(moved, words) if shift else words


def _said_of_blob(edit: BlobEdit) -> str:
    where = f"he blob at {edit.x:.0f} {edit.y:.0f} of {edit.camera}"
    match edit:
        case AssignBlob():
            return f"{edit.marker} is t{where}"
        case UnlabelBlob():
            return f"T{where} has no name"
        case DeleteBlob():
            return f"T{where} is no marker"
    raise TypeError(f"{type(edit).__name__}; expected a kind of edit")
