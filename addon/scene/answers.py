# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person answered of a take of blobs: its doubts leave the list, and its labels stay."""

from dataclasses import replace

from ..core.data.takes import EditOutcome
from ..core.edits.kinds import Edits, frames_of, kind_of
from ..core.review.answering import unanswered_of_blobs, without_accepted
from .stored import Stored


def answered_blobs(stored: Stored, edits: Edits) -> Stored:
    """A take of blobs without the doubts that its edits answer."""
    count = len(stored.motion.frames)
    spans = [frames_of(edit) for edit in edits]
    outcomes = tuple(
        EditOutcome(kind_of(edit), count if span is None else span[1] - span[0] + 1)
        for edit, span in zip(edits, spans, strict=True)
    )
    left = without_accepted(unanswered_of_blobs(stored.suspects, edits, stored.words), edits)
    return replace(stored, suspects=left, edits=edits, outcomes=outcomes)
