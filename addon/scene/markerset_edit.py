# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set laid out in the rest pose to be seen, moved and re-attached, and read back as a marker set of one's own.

What counts is where things stand on the bones at rest: joints are the heads of bones, markers are empties and capsules
are our capsule meshes, each parented to the bone of the segment that carries it.
"""

from collections import Counter
from dataclasses import replace

import bpy
import numpy as np
from mathutils import Matrix, Vector

from ..core.data.errors import InputError
from ..core.data.markersets import Capsules, MarkerSet, Skeleton, Spread
from . import armature as armatures
from . import naming
from .body import END, RADIUS, START, add_body

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
    add_body(collection, armature, markerset, build.scale)
    for index, name in enumerate(markerset.markers):
        place = np.eye(4)
        place[:3, 3] = markerset.offsets[index] * build.scale
        segment = markerset.skeleton.segments[markerset.attachment[index]]
        _add_marker(collection, armature, name, segment, place)
    return collection


def edited_collection(scene: bpy.types.Scene) -> bpy.types.Collection | None:
    """The marker set that is laid out in a scene, the latest if there are several."""
    found = [collection for collection in scene.collection.children_recursive if naming.EDITED in collection]
    return found[-1] if found else None


def skeleton_of(collection: bpy.types.Collection) -> bpy.types.Object:
    """The armature of a marker set that is laid out; InputError when it was deleted."""
    for item in collection.all_objects:
        if item.type == "ARMATURE" and armatures.SCALE in item:
            return item
    raise InputError(f"{collection.name} has lost its skeleton; expected the armature that it was shown with")


def reattach(item: bpy.types.Object, armature: bpy.types.Object, segment: str):
    """Hangs a marker or capsule on another bone where it stands."""
    place = np.array(_in_armature(item, armature), dtype=float)
    place[:3, 3] -= np.array(armature.data.bones[segment].head_local, dtype=float)
    item.matrix_parent_inverse = Matrix()
    armatures.attach(item, armature, segment, place)


def read_markerset(collection: bpy.types.Collection, base: MarkerSet, name: str, description: str = "") -> MarkerSet:
    """The marker set called `name` as it is laid out now; what cannot be seen (spread, aliases) comes from `base`.

    Raises InputError when a bone is missing, a marker or capsule hangs on none, or two markers share a name.
    """
    armature = skeleton_of(collection)
    height = float(np.mean(armature[armatures.SCALE]))
    skeleton = _read_skeleton(armature, base.skeleton, height)
    empties = {str(item.get(naming.MARKER, item.name)): item for item in _items(collection, "EMPTY")}
    _refuse_duplicates([str(item.get(naming.MARKER, item.name)) for item in _items(collection, "EMPTY")])
    if not empties:
        raise InputError(f"{collection.name} has no markers; expected at least one")
    markers = (*(m for m in base.markers if m in empties), *sorted(m for m in empties if m not in base.markers))
    attachment = np.array([_segment_of(empties[m], armature, skeleton) for m in markers])
    places = np.array([_in_armature(empties[m], armature).translation for m in markers], dtype=float) / height
    offsets = places - skeleton.rest_joints[attachment]
    return replace(
        base,
        name=name,
        description=description or base.description,
        markers=markers,
        aliases={alias: marker for alias, marker in base.aliases.items() if marker in empties and alias not in empties},
        skeleton=skeleton,
        attachment=attachment,
        offsets=offsets,
        capsules=_read_capsules(collection, armature, skeleton, height),
        spread=_carried_over(base, markers, attachment),
        likelihood=base.likelihood if _unmoved(base, markers, attachment, offsets) else None,
        source={**base.source, "edited": f"from {base.name}, by hand in Blender"},
    )


def _unmoved(base: MarkerSet, markers: tuple[str, ...], attachment: np.ndarray, offsets: np.ndarray) -> bool:
    """Whether the markers are still where the evidence for naming points was learned."""
    if markers != base.markers or (attachment != base.attachment).any():
        return False
    return bool((np.linalg.norm(offsets - base.offsets, axis=1) < UNMOVED).all())


def _add_marker(collection, armature: bpy.types.Object, name: str, segment: str, place: np.ndarray):
    empty = bpy.data.objects.new(name, None)
    empty.empty_display_type, empty.empty_display_size = "SPHERE", MARKER_SIZE
    empty.show_in_front = True
    empty[naming.MARKER] = name
    collection.objects.link(empty)
    armatures.attach(empty, armature, segment, place)


def _items(collection: bpy.types.Collection, kind: str) -> list[bpy.types.Object]:
    return [item for item in collection.all_objects if item.type == kind]


def _in_armature(item: bpy.types.Object, armature: bpy.types.Object) -> Matrix:
    """Where `item` stands in the armature's space when the armature is at rest."""
    bone = armature.data.bones.get(item.parent_bone) if item.parent == armature and item.parent_type == "BONE" else None
    if bone is None:
        name = item.get(naming.MARKER, item.name)
        raise InputError(f"{name} hangs on no bone; expected it parented to a bone of {armature.name}")
    tail = bone.matrix_local @ Matrix.Translation(Vector((0, bone.length, 0)))
    return tail @ item.matrix_parent_inverse @ item.matrix_basis


def _segment_of(item: bpy.types.Object, armature: bpy.types.Object, skeleton: Skeleton) -> int:
    _in_armature(item, armature)
    if item.parent_bone not in skeleton.segments:
        raise InputError(
            f"{item.name} hangs on bone {item.parent_bone}; expected one of {', '.join(skeleton.segments)}"
        )
    return skeleton.segments.index(item.parent_bone)


def _refuse_duplicates(names: list[str]):
    twice = [name for name, count in Counter(names).items() if count > 1]
    if twice:
        raise InputError(f"two markers are called {twice[0]}; expected every marker to have a name of its own")


def _read_skeleton(armature: bpy.types.Object, base: Skeleton, height: float) -> Skeleton:
    missing = [segment for segment in base.segments if segment not in armature.data.bones]
    if missing:
        raise InputError(
            f"{armature.name} has no bone {missing[0]}; expected the bones of the marker set it was made from"
        )
    joints = np.array([armature.data.bones[segment].head_local for segment in base.segments], dtype=float) / height
    offsets = joints.copy()
    for index, parent in enumerate(base.parents):
        if parent >= 0:
            offsets[index] -= joints[parent]
    return Skeleton(base.segments, base.parents, offsets)


def _read_capsules(collection, armature: bpy.types.Object, skeleton: Skeleton, height: float) -> Capsules:
    rows = []
    for item in _items(collection, "MESH"):
        if naming.CAPSULE not in item:
            continue
        segment = _segment_of(item, armature, skeleton)
        place = _in_armature(item, armature)
        ends = [
            np.array(place @ Vector(item[key]), dtype=float) / height - skeleton.rest_joints[segment]
            for key in (START, END)
        ]
        rows.append((segment, *ends, item[RADIUS] * float(np.mean(place.to_scale()[:2])) / height))
    rows.sort(key=lambda row: row[0])
    return Capsules(
        np.array([row[0] for row in rows], dtype=int),
        np.array([row[1] for row in rows]).reshape(-1, 3),
        np.array([row[2] for row in rows]).reshape(-1, 3),
        np.array([row[3] for row in rows], dtype=float),
    )


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
