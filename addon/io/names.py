# SPDX-License-Identifier: GPL-3.0-or-later
"""What a name may hold so that every format can write it and gives it back."""

import re

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
    return _ESCAPE.sub(lambda found: found[1][::2] + (chr(int(found[3], 16)) if found[2] else f"u{found[3]}"), spelt)
