# SPDX-License-Identifier: GPL-3.0-or-later
"""JSON for people too: a marker, an edit, a row of numbers a line."""

import json
from pathlib import Path
from typing import Any

import numpy as np

from ..core.data.errors import spelt_out

MAX_LINE = 160  # letters of what is on one line although it could be on several; by what is read at a glance
SHORT, WHOLE = 4, 6  # blanks before what is on one line where it is that short, and whatever it holds; by looking
DIGITS = 6  # of a number that was measured or learned: of metres, a thousandth of a millimetre


def compact(value: object) -> str:
    """A value as JSON of one line; ValueError where a number is not finite."""
    text = json.dumps(value, ensure_ascii=False, allow_nan=False)
    # A file's name may hold bytes that are no letters, and signs that move a cursor; JSON has an escape for each.
    return spelt_out(text).encode("utf-8", "backslashreplace").decode("utf-8")


def json_text(value: object, indent: int = 0) -> str:
    """A value as JSON of as many lines as it takes to find one's way in it; rows of numbers stay rows."""
    line = compact(value)
    inner = list(value.values() if isinstance(value, dict) else value if isinstance(value, list | tuple) else ())
    nested = any(isinstance(one, dict | list | tuple) for one in inner)
    if not nested or indent >= WHOLE or (indent >= SHORT and len(line) <= MAX_LINE):
        return line
    blank, rows = " " * (indent + 2), [json_text(one, indent + 2) for one in inner]
    if isinstance(value, dict):
        rows = [f"{compact(key)}: {row}" for key, row in zip(value, rows, strict=True)]
    return f"{line[0]}\n" + ",\n".join(blank + row for row in rows) + f"\n{' ' * indent}{line[-1]}"


def write_json(path: Path, value: object):
    """Writes a value as the whole of a file."""
    Path(path).write_text(json_text(value) + "\n", encoding="utf-8", newline="\n")


def rounded(values: float | np.ndarray) -> Any:
    """A number, or an array of them as lists, to six digits; whole ones without a point."""
    if isinstance(values, np.ndarray) and values.ndim:
        return [rounded(one) for one in values]
    value = float(f"{values:.{DIGITS}g}")
    return int(value) if value.is_integer() else value
