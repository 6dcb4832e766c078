# SPDX-License-Identifier: GPL-3.0-or-later
"""Which samples of which markers are doubtful and nobody looked at: what is asked in words, as a table."""

import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from ..data.takes import BY_EDIT, NO_MARKER, Blobs, Labels, Motion, PointRows, Suspect
from ..edits.kinds import NO_EDITS, Edits
from .answering import accepted_in, right_in
from .suspects import FAR_OFF, JUMPS, find_suspects, suspect_ranges

WHOLE_FRAME = "the placement is only"  # what begins the doubts that are about all markers of their frames


MIN_SURE = 0.99  # learned: of a point's name, a share of right ones as training counts it; 1 % are wrong below


def doubtful_samples(
    rows: Blobs | PointRows,
    labels: Labels,
    motion: Motion,
    suspects: Iterable[Suspect],
    names: Sequence[str],
    rate: float,
    edits: Edits = NO_EDITS,
    words: Mapping[str, int] | None = None,
) -> np.ndarray:
    """(F, M) True for markers that are doubtful in a frame, and that no person named there or said to be right.

    suspects are what no edit answers; words the index of each marker by all that edits may call it. What a list of
    suspects sums up over many frames, the motion tells frame by frame.
    """
    names_asked = AskedNames.of(rows, labels, motion.residual.shape)
    return doubtful_of(
        names_asked, motion.frames, find_suspects(motion, tuple(names), rate), suspects, names, edits, words
    )


@dataclass(frozen=True, eq=False)
class AskedNames:
    """What is said of the names of markers in frames, each (F, M): `unsure` ones, and those given `by_hand`."""

    unsure: np.ndarray
    by_hand: np.ndarray

    @classmethod
    def of(cls, rows: Blobs | PointRows, labels: Labels, shape: tuple[int, int]) -> Self:
        """Those of rows and their labels."""
        by_hand, at = np.zeros(shape, bool), np.flatnonzero((labels.step == BY_EDIT) & (labels.marker != NO_MARKER))
        by_hand[rows.frame[at], labels.marker[at]] = True
        unsure = np.zeros(shape, bool)
        if isinstance(rows, PointRows):  # of blobs every camera has its own say
            at = np.flatnonzero((labels.marker != NO_MARKER) & (labels.confidence < MIN_SURE))
            unsure[rows.frame[at], labels.marker[at]] = True
        return cls(unsure, by_hand)

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """Those of several parts, one after the other."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts]) for name in ("unsure", "by_hand")))


def doubtful_of(
    asked: AskedNames,
    frames: np.ndarray,
    exact: Iterable[Suspect],
    suspects: Iterable[Suspect],
    names: Sequence[str],
    edits: Edits = NO_EDITS,
    words: Mapping[str, int] | None = None,
) -> np.ndarray:
    """The same by what is said of the names, of frames (F,) by the source's numbers, and what the motion tells."""
    words, doubtful = words or {name: index for index, name in enumerate(names)}, asked.unsure.copy()
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
            for said in (f"{name} {FAR_OFF}", f"{name} {JUMPS}", f"{name} is off the body at times"):
                doubtful[:, index] &= ~accepted_in(edits, said, frames)
    return doubtful & ~asked.by_hand


def markers_meant(suspect: Suspect, of_word: Mapping[str, int]) -> list[int]:
    """The markers that a suspect is about: those that it gives, else those whose names are among its words."""
    # A colon may be a part of a name, that of its subject before it.
    words = suspect.markers or [word.rstrip(":") for word in re.findall(r"[^\s,;]+", suspect.words)]
    return [of_word[word] for word in dict.fromkeys(words) if word in of_word]


def doubtful_ranges(doubtful: np.ndarray, frames: np.ndarray, names: Sequence[str]) -> dict[str, list[list[int]]]:
    """Doubtful samples (F, M) as the first and last frame of each range, by the source's numbers, of each marker."""
    found = {}
    for index in np.flatnonzero(doubtful.any(axis=0)).tolist():
        found[names[index]] = [[one.first, one.last] for one in suspect_ranges(frames, doubtful[:, index], "", 1)]
    return found
