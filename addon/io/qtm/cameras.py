# SPDX-License-Identifier: GPL-3.0-or-later
"""The cameras of a `.qtm`: serial number, pose, lens and image of each, as the last calibration left them."""

from dataclasses import dataclass

import numpy as np

from ...core.data.errors import InputError
from ..rig import RIG_LIMITS, SUBPIXELS, RigCamera
from .container import KIND, Container
from .layout import Cursor

# Numbers of what is said of a camera; each begins with its number and its size.
CAMERA_POSITION, CAMERA_ROTATION = (1, 2, 3), tuple(range(4, 13))
CAMERA_LENS, CALIBRATED, CALIBRATION_FILE, SERIAL, LAST_COLUMN, LAST_ROW = 13, 14, 15, 23, 47, 48
WIDE = (CALIBRATION_FILE,)  # whose size is in letters of two bytes

# The first numbers of the lens: focal lengths, centre, k1 k2 p1 p2; what follows is zero in all that is known.
LENS_START, LENS_NUMBERS, LENS_REST = 4, 8, 8


@dataclass(frozen=True)
class CameraPartLimits:
    """What no camera has; format.

    max_bytes      of all that is said of it, which is 2,300 bytes
    max_rotation   by which a stored rotation may differ from one: they have the digits of a double
    """

    max_bytes: int = 1 << 20
    max_rotation: float = 1e-6


CAMERA_PART = CameraPartLimits()


@dataclass(frozen=True, eq=False)
class CameraPart:
    """What a file says of one camera: its name, and its calibration or the `trouble` with that, such as "is …"."""

    name: str
    calibration: RigCamera | None
    trouble: str = ""


def read_camera_part(container: Container, number: int) -> CameraPart:
    """The camera of that number, from 1; InputError where what is said of it is not laid out as it should be."""
    name = f"Measurement/Cameras/Camera - {number}"
    cursor = Cursor(container.stream(name).whole(CAMERA_PART.max_bytes), name, container.path)
    said = {}
    for _ in range(cursor.word()):
        what, size = cursor.word(), cursor.word()
        said[what] = cursor.bytes(size * (2 if what in WIDE else 1))
    if len(said.get(SERIAL, b"")) != 4:
        raise InputError(f"has no serial number of camera {number}; expected {KIND}", container.path)
    serial = str(int.from_bytes(said[SERIAL], "little"))
    if said.get(CALIBRATED) != b"\1":
        return CameraPart(serial, None, "is not calibrated")
    return _calibrated(serial, said)


def _calibrated(serial: str, said: dict[int, bytes]) -> CameraPart:
    """A camera looks along its own -x, with y to the right and z up: turned to our z, x and -y."""
    wanted = dict.fromkeys((*CAMERA_POSITION, *CAMERA_ROTATION), 8) | {LAST_COLUMN: 4, LAST_ROW: 4}
    lens_bytes = LENS_START + 4 * (LENS_NUMBERS + LENS_REST)
    odd = any(len(said.get(what, b"")) != size for what, size in wanted.items())
    if odd or len(said.get(CAMERA_LENS, b"")) < lens_bytes:
        return CameraPart(serial, None, "has a calibration that is laid out in a way that is not known")
    lens = np.frombuffer(said[CAMERA_LENS], "<f4", LENS_NUMBERS + LENS_REST, LENS_START).astype(float)
    position = np.frombuffer(b"".join(said[what] for what in CAMERA_POSITION), "<f8") / 1000
    stored = np.frombuffer(b"".join(said[what] for what in CAMERA_ROTATION), "<f8").reshape(3, 3)
    size = np.array([int.from_bytes(said[what], "little") + 1 for what in (LAST_COLUMN, LAST_ROW)], float)
    numbers = np.concatenate([lens, position, stored.ravel(), size])
    if not (np.abs(numbers) < RIG_LIMITS.max_number).all() or not (lens[:2] > 0).all():
        return CameraPart(serial, None, "has a calibration that is none of any camera")
    if lens[LENS_NUMBERS:].any():
        return CameraPart(serial, None, "has a lens of a kind that is not known")
    if np.abs(stored @ stored.T - np.eye(3)).max() > CAMERA_PART.max_rotation or np.linalg.det(stored) < 0:
        return CameraPart(serial, None, "has a calibration that is none of any camera")
    rotation = np.stack([stored[1], -stored[2], -stored[0]])
    (fu, fv, cu, cv), distortion = lens[:4] / SUBPIXELS, lens[4:LENS_NUMBERS]
    matrix = np.array([[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]])
    return CameraPart(serial, RigCamera(serial, size, matrix, distortion, rotation, -rotation @ position))
