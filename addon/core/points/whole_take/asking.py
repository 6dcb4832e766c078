# SPDX-License-Identifier: GPL-3.0-or-later
"""Which frames of a take are named on their own: a few of them, as those near each other show the same pose."""

from dataclasses import dataclass

import numpy as np

from ...data.lanes import blocks


@dataclass(frozen=True)
class AskingOptions:
    """How often frames are named on their own.

    rate  measured: frames a second; with 10 names of 2 % of a part of acrobatics are wrong, 30 change no label of it
    """

    rate: float = 15.0


ASKING = AskingOptions()


def asked_frames(tracklet: np.ndarray, rate: float) -> np.ndarray:
    """(F,) the frames to name first, of tracklets (T, P) at `rate` frames a second: no tracklet has none."""
    chosen = _every(len(tracklet), rate)
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


def _every(frames: int, rate: float) -> np.ndarray:
    """(T,) True for as many of so many frames, of `rate` a second, as are to be named."""
    chosen = np.zeros(frames, dtype=bool)
    chosen[:: max(round(rate / ASKING.rate), 1)] = True
    return chosen
