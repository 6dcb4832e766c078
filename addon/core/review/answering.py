# SPDX-License-Identifier: GPL-3.0-or-later
"""Doubts that a person has answered: they leave the list of what to look at, and do not come back."""

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import Suspect
from ..edits.kinds import Accepted, AssignPoint, Delete, Edits, Right, Swap, UnlabelMarker
from ..edits.replay import FREE, Edited
from .suspects import suspect_ranges

SAID = 0  # of a trajectory in a frame: an edit says something of it, whatever that is
PAIR = 2  # markers of which a doubt asks which is which


@dataclass(frozen=True, eq=False)
class Answers:
    """What an `Edited` says of doubts, for who has none: rule (T, P) FREE or SAID, right (T, M) as there."""

    rule: np.ndarray
    right: np.ndarray


def unanswered(
    suspects: Iterable[Suspect],
    edited: Edited | Answers,
    names: Mapping[str, int],
    first_frame: int,
    present: np.ndarray | None = None,
) -> tuple[Suspect, ...]:
    """The suspects of a take of points without the frames in which a person answered them.

    What is asked about a marker is answered by its being right, about a pair of them by one of the two, about more by
    all; what is asked about the name of a trajectory, called by its column, by any edit of it. names are the indices of
    the markers, first_frame the source's number of the first; present (T, P) where there are points, of which alone a
    trajectory's name is asked.
    """
    left: list[Suspect] = []
    some_right, some_said = edited.right.any(axis=0), (edited.rule != FREE).any(axis=0)
    for suspect in suspects:
        rows = slice(suspect.first - first_frame, suspect.last - first_frame + 1)
        markers = [names[name] for name in suspect.markers if name in names]
        if not some_right[markers].any() and (suspect.trajectory is None or not some_said[suspect.trajectory]):
            left.append(suspect)  # most are: nothing was said of what they are about
            continue
        answered = _enough(edited.right[rows][:, markers])
        if suspect.trajectory is not None:
            named = edited.rule[rows, suspect.trajectory] != FREE
            if present is not None and named.any():
                named = named | ~present[rows, suspect.trajectory]
            answered = answered | named
        # A change of names is answered where either of its ends is.
        of_a_change = len(suspect.markers) > 1 and suspect.trajectory is not None
        left += [] if of_a_change and answered.any() else _rest(suspect, answered)
    return tuple(left)


def unanswered_of_blobs(suspects: Iterable[Suspect], edits: Edits, names: Mapping[str, int]) -> tuple[Suspect, ...]:
    """The suspects of a take of blobs without the frames in which their markers are right."""
    left: list[Suspect] = []
    for suspect in suspects:
        own = [names[name] for name in suspect.markers if name in names]
        looked_at = right_in(edits, names, np.arange(suspect.first, suspect.last + 1))[:, own]
        left += _rest(suspect, _enough(looked_at))
    return tuple(left)


def without_accepted(suspects: Iterable[Suspect], edits: Edits) -> tuple[Suspect, ...]:
    """The suspects without the frames in which a person accepted what they say."""
    if not any(isinstance(edit, Accepted) for edit in edits):
        return tuple(suspects)
    left: list[Suspect] = []
    for suspect in suspects:
        frames = np.arange(suspect.first, suspect.last + 1)
        left += _rest(suspect, accepted_in(edits, suspect.reason, frames))
    return tuple(left)


def heard_in(edits: Edits, suspects: Iterable[Suspect]) -> frozenset[Accepted]:
    """The edits that accept what some suspect says, in some frame of it."""
    listening = [edit for edit in edits if isinstance(edit, Accepted)]
    if not listening:
        return frozenset()
    said = [(one.reason, one.first, one.last) for one in suspects]
    return frozenset(edit for edit in listening if any(is_accepted(edit, *one) for one in said))


def is_accepted(edit: Accepted, words: str, first: int, last: int) -> bool:
    """Whether an edit accepts what a review says in these words of some of the frames from the first to the last."""
    here = edit.frames is None or (edit.frames[0] <= last and first <= edit.frames[1])
    return here and topic_of(edit.doubt) == topic_of(words)


def topic_of(words: str) -> str:
    """What a review says, without its figures, which change when a take is labelled again."""
    return re.sub(r"\d[\d.,]*(?= ?(?:px|mm|%))", "…", words)


def accepted_in(edits: Edits, words: str, frames: np.ndarray) -> np.ndarray:
    """(F,) True in the frames (F,) in which a person accepted what a review says in these words."""
    accepted = np.zeros(len(frames), bool)
    for edit in edits:
        if isinstance(edit, Accepted) and topic_of(edit.doubt) == topic_of(words):
            accepted |= True if edit.frames is None else _within(frames, edit.frames)
    return accepted


def right_in(edits: Edits, names: Mapping[str, int], frames: np.ndarray) -> np.ndarray:
    """(F, M) True where markers were looked at and are right, in some frames (F,) of the source's numbers.

    names are the indices of the M markers, aliases too. What a later edit gives or takes is open again.
    """
    right = np.zeros((len(frames), max(names.values(), default=-1) + 1), bool)
    for edit in edits:
        if isinstance(edit, Right | Swap | UnlabelMarker | AssignPoint):
            span = edit.frames
            rows = slice(None) if span is None else slice(*np.searchsorted(frames, [span[0], span[1] + 1]).tolist())
            for name in edit.markers if isinstance(edit, Swap) else (edit.marker,):
                if name in names:
                    right[rows, names[name]] = isinstance(edit, Right)
    return right


def settled_in(edits: Edits, trajectory: int, first: int, last: int) -> bool:
    """Whether a person said of all frames of a trajectory without a name that it is no marker."""
    left = [(first, last)]
    for edit in edits:
        if isinstance(edit, Delete) and edit.point == trajectory:
            own = (first, last) if edit.frames is None else edit.frames
            left = [part for one in left for part in _outside(one, own)]
    return not left


def _outside(one: tuple[int, int], other: tuple[int, int]) -> list[tuple[int, int]]:
    """What is left of a range of frames without another."""
    parts = [(one[0], min(one[1], other[0] - 1)), (max(one[0], other[1] + 1), one[1])]
    return [part for part in parts if part[0] <= part[1]]


def _within(frames: np.ndarray, span: tuple[int, int]) -> np.ndarray:
    return (frames >= span[0]) & (frames <= span[1])


def _enough(right: np.ndarray) -> np.ndarray:
    """(T,) whether what is asked about N markers, right in some frames (T, N), is answered: of two, one says it."""
    return right.all(axis=1) if right.shape[1] > PAIR else right.any(axis=1)


def _rest(suspect: Suspect, answered: np.ndarray) -> list[Suspect]:
    """What is left of a suspect of which some frames are answered."""
    if not answered.any():
        return [suspect]
    frames = suspect.first + np.arange(len(answered))
    parts = suspect_ranges(frames, ~answered, suspect.words, 1)
    return [replace(suspect, first=part.first, last=part.last, doubtful=None) for part in parts]
