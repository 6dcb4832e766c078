# SPDX-License-Identifier: GPL-3.0-or-later
"""Units of a take whose file does not say, and the turns from worlds with another axis up."""

import warnings
from dataclasses import replace

import numpy as np

from ..core.data.lanes import blocks
from ..core.data.made import Scaled
from ..core.geometry.camera_up import guess_up, turned
from ..core.geometry.cameras import Cameras
from .rig import Z_UP_FROM_Y_UP

# Metres in one of each unit that files name.
UNITS = {
    "mm": 1e-3,
    "millimeters": 1e-3,
    "cm": 1e-2,
    "centimeters": 1e-2,
    "m": 1.0,
    "meters": 1.0,
    "in": 0.0254,
    "inches": 0.0254,
}

_ROTATIONS = {
    "+Z": np.eye(3),
    "-Z": np.diag([1.0, -1.0, -1.0]),
    "+Y": Z_UP_FROM_Y_UP,
    "-Y": Z_UP_FROM_Y_UP.T,
    "+X": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "-X": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
}


def up_rotation(up: str) -> np.ndarray:
    """The rotation (3, 3) that turns a world whose up axis is `up`, such as "+Y", into ours with z up."""
    return _ROTATIONS[up]


def guess_unit(xyz: np.ndarray | Scaled) -> str:
    """mm, cm or m, whichever makes the points (T, P, 3) reach as far as people and rooms do."""
    extent = _extent(xyz)
    reach = float(np.median(extent.max(axis=1), axis=0)) if len(extent) else 0.0
    return "m" if reach < 12 else "cm" if reach < 500 and _travel(xyz) < 1500 else "mm"


def _extent(xyz: np.ndarray | Scaled) -> np.ndarray:
    """(F, 3) how far the points of a frame reach along each axis, over up to 200 frames that have any."""
    some = [np.isfinite(xyz[part]).any(axis=(1, 2)) for part in blocks(*xyz.shape[:2])]
    there = np.flatnonzero(np.concatenate([np.zeros(0, bool), *some]))
    frames = xyz[there[:: max(1, len(there) // 200)]]
    if not len(frames):
        return np.zeros((0, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nan_to_num(np.nanmax(frames, axis=1) - np.nanmin(frames, axis=1))


def _travel(xyz: np.ndarray | Scaled) -> float:
    """The farthest that any point is from the origin."""
    parts = [xyz[part] for part in blocks(*xyz.shape[:2])]
    return float(max(np.nanmax(np.abs(part), initial=0.0) for part in parts))


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
