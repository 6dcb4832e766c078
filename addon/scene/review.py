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
    for index, name in enumerate(names):
        seen = np.isfinite(motion.markers[:, index]).all(axis=1)
        starts, lengths = _runs(~seen)
        rows.append(
            MarkerReview(
                name,
                int(seen.sum()),
                len(starts),
                int(lengths.max(initial=0)),
                int(starts[0]) if len(starts) else -1,
                _mean(motion.residual[seen, index]),
                _mean(motion.residual_px[seen, index]),
            )
        )
    return rows


def _runs(flags: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Where runs of True begin and how long they are."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], flags, [False]]).astype(int)))
    return edges[::2], edges[1::2] - edges[::2]


def _mean(values: np.ndarray) -> float:
    values = values[np.isfinite(values)]
    return float(values.mean()) if len(values) else float("nan")
