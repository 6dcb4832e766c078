# SPDX-License-Identifier: GPL-3.0-or-later
"""Calibrations as XML: Vicon's `.xcp`, Qualisys' `.qca.txt` and OptiTrack Motive's `.mcal`."""

import re
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..core.data.errors import InputError
from ..core.geometry import inverse_lens
from ..core.geometry.cameras import Cameras
from ..core.geometry.rotations import quaternion_to_matrix
from .rig_cameras import SUBPIXELS, RigCamera, refuse_crowd, rig
from .source import numbers, read_xml
from .world import z_up

XCP, QCA, MCAL = "a Vicon .xcp calibration", "a Qualisys calibration", "a Motive .mcal calibration"

# Radial coefficients per square pixel are far below this, those per square focal length far above.
PIXEL_COEFFICIENT = 1e-4
# Focal lengths are hundreds of px and the shapes of pixels near one; what is far below overflows where it divides.
LEAST = 1e-6
# px along a sensor: physical; a calibration in whole pixels seems to have 31 of them
LEAST_SENSOR = 100

# Qualisys and Motive look along their own -z with y up, we along +z with y down.
CAMERA_TURN = np.diag([1.0, -1.0, -1.0])

_QUALISYS_LENS = (
    "radialDistortion1",
    "radialDistortion2",
    "tangentalDistortion1",
    "tangentalDistortion2",
    "radialDistortion3",
)
_MOTIVE_LENS = ("k1", "k2", "TangentialX", "TangentialY", "k3")


class _Camera:
    """One camera of a file: its element, and what is read of it and of its parts, each with the camera's name."""

    def __init__(self, element: Element, name: str, kind: str, path: Path):
        self.element, self.name, self.kind, self.path = element, name, kind, path

    def part(self, tag: str) -> Element:
        found = self.element.find(tag)
        if found is None:
            raise InputError(f"camera {self.name} has no {tag} part; expected {self.kind}", self.path)
        return found

    def read(self, element: Element, *keys: str, each: int = 1) -> np.ndarray:
        """The numbers of some attributes, so many of each."""
        what = f"of camera {self.name}"
        return np.concatenate([numbers(element.get(key), each, f"{key} {what}", self.path) for key in keys])

    def read_lens(self, element: Element, keys: tuple[str, ...]) -> np.ndarray:
        """A number for each attribute, 0 where it is not there."""
        return np.array([self.read(element, key)[0] if element.get(key) else 0.0 for key in keys])


def _cameras(
    path: Path, kind: str, tag: str, calibrated: str, keys: Sequence[str], make: Callable[[_Camera], RigCamera]
) -> Cameras:
    """The cameras of a file that have a `calibrated` part, of those that are in use, each by the first of `keys`."""
    root = read_xml(path, kind)
    found = [one for one in root.iter(tag) if one.find(calibrated) is not None and one.get("active") != "0"]
    if not found or (kind == XCP and root.tag != "Cameras"):
        raise InputError(f"has no calibrated camera; expected {kind}", path)
    refuse_crowd(len(found), path)
    sources = [[one, *one.findall("Properties")] for one in found]
    names = [next((part.get(key) for key in keys for part in own if part.get(key)), "") or "" for own in sources]
    shared = {one for one, count in Counter(names).items() if count > 1}
    # Vicon may give two cameras one name.
    names = [one.get("DEVICEID") or own if own in shared else own for one, own in zip(found, names, strict=True)]
    return rig([make(_Camera(one, own, kind, path)) for one, own in zip(found, names, strict=True)], path)


def read_xcp(path: Path, up: str = "") -> Cameras:
    """Cameras of a Vicon calibration: the last key frame of each that is calibrated.

    Orientation is a quaternion x, y, z, w that turns the world into the camera, position is in mm. The file does not
    say which axis is up: z unless the cameras tell of another, or `up` does.
    """
    return z_up(_cameras(path, XCP, "Camera", "KeyFrames/KeyFrame", ("NAME", "USERID", "DEVICEID"), _vicon), up)


def _vicon(camera: _Camera) -> RigCamera:
    element, read = camera.element, camera.read
    frame = element.findall("KeyFrames/KeyFrame")[-1]
    size, centre = read(element, "SENSOR_SIZE", each=2), read(frame, "PRINCIPAL_POINT", each=2)
    focal = float(read(frame, "FOCAL_LENGTH")[0])
    aspect = float(read(element, "PIXEL_ASPECT_RATIO")[0]) if element.get("PIXEL_ASPECT_RATIO") else 1.0
    quaternion = read(frame, "ORIENTATION", each=4)
    if min(focal, aspect) < LEAST or not quaternion.any() or not (size > 0).all():
        words = f"camera {camera.name} has no focal length, orientation or size"
        raise InputError(f"{words}; expected a calibrated camera", camera.path)
    rotation = quaternion_to_matrix(np.roll(quaternion / np.linalg.norm(quaternion), 1))
    position = read(frame, "POSITION", each=3) / 1000
    distortion, inverse = _vicon_lens(camera, frame, focal)
    # A lens that turns back before half of the sensor is none.
    x, y = np.meshgrid(np.linspace(0, size[0], 60) - centre[0], (np.linspace(0, size[1], 60) - centre[1]) * aspect)
    if inverse_lens.turning_point(inverse) < np.median(np.hypot(x, y)) / focal:
        raise InputError(
            f"camera {camera.name} has a lens that folds the image; expected a calibrated camera", camera.path
        )
    matrix = np.array([[focal, 0, centre[0]], [0, focal / aspect, centre[1]], [0, 0, 1]])
    return RigCamera(camera.name, size, matrix, distortion, rotation, -rotation @ position, inverse)


def _vicon_lens(camera: _Camera, frame: Element, focal: float) -> tuple[np.ndarray, np.ndarray]:
    """OpenCV's lens (5,) and Vicon's (3,), of which one at least is zero; in units of the focal length."""
    terms = np.zeros(3)
    if frame.get("VICON_RADIAL"):
        terms = np.append(camera.read(frame, "VICON_RADIAL", each=2), 0.0)
    elif text := frame.get("VICON_RADIAL2"):
        what = f"VICON_RADIAL2 of camera {camera.name}"
        # In front stands the kind of lens, "Vicon3Parameter".
        terms = numbers(re.sub(r"^\s*Vicon\w+", "", text), 5, what, camera.path)[2:]
        if abs(terms[0]) > PIXEL_COEFFICIENT:
            return np.array([terms[0], terms[1], 0, 0, terms[2]]), np.zeros(3)
    return np.zeros(5), terms * focal ** np.array([2.0, 4.0, 6.0])


def read_qca(path: Path, up: str = "") -> Cameras:
    """The active cameras, named by serial number: positions in mm, z up, rows of the rotation the camera's own axes."""
    return z_up(_cameras(path, QCA, "camera", "transform", ("serial", "id"), _qca), up)


def _qca(camera: _Camera) -> RigCamera:
    read, transform, intrinsic = camera.read, camera.part("transform"), camera.part("intrinsic")
    rotation = CAMERA_TURN @ read(transform, *(f"r{row}{column}" for row in (1, 2, 3) for column in (1, 2, 3))).reshape(
        3, 3
    )
    focal = read(intrinsic, "focalLengthU", "focalLengthV") / SUBPIXELS
    centre = read(intrinsic, "centerPointU", "centerPointV") / SUBPIXELS
    [skew] = camera.read_lens(intrinsic, ("skew",)) / SUBPIXELS
    low, high = read(intrinsic, "sensorMinU", "sensorMinV"), read(intrinsic, "sensorMaxU", "sensorMaxV")
    size = np.ceil((high - low + 1) / SUBPIXELS)
    if min(size) < LEAST_SENSOR:
        words = f"camera {camera.name} has a sensor of {size[0]:.0f} × {size[1]:.0f} px"
        raise InputError(f"{words}; expected {QCA}, which is in 64ths of a pixel", camera.path)
    return RigCamera(
        name=camera.name,
        size=size,
        matrix=np.array([[focal[0], skew, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]),
        distortion=camera.read_lens(intrinsic, _QUALISYS_LENS),
        rotation=rotation,
        translation=-rotation @ (read(transform, "x", "y", "z") / 1000),
    )


def read_mcal(path: Path, up: str = "") -> Cameras:
    """The calibrated cameras, named by serial number; the world is turned from y up, or what `up` says, to z up.

    The lens is that of `IntrinsicStandardCameraModel`, which is OpenCV's; Motive's own model beside it is not public.
    """
    return z_up(_cameras(path, MCAL, "Camera", "Extrinsic", ("Serial", "CameraID"), _mcal), up or "y")


def _mcal(camera: _Camera) -> RigCamera:
    read, attributes, extrinsic = camera.read, camera.part("Attributes"), camera.part("Extrinsic")
    intrinsic = camera.element.find("IntrinsicStandardCameraModel")
    if intrinsic is None:
        intrinsic = camera.element.find("Intrinsic")
        if intrinsic is None or camera.read_lens(intrinsic, _MOTIVE_LENS).any():
            words = f"camera {camera.name} has no IntrinsicStandardCameraModel"
            raise InputError(f"{words}; expected a .mcal of Motive 2.2 or later", camera.path)
    focal = read(intrinsic, "HorizontalFocalLength", "VerticalFocalLength")
    centre = read(intrinsic, "LensCenterX", "LensCenterY")
    to_world = read(extrinsic, *(f"OrientMatrix{index}" for index in range(9))).reshape(3, 3) @ CAMERA_TURN
    return RigCamera(
        name=camera.name,
        size=read(attributes, "ImagerPixelWidth", "ImagerPixelHeight"),
        matrix=np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]),
        distortion=camera.read_lens(intrinsic, _MOTIVE_LENS),
        rotation=to_world.T,
        translation=-to_world.T @ read(extrinsic, "X", "Y", "Z"),
    )
