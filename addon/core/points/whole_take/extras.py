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
    crowd       times as many tracklets as markers, in the usual frame, where there are some: fewer are ghosts, but
    min_rest    where tracklets without a name fill this part of the take, while a marker is there for less than it:
                they may be that marker, or one whose name it has
    """

    min_frames: int = 30
    crowd: float = 1.8
    min_rest: float = 0.5


EXTRAS = ExtraOptions()


def is_crowd(tracklets: Tracklets, markers: int) -> bool:
    """Whether many more tracklets than markers are there in the usual frame."""
    long = tracklets.count >= EXTRAS.min_frames
    frames = np.arange(int(tracklets.last.max(initial=0)) + 1)
    begun = np.searchsorted(np.sort(tracklets.first[long]), frames, side="right")
    ended = np.searchsorted(np.sort(tracklets.last[long]), frames, side="left")
    return float(np.median(begun - ended)) >= EXTRAS.crowd * markers


def with_extras(
    tracklets: Tracklets, marker: np.ndarray, markers: int, missing: bool = False
) -> tuple[np.ndarray, int]:
    """The markers (N,) with extra ones, numbered from `markers` on, and how many there are.

    Extras so far that a tracklet still is stay. In a crowd and, with `missing`, where a marker is missing and there is
    something to be it, those without a name that are there in the frame in which most of them are become one extra
    each. The rest of their tracklets is for the take to find.
    """
    before, number = np.unique(marker[marker >= markers], return_inverse=True)
    marker = marker.copy()
    marker[marker >= markers] = markers + number
    known = markers + len(before)
    free = np.flatnonzero((marker == NO_MARKER) & (tracklets.count >= EXTRAS.min_frames))
    shifted = missing and _is_shifted(tracklets, marker, free, markers)
    if not len(free) or not (shifted or is_crowd(tracklets, markers)):
        return marker, len(before)
    first, last = tracklets.first[free], tracklets.last[free]
    count = np.searchsorted(np.sort(first), first, side="right") - np.searchsorted(np.sort(last), first)
    fullest = first[count.argmax()]
    together = free[(first <= fullest) & (fullest <= last)]
    together = together[np.argsort(-tracklets.count[together], kind="stable")]
    marker[together] = known + np.arange(len(together))
    return marker, len(before) + len(together)


def _is_shifted(tracklets: Tracklets, marker: np.ndarray, free: np.ndarray, markers: int) -> bool:
    """Whether names (N,) may be one place off: a marker is missing while tracklets that are `free` could be it."""
    least = EXTRAS.min_rest * (int(tracklets.last.max(initial=0)) + 1)
    named = (marker != NO_MARKER) & (marker < markers)
    frames = np.bincount(marker[named], tracklets.count[named], markers)
    return bool(tracklets.count[free].sum() >= least and (frames < least).any())
