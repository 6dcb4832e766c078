# SPDX-License-Identifier: GPL-3.0-or-later
"""The root, an empty that all of a take hangs on: moved, turned or scaled, what is shown of the take follows."""

import bpy
import numpy as np
from mathutils import Matrix

from . import naming
from .cameras import pose_of
from .ownership import is_made_for, release, sign
from .units import METRE, enlarged, metre_in, metre_of

ROOT_SIZE = 0.5  # m, of the axes that are drawn
SAME_SCALE = 1.001  # of the axes of what is scaled evenly


def root_of(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """The root of a take; None where it was deleted, or the file is older than roots."""
    return _empty_of(collection, seen=True)


def parent_of(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """What the things of a take are parented to: the hidden empty on its root; in files older than that the root."""
    return _empty_of(collection, seen=False) or root_of(collection)


def _empty_of(collection: bpy.types.Collection, seen: bool) -> bpy.types.Object | None:
    items = (item for item in collection.objects if item.get(naming.TAKE_ROOT) == seen)
    return next((item for item in items if is_made_for(item, collection)), None)


def ensure_root(scene: bpy.types.Scene, collection: bpy.types.Collection, name: str) -> bpy.types.Object:
    """What the things of a take called `name` are parented to; a new root at the origin where there is none.

    Everything on that is in metres, and it is as large as a metre is in the scene.

    Blender draws a dashed line from everything to its parent but for one that is hidden: so a hidden empty is between.
    """
    root, between = root_of(collection), _empty_of(collection, seen=False)
    if root is None:
        root = _add_empty(collection, f"{name} root", "root", seen=True)
        root.empty_display_type, root.empty_display_size = "PLAIN_AXES", ROOT_SIZE
        root[METRE] = metre_in(scene)
        root.scale = [root[METRE]] * 3
    if between is None:
        between = _add_empty(collection, f"{name} room", "room", seen=False)
        between.hide_viewport = between.hide_render = True
    between.parent = root
    return between


def _add_empty(collection: bpy.types.Collection, name: str, role: str, seen: bool) -> bpy.types.Object:
    empty = bpy.data.objects.new(name, None)
    empty[naming.TAKE_ROOT] = seen
    collection.objects.link(empty)
    sign(empty, role, collection)
    return empty


def put_where(collection: bpy.types.Collection, other: bpy.types.Collection):
    """Puts a take where another one stands, which is the same recording."""
    root, theirs = root_of(collection), root_of(other)
    if root is not None and theirs is not None:
        root.matrix_world, root[METRE] = pose_of(theirs), metre_of(theirs)


def remove_root(collection: bpy.types.Collection):
    """Removes the root of a take that is gone; one that was animated, or moved with things of a person on it, stays."""
    root, between = root_of(collection), _empty_of(collection, seen=False)
    if between is not None:
        for item in between.children:
            item.parent = root
        bpy.data.objects.remove(between)
    if root is not None and (root.animation_data is not None or (root.children and pose_of(root) != Matrix())):
        release(root)
    elif root is not None:
        bpy.data.objects.remove(root)


def placed(block: bpy.types.Collection | bpy.types.Mesh | None) -> np.ndarray:
    """(4, 4) from the coordinates of a take, or of what waits to be labelled, which are the room's, to the world's."""
    if isinstance(block, bpy.types.Mesh):
        return enlarged(metre_of(block))
    root = None if block is None else root_of(block)
    return np.array(Matrix() if root is None else pose_of(root), dtype=float)


def moved_by(collection: bpy.types.Collection) -> np.ndarray:
    """(4, 4) from the coordinates of a take to where a person put it, in metres as well."""
    root = root_of(collection)
    return enlarged(1.0 if root is None else 1 / metre_of(root)) @ placed(collection)


def is_animated(item: bpy.types.Object | None) -> bool:
    """Whether an object is keyed or driven, or hangs on what is, by its parents or constraints."""
    left, seen = [item], {None}
    while left:
        one = left.pop()
        if one in seen:
            continue
        seen.add(one)
        data = one.animation_data
        if data is not None and (data.action is not None or data.drivers or data.nla_tracks):
            return True
        targets = [held.targets if held.type == "ARMATURE" else [held] for held in one.constraints]
        left += [one.parent, *(getattr(target, "target", None) for held in targets for target in held)]
    return False


def is_even(place: np.ndarray) -> bool:
    """Whether a matrix (4, 4) turns, moves and scales all alike, and mirrors nothing."""
    sizes = np.linalg.norm(place[:3, :3], axis=0)
    return bool(np.linalg.det(place[:3, :3]) > 0 and sizes.max() <= SAME_SCALE * sizes.min())


def in_world(block: bpy.types.Collection | bpy.types.Mesh, places: np.ndarray) -> np.ndarray:
    """Where places (K, 3) m of a take, or of what waits to be labelled, are shown."""
    matrix = placed(block)
    return places @ matrix[:3, :3].T + matrix[:3, 3]
