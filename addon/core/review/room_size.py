# SPDX-License-Identifier: GPL-3.0-or-later
"""How large what the cameras see is, by blobs without names: a room in the wrong unit is a thousand times too large."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..data.markersets import MarkerSet
from ..geometry.triangulation import meet_rows
from .camera_order import Agreement


@dataclass(frozen=True)
class SizeOptions:
    """When a room is of the wrong size; reckoned: units differ by powers of ten, people by less than two.

    part         of the points, in percent from below and above, that the size is taken without: ghosts and false
                 crossings
    min_points   in a frame, as parts of the set's markers, before its size is told
    min_frames   whose size is told
    max_times    larger, or smaller, than the set's markers at rest is what a person may be: more people, or one who
                 crouches
    """

    part: float = 10.0
    min_points: float = 0.3
    min_frames: int = 3
    max_times: float = 5.0


SIZING = SizeOptions()


def times_too_large(agreement: Agreement, markerset: MarkerSet) -> tuple[float, float]:
    """By how many times a room is too large, a power of ten or 1 where it may be right; and m that is seen upwards."""
    rest = _extents(markerset.rest_markers * markerset.spread.height).max()
    seen = [_extents(points) for points in sure_points(agreement) if len(points) >= SIZING.min_points * len(markerset)]
    if len(seen) < SIZING.min_frames:
        return 1.0, np.nan
    along = np.median(seen, axis=0)
    # More people lie beside each other and not above: too large is what is too high as well.
    times = along[2] / rest if along[2] > rest else min(along.max() / rest, 1.0)
    if 1 / SIZING.max_times <= times <= SIZING.max_times:
        return 1.0, float(along[2])
    return float(10.0 ** np.round(np.log10(times))), float(along[2])


def sure_points(agreement: Agreement) -> list[np.ndarray]:
    """Frame by frame points (N, 3) m of two blobs, in two cameras, that lie on each other's epipolar lines alone."""
    frames: list[list[np.ndarray]] = []
    for one, other in combinations(range(len(agreement.cameras)), 2):
        for index, (a, b, near) in enumerate(agreement.on_lines(one, other)):
            if len(frames) <= index:
                frames.append([])
            if not near.size:
                continue
            alone = near & (near.sum(axis=1, keepdims=True) == 1) & (near.sum(axis=0, keepdims=True) == 1)
            first, second = np.nonzero(alone)
            image = np.concatenate([a[first, :2], b[second, :2]])
            camera = np.repeat([one, other], len(first))
            number = np.tile(np.arange(len(first)), 2)
            frames[index].append(meet_rows(agreement.cameras, camera, image, number, len(first)))
    joined = [np.concatenate([*parts, np.zeros((0, 3))]) for parts in frames]
    return [points[np.isfinite(points).all(axis=1)] for points in joined]


def _extents(points: np.ndarray) -> np.ndarray:
    """(3,) how far points (N, 3) reach along each axis, without the outermost."""
    low, high = np.percentile(points, [SIZING.part, 100 - SIZING.part], axis=0)
    return high - low
