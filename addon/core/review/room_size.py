# SPDX-License-Identifier: GPL-3.0-or-later
"""How large what the cameras see is, by blobs without names: a room in the wrong unit is a thousand times too large."""

from itertools import combinations

import numpy as np

from ..data.markersets import MarkerSet
from ..geometry.triangulation import meet_rows
from .camera_order import CameraAgreement

# measured: of the set's markers that must be seen in a frame; a lamp or two in the room have no size
MIN_SIZED = 0.3  # measured


def times_too_large(agreement: CameraAgreement, markerset: MarkerSet) -> tuple[float, float]:
    """By how many times a room is too large, the nearest power of ten; and m that is seen upwards, NaN where unknown.

    Units differ by powers of ten, people by less than two, whether they stand or crouch.
    """
    rest = _extents(markerset.rest_markers * markerset.spread.height).max()
    seen = [_extents(points) for points in sure_points(agreement) if len(points) >= MIN_SIZED * len(markerset)]
    if not seen:
        return 1.0, np.nan
    along = np.median(seen, axis=0)
    # More people lie beside each other and not above: too large is what is too high as well.
    times = along[2] / rest if along[2] > rest else min(along.max() / rest, 1.0)
    return float(10.0 ** np.round(np.log10(times))), float(along[2])


def sure_points(agreement: CameraAgreement) -> list[np.ndarray]:
    """Frame by frame points (N, 3) m of two blobs, in two cameras, that lie on each other's epipolar lines alone."""
    camera, image, number = [np.zeros(0, int)], [np.zeros((0, 2))], [np.zeros(0, int)]
    for one, other in combinations(range(len(agreement.cameras)), 2):
        for index, (a, b, there, back) in enumerate(agreement.beside(one, other, one, other)):
            near = (there < 1) & (back < 1)
            alone = near & (near.sum(axis=1, keepdims=True) == 1) & (near.sum(axis=0, keepdims=True) == 1)
            first, second = np.nonzero(alone)
            image.append(np.stack([a[first, :2], b[second, :2]], axis=1).reshape(-1, 2))
            camera.append(np.tile([one, other], len(first)))
            number.append(np.full(len(first), index))
    frame = np.concatenate(number)
    point = np.repeat(np.arange(len(frame)), 2)
    places = meet_rows(agreement.cameras, np.concatenate(camera), np.concatenate(image), point, len(frame))
    sound = np.isfinite(places).all(axis=1)
    return [places[sound & (frame == index)] for index in range(agreement.frame_count)]


def _extents(points: np.ndarray) -> np.ndarray:
    """(3,) how far points (N, 3) reach along each axis, from a tenth to nine: without ghosts and false crossings."""
    low, high = np.percentile(points, [10, 90], axis=0)
    return high - low
