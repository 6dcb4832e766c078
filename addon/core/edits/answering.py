# SPDX-License-Identifier: GPL-3.0-or-later
"""Doubts that a person has answered: they leave the list of what to look at, and do not come back."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import Suspect, suspect_ranges
from .kinds import Edits, Right
from .replay import FREE, Edited

SAID = 0  # of a trajectory in a frame: an edit says something of it, whatever that is


@dataclass(frozen=True, eq=False)
class Answers:
    """What an `Edited` says of doubts, for who has none: rule (T, P) FREE or SAID, right (T, M) as there."""

    rule: np.ndarray
    right: np.ndarray


def unanswered(
    suspects: Iterable[Suspect], edited: Edited | Answers, names: Mapping[str, int], first_frame: int
) -> tuple[Suspect, ...]:
    """The suspects of a take of points without the frames in which a person answered them.

    What is asked about a marker is answered by its being right; what is asked about the name of a trajectory, called
    by its column, by any edit of it. names are the indices of the markers, first_frame the source's number of the
    first.
    """
    left: list[Suspect] = []
    for suspect in suspects:
        rows = slice(suspect.first - first_frame, suspect.last - first_frame + 1)
        markers = [names[name] for name in suspect.markers if name in names]
        answered = edited.right[rows][:, markers].any(axis=1)
        if suspect.trajectory is not None:
            answered = answered | (edited.rule[rows, suspect.trajectory] != FREE)
        # A change of names is answered where either of its ends is.
        of_a_change = len(suspect.markers) > 1 and suspect.trajectory is not None
        left += [] if of_a_change and answered.any() else _rest(suspect, answered)
    return tuple(left)


def unanswered_of_blobs(suspects: Iterable[Suspect], edits: Edits, names: Mapping[str, int]) -> tuple[Suspect, ...]:
    """The suspects of a take of blobs without the frames in which their markers are right."""
    right = [(names[edit.marker], edit.frames) for edit in edits if isinstance(edit, Right)]
    left: list[Suspect] = []
    for suspect in suspects:
        frames = np.arange(suspect.first, suspect.last + 1)
        answered = np.zeros(len(frames), bool)
        own = {names[name] for name in suspect.markers if name in names}
        for marker, span in right:
            if marker in own:
                answered |= True if span is None else (frames >= span[0]) & (frames <= span[1])
        left += _rest(suspect, answered)
    return tuple(left)


def _rest(suspect: Suspect, answered: np.ndarray) -> list[Suspect]:
    """What is left of a suspect of which some frames are answered."""
    if not answered.any():
        return [suspect]
    frames = suspect.first + np.arange(len(answered))
    parts = suspect_ranges(frames, ~answered, suspect.words, 1)
    return [replace(suspect, first=part.first, last=part.last) for part in parts]
