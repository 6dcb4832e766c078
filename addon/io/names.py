# SPDX-License-Identifier: GPL-3.0-or-later
"""What a name may hold so that every format can write it and gives it back."""

import re

# Control signs, what ends a line somewhere, and halves of surrogate pairs, which no UTF-8 holds.
_UNWRITABLE = re.compile("[\x00-\x1f\x7f\x85\u2028\u2029\ud800-\udfff]")
_SURROGATE = re.compile("[\ud800-\udfff]")

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
