# SPDX-License-Identifier: GPL-3.0-or-later
"""OptiTrack Motive's calibration, `.mcal`: XML in UTF-16, metres, y up."""

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from ..core.data.errors import InputError
from ..core.geometry.cameras import Cameras
from .rig import RigCamera, refuse_crowd, rig
from .source import numbers, read_xml
from .world import z_up

KIND = "a Motive .mcal calibration"

# Motive looks along its own -z with y up, we along +z with y down.
MOTIVE_TURN = np.diag([1.0, -1.0, -1.0])

_MOTIVE_LENS = ("k1", "k2", "TangentialX", "TangentialY", "k3")


def read_mcal(path: Path, up: str = "") -> Cameras:
    """The calibrated cameras, named by serial number; the world is turned from y up, or what `up` says, to z up.

    The lens is that of `IntrinsicStandardCameraModel`, which is OpenCV's; Motive's own model beside it is not public.
    """
    root = read_xml(path, KIND)
    cameras = [camera for camera in root.iter("Camera") if camera.find("Extrinsic") is not None]
    if not cameras:
        raise InputError(f"has no calibrated camera; expected {KIND}", path)
    refuse_crowd(len(cameras), path)
    return z_up(rig([_camera(camera, path) for camera in cameras], path), up or "y")


def _camera(camera: Element, path: Path) -> RigCamera:
    properties, attributes = camera.find("Properties"), camera.find("Attributes")
    name = camera.get("Serial") or (properties.get("CameraID") if properties is not None else None) or ""
    extrinsic = camera.find("Extrinsic")
    if attributes is None:
        raise InputError(f"camera {name} has no Attributes with its image size; expected {KIND}", path)

    def read(element: Element, *keys: str) -> np.ndarray:
        return np.concatenate([numbers(element.get(key), 1, f"{key} of camera {name}", path) for key in keys])

    intrinsic = camera.find("IntrinsicStandardCameraModel")
    if intrinsic is None:
        intrinsic = camera.find("Intrinsic")
        if intrinsic is None or any(
            read(intrinsic, *(key for key in _MOTIVE_LENS if intrinsic.get(key)), "LensCenterX")[:-1]
        ):
            raise InputError(
                f"camera {name} has no IntrinsicStandardCameraModel; expected a .mcal of Motive 2.2 or later", path
            )
    focal = read(intrinsic, "HorizontalFocalLength", "VerticalFocalLength")
    centre = read(intrinsic, "LensCenterX", "LensCenterY")
    to_world = read(extrinsic, *(f"OrientMatrix{index}" for index in range(9))).reshape(3, 3) @ MOTIVE_TURN
    position = read(extrinsic, "X", "Y", "Z")
    return RigCamera(
        name=name,
        size=read(attributes, "ImagerPixelWidth", "ImagerPixelHeight"),
        matrix=np.array([[focal[0], 0, centre[0]], [0, focal[1], centre[1]], [0, 0, 1]]),
        distortion=np.array([read(intrinsic, key)[0] if intrinsic.get(key) else 0.0 for key in _MOTIVE_LENS]),
        rotation=to_world.T,
        translation=-to_world.T @ position,
    )
