# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set laid out in the rest pose to be seen, moved and re-attached, and read back as a marker set of one's own.

What counts is where things stand on the bones at rest: joints are the heads of bones, markers are empties and capsules
are our capsule meshes, each parented to the bone of the segment that carries it.
"""

import json
from collections import Counter
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..core.data.errors import InputError
from ..core.data.markersets import Capsules, MarkerSet, Skeleton, Spread
from . import armature as armatures
from . import naming
from .body import END, RADIUS, START, add_body
from .markers import add_marker
from .units import metre_in

MARKER_SIZE = 0.015
UNMOVED = 0.002  # of the subject's height: a marker nearer to its place than that was not moved


def show_markerset(context: bpy.types.Context, markerset: MarkerSet, source: str) -> bpy.types.Collection:
    """Lays `markerset` out at the world's origin, as tall as its mean person; `source` is what opens it again.

    Needs object mode; adds no undo step of its own.
    """
    collection = bpy.data.collections.new(naming.title("marker set", markerset.name))
    collection[naming.EDITED] = source
    context.scene.collection.children.link(collection)
    build = armatures.mean_build(markerset)
    armature = armatures.add_armature(context, collection, f"{markerset.name} skeleton", markerset, build)
    armature.scale = [metre_in(context.scene)] * 3
    add_body(collection, armature, markerset, build.scale)
    for index, name in enumerate(markerset.markers):
        place = np.eye(4)
        place[:3, 3] = markerset.offsets[index] * build.scale
        empty = add_marker(collection, name, MARKER_SIZE)
        empty.show_in_front = True
        armatures.attach(empty, armature, markerset.skeleton.segments[markerset.attachment[index]], place)
    return collection


def edited_collection(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The marker set that is laid out in a scene, the latest if there are several."""
    found = [collection for collection in scene.collection.children_recursive if naming.EDITED in collection]
    return found[-1] if found else None


def _name_of(item: bpy.types.Object) -> str:
    """The marker that an empty is."""
    return str(item.get(naming.MARKER, item.name))


def marker_items(collection: bpy.types.Collection) -> dict[str, bpy.types.Object]:
    """The empties of a marker set that is laid out, by marker."""
    return {_name_of(item): item for item in collection.all_objects if item.type == "EMPTY"}


def reattach(item: bpy.types.Object, armature: bpy.types.Object, segment: str):
    """Hangs a marker or capsule on another bone where it stands."""
    place = np.array(_in_armature(item, armature), dtype=float)
    place[:3, 3] -= np.array(armature.data.bones[segment].head_local, dtype=float)
    item.matrix_parent_inverse = Matrix()
    armatures.attach(item, armature, segment, place)


def read_markerset(collection: bpy.types.Collection, base: MarkerSet, name: str) -> MarkerSet:
    """The marker set called `name` as it is laid out now; what cannot be seen (spread, aliases) comes from `base`.

    Raises InputError when a bone is missing, a marker or capsule hangs on none, or two markers share a name.
    """
    armature = armatures.armature_of(collection)
    height = float(np.mean(armature[armatures.SCALE]))
    skeleton = _read_skeleton(armature, base.skeleton, height)
    names = [_name_of(item) for item in collection.all_objects if item.type == "EMPTY"]
    for twice, count in Counter(names).most_common(1):
        if count > 1:
            raise InputError(f"two markers are called {twice}; expected every marker to have a name of its own")
    empties = marker_items(collection)
    if not empties:
        raise InputError(f"{collection.name} has no markers; expected at least one")
    markers = (*(m for m in base.markers if m in empties), *sorted(m for m in empties if m not in base.markers))
    attachment = np.array([_segment_of(empties[m], armature, skeleton) for m in markers])
    places = np.array([_in_armature(empties[m], armature).translation for m in markers], dtype=float) / height
    offsets = places - skeleton.rest_joints[attachment]
    return replace(
        base,
        name=name,
        markers=markers,
        aliases={alias: marker for alias, marker in base.aliases.items() if marker in empties and alias not in empties},
        skeleton=skeleton,
        attachment=attachment,
        offsets=offsets,
        capsules=_read_capsules(collection, armature, skeleton, height),
        spread=_carried_over(base, markers, attachment),
        source={**base.source, "edited": f"from {base.name}, by hand in Blender"},
    )


def is_unmoved(markerset: MarkerSet, base: MarkerSet) -> bool:
    """Whether the markers are still where they were in the base, so that what was learned of it still holds."""
    if markerset.markers != base.markers or (markerset.attachment != base.attachment).any():
        return False
    return bool((np.linalg.norm(markerset.offsets - base.offsets, axis=1) < UNMOVED).all())


def _in_armature(item: bpy.types.Object, armature: bpy.types.Object) -> Matrix:
    """Where `item` stands in the armature's space when the armature is at rest."""
    bone = armature.data.bones.get(item.parent_bone) if item.parent == armature and item.parent_type == "BONE" else None
    if bone is None:
        raise InputError(f"{_name_of(item)} hangs on no bone; expected it parented to a bone of {armature.name}")
    tail = bone.matrix_local @ Matrix.Translation(Vector((0, bone.length, 0)))
    return tail @ item.matrix_parent_inverse @ item.matrix_basis


def _segment_of(item: bpy.types.Object, armature: bpy.types.Object, skeleton: Skeleton) -> int:
    _in_armature(item, armature)
    if item.parent_bone not in skeleton.segments:
        raise InputError(
            f"{item.name} hangs on bone {item.parent_bone}; expected one of {', '.join(skeleton.segments)}"
        )
    return skeleton.segments.index(item.parent_bone)


def _read_skeleton(armature: bpy.types.Object, base: Skeleton, height: float) -> Skeleton:
    missing = [segment for segment in base.segments if segment not in armature.data.bones]
    if missing:
        raise InputError(
            f"{armature.name} has no bone {missing[0]}; expected the bones of the marker set it was made from"
        )
    joints = np.array([armature.data.bones[segment].head_local for segment in base.segments], dtype=float) / height
    above = np.where(base.parents[:, None] >= 0, joints[base.parents], 0.0)
    return Skeleton(base.segments, base.parents, joints - above)


def _read_capsules(collection, armature: bpy.types.Object, skeleton: Skeleton, height: float) -> Capsules:
    rows = []
    for item in (one for one in collection.all_objects if one.type == "MESH" and naming.CAPSULE in one):
        segment = _segment_of(item, armature, skeleton)
        place = _in_armature(item, armature)
        ends = [
            np.array(place @ Vector(item[key]), dtype=float) / height - skeleton.rest_joints[segment]
            for key in (START, END)
        ]
        rows.append((segment, *ends, item[RADIUS] * float(np.mean(place.to_scale()[:2])) / height))
    columns = list(zip(*sorted(rows, key=lambda row: row[0]), strict=True)) or [()] * 4
    segments, start, end, radius = (np.array(column) for column in columns)
    return Capsules(segments.astype(int), start.reshape(-1, 3), end.reshape(-1, 3), radius.astype(float))


def _carried_over(base: MarkerSet, markers: tuple[str, ...], attachment: np.ndarray) -> Spread:
    """The spread for the markers there are now: one that is new or on another segment varies as most do."""
    spread, joints = base.spread, len(base.skeleton)
    modes = np.zeros((len(spread.modes), joints + len(markers), 3))
    modes[:, :joints] = spread.modes[:, :joints]
    deviation = np.full(len(markers), float(np.median(spread.marker_sd)))
    for index, marker in enumerate(markers):
        if marker in base.markers:
            old = base.markers.index(marker)
            if base.attachment[old] == attachment[index]:
                modes[:, joints + index] = spread.modes[:, joints + old]
                deviation[index] = spread.marker_sd[old]
    return replace(spread, modes=modes, marker_sd=deviation)


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
        item = items.get(row["marker"])
        if item is None:
            continue
        end = _target(collection, row)
        begin = np.array(item.matrix_world.translation)
        if end is not None and np.linalg.norm(end - begin) > MOVED_MARKER:
            found.append(Target(number, row["marker"], begin, end))
    return found


def take_advice(collection: bpy.types.Collection, number: int):
    """Moves the marker of one piece of advice, counted from 1; InputError where that cannot be done."""
    report = kept_report(collection)
    if report is None or not 1 <= number <= len(report["advice"]):
        raise InputError(f"there is no advice {number}; expected the marker set to be judged first")
    row, items = report["advice"][number - 1], marker_items(collection)
    armature, item = armatures.armature_of(collection), items.get(row["marker"])
    if item is None or row["segment"] not in armature.data.bones:
        raise InputError(f"{row['marker']} or {row['segment']} is gone; expected them where they were judged")
    place = np.eye(4)
    place[:3, 3] = np.array(row["offset"]) * np.array(armature[armatures.SCALE])
    item.matrix_parent_inverse.identity()
    armatures.attach(item, armature, row["segment"], place)


def _target(collection: bpy.types.Collection, row: dict) -> np.ndarray | None:
    """(3,) m of the world, where the armature now has the place that a row of advice means."""
    armature = armatures.armature_of(collection)
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
