# SPDX-License-Identifier: GPL-3.0-or-later
"""The dots of a frame, which of them a person points at, in pixels of a region, and which names they may have."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..core.body.sides import side_in
from ..core.data.takes import NO_MARKER, NO_POINT, rows_in_frame
from .stored import Stored

MIN_DEPTH = 1e-6  # of homogeneous coordinates: what is nearer lies behind the viewer


@dataclass(frozen=True, eq=False)
class Dots:
    """The K dots of one frame of a take of points: its points, and the markers that a person placed."""

    trajectory: np.ndarray  # (K,) the number of each point's trajectory, NO_POINT for a marker that was placed
    marker: np.ndarray  # (K,) which marker it is, NO_MARKER where it has no name
    xyz: np.ndarray  # (K, 3) m

    def __len__(self) -> int:
        return len(self.marker)

    def of(self, points: Sequence[int]) -> np.ndarray:
        """(K,) True for the points of some trajectories."""
        return np.isin(self.trajectory, points)


def dots_of(stored: Stored, index: int) -> Dots:
    """The dots of frame `index`."""
    rows = rows_in_frame(stored.rows, index)
    placed = np.array([marker for frame, marker in stored.placed if frame == index], dtype=int)
    return Dots(
        np.concatenate([stored.rows.trajectory[rows], np.full(len(placed), NO_POINT)]),
        np.concatenate([stored.labels.marker[rows], placed]),
        np.concatenate([stored.rows.xyz[rows], stored.motion.markers[index, placed]]),
    )


def missing(stored: Stored, index: int) -> np.ndarray:
    """(M,) True for the markers that nothing is in frame `index`; what is filled is nothing that was seen."""
    return ~np.isfinite(stored.unfilled.markers[index]).all(axis=1)


def to_region(points: np.ndarray, perspective: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(..., 2) px in a region of `size` of points (..., 3) m, by its perspective matrix; NaN behind the viewer."""
    flat = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ perspective.T
    with np.errstate(invalid="ignore", divide="ignore"):
        image = flat[..., :2] / np.where(flat[..., 3:] > MIN_DEPTH, flat[..., 3:], np.nan)
    return (image + 1) / 2 * np.asarray(size, dtype=float)


def nearest(places: np.ndarray, mouse: tuple[float, float], radius: float) -> int | None:
    """Which of places (K, 2) px is nearest to the mouse, None where none is within `radius` px."""
    off = np.hypot(*(places - np.asarray(mouse, dtype=float)).T)
    off[~np.isfinite(off)] = np.inf
    return int(off.argmin()) if len(off) and off.min() <= radius else None


def inside_box(places: np.ndarray, one: tuple[float, float], other: tuple[float, float]) -> np.ndarray:
    """(K,) True for places (K, 2) px in the box between two of its corners."""
    lower, upper = np.minimum(one, other), np.maximum(one, other)
    return ((places >= lower) & (places <= upper)).all(axis=1)


def inside_lasso(places: np.ndarray, outline: np.ndarray) -> np.ndarray:
    """(K,) True for places (K, 2) px inside a closed outline (L, 2) px.

    A ray from there to the right crosses the outline an odd number of times.
    """
    begin, end = outline, np.roll(outline, -1, axis=0)
    x, y = places[:, :1], places[:, 1:]
    spans = (begin[:, 1] > y) != (end[:, 1] > y)
    rise = end[:, 1] - begin[:, 1]
    with np.errstate(invalid="ignore", divide="ignore"):
        crossing = begin[:, 0] + (y - begin[:, 1]) / rise * (end[:, 0] - begin[:, 0])
        return (spans & (x < crossing)).sum(axis=1) % 2 == 1


def combined(before: list[int], found: list[int], mode: str) -> list[int]:
    """What is picked once `found` was picked: SET in place of what was, ADD to it, or TOGGLE each."""
    if mode == "SET":
        return list(dict.fromkeys(found))
    kept = [point for point in before if mode == "ADD" or point not in found]
    return [*kept, *(point for point in dict.fromkeys(found) if point not in before)]


def path_of(stored: Stored, rows: np.ndarray, index: int, reach: int, most: int) -> tuple[np.ndarray, np.ndarray]:
    """Where a trajectory is around frame `index`: (S, 2, 3) m the ends of lines, (S,) True where it has a name.

    rows are the trajectory's, in the order of the frames; those up to `reach` frames away count, thinned to `most`.
    No line leads across frames without a point.
    """
    frame = stored.rows.frame[rows]
    near = rows[slice(*np.searchsorted(frame, [index - reach, index + reach + 1]).tolist())]
    step = max(1, len(near) // most)
    follow = np.diff(stored.rows.frame[near]) == 1
    # A line between two that are kept is whole only where all in between follow each other.
    kept = near[::step]
    whole = np.diff(np.concatenate([[0], np.cumsum(~follow)])[::step]) == 0
    xyz = stored.rows.xyz[kept]
    return np.stack([xyz[:-1], xyz[1:]], axis=1)[whole], (stored.labels.marker[kept[:-1]] != NO_MARKER)[whole]


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
    between = np.full(values.shape[1:], 0.0 if body else np.nan)
    known = np.isfinite(values[..., 0])
    for marker in np.flatnonzero(known.any(axis=0)):
        at = np.flatnonzero(known[:, marker])
        between[marker] = [np.interp(here, at, axis) for axis in values[at, marker].T]
    return carried[here] + between if body else between


def likely_markers(stored: Stored, index: int, rows: np.ndarray, xyz: np.ndarray) -> list[int]:
    """All markers, the likeliest for the dot of a trajectory with these rows, at xyz (3,) m in a frame, first."""
    free = missing(stored, index)
    off = np.linalg.norm(predicted(stored, index) - xyz, axis=1)
    return ranked(off, free, stored.labels.marker[rows], stored.names, limbs(stored, index))


def limbs(stored: Stored, index: int) -> np.ndarray:
    """(M,) on which limb the body of frame `index` has each marker, by the limb's first joint; -1 where nothing tells.

    A limb goes from where the skeleton branches to its end, or to where it branches again.
    """
    expected, joints, parents = (
        stored.motion.expected[index],
        stored.motion.joints[index],
        np.array(stored.parents, int),
    )
    if not len(parents) or not np.isfinite(expected).any():
        return np.full(len(expected), -1)
    child = np.flatnonzero(parents >= 0)
    children = np.bincount(parents[child], minlength=len(parents))
    first = np.arange(len(parents))
    for joint in child:  # behind its parent
        if children[parents[joint]] == 1:
            first[joint] = first[parents[joint]]
    # The bones, each turning about the joint that it begins at; the last of a limb is known by its joint alone.
    end = np.flatnonzero(children == 0)
    begins, ends = np.append(parents[child], end), np.append(child, end)
    along = joints[ends] - joints[begins]
    away = expected[:, None] - joints[begins]
    length = np.maximum((along**2).sum(axis=1), 1e-9)
    share = np.clip((away * along).sum(axis=2) / length, 0, 1)
    off = np.linalg.norm(away - share[..., None] * along, axis=2)
    there = np.isfinite(off).any(axis=1)
    return np.where(there, first[begins[np.nan_to_num(off, nan=np.inf).argmin(axis=1)]], -1)


def ranked(off: np.ndarray, free: np.ndarray, named: np.ndarray, names: Sequence[str], limb: np.ndarray) -> list[int]:
    """The M markers, the likeliest for a dot first.

    off (M,) is how far each is from it, NaN where nothing tells; free (M,) those that nothing is, named (N,) those that
    the same trajectory is in any frames; limb (M,) as `limbs` gives it. First come those that are both free and named;
    then the NEAREST around the dot and what is free on the limb of the nearest of all, the free ones first; then the
    rest. What is on the other side than that comes last: a right hand is no left thigh, though that is all that is
    missing.
    """
    off, known, elsewhere = np.nan_to_num(off, nan=np.inf), set(names), np.isin(np.arange(len(names)), named)
    sides = np.array([side_in(name, known) for name in names])
    here = sides[off.argmin()]
    other = (here != "") & (sides != "") & (sides != here)
    near = np.zeros(len(names), bool)
    near[np.lexsort((off, other))[:NEAREST]] = True
    near |= free & (limb == limb[off.argmin()]) & (limb >= 0)
    return np.lexsort((off, ~(free & near), other, ~near, ~(free & elsewhere))).tolist()


def on_ray(origin: np.ndarray, direction: np.ndarray, near: np.ndarray) -> np.ndarray:
    """(3,) m the place on a ray, from origin (3,) along direction (3,), that is nearest to a place (3,)."""
    along = direction / np.linalg.norm(direction)
    return origin + max(float((near - origin) @ along), 0.0) * along
