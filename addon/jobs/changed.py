# SPDX-License-Identifier: GPL-3.0-or-later
"""What labelling a take again changed, by the label files of before and of now."""

from collections.abc import Sequence
from itertools import zip_longest
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import NO_MARKER
from ..core.review.changes import changes, summary_of_changes
from ..io.labels import LabelFile

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
    if found is None:
        return {}
    return {"changed": [one.as_dict() for one in found[:MAX_LISTED]], "changed_in_all": summary_of_changes(found)}


def _changes(old: LabelFile, new: LabelFile, markers: Sequence[str]):
    """All changes; None where the rows are not of the same blobs or points."""
    index = {name: number for number, name in enumerate(markers)}
    table: list[tuple[int, int, int]] = []
    for one, other in zip_longest(old.rows(), new.rows()):
        if one is None or other is None or (one.frame, one.key) != (other.frame, other.key):
            return None
        # A name that the model does not have is of another model: as good as none.
        table.append((one.frame, index.get(one.marker, NO_MARKER), index.get(other.marker, NO_MARKER)))
    frame, before, after = np.array(table, dtype=np.int64).reshape(-1, 3).T
    frames, at = np.unique(frame, return_inverse=True)
    return changes(at.ravel(), before, after, markers, frames)
