# SPDX-License-Identifier: GPL-3.0-or-later
"""What the cameras saw, made ready for the fit: lens taken out, one padded array a frame."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ..data.errors import JobError
from ..data.takes import Blobs
from .cameras import Cameras

NOWHERE = 1e6  # where padding lies in the normalised image: too far to be anybody's nearest


class VIEWING:
    """What a camera may see."""

    max_blobs: int = 500  # memory: of one camera in one frame; more is a broken threshold, not a capture
    min_depth_m: float = 0.05  # physical: m, points that are nearer to a camera are as good as behind it


@dataclass(frozen=True, eq=False)
class View:
    """One frame as C cameras saw it, K being the most blobs that one of them has."""

    image: np.ndarray  # (C, K, 2) normalised, lens-free image coordinates; NOWHERE where a camera has fewer blobs
    real: np.ndarray  # (C, K) True where there is a blob
    row: np.ndarray  # (C, K) the blob's row in its chunk, -1 where there is none

    @cached_property
    def across(self) -> np.ndarray:
        """(C, 2, K) the image once more, coordinate by coordinate."""
        return np.ascontiguousarray(self.image.swapaxes(1, 2))

    @cached_property
    def square(self) -> np.ndarray:
        """(C, 1, K) squared distance of every blob from its image's origin."""
        return (self.image**2).sum(axis=2)[:, None]

    @property
    def count(self) -> int:
        """Number of blobs."""
        return int(self.real.sum())


def split_views(blobs: Blobs, cameras: Cameras) -> list[View]:
    """One `View` for each of the chunk's frames.

    Raises JobError when a camera has more than `VIEWING.max_blobs` blobs in one frame.
    """
    image = cameras.undistort(blobs.xy, blobs.camera)
    usable = np.isfinite(image).all(axis=1)
    rows = np.flatnonzero(usable)
    rows = rows[np.lexsort((blobs.camera[rows], blobs.frame[rows]))]
    image_of = blobs.frame[rows] * len(cameras) + blobs.camera[rows]
    counts = np.bincount(image_of, minlength=len(blobs.frames) * len(cameras))
    _refuse_floods(counts, blobs.frames, cameras)
    slot = np.arange(len(rows)) - np.repeat(np.cumsum(counts) - counts, counts)
    widths = counts.reshape(-1, len(cameras)).max(axis=1, initial=0)
    # Frames lie one after the other in three blocks, each as wide as its fullest camera.
    ends = np.cumsum(np.append(0, widths)) * len(cameras)
    within = blobs.camera[rows] * widths[blobs.frame[rows]] + slot
    cell = ends[blobs.frame[rows]] + within
    places, row = np.full((ends[-1], 2), NOWHERE), np.full(ends[-1], -1)
    places[cell], row[cell] = image[rows], rows
    real = row >= 0
    nothing = View(np.full((len(cameras), 1, 2), NOWHERE), *(np.full((len(cameras), 1), one) for one in (False, -1)))
    views = []
    for begin, end, width in zip(ends.tolist(), ends[1:].tolist(), widths.tolist(), strict=False):
        if not width:  # a gap may be thousands of frames: they share the view of nothing
            views.append(nothing)
            continue
        shape = len(cameras), width
        parts = places[begin:end].reshape(*shape, 2), real[begin:end].reshape(shape), row[begin:end].reshape(shape)
        views.append(View(*parts))
    return views


def _refuse_floods(counts: np.ndarray, frames: np.ndarray, cameras: Cameras):
    flood = int(np.argmax(counts)) if len(counts) else 0
    if len(counts) and counts[flood] > VIEWING.max_blobs:
        frame, camera = frames[flood // len(cameras)], cameras.names[flood % len(cameras)]
        raise JobError(
            f"frame {frame} has {counts[flood]} blobs in camera {camera}; expected at most {VIEWING.max_blobs}, "
            "so raise that camera's threshold or mask its reflections"
        )


class Sight:
    """The cameras as the fit needs them: points to normalised images and their derivatives, without the lens."""

    def __init__(self, cameras: Cameras):
        self.count = len(cameras)
        self.min_depth, self.nowhere = VIEWING.min_depth_m, NOWHERE
        self.rotation = cameras.rotation
        self.turned = np.ascontiguousarray(cameras.rotation.transpose(0, 2, 1))
        self.translation = cameras.translation[:, None, :]
        self.centres = cameras.centres
        self.focal = cameras.focal
        self.corners = _corners(cameras)
        self.all_turned = np.ascontiguousarray(cameras.rotation.transpose(2, 0, 1).reshape(3, -1))
        self.all_translated = cameras.translation.ravel()
        self.across = np.ascontiguousarray(cameras.rotation[:, :2])
        self.ahead = np.ascontiguousarray(cameras.rotation[:, 2:])

    def local(self, points: np.ndarray) -> np.ndarray:
        """(B, C, M, 3) points (B, M, 3) m in each camera's own axes."""
        return points[:, None] @ self.turned + self.translation

    def image(self, local: np.ndarray) -> np.ndarray:
        """(..., 2) normalised image of points in camera axes (..., 3); NOWHERE's twin where behind."""
        depth = local[..., 2:]
        return np.where(depth > VIEWING.min_depth_m, local[..., :2], -NOWHERE) / np.maximum(depth, VIEWING.min_depth_m)

    def derivatives(self, local: np.ndarray, image: np.ndarray) -> np.ndarray:
        """(B, C, M, 2, 3) d image / d point."""
        inverse = 1 / np.maximum(local[..., 2], VIEWING.min_depth_m)
        rows = self.rotation[None, :, None, :2] - image[..., None] * self.rotation[None, :, None, 2:]
        return rows * inverse[..., None, None]

    def looked_at(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Image (B, M, C, 2), its derivative by the point (B, M, C, 2, 3) and depth (B, M, C) m of points (B, M, 3).

        Marker by marker and in one array, for sums over cameras; points behind a camera get nonsense.
        """
        shape = (*points.shape[:2], self.count, 3)
        local = (points.reshape(-1, 3) @ self.all_turned + self.all_translated).reshape(shape)
        depth = np.maximum(local[..., 2], VIEWING.min_depth_m)
        inverse = (1 / depth)[..., None]
        image = local[..., :2] * inverse
        slope = (self.across - image[..., None] * self.ahead) * inverse[..., None]
        return image, slope, depth

    def inside(self, image: np.ndarray) -> np.ndarray:
        """(B, C, M) True where a normalised image point falls on the camera's sensor."""
        low, high = self.corners
        return ((image > low[:, None]) & (image < high[:, None])).all(axis=-1)


def _corners(cameras: Cameras) -> tuple[np.ndarray, np.ndarray]:
    """(C, 2) the smallest and largest normalised coordinates on each sensor's edge, lens taken out.

    Where the lens does not reach an edge, it is as far as the lens reaches.
    """
    along = np.linspace(0, 1, 3)  # the corners and the middles: lenses bend edges outwards or inwards, not both ways
    edge = np.concatenate([np.stack([along, along * 0], 1), np.stack([along, along * 0 + 1], 1)])
    edge = np.concatenate([edge, edge[:, ::-1]])
    pixels = edge[None] * cameras.size[:, None]
    camera = np.repeat(np.arange(len(cameras)), len(edge))
    image = cameras.undistort(pixels.reshape(-1, 2), camera).reshape(len(cameras), -1, 2)
    plain = (pixels - cameras.matrix[:, None, :2, 2]) / cameras.matrix[:, None, [0, 1], [0, 1]]
    # The middle of the lens, whose length is none, may be on the edge.
    length = np.maximum(np.linalg.norm(plain, axis=-1), np.finfo(float).tiny)
    within = np.where(np.isfinite(cameras.reach), cameras.reach, length.max())[:, None]
    image = np.where(np.isfinite(image), image, plain / length[..., None] * within[..., None])
    return image.min(axis=1), image.max(axis=1)
