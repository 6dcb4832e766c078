# SPDX-License-Identifier: GPL-3.0-or-later
"""TOML as files of others may have it: of a size, and with keys, that take neither the memory nor the day to read."""

import re
import tomllib
from pathlib import Path

from ..core.data.errors import InputError
from .source import MAX_CALIBRATION_BYTES, read_text

# A camera's key is `matrix` or `cameras.0.matrix`. Every dot nests a table, and the parser goes through all of them.
MAX_KEY_PARTS = 8
_WORDS = re.compile(
    r'''"""(?:[^"\\]|\\.|"(?!""))*(?:""")?|"(?:[^"\\\n]|\\.)*"?|'''
    r"""'''(?:[^']|'(?!''))*(?:''')?|'[^'\n]*'?|#[^\n]*""",
    re.DOTALL,
)


def toml_document(path: Path, kind: str) -> dict:
    """The content of a TOML file; InputError with the line where it is none.

    `kind` names what it should be in the error, such as "a camera calibration".
    """
    text = read_text(path, kind, MAX_CALIBRATION_BYTES)
    _refuse_depth(text, path, kind)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        line = re.search(r"at line (\d+)", str(error))
        where = int(line.group(1)) if line else text.count("\n") + 1
        raise InputError(f"is not valid TOML; expected {kind}", path, where) from None
    except (RecursionError, ValueError):
        raise InputError(f"is not TOML that can be read; expected {kind}", path) from None


def _refuse_depth(text: str, path: Path, kind: str):
    """InputError with the line of a key of more parts than any file has; texts and comments have none."""
    plain = _WORDS.sub(lambda found: "s" + "\n" * found.group().count("\n"), text)
    line = 1
    for piece in re.split(r"([=,\[\]{}\n])", plain):
        if piece.count(".") >= MAX_KEY_PARTS:
            raise InputError(f"has a key of more than {MAX_KEY_PARTS} parts; expected {kind}", path, line)
        line += piece == "\n"
