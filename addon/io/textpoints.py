# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes of points that are written as text: what they have in common."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import MAX_FRAME


@dataclass(frozen=True)
class TextPointLimits:
    """What is no take of points; reckoned.

    max_coordinate    in any unit
    max_gap           frames that are left out between two rows: what it would fill the memory with is no take
    max_frames_a_row  and in all, beside that gap, for every row
    """

    max_coordinate: float = 1e9
    max_gap: int = 10_000
    max_frames_a_row: int = 100


TEXT_POINTS = TextPointLimits()


@dataclass(frozen=True, eq=False)
class TextTake:
    """labels P names; xyz (T, P, 3) in `unit`; rate; number of the first frame; `up` the axis that points up.

    `unit` and `up` are empty where the file does not say.
    """

    labels: list[str]
    xyz: np.ndarray
    unit: str
    rate: float
    first_frame: int
    up: str = ""


def rows_to_xyz(
    rows: Sequence[tuple[int, list[str]]], columns: Sequence[int], path: Path
) -> tuple[np.ndarray, np.ndarray]:
    """Frame numbers (T,) and coordinates (T, P, 3) of `rows`, each a line number and its fields, frame number first.

    `columns` are where the P markers begin. Empty fields, NaN and 0 0 0 are missing; frames that the file leaves out
    are there without points. InputError with the line where a field is no number or the frames do not ascend.
    """
    frames, values = [], []
    for line, fields in rows:
        frames.append(_frame(fields[0], path, line))
        if len(frames) > 1 and not 0 < frames[-1] - frames[-2] <= TEXT_POINTS.max_gap:
            raise InputError(f"goes from frame {frames[-2]} to {frames[-1]}; expected ascending frames", path, line)
        values.append([_value(fields, column + axis, path, line) for column in columns for axis in range(3)])
    number = np.array(frames)
    if number[-1] - number[0] > TEXT_POINTS.max_gap + TEXT_POINTS.max_frames_a_row * len(frames):
        raise InputError(f"has {len(frames)} rows for frames {number[0]} to {number[-1]}; expected every frame", path)
    xyz = np.full((number[-1] - number[0] + 1, len(columns), 3), np.nan)
    xyz[number - number[0]] = np.array(values, dtype=float).reshape(len(frames), len(columns), 3)
    xyz[~np.isfinite(xyz).all(axis=2) | (xyz == 0).all(axis=2)] = np.nan
    return np.arange(number[0], number[-1] + 1), xyz


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
