# SPDX-License-Identifier: GPL-3.0-or-later
"""Named blobs as what a calibration is refined by: which cameras saw which points, spread over take and space."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from ..data.takes import NO_MARKER, Blobs, Labels
from ..geometry.cameras import Cameras
from ..geometry.triangulation import meet_rows
from ..review.odd_cameras import MIN_RAYS

SIGHTED_POINTS = 2500  # of a part of the take, what a bundle adjustment carries in seconds
CELL_M = 0.2  # edge of the cubes over which points are spread: a step of somebody who stands about


@dataclass(frozen=True, eq=False)
class Sightings:
    """N blobs of P points, each a marker in a frame."""

    camera: np.ndarray  # (N,) index
    xy: np.ndarray  # (N, 2) px, lens included
    image: np.ndarray  # (N, 2) normalised image, lens taken out
    point: np.ndarray  # (N,) index of the point
    count: int  # P

    @classmethod
    def of(cls, parts: Sequence[tuple[Blobs, Labels]], cameras: Cameras) -> Self:
        """The named blobs of parts of a take, of markers that enough cameras see."""
        columns, before = [], 0
        for blobs, labels in parts:
            named = np.flatnonzero(labels.marker != NO_MARKER)
            moment = before + blobs.frame[named]
            columns.append((blobs.camera[named], blobs.xy[named], moment, labels.marker[named]))
            before += len(blobs.frames)
        camera, xy, moment, marker = (np.concatenate(column) for column in zip(*columns, strict=True))
        image = cameras.undistort(xy, camera)
        reached = np.isfinite(image).all(axis=1)
        _, point = np.unique(np.stack([moment, marker]), axis=1, return_inverse=True)
        found = cls(
            camera[reached], xy[reached], image[reached], point.ravel()[reached], int(point.max(initial=-1)) + 1
        )
        rays = np.bincount(found.point, minlength=found.count)
        return found.kept(rays >= MIN_RAYS)

    def kept(self, points: np.ndarray) -> Self:
        """The sightings of some of the points, (P,) True."""
        rows = points[self.point]
        number = np.cumsum(points) - 1
        return type(self)(
            self.camera[rows], self.xy[rows], self.image[rows], number[self.point[rows]], int(points.sum())
        )

    def rows(self, where: np.ndarray) -> Self:
        """Some of the blobs, (N,) True, of the points that enough cameras still see."""
        less = type(self)(self.camera[where], self.xy[where], self.image[where], self.point[where], self.count)
        return less.kept(np.bincount(less.point, minlength=less.count) >= MIN_RAYS)

    def met(self, cameras: Cameras) -> np.ndarray:
        """(P, 3) m: where the rays of each point meet; NaN where they fix none."""
        return meet_rows(cameras, self.camera, self.image, self.point, self.count)

    def spread(self, cameras: Cameras) -> Self:
        """At most SIGHTED_POINTS of the points, as evenly over space as they allow."""
        points = self.met(cameras)
        sound = np.isfinite(points).all(axis=1)
        cube = np.floor(np.where(sound[:, None], points, 0) / CELL_M).astype(np.int64)
        _, cell = np.unique(cube, axis=0, return_inverse=True)
        # Shuffled, so that of a cell's points not only those of the first seconds are taken.
        shuffled = np.random.default_rng(0).permutation(self.count)
        by_cell = shuffled[np.argsort(cell.ravel()[shuffled], kind="stable")]
        sizes = np.bincount(cell.ravel())
        rank = np.empty(self.count, int)
        rank[by_cell] = np.arange(self.count) - np.repeat(np.cumsum(sizes) - sizes, sizes)
        order = np.lexsort((np.arange(self.count)[np.argsort(shuffled)], rank, ~sound))
        chosen = np.zeros(self.count, bool)
        chosen[order[:SIGHTED_POINTS]] = True
        return self.kept(chosen & sound)

    def errors(self, cameras: Cameras) -> np.ndarray:
        """(C,) px: how far each camera's blobs are from where it sees the points that all rays make, median; or NaN."""
        points, errors = self.met(cameras), np.full(len(cameras), np.nan)
        for index in np.unique(self.camera):
            mine = self.camera == index
            seen = cameras.select([index]).project(points[self.point[mine]])[0]
            off = np.linalg.norm(seen - self.xy[mine], axis=1)
            if np.isfinite(off).any():
                errors[index] = np.nanmedian(off)
        return errors

    def blobs(self, count: int) -> np.ndarray:
        """(C,) how many blobs each of C cameras has."""
        return np.bincount(self.camera, minlength=count)
