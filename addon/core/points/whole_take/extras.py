# SPDX-License-Identifier: GPL-3.0-or-later
"""What is on the subject and none of the set's markers: each a marker of its own, without a name."""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_MARKER
from .tracklets import Tracklets


@dataclass(frozen=True)
class ExtraOptions:
    """What is taken for an extra marker. All reckoned.

    min_frames  of a tracklet from which one is started
    crowd       times as many tracklets as markers, in the usual frame, where there are some: fewer are ghosts
    """

    min_frames: int = 30
    crowd: float = 1.8


EXTRAS = ExtraOptions()


def with_extras(tracklets: Tracklets, marker: np.ndarray, markers: int) -> tuple[np.ndarray, int]:
    """The markers (N,) with extra ones, numbered from `markers` on, and how many there are.

    Extras so far that a tracklet still is stay. Where many more tracklets than markers are there at a time, those
    without a name that are there in the frame in which most of them are become one extra each. The rest of their
    tracklets is for the take to find.
    """
    before, number = np.unique(marker[marker >= markers], return_inverse=True)
    marker = marker.copy()
    marker[marker >= markers] = markers + number
    known = markers + len(before)
    long = tracklets.count >= EXTRAS.min_frames
    frames = np.arange(int(tracklets.last.max(initial=0)) + 1)
    begun = np.searchsorted(np.sort(tracklets.first[long]), frames, side="right")
    ended = np.searchsorted(np.sort(tracklets.last[long]), frames, side="left")
    usual = float(np.median(begun - ended))
    free = np.flatnonzero((marker == NO_MARKER) & long)
    if usual < EXTRAS.crowd * markers or not len(free):
        return marker, len(before)
    first, last = tracklets.first[free], tracklets.last[free]
    there = (first[:, None] <= first) & (first <= last[:, None])
    together = free[there[:, there.sum(axis=0).argmax()]]
    together = together[np.argsort(-tracklets.count[together], kind="stable")]
    marker[together] = known + np.arange(len(together))
    return marker, len(before) + len(together)
