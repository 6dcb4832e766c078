# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers measured again where the blobs that are theirs are others than before; all of a take at once."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from ..data.takes import NO_MARKER, Blobs, Labels, Motion, touched_samples
from .cameras import Cameras
from .triangulation import meet_rows
from .views import VIEWING


def measured_again(
    motion: Motion,
    blobs: Blobs,
    before: Labels,
    after: Labels,
    cameras: Cameras,
    also: np.ndarray | None = None,
) -> Motion:
    """The motion of T frames with the markers where the blobs meet that are theirs `after`, and were not `before`.

    `also` (T, M) are samples to measure again whatever their blobs; the body stays.
    """
    where = touched_samples(blobs, before, after, motion.residual.shape)
    where = where if also is None else where | also
    markers, residual, pixels = (getattr(motion, name).copy() for name in ("markers", "residual", "residual_px"))
    if where.any():
        found = measured_points(blobs, after, cameras, where)
        for own, again in zip((markers, residual, pixels), found, strict=True):
            own[where] = again
    return replace(motion, markers=markers, residual=residual, residual_px=pixels)


def put_places(motion: Motion, places: Mapping[tuple[int, int], np.ndarray]):
    """Puts markers where a person placed them, by index of the frame and marker, x y z m: nobody measured them."""
    for at, place in places.items():
        motion.markers[at], motion.residual[at], motion.residual_px[at] = place, 0.0, np.nan


def measured_points(
    blobs: Blobs, labels: Labels, cameras: Cameras, where: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of K samples where rays meet (K, 3) m, and how far they miss that, root mean square, (K,) m and (K,) px."""
    number = np.cumsum(where.ravel()).reshape(where.shape) - 1
    rows = np.flatnonzero(labels.marker != NO_MARKER)
    rows = rows[where[blobs.frame[rows], labels.marker[rows]]]
    image = cameras.undistort(blobs.xy[rows], blobs.camera[rows])
    usable = np.isfinite(image).all(axis=1)
    rows, image = rows[usable], image[usable]
    camera, sample = blobs.camera[rows], number[blobs.frame[rows], labels.marker[rows]]
    count = int(where.sum())
    points = meet_rows(cameras, camera, image, sample, count) if len(rows) else np.full((count, 3), np.nan)
    rays = np.bincount(sample, minlength=count)
    points[rays < 2] = np.nan
    ahead = cameras.directions(image, camera)
    arm = points[sample] - cameras.centres[camera]
    miss = arm - np.einsum("ni,ni->n", arm, ahead)[:, None] * ahead
    square = np.bincount(sample, (miss**2).sum(axis=1), minlength=count)
    residual = np.sqrt(square / np.maximum(rays, 1))
    depth = np.einsum("ni,ni->n", cameras.rotation[camera, 2], points[sample]) + cameras.translation[camera, 2]
    with np.errstate(invalid="ignore"):
        scale = cameras.focal[camera] / np.maximum(depth, VIEWING.min_depth_m)
    pixels = residual * np.bincount(sample, scale, minlength=count) / np.maximum(rays, 1)
    residual[rays < 2] = pixels[rays < 2] = np.nan
    return points, residual, pixels
