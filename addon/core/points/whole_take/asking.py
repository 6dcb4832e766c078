# SPDX-License-Identifier: GPL-3.0-or-later
"""Which frames of a take are named on their own: a few of them, and more where these are in doubt.

Frames that are near each other show the same pose and err together, so those between two frames that are sure and agree
say what these do. Where names change, or are not sure, those between are asked too.
"""

from dataclasses import dataclass

import numpy as np

from ...data.lanes import blocks
from ...data.takes import Labels


@dataclass(frozen=True)
class AskingOptions:
    """How often frames are named on their own.

    first_rate      frames a second that are named first; reckoned: votes take a tenth of a second for one witness
    full_rate       the same where those are in doubt: more show the same pose once more; reckoned
    min_confidence  of a name that is sure; reckoned: a vote counts no frame for much more
    max_unsure      part of a frame's names that are not, and
    max_changed     part of the tracklets that it shares with the one before or after whose names differ there, beyond
                    which it is in doubt; both chosen on people left out of training, where names of one subject's
                    model are unsure in a third, and of several subjects' in a tenth
    """

    first_rate: float = 10.0
    full_rate: float = 30.0
    min_confidence: float = 0.95
    max_unsure: float = 0.2
    max_changed: float = 0.1


ASKING = AskingOptions()


def asked_frames(tracklet: np.ndarray, rate: float) -> np.ndarray:
    """(F,) the frames to name first, of tracklets (T, P) at `rate` frames a second: no tracklet has none."""
    chosen = _every(len(tracklet), rate, ASKING.first_rate)
    last = np.full(int(tracklet.max(initial=-1)) + 1, -1)
    for part in blocks(*tracklet.shape):
        row, column = np.nonzero(tracklet[part] >= 0)
        np.maximum.at(last, tracklet[part][row, column], row + part.start)
    seen = last < 0
    some = tracklet[chosen]
    seen[some[some >= 0]] = True
    for one in np.argsort(last, kind="stable").tolist():
        if not seen[one]:
            chosen[last[one]] = True
            here = tracklet[last[one]]
            seen[here[here >= 0]] = True
    return np.flatnonzero(chosen)


def asked_again(said: Labels, asked: np.ndarray, tracklet: np.ndarray, rate: float) -> np.ndarray:
    """(F,) the frames to name as well, on both sides of those `asked` first (N,) in which what is `said` is in doubt.

    Of tracklets (T, L) at `rate` frames a second, with labels (N, L) of the frames asked.
    """
    wanted = np.zeros(len(tracklet), dtype=bool)
    edges = np.concatenate([[-1], asked, [len(tracklet)]])
    for place in np.flatnonzero(_doubted(said, tracklet[asked])).tolist():
        wanted[edges[place] + 1 : edges[place + 2]] = True
    wanted[asked] = False
    return np.flatnonzero(wanted & _every(len(tracklet), rate, ASKING.full_rate))


def _doubted(said: Labels, number: np.ndarray) -> np.ndarray:
    """(N,) whether what is said (N, L) of tracklets of such a number (N, L) is in doubt, of frames in their order."""
    unsure = said.named & (said.confidence < ASKING.min_confidence)
    doubted = unsure.sum(axis=1) > ASKING.max_unsure * said.named.sum(axis=1)
    both = (number[1:] == number[:-1]) & (said.named[1:] | said.named[:-1])
    changed = both & (said.marker[1:] != said.marker[:-1])
    differ = changed.sum(axis=1) > ASKING.max_changed * both.sum(axis=1)
    doubted[1:] |= differ
    doubted[:-1] |= differ
    return doubted


def _every(frames: int, rate: float, wanted: float) -> np.ndarray:
    """(T,) True for as many of so many frames as `wanted` a second, of `rate`: of every so many of the full rate's."""
    step = max(round(rate / ASKING.full_rate), 1)
    chosen = np.zeros(frames, dtype=bool)
    chosen[:: step * max(round(min(rate, ASKING.full_rate) / wanted), 1)] = True
    return chosen
