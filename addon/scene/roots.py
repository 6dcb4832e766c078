# SPDX-License-Identifier: GPL-3.0-or-later
"""The empty that all of a take hangs on: moved, turned or scaled, what is shown of the take follows."""

import bpy
import numpy as np
from mathutils import Matrix

from . import naming
from .cameras import pose_of
from .ownership import is_made_for, release, sign

ROOT_SIZE = 0.5  # m, of the axes that are drawn


def root_of(collection: bpy.types.Collection) -> bpy.types.Object | None:
    """The root of a take; None where it was deleted, or the file is older than roots."""
    items = (item for item in collection.objects if naming.TAKE_ROOT in item)
    return next((item for item in items if is_made_for(item, collection)), None)


def ensure_root(collection: bpy.types.Collection, name: str) -> bpy.types.Object:
    """The root of a take called `name`, where a person has put it; a new one at the origin where there is none."""
    root = root_of(collection)
    if root is None:
        root = bpy.data.objects.new(f"{name} root", None)
        root.empty_display_type, root.empty_display_size, root[naming.TAKE_ROOT] = "PLAIN_AXES", ROOT_SIZE, True
        collection.objects.link(root)
        sign(root, "root", collection)
    return root


def put_where(collection: bpy.types.Collection, other: bpy.types.Collection):
    """Puts a take where another one stands, which is the same recording."""
    root, theirs = root_of(collection), root_of(other)
    if root is not None and theirs is not None:
        root.matrix_world = pose_of(theirs)


def remove_root(collection: bpy.types.Collection):
    """Removes the root of a take that is gone; one that was animated, or moved with things of a person on it, stays."""
    root = root_of(collection)
    if root is not None and (root.animation_data is not None or (root.children and pose_of(root) != Matrix())):
        release(root)
    elif root is not None:
        bpy.data.objects.remove(root)


def placed(collection: bpy.types.Collection | None) -> np.ndarray:
    """(4, 4) from the coordinates of a take, which are the room's, to the world's."""
    root = None if collection is None else root_of(collection)
    return np.array(Matrix() if root is None else pose_of(root), dtype=float)


def in_world(collection: bpy.types.Collection, places: np.ndarray) -> np.ndarray:
    """Where places (K, 3) m of a take are shown."""
    matrix = placed(collection)
    return places @ matrix[:3, :3].T + matrix[:3, 3]
