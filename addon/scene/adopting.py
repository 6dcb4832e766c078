# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes of earlier versions, which signed nothing that they made: what it is tells by marks, names and plainness."""

import re

import bpy

from . import armature as armatures
from . import naming
from .cloud import FRAME
from .ownership import MADE, WITHOUT_NAMES, sign
from .performers import body_material, homes


def adopt_take(collection: bpy.types.Collection):
    """Signs what an earlier version made for a take, as far as a person left it as it was; nothing where that is done.

    Keys are taken for the add-on's, as nothing tells whose they are. Of what was duplicated the first is the add-on's.
    """
    if MADE in collection:
        return
    sign(collection, collection.name)
    looked_at, seen = set(), set()
    for performer, home in {**homes(collection), "": collection}.items():
        if performer:
            sign(home, performer, collection)
            if body_material(home) is not None:
                sign(body_material(home), "colour")
        for child in home.children:
            called = re.search("(body|markers)$", _bare(child))
            if called and MADE not in child:
                sign(child, f"{performer} {called[0]}", collection)
        capsules = [item for item in home.all_objects if naming.CAPSULE in item]
        for item in sorted(set(home.all_objects) - looked_at, key=_order):
            looked_at.add(item)
            role, name = _made_as(item, performer, capsules)
            called = name in (item.name, _bare(item)) or (name.startswith(" ") and _bare(item).endswith(name))
            if called and role not in seen and _is_plain(item):
                seen.add(role)
                if item.animation_data and item.animation_data.action:
                    sign(item.animation_data.action, "action")
                sign(item, role, collection)


def _order(item: bpy.types.Object) -> tuple[bool, str]:
    """Capsules are signed with whose bones they hang on, and a copy has a name that comes later."""
    return item.type != "ARMATURE", item.name


def _made_as(item: bpy.types.Object, performer: str, capsules: list[bpy.types.Object]) -> tuple[str, str]:
    """What an object is in a take of the performer, and its name, or how that ends; nothing where it bears no mark."""
    if naming.MARKER in item:
        return f"marker {item[naming.MARKER]}", str(item[naming.MARKER])
    if naming.CAPSULE in item:
        return f"{performer} capsule {capsules.index(item)}", f"{item[naming.CAPSULE]} capsule"
    if armatures.SCALE in item:
        return f"{performer} armature", " armature"
    if item.type == "MESH" and FRAME in item.data.attributes:
        return WITHOUT_NAMES, " unnamed"
    return "", ""


def _is_plain(item: bpy.types.Object) -> bool:
    """Whether nothing was added to an object."""
    bones = item.pose.bones if item.pose else ()
    data = item.animation_data
    keyed = data is not None and (data.nla_tracks or data.drivers or not _is_ours(data.action))
    more = item.constraints or len(item.modifiers) > (naming.CAPSULE not in item) or item.vertex_groups
    return not (keyed or more or any(bone.constraints for bone in bones))


def _is_ours(action: bpy.types.Action | None) -> bool:
    return action is None or action.name.startswith(naming.PREFIX)


def _bare(block: bpy.types.ID) -> str:
    """A name without what Blender adds to one that collides."""
    return re.sub(r"\.\d+$", "", block.name)
