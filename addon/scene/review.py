# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person wants to know of a labelled take before trusting it, marker by marker."""

from dataclasses import dataclass

import numpy as np

from ..core.data.takes import Motion


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
    rows = []
    there = np.isfinite(motion.markers[..., 0]).T.copy()  # a place is whole or not at all
    means = [_means(values, there) for values in (motion.residual, motion.residual_px)]
    for index, name in enumerate(names):
        starts, lengths = _runs(~there[index])
        first = int(starts[0]) if len(starts) else -1
        found, longest = int(there[index].sum()), int(lengths.max(initial=0))
        rows.append(MarkerReview(name, found, len(starts), longest, first, *(float(mean[index]) for mean in means)))
    return rows


def _runs(flags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where runs of True begin and how long they are."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(np.int8)))
    return edges[::2], edges[1::2] - edges[::2]


def _means(values: np.ndarray, there: np.ndarray) -> np.ndarray:
    """(M,) the mean of what is known of values (F, M) where a marker is there (M, F); NaN without any."""
    known = np.isfinite(values)
    if not known.any():
        return np.full(values.shape[1], np.nan)
    known &= there.T
    count = known.sum(axis=0)
    total = np.where(known, values, 0.0).sum(axis=0)
    return np.where(count > 0, total / np.maximum(count, 1), np.nan)
