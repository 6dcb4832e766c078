# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person said of a take of 3D points: kept with it as text, and the take as it follows from that.

The file keeps the program's own labels and the edits, never what comes of the two: so undo, save and another version
of the extension need to know of nothing else.
"""

import json
from dataclasses import replace

import bpy
import numpy as np

from ..core.data.copies import Copies
from ..core.data.takes import Labels, Motion, PointRows, Suspect
from ..core.edits.following import FollowedEdits, Following, Held, moved_frames
from ..core.edits.kinds import Edits
from ..core.edits.replay import FREE
from ..core.edits.rows import document_of, edits_of
from ..core.review.answering import SAID, Answers, unanswered, without_accepted
from ..core.review.suspects import called_by
from .answers import BlobCorrecting
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


class PointCorrecting:
    """What works the edits of a take of points out, each from what the last ones made of it."""

    def __init__(self, stored: Stored):
        """Stored has the labels that the program gave."""
        self._following = Following(stored.rows, stored.labels, stored.words, len(stored.names))
        self._held: Held | None = None
        # Marker by marker: the scene's motions lie so in memory.
        of_marker = (values.swapaxes(0, 1) for values in (stored.motion.markers, stored.motion.residual))
        self._copies = Copies(*(np.array(values, order="C") for values in of_marker))

    def apply(self, stored: Stored, edits: Edits) -> Stored:
        """The take with its edits applied; stored is as it was first given."""
        followed = self._following.apply(edits)
        self._move(stored.rows, followed.held)
        xyz, off = (values.swapaxes(0, 1) for values in self._copies.copy())
        return replace(
            stored,
            labels=followed.labels,
            motion=replace(stored.motion, markers=xyz, residual=off),
            suspects=without_accepted(_unanswered(stored, followed, self._following), edits),
            edits=edits,
            outcomes=followed.outcomes,
            placed=tuple(followed.held.places),
            held=followed.held,
        )

    def _move(self, rows: PointRows, held: Held):
        """Puts the markers that are elsewhere than after the last edits where they are."""
        xyz, off = self._copies.arrays
        known = rows.residual is not None and len(rows)
        for marker, frames in moved_frames(self._held, held).items():
            of = held.rows[marker, frames]
            there = of >= 0
            xyz[marker, frames] = np.where(there[:, None], rows.xyz[of], np.nan) if len(rows) else np.nan
            off[marker, frames] = np.where(there, rows.residual[of], np.nan) if known else np.nan
            for which in (0, 1):
                self._copies.note(which, (marker, frames))
        for (frame, marker), place in held.places.items():
            xyz[marker, frame], off[marker, frame] = place, 0.0
            for which in (0, 1):
                self._copies.note(which, (marker, frame))
        self._held = held


def following_of(stored: Stored) -> PointCorrecting | BlobCorrecting:
    """What works the edits of a take out; stored has the labels that the program gave."""
    return PointCorrecting(stored) if isinstance(stored.rows, PointRows) else BlobCorrecting(stored)


def edited(stored: Stored, edits: Edits, following: PointCorrecting | BlobCorrecting | None = None) -> Stored:
    """A take with its edits applied: labels, markers and what is left to look at; the body follows by `reposing`.

    stored has the labels that the program gave, `following` is its own and makes one more edit quick.
    """
    return (following or following_of(stored)).apply(stored, edits)


def motion_of_labels(motion: Motion, rows: PointRows, labels: Labels) -> Motion:
    """The motion with each marker where its points are."""
    xyz, off = np.full_like(motion.markers, np.nan), np.full_like(motion.residual, np.nan)
    at = rows.frame[labels.named], labels.marker[labels.named]
    xyz[at] = rows.xyz[labels.named]
    if rows.residual is not None:
        off[at] = rows.residual[labels.named]
    return replace(motion, markers=xyz, residual=off)


def _unanswered(stored: Stored, followed: FollowedEdits, following: Following) -> tuple[Suspect, ...]:
    """The suspects that no edit answers, called by the trajectories' own numbers as before."""
    columns = np.array(sorted({one.trajectory for one in stored.suspects if one.trajectory is not None}), int)
    column = {int(number): place for place, number in enumerate(columns)}
    rule = np.full((len(stored.motion.frames), len(columns)), FREE, np.int8)
    present = np.zeros(rule.shape, bool)
    for number, place in column.items():
        rows = following.rows_of(number)
        present[stored.rows.frame[rows], place] = True
        rule[stored.rows.frame[rows], place] = np.where(followed.said[rows], SAID, FREE)
    asked = [
        one if one.trajectory is None else replace(one, trajectory=column[one.trajectory]) for one in stored.suspects
    ]
    answers = Answers(rule, followed.right)
    return called_by(unanswered(asked, answers, stored.words, int(stored.motion.frames[0]), present), columns)
