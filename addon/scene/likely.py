# SPDX-License-Identifier: GPL-3.0-or-later
"""Which names a dot may have: the markers that are missing, the one that should be nearest to it first."""

import numpy as np

from ..core.data.takes import NO_MARKER
from .picking import missing
from .stored import Stored

NEAR_SECONDS = 5.0  # to each side: in more time a marker may have been placed anew, or the body was lost between


def predicted(stored: Stored, index: int) -> np.ndarray:
    """(M, 3) m where each marker should be in frame `index`: NaN where nothing tells.

    The body carries a marker there, off by as much as it was where the marker was seen last and next; without a body it
    is taken to go straight from the one to the other. What was not seen for NEAR_SECONDS tells nothing of that.
    """
    reach = round(NEAR_SECONDS * stored.rate)
    near = slice(max(index - reach, 0), index + reach + 1)
    here = index - near.start
    seen, carried = stored.motion.markers[near], stored.motion.expected[near]
    body = bool(np.isfinite(carried[here]).any())
    values = seen - carried if body else seen
    known = np.isfinite(values[..., 0])
    number = np.arange(len(known))[:, None]
    before = np.where(known[: here + 1], number[: here + 1], -1).max(axis=0)
    after = np.where(known[here:], number[here:], len(known)).min(axis=0)
    only_after, only_before = before < 0, after >= len(known)
    begin, end = np.where(only_after, after, before), np.where(only_before, before, after)
    never = only_after & only_before
    begin, end = np.where(never, 0, begin), np.where(never, 0, end)
    share = ((here - begin) / np.maximum(end - begin, 1))[:, None]
    markers = np.arange(values.shape[1])
    one, other = values[begin, markers], values[end, markers]
    between = np.where((begin == end)[:, None], one, one + share * (other - one))
    between[never] = 0.0 if body else np.nan
    return carried[here] + between if body else between


def likely_markers(stored: Stored, index: int, rows: np.ndarray, xyz: np.ndarray) -> list[int]:
    """All markers, the likeliest for the dot of a trajectory, whose rows are given, at xyz (3,) m in a frame first.

    First come those that nothing is in this frame, of which those that the trajectory is in other frames; then those
    that another dot is. Of each the nearest first, and what cannot be told last.
    """
    free = missing(stored, index)
    off = np.linalg.norm(predicted(stored, index) - xyz, axis=1)
    names = stored.labels.marker[rows]
    elsewhere = np.bincount(names[names != NO_MARKER], minlength=len(stored.names)) > 0
    return np.lexsort((np.nan_to_num(off, nan=np.inf), ~(free & elsewhere), ~free)).tolist()


def on_ray(origin: np.ndarray, direction: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(3,) m the place on a ray, from origin (3,) along direction (3,), that is nearest to a place (3,)."""
    along = direction / np.linalg.norm(direction)
    return origin + max(float((near - origin) @ along), 0.0) * along
