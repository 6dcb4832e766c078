# SPDX-License-Identifier: GPL-3.0-or-later
"""The 3D points of a `.qtm`: trajectories with and without labels, and which of their samples were measured."""

from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np

from ...core.data.errors import InputError
from ..samples import PointFile, Samples
from .capture import TRAJECTORY_DATA, QtmCapture
from .container import KIND

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
        parts = partial(_parts, Path(path), kept, first)
        return PointFile(labels, np.array(kept), count, frames, capture.point_rate, first, parts, unit="mm")


def _parts(path: Path, columns: Sequence[int], first: int) -> Iterator[Samples]:
    """All samples, part by part: mm; a residual of 0 says that a sample was filled, NaN that it is not known."""
    with QtmCapture(path) as capture:
        dtype, cell = capture.schema.record(TRAJECTORY_DATA)
        named = dtype.names or ()
        if cell is not None or any(name not in named for name in (*COORDINATES, POINT_RESIDUAL, POINT_TYPE)):
            raise InputError(f"describes no points with X, Y, Z, residual and type; expected {KIND}", path)
        bits = capture.schema.bits(TRAJECTORY_DATA, POINT_TYPE)
        filled = sum(bits.get(name, 0) for name in FILLED_TYPES)
        for column in columns:
            yield from _samples(capture, column, dtype, filled, first)


def _samples(capture: QtmCapture, column: int, dtype: np.dtype, filled: int, first: int) -> Iterator[Samples]:
    """Those of one trajectory, block by block."""
    one = capture.trajectories[column]
    series, lengths = capture.series(one.number), one.ranges[:, 1] - one.ranges[:, 0] + 1
    what = f"trajectory {column}" + (f" ({one.label[:40]})" if one.label else "")
    if series.size != dtype.itemsize * int(lengths.sum()):
        raise InputError(
            f"has {series.size / dtype.itemsize:g} samples of {what} in {int(lengths.sum())} frames; expected one each",
            capture.path,
        )
    ends, done, rest = np.cumsum(lengths), 0, b""
    for block in series.blocks():
        content = rest + block
        whole = len(content) // dtype.itemsize
        records, rest = np.frombuffer(content, dtype, whole), content[whole * dtype.itemsize :]
        at = np.arange(done, done + whole)
        part = np.searchsorted(ends, at, side="right")
        frame = one.ranges[part, 0] + at - (ends - lengths)[part] - first
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
