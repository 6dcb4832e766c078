# SPDX-License-Identifier: GPL-3.0-or-later
"""Vicon's `.xcp` calibration: quaternions, millimetres, and a lens given the other way round, which is kept so."""

from collections import Counter
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..core.data.errors import InputError
from ..core.geometry import inverse_lens
from ..core.geometry.cameras import Cameras
from .rig import RigCamera, refuse_crowd, rig, rotation_from_quaternion
from .source import numbers, read_xml
from .world import z_up

KIND = "a Vicon .xcp calibration"

# Radial coefficients per square pixel are far below this, those per square focal length far above.
PIXEL_COEFFICIENT = 1e-4
# Focal lengths are hundreds of px and the shapes of pixels near one; what is far below overflows where it divides.
LEAST = 1e-6


def read_xcp(path: Path, up: str = "") -> Cameras:
    """Cameras of a Vicon calibration: the last key frame of each that is calibrated.

    Orientation is a quaternion x, y, z, w that turns the world into the camera, position is in mm. The file does not
    say which axis is up: z unless the cameras tell of another, or `up` does.
    """
    root = read_xml(path, KIND)
    cameras = [camera for camera in root.iter("Camera") if camera.find("KeyFrames/KeyFrame") is not None]
    if root.tag != "Cameras" or not cameras:
        raise InputError(f"has no calibrated camera; expected {KIND}", path)
    refuse_crowd(len(cameras), path)
    named = zip(cameras, _names(cameras), strict=True)
    return z_up(rig([_camera(camera, name, path) for camera, name in named], path), up)


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
    if min(focal, aspect) < LEAST or not quaternion.any() or not (size > 0).all():
        raise InputError(f"camera {name} has no focal length, orientation or size; expected a calibrated camera", path)
    rotation = rotation_from_quaternion(quaternion)
    position = read(frame, "POSITION", 3) / 1000
    distortion, inverse = _lens(frame, name, focal, path)
    _refuse_fold(inverse, _radii(size, centre, aspect) / focal, name, path)
    return RigCamera(
        name=name,
        size=size,
        matrix=np.array([[focal, 0, centre[0]], [0, focal / aspect, centre[1]], [0, 0, 1]]),
        distortion=distortion,
        rotation=rotation,
        translation=-rotation @ position,
        inverse=inverse,
    )


def _radii(size: np.ndarray, centre: np.ndarray, aspect: float) -> np.ndarray:
    """Distances in px from the principal point to points spread evenly over the sensor."""
    x, y = np.meshgrid(np.linspace(0, size[0], 60) - centre[0], (np.linspace(0, size[1], 60) - centre[1]) * aspect)
    return np.hypot(x, y).ravel()


def _lens(frame: Element, name: str, focal: float, path: Path) -> tuple[np.ndarray, np.ndarray]:
    """OpenCV's lens (5,) and Vicon's (3,), of which one at least is zero; in units of the focal length."""
    text = frame.get("VICON_RADIAL")
    if text:
        terms = np.append(numbers(text, 2, f"VICON_RADIAL of camera {name}", path), 0.0)
    elif frame.get("VICON_RADIAL2"):
        text = frame.get("VICON_RADIAL2").replace("ViconRadial2", "")
        terms = numbers(text, 5, f"VICON_RADIAL2 of camera {name}", path)[2:]
        if abs(terms[0]) > PIXEL_COEFFICIENT:
            return np.array([terms[0], terms[1], 0, 0, terms[2]]), np.zeros(3)
    else:
        terms = np.zeros(3)
    return np.zeros(5), terms * focal ** np.array([2.0, 4.0, 6.0])


def _refuse_fold(inverse: np.ndarray, radii: np.ndarray, name: str, path: Path):
    """InputError where the lens turns back before half of the sensor: then it is no lens."""
    if inverse_lens.turning_point(inverse) < np.median(radii):
        raise InputError(f"camera {name} has a lens that folds the image; expected a calibrated camera", path)
