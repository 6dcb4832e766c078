# SPDX-License-Identifier: GPL-3.0-or-later
"""What a take's own file says that other takes are told from outside: calibration, rate, and which of two things it is.

Only captures as a capture program saves them, `.qtm`, say it.
"""

from pathlib import Path

from ..core.data.errors import InputError
from ..core.geometry.cameras import Cameras
from ..io.qtm import USE_BLOBS, USE_POINTS, held_in, is_qtm


def calibration_for(source: Path, cameras: Path | None) -> Path:
    """The calibration of a take of blobs: the one that was named, else its own; InputError where there is none."""
    if cameras is not None:
        return cameras
    if is_qtm(source):
        return source
    words = "holds blobs, and there is no calibration of their cameras"
    raise InputError(f"{words}; expected --cameras or, in Blender, Import Calibration", source)


def blob_rate(source: Path, rate: float | None) -> float | None:
    """Frames a second of a take of blobs: those that were given, else its own; None where nobody knows."""
    return held_in(source).rate if rate is None and is_qtm(source) else rate


def told_by_capture(source: Path, cameras: Path | None, rate: float | None) -> dict:
    """Both, as fields of a job of blobs."""
    return {"cameras": calibration_for(source, cameras), "rate": blob_rate(source, rate)}


def told_of_capture(source: Path, points: bool, cameras: Cameras | None = None) -> list[str]:
    """What was taken of a capture, and which of its cameras are left out of `cameras`, a sentence each."""
    if not is_qtm(source):
        return []
    held = held_in(source)
    choice = held.told(USE_POINTS if points else USE_BLOBS, None if cameras is None else cameras.names)
    said = [f"of {source.name}, {choice}"] if choice else []
    left = [] if cameras is None else [name for name in held.calibrated if name not in cameras.names]
    if left:
        words = "cameras that the calibration does not have are left out"
        said.append(f"of {source.name}, the blobs of {len(left)} {words}: {', '.join(left)}")
    return said


def facts_of_capture(source: Path, points: bool, cameras: Cameras | None = None) -> dict:
    """The same as part of a report; nothing for other takes."""
    said = told_of_capture(source, points, cameras)
    return {"capture": said} if said else {}
