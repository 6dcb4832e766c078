# SPDX-License-Identifier: GPL-3.0-or-later
"""What labelling a take again changed: which markers got another name's blobs or points, gained some, or lost them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..data.takes import NO_MARKER
from ..data.wording import words_of_frames
from .suspects import MAX_BREAK_FRAMES, runs

GAINED, LOST, OTHER = "gained", "lost", "other"


@dataclass(frozen=True)
class Change:
    """One marker in a range of frames (the source's numbers, both included)."""

    marker: str
    what: str  # GAINED where it had nothing, LOST where it has nothing now, OTHER where it is something else now
    first: int
    last: int
    frames: int  # in how many frames of the range

    @property
    def words(self) -> str:
        """What changed, for a person to read."""
        words = {GAINED: "is named now", LOST: "is named no more", OTHER: "is another point or blob now"}[self.what]
        return f"{self.marker} {words} in {words_of_frames(self.first, self.last)}"


def changes(
    frame: np.ndarray, before: np.ndarray, after: np.ndarray, names: Sequence[str], frames: np.ndarray
) -> tuple[Change, ...]:
    """What is otherwise than before, the longest first.

    frame (N,) is each row's index into frames (F,), the source's numbers; before and after (N,) are the markers that it
    was and is. Rows that are not of both labellings are left out by the caller.
    """
    shape = len(frames), len(names)
    had, has, moved = np.zeros(shape, np.int64), np.zeros(shape, np.int64), np.zeros(shape, bool)
    for marker, counts in ((before, had), (after, has)):
        named = marker != NO_MARKER
        np.add.at(counts, (frame[named], marker[named]), 1)
        other = named & (before != after)
        moved[frame[other], marker[other]] = True
    kinds = {GAINED: (had == 0) & (has > 0), LOST: (had > 0) & (has == 0)}
    kinds[OTHER] = moved & (had > 0) & (has > 0)
    found = [
        change
        for what, flags in kinds.items()
        for marker in np.flatnonzero(flags.any(axis=0)).tolist()
        for change in _ranges(names[marker], what, flags[:, marker], frames)
    ]
    return tuple(sorted(found, key=lambda one: (-one.frames, one.first, one.marker)))


def summary_of_changes(found: Sequence[Change]) -> str:
    """How much changed, in half a sentence; empty where nothing did."""
    counts = {what: sum(one.frames for one in found if one.what == what) for what in (GAINED, LOST, OTHER)}
    words = {GAINED: f"label{'' if counts[GAINED] == 1 else 's'} more", LOST: "fewer", OTHER: "changed"}
    return ", ".join(f"{counts[what]} {words[what]}" for what in counts if counts[what])


def _ranges(name: str, what: str, flags: np.ndarray, frames: np.ndarray) -> list[Change]:
    return [
        Change(name, what, int(frames[start]), int(frames[stop - 1]), int(flags[start:stop].sum()))
        for start, stop in runs(flags, MAX_BREAK_FRAMES)
    ]
