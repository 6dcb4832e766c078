# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person wants to know of a labelled take before trusting it, marker by marker."""

from dataclasses import dataclass

import numpy as np

from ..core.data.takes import Motion
from .stored import Stored, changed_between

# The take that was reviewed last, and what came of it.
_reviewed: list[tuple[Stored, list["MarkerReview"]]] = []


@dataclass(frozen=True)
class MarkerReview:
    """One marker over a take.

    labelled     frames with a position
    gaps         runs of frames without one, those at the ends included
    longest_gap  frames of the longest
    first_gap    index of the frame where the first begins, -1 without gaps
    residual     mean residual, m; NaN when never seen
    residual_px  the same as reprojection error, px
    """

    name: str
    labelled: int
    gaps: int
    longest_gap: int
    first_gap: int
    residual: float
    residual_px: float


def review_markers(names: tuple[str, ...], motion: Motion) -> list[MarkerReview]:
    """A `MarkerReview` for each of the markers, in order."""
    return [review_marker(name, motion, index) for index, name in enumerate(names)]


def review_marker(name: str, motion: Motion, index: int) -> MarkerReview:
    """The `MarkerReview` of one marker."""
    there = np.isfinite(motion.markers[:, index, 0])  # a place is whole or not at all
    starts, lengths = _runs(~there)
    first = int(starts[0]) if len(starts) else -1
    found, longest = int(there.sum()), int(lengths.max(initial=0))
    means = (_mean(values[there, index]) for values in (motion.residual, motion.residual_px))
    return MarkerReview(name, found, len(starts), longest, first, *means)


def _runs(flags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where runs of True begin and how long they are."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return edges[::2], edges[1::2] - edges[::2]


def _mean(values: np.ndarray) -> float:
    """The mean of what is known; NaN where nothing is."""
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else float("nan")


def marker_reviews(stored: Stored) -> list[MarkerReview]:
    """That of each marker of a take as it is; of one that was edited since, only what that changed is looked at."""
    changed = changed_between(_reviewed[0][0], stored) if _reviewed else None
    if changed is None:
        reviews = review_markers(stored.names, stored.unfilled)  # what is filled was not found
    else:
        reviews = _reviewed[0][1]
        for index in changed:
            reviews[index] = review_marker(stored.names[index], stored.unfilled, index)
    _reviewed[:] = [(stored, reviews)]
    return list(reviews)


def forget_reviews():
    """Lets go of what was worked out: another file was loaded, or the extension ends."""
    _reviewed.clear()
