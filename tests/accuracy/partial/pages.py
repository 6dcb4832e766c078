# SPDX-License-Identifier: GPL-3.0-or-later
"""Writes what was printed into the pages that quote it."""

import re
from collections.abc import Mapping
from pathlib import Path

from addon.core.data.errors import InputError

COMMAND = "python -m tests.accuracy.partial --show"


def written(text: str, blocks: Mapping[str, str]) -> str:
    """The page with every marked block of a name in `blocks` replaced by that text; others stay.

    A block stands between `<!-- begin: python -m tests.accuracy.partial --show NAME -->` and `<!-- end -->`.
    """

    def block(match: re.Match) -> str:
        name = match[2]
        return f"{match[1]}\n\n{blocks[name].strip()}\n\n{match[4]}" if name in blocks else match[0]

    return re.sub(rf"(<!-- begin: {re.escape(COMMAND)} (\S+) -->)(.*?)(<!-- end -->)", block, text, flags=re.DOTALL)


def write(page: Path, blocks: Mapping[str, str]):
    """The same in a file. Raises InputError when the page has none of the blocks."""
    before = page.read_text(encoding="utf-8")
    if COMMAND not in before:
        raise InputError(f"{page}: no marked block; expected <!-- begin: {COMMAND} NAME --> … <!-- end -->")
    page.write_text(written(before, blocks), encoding="utf-8")
