# SPDX-License-Identifier: GPL-3.0-or-later
"""Which names a dot may have: the markers that are missing, the one that should be nearest to it first."""

from collections.abc import Sequence

import numpy as np

from ..core.data.takes import NO_MARKER
from .picking import missing
from .stored import Stored


def predicted(stored: Stored, index: int, markers: Sequence[int]) -> np.ndarray:
    """(K, 3) m where some markers should be in frame `index`: NaN where nothing tells.

    The body carries a marker there, off by as much as it was where the marker was seen last and next; without a body it
    is taken to go straight from the one to the other.
    """
    return np.array([_predicted(stored, index, marker) for marker in markers]).reshape(-1, 3)


def _predicted(stored: Stored, index: int, marker: int) -> np.ndarray:
    seen, carried = stored.motion.markers[:, marker], stored.motion.expected[:, marker]
    body = bool(np.isfinite(carried[index]).all())
    known = np.isfinite(seen).all(axis=1)
    if body:
        known = known & np.isfinite(carried).all(axis=1)
    at = np.flatnonzero(known)
    if not len(at):
        return carried[index]
    after = int(np.searchsorted(at, index))
    ends = at[[max(after - 1, 0), min(after, len(at) - 1)]]
    values = seen[ends] - carried[ends] if body else seen[ends]
    share = (index - ends[0]) / (ends[1] - ends[0]) if ends[1] > ends[0] else 0.0
    between = values[0] + share * (values[1] - values[0])
    return carried[index] + between if body else between


def likely_markers(stored: Stored, index: int, point: int, xyz: np.ndarray) -> list[int]:
    """All markers, the likeliest for the dot of trajectory `point` at xyz (3,) m in frame `index` first.

    First come those that nothing is in this frame, of which those that the trajectory is in other frames; then those
    that another dot is. Of each the nearest first, and what cannot be told last.
    """
    count = len(stored.names)
    free = missing(stored, index)
    off = np.linalg.norm(predicted(stored, index, range(count)) - xyz, axis=1)
    names = stored.labels.marker[stored.rows.trajectory == point]
    elsewhere = np.zeros(count, dtype=bool)
    elsewhere[names[names != NO_MARKER]] = True
    return np.lexsort((np.nan_to_num(off, nan=np.inf), ~(free & elsewhere), ~free)).tolist()


def on_ray(origin: np.ndarray, direction: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(3,) m the place on a ray, from origin (3,) along direction (3,), that is nearest to a place (3,)."""
    along = direction / np.linalg.norm(direction)
    return origin + max(float((near - origin) @ along), 0.0) * along
