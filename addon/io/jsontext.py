# SPDX-License-Identifier: GPL-3.0-or-later
"""JSON that somebody else wrote: read within bounds of memory and time, or refused in one sentence."""

import json
from pathlib import Path

from ..core.data.errors import InputError
from .source import read_text

# Parsed, a value takes up to a hundred times the letters that it was written with, and no file of ours has a tenth of
# these. Long texts, such as packed arrays, cost no more than their letters.
MOST_VALUES = 2_000_000


def read_json(path: Path, kind: str) -> object:
    """The content of a JSON file; InputError with the line where it is none, and where it would fill the memory.

    `kind` names the format in the error, such as "a marker set".
    """
    text = read_text(path, kind)
    # Every value but the first stands behind one of these signs.
    if sum(map(text.count, ",[{")) > MOST_VALUES:
        raise InputError(f"has more than {MOST_VALUES} values; expected {kind}", path)
    try:
        return json.loads(text)
    except json.JSONDecodeError as error:
        raise InputError(f"is not valid JSON ({error.msg}); expected {kind}", path, error.lineno) from None
    except (ValueError, RecursionError):
        raise InputError(f"is not JSON that can be read; expected {kind}", path) from None
