# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person said of a take of 3D points: kept with it as text, and the take as it follows from that.

The file keeps the program's own labels and the edits, never what comes of the two: so undo, save and another version
of the extension need to know of nothing else.
"""

import json
from dataclasses import replace

import bpy
import numpy as np

from ..core.data.takes import Labels, Motion, PointRows, Suspect
from ..core.edits.following import FollowedEdits, Following
from ..core.edits.kinds import Edits
from ..core.edits.replay import FREE
from ..core.edits.rows import document_of, edits_of
from ..core.review.answering import SAID, Answers, unanswered, without_accepted
from ..core.review.suspects import called_by
from .answers import BlobCorrecting, answered_blobs
from .stored import Stored

EDITS = "mocap_edits"
OWN_LABELS = (
    "mocap_own_labels"  # of a take of blobs: its labels are the program's own, which the first versions had not
)


def text_of(edits: Edits) -> str:
    """The edits as the text that the file keeps."""
    return json.dumps(document_of(edits), ensure_ascii=False)


def keep_edits(collection: bpy.types.Collection, edits: Edits):
    """Keeps the edits with the take that `collection` holds."""
    if EDITS not in collection:
        collection[OWN_LABELS] = True  # nobody said anything yet, so the labels follow from nothing else
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


def following_of(stored: Stored) -> Following | BlobCorrecting:
    """What works the edits of a take out; stored has the labels that the program gave."""
    if not isinstance(stored.rows, PointRows):
        return BlobCorrecting(stored)
    return Following(stored.rows, stored.labels, stored.words, len(stored.names))


def edited(stored: Stored, edits: Edits, following: Following | BlobCorrecting | None = None) -> Stored:
    """A take with its edits applied: labels, markers and what is left to look at; the body stays.

    stored has the labels that the program gave, `following` is its own and makes one more edit quick. Where the labels
    are not the program's own they stay as well: they were made with the edits.
    """
    if not stored.own_labels:
        return answered_blobs(stored, edits)
    following = following or following_of(stored)
    if isinstance(following, BlobCorrecting):
        return following.apply(stored, edits)
    followed = following.apply(edits)
    return replace(
        stored,
        labels=followed.labels,
        motion=_motion(stored.motion, followed),
        suspects=without_accepted(_unanswered(stored, followed, following), edits),
        edits=edits,
        outcomes=followed.outcomes,
        placed=tuple(followed.places),
        groups=followed.groups,
    )


def motion_of_labels(motion: Motion, rows: PointRows, labels: Labels) -> Motion:
    """The motion with each marker where its points are."""
    xyz, off = np.full_like(motion.markers, np.nan), np.full_like(motion.residual, np.nan)
    at = rows.frame[labels.named], labels.marker[labels.named]
    xyz[at] = rows.xyz[labels.named]
    if rows.residual is not None:
        off[at] = rows.residual[labels.named]
    return replace(motion, markers=xyz, residual=off)


def _motion(motion: Motion, followed: FollowedEdits) -> Motion:
    """The motion with the markers that were edited where their points are."""
    xyz, off = motion.markers.copy(), motion.residual.copy()
    for group in followed.groups:
        xyz[group.frames, group.markers], off[group.frames, group.markers] = group.xyz, group.residual
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
