# SPDX-License-Identifier: GPL-3.0-or-later
"""`STEM.edits.json`: what a person said of a take, an edit a line."""

import os
from pathlib import Path
from typing import TYPE_CHECKING

from ..core.data.errors import of_file
from ..core.edits.applying import refuse_unknown
from ..core.edits.kinds import NO_EDITS, Edits
from ..core.edits.rows import document_of, edits_of
from .source import read_json
from .text import write_json
from .whole import whole_file

if TYPE_CHECKING:  # it is looked at, and none is made
    from ..core.data.markersets import Worn

EDITS_ENDING = ".edits.json"


def edits_path(take: Path) -> Path:
    """Where the edits of a take lie beside it."""
    return Path(take).with_name(Path(take).stem + EDITS_ENDING)


def edits_beside(take: Path) -> Path | None:
    """The file of edits beside a take, None where there is none."""
    path = edits_path(take)
    return path if os.path.exists(path) else None  # noqa: PTH110 beside a name that is too long there is none


def open_edits(edits: Edits | Path | None, take: Path, markerset: "Worn", **known) -> Edits:
    """The edits of a take that are given, or those of a file.

    `known` is what is known of the take, as `applying.refuse_unknown` takes it.
    Raises InputError with the file and the number of the edit where one cannot be of this take.
    """
    found = read_edits(edits) if isinstance(edits, Path) else edits or NO_EDITS
    with of_file(edits if isinstance(edits, Path) else take):
        refuse_unknown(found, markerset.by_name, **known)
    return found


def read_edits(path: Path) -> Edits:
    """The edits of a file; InputError with the file, and the number of the edit, where it is not what it should be."""
    document = read_json(path, "edits")
    with of_file(path):
        return edits_of(document)


def write_edits(path: Path, edits: Edits):
    """Writes the edits, an edit a line, in the place of an older file; it appears whole or not at all."""
    with whole_file(path, overwrite=True) as part:
        write_json(part, document_of(edits))
