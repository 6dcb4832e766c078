# SPDX-License-Identifier: GPL-3.0-or-later
"""Which samples of which markers are doubtful and nobody looked at: what is asked in words, as a table."""

import re
from collections.abc import Iterable, Mapping, Sequence

import numpy as np

from ..data.takes import BY_EDIT, NO_MARKER, Blobs, Labels, PointRows, Suspect
from ..edits.kinds import NO_EDITS, Edits
from .answering import accepted_in, right_in
from .suspects import FAR_OFF, JUMPS, runs

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


def add_ranges(known: Mapping[str, list[list[int]]], flags: np.ndarray, frames: np.ndarray):
    """Adds the flags (F, M) of the next frames (F,) to the first and last frame of each range, by the M markers' names.

    What goes on from what was added before is one range with it.
    """
    spans = list(known.values())
    for index in np.flatnonzero(flags.any(axis=0)).tolist():
        for start, stop in runs(flags[:, index]):
            first, last = int(frames[start]), int(frames[stop - 1])
            if spans[index] and spans[index][-1][1] + 1 == first:
                spans[index][-1][1] = last
            else:
                spans[index].append([first, last])
