# SPDX-License-Identifier: GPL-3.0-or-later
"""The calibration of a `.qtm` as one that cameras are read from."""

from dataclasses import replace
from pathlib import Path

from ...core.data.errors import InputError
from ...core.geometry.cameras import Cameras
from ..rig import rig
from ..world import z_up
from .capture import QtmCapture


def read_qtm_cameras(path: Path, up: str = "") -> Cameras:
    """The calibrated cameras that recorded blobs, by serial number; `remarks` name those that are left out, and why.

    Raises InputError where there are none.
    """
    with QtmCapture(path) as capture:
        left, usable = capture.left_out, capture.usable
    if not usable:
        words = f"has no calibrated cameras ({', '.join(left[:3]) or 'it has none at all'})"
        raise InputError(f"{words}; expected a calibration, such as --cameras says", path)
    cameras = z_up(rig([one.calibration for one in usable if one.calibration is not None], path), up)
    remark = f"of {Path(path).name}, {len(left)} cameras are left out: {', '.join(left)}"
    return replace(cameras, remarks=(*cameras.remarks, remark)) if left else cameras
