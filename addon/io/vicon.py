# SPDX-License-Identifier: GPL-3.0-or-later
"""Vicon's `.xcp` calibration: quaternions, millimetres, and a lens given the other way round."""

from collections import Counter
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..core.data.errors import InputError
from ..core.geometry.cameras import Cameras
from .rig import RigCamera, rig, rotation_from_quaternion
from .source import numbers, read_xml

KIND = "a Vicon .xcp calibration"

# What turning Vicon's lens into OpenCV's may leave, root mean square over the sensor. Real cameras leave 0.03 to
# 0.5 px, nearly all of it in the corners: the rest is beyond three radial terms.
LENS_TOLERANCE_PX = 2.0

# Radial coefficients per square pixel are far below this, those per square focal length far above.
PIXEL_COEFFICIENT = 1e-4


def read_xcp(path: Path) -> Cameras:
    """Cameras of a Vicon calibration: the last key frame of each that is calibrated.

    Orientation is a quaternion x, y, z, w that turns the world into the camera, position is in mm, z is up.
    """
    root = read_xml(path, KIND)
    cameras = [camera for camera in root.iter("Camera") if camera.find("KeyFrames/KeyFrame") is not None]
    if root.tag != "Cameras" or not cameras:
        raise InputError(f"has no calibrated camera; expected {KIND}", path)
    return rig([_camera(camera, name, path) for camera, name in zip(cameras, _names(cameras), strict=True)], path)


def _names(cameras: list[Element]) -> list[str]:
    """NAME, or USERID where it is empty, or DEVICEID where that leaves two cameras alike."""
    names = [camera.get("NAME") or camera.get("USERID") or camera.get("DEVICEID") or "" for camera in cameras]
    shared = {name for name, count in Counter(names).items() if count > 1}
    return [
        camera.get("DEVICEID") or name if name in shared else name for camera, name in zip(cameras, names, strict=True)
    ]


def _camera(camera: Element, name: str, path: Path) -> RigCamera:
    frame = camera.findall("KeyFrames/KeyFrame")[-1]

    def read(element: Element, key: str, count: int) -> np.ndarray:
        return numbers(element.get(key), count, f"{key} of camera {name}", path)

    size = read(camera, "SENSOR_SIZE", 2)
    centre = read(frame, "PRINCIPAL_POINT", 2)
    focal = float(read(frame, "FOCAL_LENGTH", 1)[0])
    aspect = float(read(camera, "PIXEL_ASPECT_RATIO", 1)[0]) if camera.get("PIXEL_ASPECT_RATIO") else 1.0
    quaternion = read(frame, "ORIENTATION", 4)
    if focal <= 0 or aspect <= 0 or not quaternion.any() or not (size > 0).all():
        raise InputError(f"camera {name} has no focal length, orientation or size; expected a calibrated camera", path)
    rotation = rotation_from_quaternion(quaternion)
    position = read(frame, "POSITION", 3) / 1000
    return RigCamera(
        name=name,
        size=size,
        matrix=np.array([[focal, 0, centre[0]], [0, focal / aspect, centre[1]], [0, 0, 1]]),
        distortion=_lens(frame, name, focal, _radii(size, centre, aspect), path),
        rotation=rotation,
        translation=-rotation @ position,
    )


def _radii(size: np.ndarray, centre: np.ndarray, aspect: float) -> np.ndarray:
    """Distances in px from the principal point to points spread evenly over the sensor, ascending."""
    x, y = np.meshgrid(np.linspace(0, size[0], 60) - centre[0], (np.linspace(0, size[1], 60) - centre[1]) * aspect)
    return np.sort(np.hypot(x, y).ravel())


def _lens(frame: Element, name: str, focal: float, radii: np.ndarray, path: Path) -> np.ndarray:
    if frame.get("VICON_RADIAL"):
        return forward_lens(
            numbers(frame.get("VICON_RADIAL"), 2, f"VICON_RADIAL of camera {name}", path), name, focal, radii, path
        )
    text = frame.get("VICON_RADIAL2")
    if not text:
        return np.zeros(5)
    k1, k2, k3 = numbers(text.replace("ViconRadial2", ""), 5, f"VICON_RADIAL2 of camera {name}", path)[2:]
    if abs(k1) > PIXEL_COEFFICIENT:
        return np.array([k1, k2, 0, 0, k3])
    return forward_lens(np.array([k1, k2, k3]), name, focal, radii, path)


def forward_lens(inverse: np.ndarray, name: str, focal: float, radii: np.ndarray, path: Path) -> np.ndarray:
    """OpenCV's k1 k2 p1 p2 k3 (5,) for Vicon's lens: undistorted = distorted · (1 + a r² + b r⁴ + …), r in px.

    `inverse` is a, b, …; least squares over the ascending `radii` px. InputError where OpenCV's model cannot follow
    within LENS_TOLERANCE_PX. Where the lens folds back in the last corners, only what lies before the fold counts.
    """
    powers = 2 * np.arange(1, len(inverse) + 1)
    straight = radii * (1 + radii[:, None] ** powers @ inverse)
    slope = 1 + radii[:, None] ** powers @ (inverse * (powers + 1))
    inside = int(np.argmax(slope <= 0)) if (slope <= 0).any() else len(radii)
    if inside < len(radii) // 2:
        raise InputError(f"camera {name} has a lens that folds the image; expected a calibrated camera", path)
    straight, radii = straight[:inside], radii[:inside]
    # Scaled by the reach, the columns are near one in size and the solution keeps all its digits.
    reach = radii[-1]
    columns = (straight[:, None] / reach) ** (3, 5, 7)
    solution, *_ = np.linalg.lstsq(columns, (radii - straight) / reach, rcond=None)
    error = np.sqrt(np.mean((columns @ solution * reach - (radii - straight)) ** 2))
    if not error < LENS_TOLERANCE_PX:
        raise InputError(
            f"camera {name} has a lens too strong to convert (off by {error:.2g} px); expected a moderate lens", path
        )
    k1, k2, k3 = solution * (focal / reach) ** np.array([2, 4, 6])
    return np.array([k1, k2, 0, 0, k3])
