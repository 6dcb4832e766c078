# SPDX-License-Identifier: GPL-3.0-or-later
"""The world of a calibration with z up, whichever axis its file has up."""

from dataclasses import replace

from ..core.geometry.camera_up import guess_up, turned
from ..core.geometry.cameras import Cameras
from .world import up_rotation


def z_up(cameras: Cameras, up: str = "") -> Cameras:
    """The cameras of a file whose world has the axis `up`, such as "y" or "-x", pointing up; turned to z up.

    Where nobody says (`up` is empty), the cameras themselves tell; a turn that was decided so is among the `remarks`.
    """
    axis = up or guess_up(cameras) or "z"
    if axis == "z":
        return cameras
    cameras = turned(cameras, up_rotation(axis.upper() if axis[0] == "-" else "+" + axis.upper()))
    if up:
        return cameras
    remark = f"the cameras stand with {axis} up in the calibration, which does not say: turned to z up"
    return replace(cameras, remarks=(*cameras.remarks, remark))
