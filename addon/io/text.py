# SPDX-License-Identifier: GPL-3.0-or-later
"""What a name may hold so that every format can write it and gives it back, and JSON for people too."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np

from ..core.data.errors import UNSEEN, spelt_out

# Control signs, what ends a line somewhere, and halves of surrogate pairs, which no UTF-8 holds.
_UNWRITABLE = re.compile("[\x00-\x1f\x7f\x85\u2028\u2029\ud800-\udfff]")
_SURROGATE = re.compile("[\ud800-\udfff]")

# What tables take for a formula, also in the wide letters of East Asian ones, and what is our own mark of one.
_FORMULA = re.compile("'*[=+@\uff0b\uff0d\uff1d\uff20-]")
_ESCAPED = "u([0-9a-f]{4})"
_LIKE_ESCAPES = re.compile(rf"(\\+)(?={_ESCAPED}|{UNSEEN.pattern})")
_ESCAPE = re.compile(rf"((?:\\\\)*)(\\?){_ESCAPED}")

EXPECTED = "expected letters without control signs, line ends or halves of surrogate pairs"


def can_be_written(name: str) -> bool:
    """Whether every format can hold the name."""
    return not _UNWRITABLE.search(name)


def is_unicode(text: str) -> bool:
    """Whether UTF-8 can hold the text, of one line or of many."""
    return not _SURROGATE.search(text)


def written(name: str) -> str:
    """The name, such as that of a file, with a sign in the place of each that cannot be written."""
    return _UNWRITABLE.sub("\ufffd", name)


def can_be_named(name: str) -> bool:
    """Whether a marker can have this name: label files need some signs for themselves, and readers strip blanks."""
    return can_be_written(name) and name == name.strip() and not re.search(r'[|,"]|^\*', name)


def cell_of(text: str) -> str:
    r"""The text as a table's cell, where it is no formula and moves no terminal's cursor; `in_cell` gives it back.

    A sign that nobody sees becomes an escape such as `\u001b`, and what begins as a formula gets a `'` in front.
    Ordinary names are as they were.
    """
    spelt = spelt_out(_LIKE_ESCAPES.sub(r"\1\1", text))
    return f"'{spelt}" if _FORMULA.match(spelt) else spelt


def in_cell(cell: str) -> str:
    """What a cell of `cell_of` says."""
    spelt = cell[1:] if cell.startswith("'") and _FORMULA.match(cell) else cell
    if "\\" not in spelt:  # nearly every cell of millions
        return spelt
    return _ESCAPE.sub(lambda found: found[1][::2] + (chr(int(found[3], 16)) if found[2] else f"u{found[3]}"), spelt)


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
