# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes of points that are written as text: what they have in common."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import MAX_FRAME
from .samples import Samples


@dataclass(frozen=True)
class TextPointLimits:
    """What is no take of points; physical, and memory.

    max_coordinate    in any unit
    max_gap           frames that are left out between two rows: what it would fill the memory with is no take
    max_frames_a_row  and in all, beside that gap, for every row
    rows_at_once      whose samples are put together
    """

    max_coordinate: float = 1e9
    max_gap: int = 10_000
    max_frames_a_row: int = 100
    rows_at_once: int = 1000


TEXT_POINTS = TextPointLimits()


@dataclass(frozen=True, eq=False)
class TextTake:
    """labels P names; frames how many; parts their samples in `unit`; rate; number of the first frame.

    `up` is the axis that points up; it and `unit` are empty where the file does not say.
    """

    labels: list[str]
    frames: int
    parts: tuple[Samples, ...]
    unit: str
    rate: float
    first_frame: int
    up: str = ""


def rows_to_samples(
    rows: Iterable[tuple[int, list[str]]], columns: Sequence[int], path: Path
) -> tuple[int, int, tuple[Samples, ...]]:
    """Number of the first frame, how many there are and their samples, of rows: a line number and its fields each.

    The first field is the frame's number, and `columns` are where the P markers begin. Empty fields, NaN and 0 0 0 are
    missing; frames that the file leaves out are there without points. InputError with the line where a field is no
    number or the frames do not ascend.
    """
    parts, values, first, before, count = [], [], 0, 0, 0
    for line, fields in rows:
        frame = _frame(fields[0], path, line)
        if count and not 0 < frame - before <= TEXT_POINTS.max_gap:
            raise InputError(f"goes from frame {before} to {frame}; expected ascending frames", path, line)
        first, before, count = frame if not count else first, frame, count + 1
        row = [_value(fields, column + axis, path, line) for column in columns for axis in range(3)]
        values.append(_samples_of(np.array(row, dtype=float).reshape(1, -1, 3), frame - first))
        if len(values) == TEXT_POINTS.rows_at_once:
            parts.append(_joined(values))
            values = []
    frames = before - first + 1
    if frames - 1 > TEXT_POINTS.max_gap + TEXT_POINTS.max_frames_a_row * count:
        raise InputError(f"has {count} rows for frames {first} to {before}; expected every frame", path)
    return first, frames, (*parts, *([_joined(values)] if values else []))


def count_in(text: str) -> int:
    """A number of frames or markers as a head says it, 0 where it is none; Python makes none of thousands of digits."""
    return int(text) if text.isascii() and text.isdigit() and len(text) < 100 else 0


def _samples_of(xyz: np.ndarray, frame: int) -> Samples:
    """Those of a frame (1, P, 3) that are there."""
    xyz[(xyz == 0).all(axis=2)] = np.nan
    return Samples.of(xyz, frame)


def _joined(parts: Sequence[Samples]) -> Samples:
    names = ("frame", "column", "xyz", "residual")
    return Samples(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def _frame(field: str, path: Path, line: int) -> int:
    try:
        value = float(field)
    except ValueError:
        value = np.nan
    if value % 1 == 0 and abs(value) <= MAX_FRAME:
        return int(value)
    raise InputError(
        f"begins with {field.strip()[:40]!r}; expected a frame number, a whole one up to {MAX_FRAME}", path, line
    )


def _value(fields: list[str], index: int, path: Path, line: int) -> float:
    field = fields[index] if index < len(fields) else ""
    if not field or field.isspace():
        return np.nan
    try:
        value = float(field)
    except ValueError:
        raise InputError(f"has {field.strip()[:40]!r} as a coordinate; expected a number", path, line) from None
    if abs(value) > TEXT_POINTS.max_coordinate:
        raise InputError(f"has {field.strip()[:40]!r} as a coordinate; expected a position in a room", path, line)
    return value
