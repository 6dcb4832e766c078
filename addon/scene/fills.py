# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills and smoothing, kept beside labels and edits; the take as it is with them follows whenever it is read.

What was filled is no label and no edit: it lies in the file as a table of places and a text that says of what.
"""

import json
from collections.abc import Sequence
from dataclasses import replace
from zlib import crc32

import bpy
import numpy as np

from ..core.data.errors import InputError
from ..core.data.made import Copies
from ..core.filling.kept import KeptFill, fills_by_marker, put_in_marker
from . import storage
from .naming import title
from .stored import Stored, changed_between

FILLS, FILL_PATHS, CUTOFF = "mocap_fills", "mocap_fill_paths", "mocap_smoothing"


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
    expected = [float(fill.expected) if np.isfinite(fill.expected) else None for fill in fills]
    rows = [[one.marker, one.first, one.last, one.method, off] for one, off in zip(fills, expected, strict=True)]
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


class FillsInTake:
    """The fills of a take that goes on being edited: those of markers that moved since are looked at again."""

    def __init__(self, fills: Sequence[KeptFill]):
        self._fills = tuple(fills)
        self._unfit = [""] * len(self._fills)
        self._base: Stored | None = None
        self._copies = Copies()
        self._by_marker: dict[int, list[tuple[int, slice]]] = {}

    def put(self, stored: Stored) -> Stored:
        """A take without fills as it is with these."""
        if not self._fills:
            return stored
        moved = None if self._base is None else changed_between(self._base, stored, by_hand=False)
        if moved is None:
            # Marker by marker, as the scene's motions lie in memory.
            of_marker = (values.swapaxes(0, 1) for values in (stored.motion.markers, stored.motion.residual))
            self._copies = Copies(*(np.array(values, order="C") for values in of_marker))
            self._by_marker = fills_by_marker(stored.motion.frames, stored.names, self._fills)
            self._unfit = ["the take has no such marker"] * len(self._fills)
            moved = self._by_marker
        for marker in moved:
            self._put_again(stored, marker)
        self._base = stored
        xyz, off = (values.swapaxes(0, 1) for values in self._copies.copy())
        motion = replace(stored.motion, markers=xyz, residual=off)
        return replace(stored, measured=stored.motion, motion=motion, fills=self._fills, unfit=tuple(self._unfit))

    def _put_again(self, stored: Stored, marker: int):
        xyz, off = self._copies.arrays
        xyz[marker], off[marker] = stored.motion.markers[:, marker], stored.motion.residual[:, marker]
        own = self._by_marker.get(marker, ())
        for number, reason in put_in_marker(xyz[marker], off[marker], own, self._fills).items():
            self._unfit[number] = reason
        for which in (0, 1):
            self._copies.note(which, marker)


def keep_cutoff(collection: bpy.types.Collection, cutoff: float | None):
    """Keeps the cut-off, Hz, with the take that `collection` holds; None for none."""
    if cutoff is not None:
        collection[CUTOFF] = float(cutoff)
    elif CUTOFF in collection:
        del collection[CUTOFF]


def kept_cutoff(collection: bpy.types.Collection) -> float | None:
    """The cut-off, Hz, by which a take is smoothed; None where it is not."""
    value = collection.get(CUTOFF)
    return None if value is None else float(value)
