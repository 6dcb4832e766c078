# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras as files give them, one at a time, then the rig of them all."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError, of_file
from ..core.geometry.cameras import Cameras
from ..core.geometry.rotations import turn_of
from .text import is_unicode

# Qualisys has focal lengths, centres, the sensor and blobs in 64ths of a pixel; its lens is OpenCV's.
SUBPIXELS = 64


# What no camera room has; physical.
MAX_ROTATION_ERROR = 1e-2  # of a rotation times its transpose: printed ones carry four digits or more
MAX_CAMERAS = 1000  # no room has more
MAX_CAMERA_NUMBER = 1e9  # in m, rad, px or lens units


@dataclass(frozen=True)
class RigCamera:
    """One camera as a file gives it, already in metres, z up, and in OpenCV's sense of camera and lens.

    size (2,) px; matrix (3, 3) px; distortion (up to 5,) k1 k2 p1 p2 k3; rotation (3, 3) world to camera;
    translation (3,) m; inverse (3,) see `Cameras`
    """

    name: str
    size: np.ndarray
    matrix: np.ndarray
    distortion: np.ndarray
    rotation: np.ndarray
    translation: np.ndarray
    inverse: np.ndarray = field(default_factory=lambda: np.zeros(3))


def refuse_crowd(count: int, path: Path):
    """InputError where a file says it has more cameras than any room, before each of them is looked at."""
    if count > MAX_CAMERAS:
        raise InputError(f"has {count} cameras; expected at most {MAX_CAMERAS}", path)


def rig(cameras: Sequence[RigCamera], path: Path) -> Cameras:
    """All cameras of a file; InputError that names the file when there are none or one cannot be."""
    if not cameras:
        raise InputError("has no cameras; expected at least one", path)
    for camera in cameras:
        _check(camera, path)
    with of_file(path):
        return Cameras(
            names=tuple(camera.name for camera in cameras),
            size=np.array([camera.size for camera in cameras]),
            matrix=np.array([camera.matrix for camera in cameras]),
            distortion=np.array([np.pad(camera.distortion, (0, 5 - len(camera.distortion))) for camera in cameras]),
            rotation=np.array([nearest_rotation(camera.rotation) for camera in cameras]),
            translation=np.array([camera.translation for camera in cameras]),
            inverse=np.array([camera.inverse for camera in cameras]),
        )


def _check(camera: RigCamera, path: Path):
    if not camera.name.strip():
        raise InputError("has a camera without a name; expected every camera to have one", path)
    if not is_unicode(camera.name) or any(sign in camera.name for sign in "\0\r\n"):
        raise InputError(f"has a camera with the name {camera.name!r}; expected one line of letters", path)
    lenses = (camera.distortion, camera.inverse)
    values = np.concatenate(
        [np.ravel(part) for part in (camera.size, camera.matrix, *lenses, camera.rotation, camera.translation)]
    )
    if not (np.abs(values) < MAX_CAMERA_NUMBER).all():
        raise InputError(
            f"camera {camera.name} has a value that is not a number of any camera; expected a complete calibration",
            path,
        )
    if not (np.asarray(camera.size) > 0).all():
        raise InputError(f"camera {camera.name} has no image size; expected its width and height in pixels", path)
    if not np.allclose(camera.matrix[2], (0, 0, 1)):
        raise InputError(
            f"camera {camera.name} has a matrix that does not end in 0 0 1; expected an intrinsic matrix in pixels",
            path,
        )


def nearest_rotation(matrix: np.ndarray) -> np.ndarray:
    """The rotation next to a printed, rounded one (3, 3); a matrix that is none is given back as it is."""
    if np.abs(matrix @ matrix.T - np.eye(3)).max() > MAX_ROTATION_ERROR:
        return matrix
    left, _, right = np.linalg.svd(matrix)
    return left @ right


def rotation_of(values: np.ndarray) -> np.ndarray:
    """The rotation (3, 3) of nine numbers, or of the three of a Rodrigues vector; NaN for none, which `rig` refuses."""
    if values.size == 9:
        return values.reshape(3, 3)
    return turn_of(values) if np.abs(values).max() < MAX_CAMERA_NUMBER else np.full((3, 3), np.nan)


def numbers_in(parts: Mapping, keys: Sequence[str], name: str, path: Path, *counts: int) -> np.ndarray:
    """(N,) what a camera has under the first of `keys` that it has, N being one of `counts`; InputError otherwise."""
    value = next((parts[key] for key in keys if parts.get(key) is not None), None)
    if value is None:
        raise InputError(f"camera {name} has no `{keys[0]}`; expected a complete calibration", path)
    try:
        found = np.array(value)
    except ValueError:
        found = np.array([None])
    array = found.astype(float).ravel() if found.dtype.kind in "iuf" else np.array([np.nan])
    if not np.isfinite(array).all():
        raise InputError(f"camera {name} has a `{keys[0]}` that is not made of numbers; expected numbers", path)
    if counts and array.size not in counts:
        words = f"camera {name} has a `{keys[0]}` of {array.size} numbers"
        raise InputError(f"{words}; expected {' or '.join(map(str, counts[:2]))}", path)
    return array


def lens(coefficients: np.ndarray, name: str, path: Path) -> np.ndarray:
    """OpenCV's distortion coefficients cut to our five; InputError when a longer model is really used."""
    if np.any(coefficients[5:]):
        raise InputError(
            f"camera {name} has a lens of {coefficients.size} coefficients; expected k1 k2 p1 p2 k3 at most", path
        )
    return coefficients[:5]
