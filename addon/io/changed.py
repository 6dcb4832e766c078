# SPDX-License-Identifier: GPL-3.0-or-later
"""What labelling a take again changed, by the label files of before and of now."""

from array import array
from collections.abc import Iterator, Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import NO_MARKER
from ..core.review.changes import changes, summary_of_changes
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


def _changes(old: LabelFile, new: LabelFile, markers: Sequence[str]):
    """All changes; InputError where the rows are not of the same blobs or points."""
    index = {name: number for number, name in enumerate(markers)}
    frames, table = array("q"), array("q")
    alike = old.header == new.header
    for frame, pairs in _frame_by_frame(old, new):
        # Most of a take is as it was: those frames are counted, and only the others read.
        if not alike or any(one.text != other.text for one, other in pairs):
            for pair in pairs:
                one, other = old.read(pair[0]), new.read(pair[1])
                if one.key != other.key:
                    raise _others(old)
                # A name that the model does not have is of another model: as good as none.
                table.extend((len(frames), index.get(one.marker, NO_MARKER), index.get(other.marker, NO_MARKER)))
        frames.append(frame)
    at, before, after = np.array(table, dtype=np.int64).reshape(-1, 3).T
    return changes(at, before, after, markers, np.array(frames, dtype=np.int64))


def _frame_by_frame(old: LabelFile, new: LabelFile) -> Iterator[tuple[int, list[tuple[UnreadRow, UnreadRow]]]]:
    """Each frame, and its rows in pairs; InputError where the frames have other rows."""
    pairs: list[tuple[UnreadRow, UnreadRow]] = []
    for one, other in zip_longest(old.unread_rows(), new.unread_rows()):
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
