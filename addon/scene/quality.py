# SPDX-License-Identifier: GPL-3.0-or-later
"""What is known of the placement of the markers that are laid out: kept with them, and taken up by moving them."""

import json
from dataclasses import dataclass

import bpy
import numpy as np

from ..core.data.errors import InputError
from . import armature as armatures
from . import naming
from .markerset_edit import skeleton_of

QUALITY_REPORT = "mocap_quality"
PLACES = "mocap_quality_places"
MOVED_MARKER = 1e-4  # m; a marker that stands farther from where it was judged was moved

# The last text that was read: panels and overlay ask at every redraw.
_read: dict[str, dict] = {}


@dataclass(frozen=True, eq=False)
class Target:
    """Where advice number `number` wants a marker: `begin` and `end` (3,) m in the world."""

    number: int
    marker: str
    begin: np.ndarray
    end: np.ndarray


def marker_items(collection: bpy.types.Collection) -> dict[str, bpy.types.Object]:
    """The empties of a marker set that is laid out, by marker."""
    items = (item for item in collection.all_objects if item.type == "EMPTY")
    return {str(item.get(naming.MARKER, item.name)): item for item in items}


def locked_markers(collection: bpy.types.Collection) -> list[str]:
    """The markers whose location is locked: they stay where they are."""
    return [name for name, item in marker_items(collection).items() if all(item.lock_location)]


def keep_report(collection: bpy.types.Collection, text: str):
    """Keeps a report, as text, with the marker set that it is about."""
    collection[QUALITY_REPORT] = text
    collection[PLACES] = json.dumps({name: list(place) for name, place in _places(collection).items()})


def kept_report(collection: bpy.types.Collection | None) -> dict | None:
    """The report of a marker set that is laid out; None before it was judged."""
    text = collection.get(QUALITY_REPORT) if collection is not None else None
    if not text:
        return None
    if text not in _read:
        _read.clear()
        _read[text] = json.loads(text)
    return _read[text]


def changed_since(collection: bpy.types.Collection) -> bool:
    """Whether markers were moved, added, renamed or taken away since they were judged."""
    before, now = json.loads(collection.get(PLACES, "{}")), _places(collection)
    if set(before) != set(now):
        return True
    return any(np.abs(np.subtract(before[name], now[name])).max() > MOVED_MARKER for name in now)


def targets(collection: bpy.types.Collection) -> list[Target]:
    """Where the report's advice wants markers that are not there yet."""
    report, items, found = kept_report(collection), marker_items(collection), []
    for number, row in enumerate(report["advice"] if report else (), 1):
        anchor = items.get(row["anchor"])
        if anchor is None or (row["do"] == "add" and row["marker"] in items):
            continue
        end = _target(collection, row)
        begin = np.array(anchor.matrix_world.translation)
        if end is not None and np.linalg.norm(end - begin) > MOVED_MARKER:
            found.append(Target(number, row["marker"], begin, end))
    return found


def take_advice(collection: bpy.types.Collection, number: int):
    """Moves or adds the marker of one piece of advice, counted from 1; InputError where that cannot be done."""
    report = kept_report(collection)
    if report is None or not 1 <= number <= len(report["advice"]):
        raise InputError(f"there is no advice {number}; expected the marker set to be judged first")
    row, items = report["advice"][number - 1], marker_items(collection)
    armature, item = skeleton_of(collection), items.get(row["anchor"])
    if item is None or row["segment"] not in armature.data.bones:
        raise InputError(f"{row['anchor']} or {row['segment']} is gone; expected them where they were judged")
    if row["do"] == "add":
        if row["marker"] in items:
            raise InputError(f"{row['marker']} was added already; expected it once")
        item = item.copy()
        item.name = item[naming.MARKER] = row["marker"]
        collection.objects.link(item)
    place = np.eye(4)
    place[:3, 3] = np.array(row["offset"]) * np.array(armature[armatures.SCALE])
    item.matrix_parent_inverse.identity()
    armatures.attach(item, armature, row["segment"], place)


def _target(collection: bpy.types.Collection, row: dict) -> np.ndarray | None:
    """(3,) m of the world, where the armature now has the place that a row of advice means."""
    armature = skeleton_of(collection)
    bone = armature.pose.bones.get(row["segment"])
    if bone is None:
        return None
    offset = np.array(row["offset"]) * np.array(armature[armatures.SCALE])
    rest, posed = (np.array(part, dtype=float) for part in (bone.bone.matrix_local, bone.matrix))
    local = np.linalg.inv(rest) @ np.append(rest[:3, 3] + offset, 1)
    return (np.array(armature.matrix_world, dtype=float) @ posed @ local)[:3]


def _places(collection: bpy.types.Collection) -> dict[str, tuple[float, float, float]]:
    """Where every marker hangs, whatever its armature does meanwhile."""
    return {name: tuple(item.matrix_basis.translation) for name, item in marker_items(collection).items()}
