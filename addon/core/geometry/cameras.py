# SPDX-License-Identifier: GPL-3.0-or-later
"""One camera model for everything: pinhole with OpenCV's lens (k1 k2 p1 p2 k3) or Vicon's, over all points at once."""

from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np

from ..data.errors import InputError
from ..kernels import calls, stands_for
from . import inverse_lens

# How a lens is taken out by Newton's method, in units of the normalised image.
LENS_STEPS = 20  # at most; each doubles the digits once it is near
LENS_TOLERANCE = 1e-13  # where the steps end: rounding
LENS_ERROR = 1e-9  # with which a point still counts as reached: a millionth of a pixel
LENS_FIRST = 0.8  # of a lens' reach, the farthest from the axis that the steps begin: before the lens turns back
LENS_POINTS = 8000  # that are worked on at once, for memory: few enough for the processor's cache
LENS_NEWTON = LENS_STEPS, LENS_TOLERANCE, LENS_ERROR, LENS_FIRST
NEAREST_M = 1e-9  # before a camera, m, where a point is still at its centre and has no image that a number could hold


@dataclass(frozen=True, eq=False)
class Cameras:
    """C calibrated cameras.

    names        C camera names, each once
    size         (C, 2) image width and height, px
    matrix       (C, 3, 3) intrinsic matrices, px
    distortion   (C, 5) k1 k2 p1 p2 k3, in OpenCV's order and sense
    rotation     (C, 3, 3) world to camera; a camera looks along its own +z, x right, y down
    translation  (C, 3) m: a point in the camera is rotation @ point + translation
    inverse      (C, 3) a b c of lenses of Vicon's kind, see `inverse_lens`; zeros where `distortion` is the lens
    remarks      what a person should know of how these cameras came about, a sentence each
    """

    names: tuple[str, ...]
    size: np.ndarray
    matrix: np.ndarray
    distortion: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    inverse: np.ndarray = field(default_factory=lambda: np.zeros((0, inverse_lens.TERMS)))
    remarks: tuple[str, ...] = ()

    def __post_init__(self):
        count = len(self.names)
        if not len(self.inverse):
            object.__setattr__(self, "inverse", np.zeros((count, inverse_lens.TERMS)))
        for name, shape in (
            ("size", (2,)),
            ("matrix", (3, 3)),
            ("distortion", (5,)),
            ("rotation", (3, 3)),
            ("translation", (3,)),
            ("inverse", (inverse_lens.TERMS,)),
        ):
            array = np.array(getattr(self, name), dtype=float)
            if array.shape != (count, *shape):
                raise ValueError(f"{name} has shape {array.shape}; expected {(count, *shape)}")
            array.setflags(write=False)
            object.__setattr__(self, name, array)
        if len(set(self.names)) != count:
            raise InputError("has two cameras of the same name; expected every camera to have a name of its own")
        for index, name in enumerate(self.names):
            self._check(index, name)

    def _check(self, index: int, name: str):
        """Raises InputError when camera `index` could not have taken a picture."""
        matrix, rotation = self.matrix[index], self.rotation[index]
        lenses = (self.distortion[index], self.inverse[index])
        values = np.concatenate([matrix.ravel(), rotation.ravel(), self.translation[index], *lenses])
        if not np.isfinite(values).all():
            raise InputError(f"camera {name} has a value that is not a finite number; expected a complete calibration")
        if abs(np.linalg.det(matrix)) < 1e-9 or matrix[0, 0] <= 0 or matrix[1, 1] <= 0:
            raise InputError(f"camera {name} has a singular matrix; expected focal lengths above zero")
        if not np.allclose(rotation @ rotation.T, np.eye(3), atol=1e-4) or np.linalg.det(rotation) < 0:
            raise InputError(f"camera {name} has a rotation that is not a rotation; expected an orthonormal matrix")
        if all(lens.any() for lens in lenses):
            raise InputError(f"camera {name} has two lenses, OpenCV's and Vicon's; expected one of them")

    def __len__(self) -> int:
        return len(self.names)

    def select(self, indices) -> "Cameras":
        """The cameras at `indices` (a sequence of whole numbers), in that order."""
        chosen = np.asarray(indices, dtype=int)
        fields = ("size", "matrix", "distortion", "rotation", "translation", "inverse")
        arrays = {field: getattr(self, field)[chosen] for field in fields}
        return replace(self, names=tuple(self.names[i] for i in chosen), **arrays)

    @cached_property
    def centres(self) -> np.ndarray:
        """(C, 3) camera positions in the world, m."""
        return -np.einsum("cji,cj->ci", self.rotation, self.translation)

    @cached_property
    def extrinsics(self) -> np.ndarray:
        """(C, 3, 4) world to normalised image coordinates: the P_i of the paper's equations 1 to 5."""
        return np.concatenate([self.rotation, self.translation[:, :, None]], axis=2)

    @cached_property
    def focal(self) -> np.ndarray:
        """(C,) mean focal length, px: how many pixels one unit of normalised image is worth."""
        return (self.matrix[:, 0, 0] + self.matrix[:, 1, 1]) / 2

    @cached_property
    def reach(self) -> np.ndarray:
        """(C,) how far from the axis a lens lets light through, normalised image without the lens; inf if anywhere."""
        return np.minimum(lens_reach(self.distortion), inverse_lens.reach(self.inverse))

    def normalised(self, points: np.ndarray) -> np.ndarray:
        """Normalised image coordinates (C, ..., 2) of world points (..., 3) m; NaN at a camera's centre and behind."""
        points = np.asarray(points, dtype=float)
        flat = points.reshape(-1, 3)
        local = flat @ self.rotation.transpose(0, 2, 1) + self.translation[:, None, :]
        with np.errstate(invalid="ignore", divide="ignore"):
            image = local[..., :2] / np.where(local[..., 2:] > NEAREST_M, local[..., 2:], np.nan)
        return image.reshape(len(self), *points.shape[:-1], 2)

    def project(self, points: np.ndarray) -> np.ndarray:
        """Pixels (C, ..., 2) where each camera sees world points (..., 3) m, lens included; NaN behind the camera.

        NaN also where a lens of Vicon's kind lets no light through; OpenCV's model says nonsense there, see `reach`.
        The paper's equation 6 without the model: x = P X, then the lens.
        """
        image = self.normalised(points)
        flat = image.reshape(len(self), -1, 2)
        seen = distort(flat, self.distortion[:, None, :])
        for index in np.flatnonzero(self.inverse.any(axis=1)):
            seen[index] = inverse_lens.bend(flat[index], self.inverse[index])
        pixels = seen @ self.matrix[:, :2, :2].transpose(0, 2, 1) + self.matrix[:, None, :2, 2]
        return pixels.reshape(image.shape)

    def directions(self, image: np.ndarray, camera: np.ndarray) -> np.ndarray:
        """(N, 3) directions of length 1, in the world, of normalised image points (N, 2) of camera index (N,)."""
        ahead = np.einsum("nji,nj->ni", self.rotation[camera], np.column_stack([image, np.ones(len(image))]))
        return ahead / np.linalg.norm(ahead, axis=1)[:, None]

    def undistort(self, pixels: np.ndarray, camera: np.ndarray) -> np.ndarray:
        """Normalised, lens-free image coordinates (N, 2) of pixels (N, 2) seen by camera index `camera` (N,).

        OpenCV's lens is solved by Newton's method to rounding error, not by the usual few fixed-point steps. A pixel
        that no light reaches through its lens gives NaN.
        """
        pixels, camera = np.asarray(pixels, dtype=float), np.asarray(camera, dtype=int)
        inverse = np.linalg.inv(self.matrix[:, :2, :2])
        image = np.einsum("nij,nj->ni", inverse[camera], pixels - self.matrix[camera, :2, 2])
        forward = np.flatnonzero(self.distortion.any(axis=1)[camera])
        for first in range(0, len(forward), LENS_POINTS):
            part = forward[first : first + LENS_POINTS]
            bent = camera[part]
            image[part] = straightened(image[part], self.distortion[bent], self.reach[bent], *LENS_NEWTON)
        for index in np.flatnonzero(self.inverse.any(axis=1)):
            seen = camera == index
            image[seen] = inverse_lens.straighten(image[seen], self.inverse[index])
        return image


def distort(image: np.ndarray, lens: np.ndarray) -> np.ndarray:
    """Where the lens (..., 5) moves normalised image coordinates (..., 2)."""
    x, y = image[..., 0], image[..., 1]
    k1, k2, p1, p2, k3 = np.moveaxis(lens, -1, 0)
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    return np.stack(
        [x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x), y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y],
        axis=-1,
    )


def lens_reach(lens: np.ndarray) -> np.ndarray:
    """The radius (...) up to which the radial part of a lens (..., 5) rises, normalised image; inf if it always does.

    Beyond it the polynomial r (1 + k1 r² + k2 r⁴ + k3 r⁶) turns back, so that one pixel would show two directions; no
    lens does that.
    """
    return inverse_lens.turning_point(np.asarray(lens, dtype=float)[..., [0, 1, 4]])


@stands_for(calls.straightened)
def straightened(
    image: np.ndarray,
    lens: np.ndarray,
    reach: np.ndarray,
    max_steps: int,
    tolerance: float,
    max_error: float,
    first_share: float,
) -> np.ndarray:
    """The inverse of `distort`, exact to rounding: image (N, 2), lens (N, 5) and its reach (N,); NaN beyond that.

    Newton's method, in the steps of `LENS_NEWTON`.
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        # From a start below the turning point Newton's steps stay on the branch that light takes.
        radius = np.sqrt(np.einsum("ni,ni->n", image, image))
        found = image * np.minimum(1.0, first_share * reach / radius)[:, None]
        for _ in range(max_steps):
            error = distort(found, lens) - image
            if np.nanmax(np.abs(error), initial=0.0) < tolerance:
                break
            found -= _solve2(_distort_jacobian(found, lens), error)
        reached = np.abs(distort(found, lens) - image).max(axis=-1) < max_error
        reached &= np.einsum("ni,ni->n", found, found) < reach**2
    found[~reached] = np.nan
    return found


def _distort_jacobian(image: np.ndarray, lens: np.ndarray) -> tuple[np.ndarray, ...]:
    """The four entries (dx/dx, dx/dy, dy/dx, dy/dy) of the derivative of `distort`."""
    x, y = image[..., 0], image[..., 1]
    k1, k2, p1, p2, k3 = np.moveaxis(lens, -1, 0)
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = 2 * (k1 + r2 * (2 * k2 + 3 * k3 * r2))
    cross = slope * x * y + 2 * p1 * x + 2 * p2 * y
    return (
        radial + slope * x * x + 2 * p1 * y + 6 * p2 * x,
        cross,
        cross,
        radial + slope * y * y + 6 * p1 * y + 2 * p2 * x,
    )


def _solve2(jacobian: tuple[np.ndarray, ...], right: np.ndarray) -> np.ndarray:
    """Solves many 2x2 systems at once: (..., 2)."""
    a, b, c, d = jacobian
    det = a * d - b * c
    return np.stack(
        [(d * right[..., 0] - b * right[..., 1]) / det, (a * right[..., 1] - c * right[..., 0]) / det], axis=-1
    )


# Of a take that came as points.
NO_CAMERAS = Cameras((), np.zeros((0, 2)), np.zeros((0, 3, 3)), np.zeros((0, 5)), np.zeros((0, 3, 3)), np.zeros((0, 3)))
