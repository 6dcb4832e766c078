# SPDX-License-Identifier: GPL-3.0-or-later
"""What a `.qtm` holds: cameras, each with blobs and calibration, trajectories, rate, and what of it is read."""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from itertools import zip_longest
from pathlib import Path
from typing import Self

import numpy as np

from ...core.data.errors import InputError
from ...core.data.takes import MAX_RATE_HZ, MIN_RATE_HZ
from ...core.data.wording import count_of
from ...core.geometry.cameras import Cameras
from ..rig_cameras import MAX_CAMERA_NUMBER, SUBPIXELS, RigCamera, refuse_crowd, rig
from ..world import z_up
from .container import KIND, Container, Cursor, Item, Series, read_items, read_schema

# Numbers of what is said of a camera; each begins with its number and its size.
CAMERA_POSITION, CAMERA_ROTATION = (1, 2, 3), tuple(range(4, 13))
CAMERA_LENS, CALIBRATED, CALIBRATION_FILE, SERIAL, LAST_COLUMN, LAST_ROW = 13, 14, 15, 23, 47, 48
WIDE = (CALIBRATION_FILE,)  # whose size is in letters of two bytes

# The first numbers of the lens: focal lengths, centre, k1 k2 p1 p2; what follows is zero in all that is known.
LENS_START, LENS_NUMBERS, LENS_REST = 4, 8, 8


# What no camera has; format.
MAX_CAMERA_BYTES = 1 << 20  # of all that is said of it, which is 2,300 bytes
MAX_CAMERA_TURN = 1e-6  # by which a stored rotation may differ from one: they have the digits of a double


@dataclass(frozen=True, eq=False)
class QtmCamera:
    """One camera of a capture."""

    name: str  # its serial number, as calibrations name it
    # where it stands and how it sees; None where the file does not say, and the `trouble` with it, "is …"
    calibration: RigCamera | None
    trouble: str = ""
    number: int = -1  # of the data series of its blobs
    # (N, 2) first and last frames, both included, that these are of
    ranges: np.ndarray = field(default_factory=lambda: np.empty((0, 2), np.int64))
    seen: bool = False  # whether there are blobs: of video cameras there are none


def read_camera(container: Container, number: int) -> QtmCamera:
    """The camera of that number, from 1; InputError where what is said of it is not laid out as it should be."""
    name = f"Measurement/Cameras/Camera - {number}"
    cursor = Cursor(container.stream(name).whole(MAX_CAMERA_BYTES), name, container.path)
    fields = {}
    for _ in range(cursor.word()):
        what, size = cursor.word(), cursor.word()
        fields[what] = cursor.bytes(size * (2 if what in WIDE else 1))
    if len(fields.get(SERIAL, b"")) != 4:
        raise InputError(f"has no serial number of camera {number}; expected {KIND}", container.path)
    serial = str(int.from_bytes(fields[SERIAL], "little"))
    if fields.get(CALIBRATED) != b"\1":
        return QtmCamera(serial, None, "is not calibrated")
    return _calibrated(serial, fields)


def _calibrated(serial: str, fields: dict[int, bytes]) -> QtmCamera:
    """A camera looks along its own -x, with y to the right and z up: turned to our z, x and -y."""
    wanted = dict.fromkeys((*CAMERA_POSITION, *CAMERA_ROTATION), 8) | {LAST_COLUMN: 4, LAST_ROW: 4}
    lens_bytes = LENS_START + 4 * (LENS_NUMBERS + LENS_REST)
    odd = any(len(fields.get(what, b"")) != size for what, size in wanted.items())
    if odd or len(fields.get(CAMERA_LENS, b"")) < lens_bytes:
        return QtmCamera(serial, None, "has a calibration that is laid out in a way that is not known")
    lens = np.frombuffer(fields[CAMERA_LENS], "<f4", LENS_NUMBERS + LENS_REST, LENS_START).astype(float)
    position = np.frombuffer(b"".join(fields[what] for what in CAMERA_POSITION), "<f8") / 1000
    stored = np.frombuffer(b"".join(fields[what] for what in CAMERA_ROTATION), "<f8").reshape(3, 3)
    size = np.array([int.from_bytes(fields[what], "little") + 1 for what in (LAST_COLUMN, LAST_ROW)], float)
    numbers = np.concatenate([lens, position, stored.ravel(), size])
    if not (np.abs(numbers) < MAX_CAMERA_NUMBER).all() or not (lens[:2] > 0).all():
        return QtmCamera(serial, None, "has a calibration that is none of any camera")
    if lens[LENS_NUMBERS:].any():
        return QtmCamera(serial, None, "has a lens of a kind that is not known")
    if np.abs(stored @ stored.T - np.eye(3)).max() > MAX_CAMERA_TURN or np.linalg.det(stored) < 0:
        return QtmCamera(serial, None, "has a calibration that is none of any camera")
    rotation = np.stack([stored[1], -stored[2], -stored[0]])
    (fu, fv, cu, cv), distortion = lens[:4] / SUBPIXELS, lens[4:LENS_NUMBERS]
    matrix = np.array([[fu, 0.0, cu], [0.0, fv, cv], [0.0, 0.0, 1.0]])
    return QtmCamera(serial, RigCamera(serial, size, matrix, distortion, rotation, -rotation @ position))


BLOB_DATA, CAMERA_DATA = "2dData", "2dCameraData"
POINT_DATA, TRAJECTORY_DATA = "Trajectories", "Trajectory"
LZO1X = 1  # in the field "Series Compression"
DISCARDED = 2  # in the field "Trajectory Type": what a person or the program threw away


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
            self.container.close()
            raise

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object):
        self.container.close()

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
            f"{camera.name} {camera.trouble or 'recorded no blobs (a video camera)'}"
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
        names = [name for name in self.container.names("Measurement/Cameras") if name.startswith("Camera - ")]
        numbers = [name.removeprefix("Camera - ") for name in names]
        named = {int(number) for number in numbers if number.isdecimal()}
        refuse_crowd(len(named), self.path)
        if named != set(range(1, len(named) + 1)) or (items and len(items) != len(named)):
            raise InputError(
                f"has {len(named)} cameras and the blobs of {len(items)}; expected as many of both", self.path
            )
        cameras = [read_camera(self.container, number) for number in sorted(named)]
        return [self._recorded(camera, item) for camera, item in zip_longest(cameras, items)]

    def _recorded(self, camera: QtmCamera, item: Item | None) -> QtmCamera:
        """The camera with what is known of its blobs."""
        number = None if item is None else item.number("Series ID")
        if item is None or number is None:
            return camera
        ranges = self._ranges(item, f"camera {camera.name}")
        return replace(camera, number=number, ranges=ranges, seen=bool(len(ranges)) and self.series(number).size > 0)

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
    remark = f"{count_of(len(left), 'camera')} of {Path(path).name} left out: {', '.join(left)}"
    return replace(cameras, remarks=(*cameras.remarks, remark)) if left else cameras


USE_BLOBS, USE_POINTS = USES = ("blobs", "points")
NEEDED = 2  # cameras that must have seen something and be calibrated, for a point to be found


def is_qtm(path: Path) -> bool:
    """Whether a file is a capture of Qualisys Track Manager, by its suffix."""
    return Path(path).suffix.lower() == ".qtm"


@dataclass(frozen=True)
class CaptureHolds:
    """What a capture holds."""

    cameras: tuple[str, ...]  # names of those that recorded blobs, and
    calibrated: tuple[str, ...]  # of those of them that have a calibration
    labelled: int  # how many trajectories have a label, and
    unlabelled: int  # how many have none
    rate: float | None  # frames a second of the blobs, None where it is not said
    # first and last frame of the blobs
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

    def chosen(self, choice: str, cameras: Sequence[str] | None = None) -> str:
        """What was taken of the capture, and what not, for a person to read; empty where it holds one of them only.

        `cameras` are the names of those of a calibration that is not the capture's own.
        """
        if not self.cameras or not self.labelled + self.unlabelled:
            return ""
        points = f"its 3D points ({count_of(self.labelled, 'trajectory')} with a label, {self.unlabelled} without)"
        used = self.calibrated if cameras is None else set(self.cameras) & set(cameras)
        blobs = f"its blobs ({count_of(len(used if choice == USE_BLOBS else self.cameras), 'camera')})"
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
