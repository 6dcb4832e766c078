# SPDX-License-Identifier: GPL-3.0-or-later
"""Which names a dot may have: of the markers around it those that are missing, the nearest first."""

from collections.abc import Sequence

import numpy as np

from ..core.body.anatomy import side_in
from ..core.data.takes import NO_MARKER
from .picking import missing
from .stored import Stored

NEAREST = 6  # markers that a dot may well be: as many as a pie has pieces for, beside those for all names and for none
NEAR_SECONDS = 5.0  # to each side: in more time a marker may have been placed again, or the body was lost between


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

    They are `ranked` by how far they are or should be.
    """
    free = missing(stored, index)
    off = np.linalg.norm(predicted(stored, index) - xyz, axis=1)
    names = stored.labels.marker[rows]
    elsewhere = np.bincount(names[names != NO_MARKER], minlength=len(stored.names)) > 0
    return ranked(off, free, elsewhere, stored.names)


def ranked(off: np.ndarray, free: np.ndarray, elsewhere: np.ndarray, names: Sequence[str]) -> list[int]:
    """The M markers, the likeliest for a dot first.

    off (M,) is how far each is from it, NaN where nothing tells; free (M,) those that nothing is, elsewhere (M,) those
    that the same trajectory is in other frames. First come those that are both; then the NEAREST around the dot, of
    which the free ones first; then the rest. What is on the other side than the nearest of all comes last: a right hand
    is no left thigh, though that is all that is missing.
    """
    off, known = np.nan_to_num(off, nan=np.inf), set(names)
    sides = np.array([side_in(name, known) for name in names])
    here = sides[off.argmin()]
    other = (here != "") & (sides != "") & (sides != here)
    near = np.zeros(len(names), bool)
    near[np.lexsort((off, other))[:NEAREST]] = True
    return np.lexsort((off, ~(free & near), other, ~near, ~(free & elsewhere))).tolist()


def on_ray(origin: np.ndarray, direction: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(3,) m the place on a ray, from origin (3,) along direction (3,), that is nearest to a place (3,)."""
    along = direction / np.linalg.norm(direction)
    return origin + max(float((near - origin) @ along), 0.0) * along
