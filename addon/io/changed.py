# SPDX-License-Identifier: GPL-3.0-or-later
"""What labelling a take again changed, by the label files of before and of now."""

from array import array
from collections.abc import Iterator, Sequence
from itertools import dropwhile, takewhile, zip_longest
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import NO_MARKER
from ..core.review.changes import Change, changes, summary_of_changes
from .labels import LabelFile, UnreadRow

MAX_LISTED = 200  # changes that a report lists, the longest first: a list that a person reads


def facts_of_changes(before: Path, after: Path, markers: Sequence[str]) -> dict:
    """What a report says of what is otherwise than in an earlier label file; nothing where that is of other rows."""
    if not before.exists():
        return {}
    try:
        with LabelFile(before) as old, LabelFile(after) as new:
            found = _changes(old, new, markers)
    except (InputError, OSError):  # whatever lies there, it is about to be replaced
        return {}
    return {"changed": [one.as_dict() for one in found[:MAX_LISTED]], "changed_in_all": summary_of_changes(found)}


def changes_of_part(
    whole: Path, part: Path, markers: Sequence[str], frames: tuple[int, int]
) -> tuple[Change, ...] | None:
    """What is otherwise in the label file of a part of a take, its first to last frame, than in that of all of it.

    None where nobody can tell: the one of the whole take is not there, or is of other rows.
    """
    try:
        with LabelFile(whole) as old, LabelFile(part) as new:
            return _changes(old, new, markers, frames)
    except (InputError, OSError):
        return None


def _changes(
    old: LabelFile, new: LabelFile, markers: Sequence[str], frames: tuple[int, int] | None = None
) -> tuple[Change, ...]:
    """All changes, in some `frames` of the old file; InputError where the rows are not of the same blobs or points."""
    index = {name: number for number, name in enumerate(markers)}
    numbers, table = array("q"), array("q")
    alike = old.header == new.header
    for frame, pairs in _frame_by_frame(old, new, frames):
        # Most of a take is as it was: those frames are counted, and only the others read.
        if not alike or any(one.text != other.text for one, other in pairs):
            for pair in pairs:
                one, other = old.read(pair[0]), new.read(pair[1])
                if one.key != other.key:
                    raise _others(old)
                # A name that the model does not have is of another model: as good as none.
                table.extend((len(numbers), index.get(one.marker, NO_MARKER), index.get(other.marker, NO_MARKER)))
        numbers.append(frame)
    at, before, after = np.array(table, dtype=np.int64).reshape(-1, 3).T
    return changes(at, before, after, markers, np.array(numbers, dtype=np.int64))


def _frame_by_frame(
    old: LabelFile, new: LabelFile, frames: tuple[int, int] | None
) -> Iterator[tuple[int, list[tuple[UnreadRow, UnreadRow]]]]:
    """Each frame, and its rows in pairs; InputError where the frames have other rows."""
    pairs: list[tuple[UnreadRow, UnreadRow]] = []
    before = old.unread_rows()
    if frames is not None:
        begun = dropwhile(lambda row: row.frame < frames[0], before)
        before = takewhile(lambda row: row.frame <= frames[1], begun)
    for one, other in zip_longest(before, new.unread_rows()):
        if one is None or other is None or one.frame != other.frame:
            raise _others(old)
        if pairs and one.frame != pairs[0][0].frame:
            yield pairs[0][0].frame, pairs
            pairs = []
        pairs.append((one, other))
    if pairs:
        yield pairs[0][0].frame, pairs


def _others(old: LabelFile) -> InputError:
    return InputError("holds other rows than now; expected the labels of the same blobs or points", old.path)
