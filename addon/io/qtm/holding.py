# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the two a `.qtm` is read for, its blobs or its 3D points, and what is said of that."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from ...core.data.errors import InputError
from .capture import QtmCapture

USE_BLOBS, USE_POINTS = USES = ("blobs", "points")
NEEDED = 2  # cameras that must have seen something and be calibrated, for a point to be found


def is_qtm(path: Path) -> bool:
    """Whether a file is a capture of Qualisys Track Manager, by its suffix."""
    return Path(path).suffix.lower() == ".qtm"


@dataclass(frozen=True)
class CaptureHolds:
    """What a capture holds.

    cameras      names of those that recorded blobs, and
    calibrated   of those of them that have a calibration
    labelled     how many trajectories have a label, and
    unlabelled   how many have none
    rate         frames a second of the blobs, None where it is not said
    first, last  frame of the blobs
    """

    cameras: tuple[str, ...]
    calibrated: tuple[str, ...]
    labelled: int
    unlabelled: int
    rate: float | None
    first: int = 0
    last: int = 0

    def choice(self, wanted: str | None, path: Path) -> str:
        """One of USES: what was `wanted`; else blobs where their cameras are calibrated, or where there are no points.

        InputError where the capture does not hold it.
        """
        there = {USE_BLOBS: bool(self.cameras), USE_POINTS: bool(self.labelled + self.unlabelled)}
        if not any(there.values()):
            raise InputError("holds neither blobs nor 3D points; expected a capture with some", path)
        if wanted is not None and not there[wanted]:
            other = "3D points, and no blobs" if wanted == USE_BLOBS else "blobs, and no 3D points"
            raise InputError(f"holds {other}; expected a capture with {wanted}, or another --use", path)
        calibrated = len(self.calibrated) >= NEEDED or not there[USE_POINTS]
        return wanted or (USE_BLOBS if calibrated else USE_POINTS)

    def told(self, choice: str, cameras: Sequence[str] | None = None) -> str:
        """What was taken of the capture, and what not, for a person to read; empty where it holds one of them only.

        `cameras` are the names of those of a calibration that is not the capture's own.
        """
        if not self.cameras or not self.labelled + self.unlabelled:
            return ""
        points = f"its 3D points ({self.labelled} trajectories with a label, {self.unlabelled} without)"
        used = self.calibrated if cameras is None else set(self.cameras) & set(cameras)
        blobs = f"its blobs ({len(used) if choice == USE_BLOBS else len(self.cameras)} cameras)"
        taken, other = (blobs, points) if choice == USE_BLOBS else (points, blobs)
        return f"{taken} are taken, not {other}"


def held_in(path: Path) -> CaptureHolds:
    """What a capture holds; InputError where it cannot be read."""
    with QtmCapture(path) as capture:
        seen = [camera for camera in capture.cameras if camera.seen]
        kept = [capture.trajectories[at] for at in capture.kept]
        labelled = sum(bool(one.label) for one in kept)
        ranges = seen[0].ranges if seen else None
        return CaptureHolds(
            cameras=tuple(camera.name for camera in seen),
            calibrated=tuple(camera.name for camera in seen if camera.calibration is not None),
            labelled=labelled,
            unlabelled=len(kept) - labelled,
            rate=capture.blob_rate,
            first=0 if ranges is None else int(ranges[0, 0]),
            last=0 if ranges is None else int(ranges[-1, 1]),
        )
