# SPDX-License-Identifier: GPL-3.0-or-later
"""Doubts that a person has answered: they leave the list of what to look at, and do not come back."""

from collections.abc import Iterable, Mapping
from dataclasses import replace

import numpy as np

from ..data.takes import Suspect, suspect_ranges
from .replay import FREE, Edited


def unanswered(
    suspects: Iterable[Suspect], edited: Edited, names: Mapping[str, int], first_frame: int
) -> tuple[Suspect, ...]:
    """The suspects without the frames in which a person answered them.

    What is asked about a marker is answered by its being right; what is asked about the name of a trajectory, called
    by its column, by any edit of it. names are the indices of the markers; first_frame the source's number of the first.
    """
    left: list[Suspect] = []
    for suspect in suspects:
        first, after = suspect.first - first_frame, suspect.last - first_frame + 1
        rows = slice(max(first, 0), max(after, 0))
        markers = [names[name] for name in suspect.markers if name in names]
        answered = edited.right[rows][:, markers].any(axis=1)
        if suspect.trajectory is not None:
            answered = answered | (edited.rule[rows, suspect.trajectory] != FREE)
        left += _rest(suspect, answered, len(suspect.markers) > 1 and suspect.trajectory is not None)
    return tuple(left)


def _rest(suspect: Suspect, answered: np.ndarray, of_a_change: bool) -> list[Suspect]:
    """What is left of a suspect; a change of names is answered where either of its ends is."""
    if not answered.any():
        return [suspect]
    if of_a_change:
        return []
    frames = suspect.first + np.arange(len(answered))
    parts = suspect_ranges(frames, ~answered, suspect.words, 1)
    return [replace(suspect, first=part.first, last=part.last) for part in parts]
