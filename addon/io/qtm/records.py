# SPDX-License-Identifier: GPL-3.0-or-later
"""The blobs of a `.qtm` as rows like those of a blob file, and its 3D points: which of them were measured."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from ...core.geometry.cameras import Cameras
from ..rig_cameras import SUBPIXELS
from ..rows import MAX_PIXEL, Rows
from ..samples import PointFile, Samples
from .capture import CAMERA_DATA, TRAJECTORY_DATA, QtmCamera, QtmCapture
from .container import KIND

BLOB_COUNT = np.dtype("<u4")  # of a frame's blobs, behind its head
DISCARDED_BLOB = "Discarded by size test"


# How the blobs are read, and what is no frame; memory, and what cameras send.
IMAGES_AT_ONCE = 256  # of all cameras that are put together at a time
BYTES_AT_ONCE = 1 << 24  # of blobs that are unpacked for that, of all cameras together, unless one frame has more
MAX_A_FRAME = 20_000  # blobs that one camera finds in a frame: the most that cameras send are some thousands


def rows_of_qtm(path: Path, cameras: Cameras) -> Iterator[tuple[Rows, float, bool]]:
    """Rows of the blobs that these cameras saw, the fraction of the take behind them, and whether they are the last.

    Blobs are in the order of frames, cameras of the file, and the file; those of cameras that are not among `cameras`,
    known by their names, are left out.

    Raises InputError for whatever cannot be used, and where no camera of the file is among them.
    """
    with QtmCapture(path) as capture:
        recorded = [camera for camera in capture.cameras if camera.seen]
        known = [camera for camera in recorded if camera.name in cameras.names]
        if not known:
            names = ", ".join(camera.name for camera in recorded[:6]) or "none at all"
            few = ", ".join(cameras.names[:6])
            raise InputError(f"has blobs of the cameras {names}; expected some of the calibration's, {few}", path)
        index = [cameras.names.index(camera.name) for camera in known]
        yield from _rows(capture, known, index, frames_of(known, path))


def frames_of(cameras: list[QtmCamera], path: Path) -> np.ndarray:
    """(N, 2) the ranges of frames that cameras recorded, first and last; InputError where these are not the same."""
    first = cameras[0]
    other = next((camera for camera in cameras if not np.array_equal(camera.ranges, first.ranges)), None)
    if other is not None:
        words = f"has blobs of other frames of camera {other.name} than of {first.name}"
        raise InputError(f"{words}; expected cameras that recorded at the same time", path)
    return first.ranges


def _rows(
    capture: QtmCapture, cameras: Sequence[QtmCamera], index: Sequence[int], ranges: np.ndarray
) -> Iterator[tuple[Rows, float, bool]]:
    unwanted = capture.schema.bits(CAMERA_DATA, "Flags", row=True).get(DISCARDED_BLOB, 0)
    streams = [_frames(capture, camera) for camera in cameras]
    total, done = int((ranges[:, 1] - ranges[:, 0] + 1).sum()), 0
    while done < total:
        taken: list[list[np.ndarray]] = []
        size = 0
        while len(taken) < min(IMAGES_AT_ONCE, total - done) and size < BYTES_AT_ONCE:
            taken.append([one for stream in streams if (one := next(stream, None)) is not None])
            if len(taken[-1]) < len(streams):
                words = f"ends after {done + len(taken) - 1} of {total} frames of blobs"
                raise InputError(f"{words}; expected all of them", capture.path)
            size += sum(one.nbytes for one in taken[-1])
        frames = _numbers(ranges, done, len(taken))
        parts = zip(cameras, index, zip(*taken, strict=True), strict=True)
        rows = Rows.join([_part(camera.name, at, own, frames, unwanted, capture.path) for camera, at, own in parts])
        done += len(taken)
        order = np.argsort(rows.frame, kind="stable")
        keys = [rows.keys[at] for at in order.tolist()]
        rows = Rows(rows.frame[order], rows.camera[order], rows.xy[order], rows.area[order], keys, rows.lines)
        yield rows, done / total, done == total
    for camera, stream in zip(cameras, streams, strict=True):
        if next(stream, None) is not None:
            words = f"has blobs of {camera.name} behind the last of {total} frames"
            raise InputError(f"{words}; expected {KIND}", capture.path)


def _numbers(ranges: np.ndarray, start: int, count: int) -> np.ndarray:
    """(count,) the numbers of the frames from the `start`th on."""
    lengths = ranges[:, 1] - ranges[:, 0] + 1
    ends = np.cumsum(lengths)
    at = np.arange(start, start + count)
    part = np.searchsorted(ends, at, side="right")
    return ranges[part, 0] + at - (ends - lengths)[part]


def _part(name: str, camera: int, blobs: Sequence[np.ndarray], frames: np.ndarray, unwanted: int, path: Path) -> Rows:
    """The rows of one camera: its blobs in each of the frames but those with an unwanted flag."""
    frame, cells = np.repeat(frames, [len(one) for one in blobs]), np.concatenate(blobs)
    if unwanted:
        kept = (cells["Flags"] & unwanted) == 0
        frame, cells = frame[kept], cells[kept]
    x, y = cells["X"] / SUBPIXELS, cells["Y"] / SUBPIXELS
    if max(np.abs(x).max(initial=0), np.abs(y).max(initial=0)) > MAX_PIXEL:
        raise InputError(f"has a blob of camera {name} that is on no image; expected pixels", path)
    # Of an ellipse of these diameters.
    area = np.pi / 4 * cells["Diameter X"].astype(float) * cells["Diameter Y"] / SUBPIXELS**2
    keys = [
        f"{number},{name},{u:.3f},{v:.3f}" for number, u, v in zip(frame.tolist(), x.tolist(), y.tolist(), strict=True)
    ]
    none = np.zeros(len(frame), np.int64)  # there are no lines
    return Rows(frame.astype(np.int64), np.full(len(frame), camera), np.column_stack([x, y]), area, keys, none)


def _frames(capture: QtmCapture, camera: QtmCamera) -> Iterator[np.ndarray]:
    """The blobs of one frame after the other; InputError where the series ends within a frame, or a frame is none.

    A record is a head, how many blobs there are, and these: where a frame begins is known when the one before is.
    """
    head, cell = capture.schema.record(CAMERA_DATA)
    if cell is None or any(name not in (cell.names or ()) for name in ("X", "Y", "Diameter X", "Diameter Y")):
        raise InputError(f"describes no blobs with X, Y and diameters; expected {KIND}", capture.path)
    blocks, content = capture.series(camera.number).blocks(), b""

    def filled(size: int) -> int:
        """How many bytes there are, once there are as many as `size` or no more."""
        nonlocal content
        while len(content) < size and (block := next(blocks, None)) is not None:
            content += block
        return len(content)

    begin = head.itemsize + BLOB_COUNT.itemsize
    while filled(begin):
        count = int.from_bytes(content[head.itemsize : begin], "little")
        if count > MAX_A_FRAME:
            words = f"has a frame of {count} blobs of camera {camera.name}"
            raise InputError(f"{words}; expected at most {MAX_A_FRAME}", capture.path)
        end = begin + count * cell.itemsize
        if filled(end) < end:
            raise InputError(f"ends within a frame of camera {camera.name}; expected {KIND}", capture.path)
        yield np.frombuffer(content, cell, count, begin)
        content = content[end:]


COORDINATES, POINT_RESIDUAL, POINT_TYPE = ("X", "Y", "Z"), "Residual", "Point Type"
# Kinds of samples that no camera measured, by their names in the file.
FILLED_TYPES = ("Point Type Gap Filled", "Point Type Virtual", "Point Type Linear Gap Fill")


# What is no take of points; physical, and memory.
MAX_MM = 1e9  # mm: no room is a thousand kilometres wide
MAX_POINT_FRAMES = 50_000_000  # of a take: a day at 500 Hz, and each takes memory


def read_qtm_points(path: Path) -> PointFile:
    """The 3D points of a file that were not discarded; InputError where it has none."""
    with QtmCapture(path) as capture:
        kept = capture.kept
        if not kept:
            raise InputError("has no 3D points; expected a take that was tracked in 3D, or its blobs", path)
        chosen = [capture.trajectories[at] for at in kept]
        first = min(int(one.ranges[0, 0]) for one in chosen)
        frames = max(int(one.ranges[-1, 1]) for one in chosen) - first + 1
        if frames > MAX_POINT_FRAMES:
            raise InputError(f"has {frames} frames of 3D points; expected at most {MAX_POINT_FRAMES}", path)
        if capture.point_rate is None:
            raise InputError(f"has no rate of its 3D points; expected {KIND}", path)
        labels, count = [one.label for one in chosen], len(capture.trajectories)
        parts = partial(_point_parts, Path(path), kept, first)
        return PointFile(labels, np.array(kept), count, frames, capture.point_rate, first, parts, unit="mm")


def _point_parts(path: Path, columns: Sequence[int], first: int) -> Iterator[Samples]:
    """All samples, part by part: mm; a residual of 0 says that a sample was filled, NaN that it is not known."""
    with QtmCapture(path) as capture:
        dtype, cell = capture.schema.record(TRAJECTORY_DATA)
        named = dtype.names or ()
        if cell is not None or any(name not in named for name in (*COORDINATES, POINT_RESIDUAL, POINT_TYPE)):
            raise InputError(f"describes no points with X, Y, Z, residual and type; expected {KIND}", path)
        bits = capture.schema.bits(TRAJECTORY_DATA, POINT_TYPE)
        filled = sum(bits.get(name, 0) for name in FILLED_TYPES)
        for column in columns:
            yield from _point_samples(capture, column, dtype, filled, first)


def _point_samples(capture: QtmCapture, column: int, dtype: np.dtype, filled: int, first: int) -> Iterator[Samples]:
    """Those of one trajectory, block by block."""
    one = capture.trajectories[column]
    series, lengths = capture.series(one.number), one.ranges[:, 1] - one.ranges[:, 0] + 1
    what = f"trajectory {column}" + (f" ({one.label[:40]})" if one.label else "")
    if series.size != dtype.itemsize * int(lengths.sum()):
        raise InputError(
            f"has {series.size / dtype.itemsize:g} samples of {what} in {int(lengths.sum())} frames; expected one each",
            capture.path,
        )
    done, rest = 0, b""
    for block in series.blocks():
        content = rest + block
        whole = len(content) // dtype.itemsize
        records, rest = np.frombuffer(content, dtype, whole), content[whole * dtype.itemsize :]
        frame = _numbers(one.ranges, done, whole) - first
        done += whole
        yield _measured(records, frame, column, filled, what, capture.path)


def _measured(records: np.ndarray, frame: np.ndarray, column: int, filled: int, what: str, path: Path) -> Samples:
    """The samples that are there, and what each of them is worth."""
    xyz = np.stack([records[name] for name in COORDINATES], axis=1).astype(float)
    there = np.isfinite(xyz).all(axis=1)
    if np.abs(xyz[there]).max(initial=0) > MAX_MM:
        raise InputError(f"has a sample of {what} that is in no room; expected mm", path)
    residual = records[POINT_RESIDUAL].astype(float)
    residual[~((residual > 0) & (residual < MAX_MM))] = np.nan
    residual[(records[POINT_TYPE] & filled) != 0] = 0.0
    columns = np.full(int(there.sum()), column, np.int32)
    return Samples(frame[there].astype(np.int32), columns, xyz[there], residual[there])
