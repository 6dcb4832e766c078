# SPDX-License-Identifier: GPL-3.0-or-later
"""Filled gaps, kept with a take beside the labels and edits; the take as it is with them follows whenever it is read.

What was filled is no label and no edit: it lies in the file as a table of places and a text that says of what.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from zlib import crc32

import bpy
import numpy as np

from ..core.data.errors import InputError
from ..core.filling.kept import KeptFill, put_fills
from . import storage
from .naming import title
from .stored import Stored

FILLS, FILL_PATHS = "mocap_fills", "mocap_fill_paths"


def keep_fills(collection: bpy.types.Collection, fills: Sequence[KeptFill]):
    """Keeps the fills, in the place of former ones, with the take that `collection` holds."""
    former = collection.get(FILL_PATHS)
    for key in (FILLS, FILL_PATHS):
        if key in collection:
            del collection[key]
    if former is not None and not former.users:
        bpy.data.meshes.remove(former)
    if not fills:
        return
    paths = np.concatenate([fill.path for fill in fills])
    collection[FILL_PATHS] = storage.store_table(title(collection.name, "fills"), {"path": paths})
    rows = [[fill.marker, fill.first, fill.last, fill.method, _number(fill.expected)] for fill in fills]
    # Other places under the same words make another text, by which the take at hand is known to be another.
    digest = crc32(paths.astype(np.float32).tobytes())
    collection[FILLS] = json.dumps({"version": 1, "digest": digest, "gaps": rows}, ensure_ascii=False)


def fills_text(collection: bpy.types.Collection) -> str | None:
    """What the file says of a take's fills; None where there are none."""
    text = collection.get(FILLS)
    return None if text is None else str(text)


def kept_fills(collection: bpy.types.Collection) -> tuple[KeptFill, ...]:
    """The fills of a take; InputError where the file holds none of ours in their place."""
    text = fills_text(collection)
    if text is None:
        return ()
    rows = json.loads(text)["gaps"]
    paths = storage.read_table(collection[FILL_PATHS])["path"]
    ends = np.cumsum([last - first + 3 for _, first, last, _, _ in rows])
    if ends[-1] != len(paths):
        raise InputError(f"the take has {len(paths)} filled places; expected {ends[-1]}, as its list of fills says")
    parts = np.split(paths, ends[:-1])
    return tuple(
        KeptFill(marker, first, last, method, np.nan if expected is None else expected, path)
        for (marker, first, last, method, expected), path in zip(rows, parts, strict=True)
    )


def filled_in(stored: Stored, fills: Sequence[KeptFill]) -> Stored:
    """A take without fills as it is with these."""
    motion, unfit = put_fills(stored.motion, stored.names, fills)
    return replace(stored, measured=stored.motion, motion=motion, fills=tuple(fills), unfit=unfit)


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
