# SPDX-License-Identifier: GPL-3.0-or-later
"""The dots of a frame and which of them a person points at, in pixels of a region: plain arrays, no Blender."""

from dataclasses import dataclass

import numpy as np

from ..core.data.takes import NO_MARKER, NO_POINT, rows_in_frame
from .stored import Stored

MIN_DEPTH = 1e-6  # of homogeneous coordinates: what is nearer lies behind the viewer


@dataclass(frozen=True, eq=False)
class Dots:
    """The K dots of one frame of a take of points: its points, and the markers that a person placed.

    trajectory  (K,) the number of each point's trajectory, NO_POINT for a marker that was placed
    marker      (K,) which marker it is, NO_MARKER where it has no name
    xyz         (K, 3) m
    """

    trajectory: np.ndarray
    marker: np.ndarray
    xyz: np.ndarray

    def __len__(self) -> int:
        return len(self.marker)

    def of(self, points: list[int]) -> np.ndarray:
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
