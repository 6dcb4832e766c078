# SPDX-License-Identifier: GPL-3.0-or-later
"""What a `.qtm` holds: its cameras, each with its blobs and calibration, its trajectories, and its rate."""

from dataclasses import dataclass
from itertools import zip_longest
from pathlib import Path
from typing import Self

import numpy as np

from ...core.data.errors import InputError
from ...core.data.takes import MAX_RATE_HZ, MIN_RATE_HZ
from ..rig import RigCamera, refuse_crowd
from .cameras import CameraPart, read_camera_part
from .container import KIND, Container
from .layout import Item, read_items, read_schema
from .series import Series

BLOB_DATA, CAMERA_DATA = "2dData", "2dCameraData"
POINT_DATA, TRAJECTORY_DATA = "Trajectories", "Trajectory"
LZO1X = 1  # in the field "Series Compression"
DISCARDED = 2  # in the field "Trajectory Type": what a person or the program threw away


@dataclass(frozen=True, eq=False)
class QtmCamera:
    """One camera of a capture.

    part    what the file says of it: its name, and its calibration or why there is none
    number  of the data series of its blobs
    ranges  (N, 2) first and last frames, both included, that these are of
    seen    whether there are any: of video cameras there are none
    """

    part: CameraPart
    number: int
    ranges: np.ndarray
    seen: bool

    @property
    def name(self) -> str:
        """Its serial number, as calibrations name it."""
        return self.part.name

    @property
    def calibration(self) -> RigCamera | None:
        """Where it stands and how it sees; None where the file does not say."""
        return self.part.calibration


@dataclass(frozen=True, eq=False)
class QtmTrajectory:
    """One trajectory: its label, empty where it has none, its data series and frames, and whether it was discarded."""

    label: str
    number: int
    ranges: np.ndarray
    discarded: bool


class QtmCapture:
    """An open capture; a context manager."""

    def __init__(self, path: Path):
        """Raises InputError where the file is none, or is laid out in a way that is not known."""
        self.path = Path(path)
        self.container = Container(self.path)
        try:
            self.schema = read_schema(self.container)
            root = read_items(self.container, self.schema)
            packing = root.number("Series Compression")
            if packing != LZO1X:
                raise InputError(f"packs its data in a way that is not known ({packing}); expected {KIND}", self.path)
            blobs, points = (self._only(root, kind) for kind in (BLOB_DATA, POINT_DATA))
            self.cameras = self._cameras(blobs)
            self.trajectories = self._trajectories(points)
            self.blob_rate, self.point_rate = self._rate(blobs), self._rate(points)
        except BaseException:
            self.container.__exit__()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object):
        self.container.__exit__()

    def series(self, number: int) -> Series:
        """A data series by its number."""
        return Series(self.container, number)

    @property
    def usable(self) -> list[QtmCamera]:
        """The cameras that have a calibration, and blobs if any camera has some."""
        some = any(camera.seen for camera in self.cameras)
        return [camera for camera in self.cameras if camera.calibration is not None and (camera.seen or not some)]

    @property
    def left_out(self) -> list[str]:
        """The others, each with the reason: "15478 is not calibrated"."""
        usable = {id(camera) for camera in self.usable}
        return [
            f"{camera.name} {camera.part.trouble or 'recorded no blobs (a video camera)'}"
            for camera in self.cameras
            if id(camera) not in usable
        ]

    @property
    def kept(self) -> list[int]:
        """The indices of the trajectories that were not discarded and have samples."""
        return [at for at, one in enumerate(self.trajectories) if not one.discarded and len(one.ranges)]

    def _only(self, root: Item, kind: str) -> Item | None:
        found = [item for item in root.within if item.kind == kind]
        if len(found) > 1:
            raise InputError(f"has {len(found)} parts of {kind}; expected one", self.path)
        return found[0] if found else None

    def _rate(self, item: Item | None) -> float | None:
        rate = None if item is None else item.real("TimeBaseFrequency")
        return rate if rate is not None and MIN_RATE_HZ <= rate <= MAX_RATE_HZ else None

    def _cameras(self, blobs: Item | None) -> list[QtmCamera]:
        """All cameras in their order, the first of which has the first series of blobs."""
        items = [] if blobs is None else [item for item in blobs.within if item.kind == CAMERA_DATA]
        named = {int(name.removeprefix("Camera - ")) for name in self._camera_names()}
        refuse_crowd(len(named), self.path)
        if named != set(range(1, len(named) + 1)) or (items and len(items) != len(named)):
            raise InputError(
                f"has {len(named)} cameras and the blobs of {len(items)}; expected as many of both", self.path
            )
        parts = [read_camera_part(self.container, number) for number in sorted(named)]
        return [self._camera(part, item) for part, item in zip_longest(parts, items)]

    def _camera_names(self) -> list[str]:
        names = self.container.names("Measurement/Cameras")
        return [name for name in names if name.startswith("Camera - ") and name[len("Camera - ") :].isdecimal()]

    def _camera(self, part: CameraPart, item: Item | None) -> QtmCamera:
        number = None if item is None else item.number("Series ID")
        if item is None or number is None:
            return QtmCamera(part, -1, np.empty((0, 2), np.int64), seen=False)
        ranges = self._ranges(item, f"camera {part.name}")
        return QtmCamera(part, number, ranges, bool(len(ranges)) and self.series(number).size > 0)

    def _trajectories(self, points: Item | None) -> list[QtmTrajectory]:
        found: list[QtmTrajectory] = []
        for item in [] if points is None else points.within:
            number = item.number("Series ID")
            if item.kind != TRAJECTORY_DATA or number is None:
                continue
            label, discarded = item.text("Trajectory Label"), item.number("Trajectory Type") == DISCARDED
            ranges = self._ranges(item, f"trajectory {label or len(found)}")
            found.append(QtmTrajectory(label, number, ranges, discarded))
        return found

    def _ranges(self, item: Item, of: str) -> np.ndarray:
        """The item's ranges of frames; InputError where they do not ascend."""
        steps = np.diff(item.ranges.ravel())
        if (steps[::2] < 0).any() or (steps[1::2] <= 0).any():
            raise InputError(f"has frames of {of} that do not ascend; expected {KIND}", self.path)
        return item.ranges
