# SPDX-License-Identifier: GPL-3.0-or-later
"""How large what the cameras see is, by blobs without names: a room in the wrong unit is a thousand times too large."""

from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ..data.markersets import MarkerSet
from ..geometry.triangulation import meet_rows
from .camera_order import CameraAgreement


@dataclass(frozen=True)
class SizeOptions:
    """When a room is of the wrong size; reckoned: units differ by powers of ten, people by less than two.

    part         of the points, in percent from below and above, that the size is taken without: ghosts and false
                 crossings
    min_points   in a frame before its size is given: one lamp has none
    min_part     of the set's markers that these are
    min_frames   whose size is given
    max_times    larger, or smaller, than the set's markers at rest is what a person may be: more people, or one who
                 crouches
    """

    part: float = 10.0
    min_points: int = 6
    min_part: float = 0.3
    min_frames: int = 3
    max_times: float = 5.0


SIZING = SizeOptions()


def times_too_large(agreement: CameraAgreement, markerset: MarkerSet) -> tuple[float, float]:
    """By how many times a room is too large, a power of ten or 1 where it may be right; and m that is seen upwards."""
    rest = _extents(markerset.rest_markers * markerset.spread.height).max()
    least = max(SIZING.min_points, SIZING.min_part * len(markerset))
    seen = [_extents(points) for points in sure_points(agreement) if len(points) >= least]
    if len(seen) < SIZING.min_frames:
        return 1.0, np.nan
    along = np.median(seen, axis=0)
    # More people lie beside each other and not above: too large is what is too high as well.
    times = along[2] / rest if along[2] > rest else min(along.max() / rest, 1.0)
    if 1 / SIZING.max_times <= times <= SIZING.max_times:
        return 1.0, float(along[2])
    return float(10.0 ** np.round(np.log10(times))), float(along[2])


def sure_points(agreement: CameraAgreement) -> list[np.ndarray]:
    """Frame by frame points (N, 3) m of two blobs, in two cameras, that lie on each other's epipolar lines alone."""
    frames = agreement.frame_count
    points, numbers = [np.zeros((0, 3))], [np.zeros(0, int)]
    for one, other in combinations(range(len(agreement.cameras)), 2):
        image, number = [np.zeros((0, 2, 2))], [np.zeros(0, int)]
        for index, (a, b, near) in enumerate(agreement.on_lines(one, other)):
            alone = near & (near.sum(axis=1, keepdims=True) == 1) & (near.sum(axis=0, keepdims=True) == 1)
            first, second = np.nonzero(alone)
            image.append(np.stack([a[first, :2], b[second, :2]], axis=1))
            number.append(np.full(len(first), index))
        pairs = np.concatenate(image)
        camera, point = np.tile([one, other], len(pairs)), np.repeat(np.arange(len(pairs)), 2)
        points.append(meet_rows(agreement.cameras, camera, pairs.reshape(-1, 2), point, len(pairs)))
        numbers.append(np.concatenate(number))
    places, frame = np.concatenate(points), np.concatenate(numbers)
    sound = np.isfinite(places).all(axis=1)
    return [places[sound & (frame == index)] for index in range(frames)]


def _extents(points: np.ndarray) -> np.ndarray:
    """(3,) how far points (N, 3) reach along each axis, without the outermost."""
    low, high = np.percentile(points, [SIZING.part, 100 - SIZING.part], axis=0)
    return high - low
