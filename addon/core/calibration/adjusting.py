# SPDX-License-Identifier: GPL-3.0-or-later
"""Bundle adjustment: cameras moved and turned, and points with them, until the rays of named blobs meet.

The lens is out of the blobs before, and stays as it was with the rest of the intrinsics, so that every kind of lens is
the same here. Where all cameras and all points move, turn or grow together nothing changes in the images: that freedom
is taken away afterwards by the cameras that agree with how they stood before, see `held`.

`Sightings` are what it goes by: which cameras saw which named points, spread over take and space.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ..data.physical import MARKER_LIMITS, SIGMAS
from ..data.takes import NO_MARKER, Blobs, Labels
from ..geometry.cameras import Cameras
from ..geometry.rotations import turn_of
from ..geometry.triangulation import meet_rows
from ..review.camera_places import SHIFT_SD_M, TURN_SD_RAD
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


TURN_AND_SHIFT = 6  # unknowns of a camera


def adjusted(cameras: Cameras, seen: Sightings, free: np.ndarray) -> Cameras:
    """The cameras (C,) True in `free` moved and turned so that what is seen meets; the others stay."""
    return _Bundle(cameras, seen, np.flatnonzero(free)).solved()


class _Bundle:
    """The unknowns of an adjustment: a turn and a shift for each free camera, in its own axes, then the points."""

    def __init__(self, cameras: Cameras, seen: Sightings, free: np.ndarray):
        points = seen.met(cameras)
        sound = np.isfinite(points).all(axis=1)
        self.cameras, self.free, self.seen = cameras, free, seen.kept(sound)
        self.begin = np.concatenate([np.zeros(TURN_AND_SHIFT * len(free)), points[sound].ravel()])
        column = np.full(len(cameras), -1)
        column[free] = np.arange(len(free))
        self.column = column[self.seen.camera]
        self.focal = cameras.focal[self.seen.camera]
        # Only what the blobs do not say is kept from running away.
        sds = np.repeat([TURN_SD_RAD, SHIFT_SD_M], 3)
        self.held = np.tile(MARKER_LIMITS.noise_px / sds, len(free))

    def solved(self) -> Cameras:
        """The cameras where the blobs miss their points least."""
        from scipy.optimize import least_squares

        found = self.begin
        for loss in ("soft_l1", "cauchy"):  # a wrong name or a merged blob pulls less, and at last next to nothing
            found = least_squares(
                self.misses,
                found,
                jac_sparsity=self._known(),
                loss=loss,
                f_scale=SIGMAS * MARKER_LIMITS.noise_px,
                x_scale="jac",
                method="trf",
                tr_solver="lsmr",
                ftol=1e-5,
                max_nfev=40,
            ).x
        rotation, translation, _ = self._moved(found)
        return replace(self.cameras, rotation=rotation, translation=translation)

    def misses(self, unknowns: np.ndarray) -> np.ndarray:
        """(2 N + 6 free,) px of each blob in x and y, then what holds the cameras back."""
        rotation, translation, points = self._moved(unknowns)
        camera = self.seen.camera
        local = np.einsum("nij,nj->ni", rotation[camera], points[self.seen.point]) + translation[camera]
        off = (local[:, :2] / local[:, 2:] - self.seen.image) * self.focal[:, None]
        return np.concatenate([off.ravel(), unknowns[: len(self.held)] * self.held])

    def _moved(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Rotations (C, 3, 3), translations (C, 3) m and points (P, 3) m."""
        steps = unknowns[: len(self.held)].reshape(-1, TURN_AND_SHIFT)
        turn = turn_of(steps[:, :3])
        rotation, translation = self.cameras.rotation.copy(), self.cameras.translation.copy()
        rotation[self.free] = turn @ rotation[self.free]
        translation[self.free] = np.einsum("cij,cj->ci", turn, translation[self.free]) + steps[:, 3:]
        return rotation, translation, unknowns[len(self.held) :].reshape(-1, 3)

    def _known(self):
        """(2 N + 6 free, unknowns) what each of `misses` depends on: a blob knows its camera and its point."""
        from scipy.sparse import csr_matrix

        row = np.arange(2 * len(self.column)).reshape(-1, 2, 1)
        point = (len(self.held) + 3 * self.seen.point)[:, None, None] + np.arange(3)
        free = np.flatnonzero(self.column >= 0)
        camera = (TURN_AND_SHIFT * self.column[free])[:, None, None] + np.arange(TURN_AND_SHIFT)
        pairs = (np.broadcast_arrays(row, point), np.broadcast_arrays(row[free], camera))
        own = np.arange(len(self.held))
        rows = np.concatenate([*(one.ravel() for one, _ in pairs), row.size + own])
        columns = np.concatenate([*(other.ravel() for _, other in pairs), own])
        return csr_matrix((np.ones(len(rows)), (rows, columns)), shape=(row.size + len(own), len(self.begin)))


def held(before: Cameras, after: Cameras, seen: Sightings) -> Cameras:
    """The adjusted cameras in the world of those before: moved, turned and scaled together, which no image shows.

    The world is where most cameras, as they stood before, see the points where they see them now; those that moved are
    outvoted. Scale, floor and axes of the calibration stay.
    """
    from scipy.optimize import least_squares

    points = seen.met(after)
    rows = np.flatnonzero(np.isfinite(points[seen.point]).all(axis=1))
    camera, places = seen.camera[rows], points[seen.point[rows]]
    each = len(rows) / len(before)  # as many of every camera would be
    weight = before.focal[camera] * np.sqrt(each / np.bincount(camera)[camera])
    goal, middle = _imaged(after, camera, places), places.mean(axis=0)

    def misses(world: np.ndarray) -> np.ndarray:
        turn = np.exp(world[6]) * turn_of(world[:3])
        moved = (places - middle) @ turn.T + middle + world[3:6]
        return ((_imaged(before, camera, moved) - goal) * weight[:, None]).ravel()

    world, beyond = np.zeros(7), MARKER_LIMITS.noise_px / SIGMAS  # no noise of blobs is in it
    for loss in ("soft_l1", "cauchy"):
        world = least_squares(misses, world, loss=loss, f_scale=beyond, x_scale="jac").x
    turn, scale = turn_of(world[:3]), np.exp(world[6])
    shift = middle + world[3:6] - scale * turn @ middle
    rotation = after.rotation @ turn.T
    return replace(after, rotation=rotation, translation=scale * after.translation - rotation @ shift)


def _imaged(cameras: Cameras, camera: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(N, 2) normalised image of points (N, 3) m, each in its camera."""
    local = np.einsum("nij,nj->ni", cameras.rotation[camera], points) + cameras.translation[camera]
    return local[:, :2] / local[:, 2:]
