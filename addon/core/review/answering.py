# SPDX-License-Identifier: GPL-3.0-or-later
"""Doubts that a person has answered, which do not come back; and which samples of which markers are doubtful still."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from ..data.takes import BY_EDIT, NO_MARKER, Blobs, Labels, PointRows, Suspect
from ..edits.kinds import (
    NO_EDITS,
    Accepted,
    AssignBlob,
    AssignPoint,
    Delete,
    Edits,
    PointEdit,
    Right,
    Swap,
    UnlabelMarker,
)
from .suspects import EITHER_WAY, FAR_OFF, JUMPS, suspect_ranges

PAIR = 2  # markers of which a doubt asks which is which


def unanswered(suspects: Iterable[Suspect], edits: Edits, names: Mapping[str, int]) -> tuple[Suspect, ...]:
    """The suspects of a take without the frames in which a person answered them.

    What is asked about a marker is answered by its being right, about a pair of them by one of the two, about more by
    all; what is asked about the name of a trajectory, by its index in the file, by any edit of it, and by an exchange
    of its markers; and which of two is which by the name of one. `names` are the indices of the markers, aliases too.
    """
    left: list[Suspect] = []
    for suspect in suspects:
        markers = {names[name] for name in suspect.markers if name in names}
        own = {name: index for name, index in names.items() if index in markers}
        about = edits.of(edit for edit in edits if own.keys() & set(edit.names) or _is_of_trajectory(edit, suspect))
        if not len(about):
            left.append(suspect)
            continue
        if EITHER_WAY in suspect.words and any(isinstance(edit, AssignBlob | AssignPoint) for edit in about):
            continue
        frames = np.arange(suspect.first, suspect.last + 1)
        right = right_in(about, own, frames)[:, sorted(markers)]
        answered = right.all(axis=1) if len(markers) > PAIR else right.any(axis=1)
        if suspect.trajectory is not None:
            for edit in about:
                if isinstance(edit, Swap) or _is_of_trajectory(edit, suspect):
                    answered |= _within(frames, edit.frames)
        # A change of names is answered where either of its ends is.
        of_a_change = len(suspect.markers) > 1 and suspect.trajectory is not None
        left += [] if of_a_change and answered.any() else _rest(suspect, answered)
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


def accepted_in(edits: Edits, words: str, frames: np.ndarray) -> np.ndarray:
    """(F,) True in the frames (F,) in which a person accepted what a review says in these words."""
    accepted = np.zeros(len(frames), bool)
    for edit in edits:
        if isinstance(edit, Accepted) and _without_figures(edit.doubt) == _without_figures(words):
            accepted |= _within(frames, edit.frames)
    return accepted


def _without_figures(words: str) -> str:
    """What a review says, without its figures, which change when a take is labelled again."""
    return re.sub(r"\d[\d.,]*(?= ?(?:px|mm|%))", "…", words)


def right_in(edits: Edits, names: Mapping[str, int], frames: np.ndarray) -> np.ndarray:
    """(F, M) True where markers were looked at and are right, in some frames (F,) of the source's numbers.

    names are the indices of the M markers, aliases too. What a later edit gives or takes is open again.
    """
    right = np.zeros((len(frames), max(names.values(), default=-1) + 1), bool)
    for edit in edits:
        if isinstance(edit, Right | Swap | UnlabelMarker | AssignPoint):
            span = edit.frames
            rows = slice(None) if span is None else slice(*np.searchsorted(frames, [span[0], span[1] + 1]).tolist())
            for name in edit.names:
                if name in names:
                    right[rows, names[name]] = isinstance(edit, Right)
    return right


def settled_in(edits: Edits, trajectory: int, first: int, last: int) -> bool:
    """Whether a person said of all frames of a trajectory without a name that it is no marker."""
    frames = np.arange(first, last + 1)
    own = (edit for edit in edits if isinstance(edit, Delete) and edit.point == trajectory)
    return bool(np.any([np.zeros(len(frames), bool), *(_within(frames, edit.frames) for edit in own)], axis=0).all())


def _is_of_trajectory(edit: object, suspect: Suspect) -> bool:
    return isinstance(edit, PointEdit) and edit.point == suspect.trajectory


def _within(frames: np.ndarray, span: tuple[int, int] | None) -> np.ndarray:
    """(F,) True for the frames of an edit, which are all where it names none."""
    return np.full(len(frames), True) if span is None else (frames >= span[0]) & (frames <= span[1])


def _rest(suspect: Suspect, answered: np.ndarray) -> list[Suspect]:
    """What is left of a suspect of which some frames are answered."""
    if not answered.any():
        return [suspect]
    frames = suspect.first + np.arange(len(answered))
    parts = suspect_ranges(frames, ~answered, suspect.words, 1)
    return [replace(suspect, first=part.first, last=part.last, doubtful=None) for part in parts]


WHOLE_FRAME = "the placement is only"  # what begins the doubts that are about all markers of their frames
MIN_SURE = 0.99  # learned: of a point's name, a share of right ones as training counts it; 1 % are wrong below


def doubtful_samples(
    rows: Blobs | PointRows,
    labels: Labels,
    frames: np.ndarray,
    exact: Iterable[Suspect],
    suspects: Iterable[Suspect],
    names: Sequence[str],
    edits: Edits = NO_EDITS,
    words: Mapping[str, int] | None = None,
) -> np.ndarray:
    """(F, M) True for markers that are doubtful in a frame, and that no person named there or said to be right.

    Rows and labels are those of frames (F,), by the source's numbers. `suspects` are what no edit answers; what they
    sum up over many frames, `exact` tells frame by frame, as `find_suspects` of the motion does. words are the index of
    each marker by all that edits may call it.
    """
    words = words or {name: index for index, name in enumerate(names)}
    doubtful = np.zeros((len(frames), len(names)), bool)
    named = np.flatnonzero(labels.marker != NO_MARKER)
    if isinstance(rows, PointRows):  # of blobs every camera has its own say
        unsure = named[labels.confidence[named] < MIN_SURE]
        doubtful[rows.frame[unsure], labels.marker[unsure]] = True
    listed = [one for one in suspects if FAR_OFF not in one.words and JUMPS not in one.words]
    for suspect in (*exact, *listed):
        part = slice(*np.searchsorted(frames, [suspect.first, suspect.last + 1]).tolist())
        own = markers_meant(suspect, words)
        if not own and suspect.words.startswith(WHOLE_FRAME):
            own = list(range(len(names)))
        doubtful[part, own] = True
    if len(edits):
        right = right_in(edits, words, frames)
        doubtful[:, : right.shape[1]] &= ~right
        for index, name in enumerate(names):
            for reason in (f"{name} {FAR_OFF}", f"{name} {JUMPS}", f"{name} is off the body at times"):
                doubtful[:, index] &= ~accepted_in(edits, reason, frames)
    given = named[labels.step[named] == BY_EDIT]
    doubtful[rows.frame[given], labels.marker[given]] = False
    return doubtful


def markers_meant(suspect: Suspect, of_word: Mapping[str, int]) -> list[int]:
    """The markers that a suspect is about: those that it gives, else those whose names are among its words."""
    # A colon may be a part of a name, that of its subject before it.
    words = suspect.markers or [word.rstrip(":") for word in re.findall(r"[^\s,;]+", suspect.words)]
    return [of_word[word] for word in dict.fromkeys(words) if word in of_word]
