# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person said of a take of 3D points: kept with it as text, and the take as it follows from that.

The file keeps the program's own labels and the edits, never what comes of the two: so undo, save and another version
of the extension need to know of nothing else.
"""

import json
from dataclasses import replace

import bpy
import numpy as np

from ..core.data.takes import Labels, Motion, PointRows, Suspect, called_by
from ..core.edits.answering import unanswered, without_accepted
from ..core.edits.applying import OF_POINTS, AppliedEdits, PointCells, apply_to_points
from ..core.edits.kinds import Edits
from ..core.edits.rows import document_of, edits_of
from .answers import answered_blobs
from .stored import Stored

EDITS = "mocap_edits"


def text_of(edits: Edits) -> str:
    """The edits as the text that the file keeps."""
    return json.dumps(document_of(edits), ensure_ascii=False)


def keep_edits(collection: bpy.types.Collection, edits: Edits):
    """Keeps the edits with the take that `collection` holds."""
    collection[EDITS] = text_of(edits)


def kept_text(collection: bpy.types.Collection) -> str | None:
    """The text of a take's edits; None where nobody ever said anything of it, which an empty list is not."""
    text = collection.get(EDITS)
    return None if text is None else str(text)


def kept_edits(collection: bpy.types.Collection) -> Edits | None:
    """The edits of a take; None where nobody ever said anything of it.

    Raises InputError where the text is none of ours.
    """
    text = kept_text(collection)
    return None if text is None else edits_of(json.loads(text))


def edited(stored: Stored, edits: Edits) -> Stored:
    """A take of points with its edits applied: labels, markers and what is left to look at; the body stays.

    stored has the labels that the program gave. Of blobs the labels stay as well: they were made with the edits.
    """
    if not isinstance(stored.rows, PointRows):
        return answered_blobs(stored, edits)
    rows, words = stored.rows, stored.words
    columns = np.union1d(rows.trajectory, [edit.point for edit in edits if isinstance(edit, OF_POINTS)]).astype(int)
    at = rows.frame, np.searchsorted(columns, rows.trajectory)
    shape = len(stored.motion.frames), len(columns)
    present = np.zeros(shape, bool)
    present[at] = True
    cells = PointCells(words, len(stored.names), int(stored.motion.frames[0]), present, columns)
    applied = apply_to_points(stored.labels.spread(at, *shape), edits, cells)
    labels = applied.labels[at]
    return replace(
        stored,
        labels=labels,
        motion=_motion(stored.motion, rows, labels, applied),
        suspects=without_accepted(_unanswered(stored, applied, columns, present), edits),
        edits=edits,
        outcomes=applied.outcomes,
    )


def _motion(motion: Motion, rows: PointRows, labels: Labels, applied: AppliedEdits) -> Motion:
    """The motion with the markers where their points are."""
    xyz, off = np.full_like(motion.markers, np.nan), np.full_like(motion.residual, np.nan)
    named = labels.named
    at = rows.frame[named], labels.marker[named]
    xyz[at] = rows.xyz[named]
    if rows.residual is not None:
        off[at] = rows.residual[named]
    for place, where in applied.places.items():
        xyz[place], off[place] = where, 0.0
    return replace(motion, markers=xyz, residual=off)


def _unanswered(stored: Stored, applied: AppliedEdits, columns: np.ndarray, present: np.ndarray) -> tuple[Suspect, ...]:
    """The suspects that no edit answers, called by the trajectories' own numbers as before."""
    column = {int(number): place for place, number in enumerate(columns)}
    asked = [
        one if one.trajectory is None else replace(one, trajectory=column[one.trajectory])
        for one in stored.suspects
        if one.trajectory is None or one.trajectory in column
    ]
    return called_by(unanswered(asked, applied.edited, stored.words, int(stored.motion.frames[0]), present), columns)
