# SPDX-License-Identifier: GPL-3.0-or-later
"""A take's body as the armature of a character, for retargeting: usual bone names, at rest in a T-pose.

Every bone's Z axis faces where the character looks, but for feet and toes, whose Z axis is up.
"""

import bpy
import numpy as np
from mathutils import Vector

from ..core.data.errors import InputError
from ..core.filling.ground import settled
from ..core.posing.character import BONE_NAMES, character_of
from . import armature as armatures
from . import naming
from .stored import Stored

CHARACTER_OF = "mocap_character"  # on the armature: whose names its bones have
BLENDER_AXES, BVH_AXES = np.eye(3), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def ends_in(collection: bpy.types.Collection, stored: Stored) -> tuple[np.ndarray, np.ndarray]:
    """Where the bones of a take's armature begin and end at rest, (J, 3) m each; InputError where one is gone."""
    armature = armatures.armature_of(collection)
    bones = [armature.data.bones.get(name) for name in stored.segments]
    if None in bones:
        gone = stored.segments[bones.index(None)]
        raise InputError(f"{armature.name} has no bone {gone}; expected the bones that it was shown with")
    return tuple(np.array([getattr(bone, end) for bone in bones]) for end in ("head_local", "tail_local"))


def add_character(
    context: bpy.types.Context,
    collection: bpy.types.Collection,
    stored: Stored,
    names: str,
    axes: np.ndarray = BLENDER_AXES,
) -> bpy.types.Object:
    """Adds the armature of a take's character, keyed in every frame in which the subject was found.

    `names` is one of `BONE_NAMES`; `axes` (3, 3) turns it all into the axes of another program. Needs object mode;
    adds no undo step of its own. Raises InputError as `ends_in` does, and where the body is no person's.
    """
    heads, tails = ends_in(collection, stored)
    character, words = character_of(stored.segments, heads, tails), BONE_NAMES[names]
    called = [words[name] for name in character.names]
    data = bpy.data.armatures.new(naming.title(stored.name, "character"))
    armature = bpy.data.objects.new(f"{stored.name} character", data)
    armature[CHARACTER_OF] = names
    collection.objects.link(armature)
    ahead, up = axes @ [0.0, -1, 0], axes @ [0.0, 0, 1]
    with armatures.edited_bones(context, armature) as bones:
        for index, (name, above) in enumerate(zip(called, character.parents, strict=True)):
            bone = bones.new(name)
            bone.head, bone.tail = axes @ character.heads[index], axes @ character.tails[index]
            bone.align_roll(Vector(up if character.names[index].startswith(("foot", "toes")) else ahead))
            if above >= 0:
                bone.parent = bones[called[above]]
                bone.use_connect = (bone.head - bone.parent.tail).length < armatures.MOVED_BONE
    for bone in armature.pose.bones:
        bone.rotation_mode = "QUATERNION"
    rest = np.array([data.bones[name].matrix_local for name in called], dtype=float)
    pose = stored.motion.joints, stored.motion.rotations, stored.segments, stored.parents
    heads, rotations = character.posed(*settled(*pose, tails - heads, stored.rate, stored.cutoff))
    channels = list(armatures.bone_channels(character.parents, rest, axes @ rotations @ axes.T, heads @ axes.T))
    # Only the root moves: each bone begins where the one above has it, and hundredths of millimetres are no motion.
    still = [(np.zeros_like(location), turn) for location, turn in channels[1:]]
    action = bpy.data.actions.new(armature.name)
    armatures.key_bones(armature, action, called, [channels[0], *still], stored.motion.frames + stored.shift)
    return armature
