# SPDX-License-Identifier: GPL-3.0-or-later
"""Qualisys Track Manager's calibration, `.qca.txt` or the same as `.xml`."""

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ..core.data.errors import InputError
from ..core.geometry.cameras import Cameras
from .rig import RigCamera, refuse_crowd, rig
from .source import numbers, read_xml
from .world import z_up

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

KIND = "a Qualisys calibration"

# Focal lengths, centres and the sensor are in 64ths of a pixel; the distortion is of the normalised image, as OpenCV's.
SUBPIXELS = 64

# Qualisys looks along its own -z with y up, we along +z with y down.
QUALISYS_TURN = np.diag([1.0, -1.0, -1.0])

_QUALISYS_LENS = (
    "radialDistortion1",
    "radialDistortion2",
    "tangentalDistortion1",
    "tangentalDistortion2",
    "radialDistortion3",
)
_ROTATION = tuple(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))


def read_qca(path: Path, up: str = "") -> Cameras:
    """The active cameras, named by serial number: positions in mm, z up, rows of the rotation the camera's own axes."""
    root = read_xml(path, KIND)
    cameras = [
        camera for camera in root.iter("camera") if camera.find("transform") is not None and camera.get("active") != "0"
    ]
    if not cameras:
        raise InputError(f"has no calibrated camera; expected {KIND}", path)
    refuse_crowd(len(cameras), path)
    return z_up(rig([_camera(camera, path) for camera in cameras], path), up)


def _camera(camera: "Element", path: Path) -> RigCamera:
    name = camera.get("serial") or camera.get("id") or ""
    transform, intrinsic = camera.find("transform"), camera.find("intrinsic")
    if intrinsic is None:
        raise InputError(f"camera {name} has no intrinsic part; expected {KIND}", path)

    def read(element: "Element", *keys: str) -> np.ndarray:
        return np.concatenate([numbers(element.get(key), 1, f"{key} of camera {name}", path) for key in keys])

    rotation = QUALISYS_TURN @ read(transform, *_ROTATION).reshape(3, 3)
    position = read(transform, "x", "y", "z") / 1000
    focal = read(intrinsic, "focalLengthU", "focalLengthV") / SUBPIXELS
    centre = read(intrinsic, "centerPointU", "centerPointV") / SUBPIXELS
    skew = read(intrinsic, "skew")[0] / SUBPIXELS if intrinsic.get("skew") else 0.0
    low, high = read(intrinsic, "sensorMinU", "sensorMinV"), read(intrinsic, "sensorMaxU", "sensorMaxV")
    return RigCamera(
        name=name,
        size=np.ceil((high - low + 1) / SUBPIXELS),
        matrix=np.array([[focal[0], skew, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]),
        distortion=np.array([read(intrinsic, key)[0] if intrinsic.get(key) else 0.0 for key in _QUALISYS_LENS]),
        rotation=rotation,
        translation=-rotation @ position,
    )
