# SPDX-License-Identifier: GPL-3.0-or-later
"""A take's body as the armature of a character, for retargeting: usual bone names, at rest in a T-pose.

Every bone's Z axis faces where the character looks, but for feet and toes, whose Z axis is up.
"""

from collections.abc import Callable
from pathlib import Path

import bpy
import numpy as np
from mathutils import Vector

from ..core.data.errors import InputError, JobError
from ..core.posing.character import BONE_NAMES
from ..core.retarget.moving import Moving
from . import armature as armatures
from . import naming
from .stored import Stored
from .timing import set_time

CHARACTER_OF = "mocap_character"  # on the armature: whose names its bones have
BLENDER_AXES, BVH_AXES = np.eye(3), np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])


def moving_in(collection: bpy.types.Collection, stored: Stored) -> Moving:
    """The body that a take's armature shows; InputError where a bone of that is gone."""
    armature, motion = armatures.armature_of(collection), stored.motion
    bones = [armature.data.bones.get(name) for name in stored.segments]
    if None in bones:
        gone = stored.segments[bones.index(None)]
        raise InputError(f"{armature.name} has no bone {gone}; expected the bones that it was shown with")
    places = (np.array([getattr(bone, end) for bone in bones]) for end in ("head_local", "tail_local"))
    own = stored.name, stored.rate, stored.cutoff, stored.segments, stored.parents
    return Moving(*own, *places, motion.frames + stored.clock.shift, motion.joints, motion.rotations).with_toes()


def add_character(
    context: bpy.types.Context,
    collection: bpy.types.Collection,
    body: Moving,
    names: str,
    axes: np.ndarray = BLENDER_AXES,
) -> bpy.types.Object:
    """Adds the armature of a take's character, keyed in every frame in which the subject was found.

    `names` is one of `BONE_NAMES`; `axes` (3, 3) turns it all into the axes of another program. Needs object mode;
    adds no undo step of its own. Raises InputError where the body is no person's.
    """
    character, words = body.character, BONE_NAMES[names]
    heads, rotations = character.posed(*body.settled())
    called = [words[name] for name in character.names]
    data = bpy.data.armatures.new(naming.title(body.name, "character"))
    armature = bpy.data.objects.new(f"{body.name} character", data)
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
    channels = list(armatures.bone_channels(character.parents, rest, axes @ rotations @ axes.T, heads @ axes.T))
    # Only the root moves: each bone begins where the one above has it, and hundredths of millimetres are no motion.
    still = [(np.zeros_like(location), turn) for location, turn in channels[1:]]
    action = bpy.data.actions.new(armature.name)
    armatures.key_bones(armature, action, called, [channels[0], *still], body.frames)
    return armature


# Blender's exporters, by the endings of their files: the operator, the axes of what it writes, and how.
EXPORTERS = {
    "bvh": (
        ("export_anim", "bvh"),
        BVH_AXES,
        {"rotate_mode": "ZXY", "root_transform_only": True},
    ),
    "fbx": (
        ("export_scene", "fbx"),
        BLENDER_AXES,
        {
            "use_selection": True,
            "object_types": {"ARMATURE"},
            "add_leaf_bones": False,
            "bake_anim_use_all_bones": True,
            "bake_anim_use_nla_strips": False,
            "bake_anim_use_all_actions": False,
            "bake_anim_simplify_factor": 0.0,
        },
    ),
}


def export_character(path: Path, body: Moving, names: str, scale: float, tell: Callable[[float], None]):
    """Writes a take's character by one of Blender's exporters, from a scene of its own that is gone afterwards.

    `scale` is of BVH, which has no unit: how many of its units are a metre. `tell` hears which share is done. JobError
    where this Blender cannot write it.
    """
    (family, own), axes, options = EXPORTERS[path.suffix[1:]]
    exporter = getattr(getattr(bpy.ops, family), own)
    try:
        exporter.get_rna_type()
    except KeyError:
        called = own.upper()
        raise JobError(
            f"Blender's own {called} exporter is switched off; expected it enabled in the preferences, under Add-ons"
        ) from None
    if own == "bvh":
        first, last = int(body.frames[0]), int(body.frames[-1])
        options = {**options, "global_scale": scale, "frame_start": first, "frame_end": last}
    context, mine = bpy.context, bpy.context.scene.collection.objects
    item = add_character(context, context.scene.collection, body, names, axes)  # where bones can be made
    scene = bpy.data.scenes.new(body.name)
    scene.collection.objects.link(item)
    mine.unlink(item)

    def hear(played: bpy.types.Scene, *_):
        if played == scene:
            tell((played.frame_current - body.frames[0]) / len(body.frames))

    chosen = {"object": item, "active_object": item, "selected_objects": [item]}
    bpy.app.handlers.frame_change_post.append(hear)
    try:
        set_time(scene, body.rate, body.frames)
        with context.temp_override(scene=scene, view_layer=scene.view_layers[0], **chosen):
            if "FINISHED" not in exporter(filepath=str(path), check_existing=False, **options):
                raise RuntimeError("that it wrote nothing")
        if own == "bvh":  # Blender rounds this to microseconds, which is a frame in some minutes
            head, words, rest = path.read_bytes().partition(b"Frame Time: ")
            path.write_bytes(head + words + f"{1 / body.rate:.12g}".encode() + rest[rest.index(b"\n") :])
    except (RuntimeError, OSError) as error:  # the exporter's trouble, of which the last line says what it was
        reason = str(error).partition("\nLocation: ")[0].strip().splitlines()[-1]
        raise JobError(f"Blender's exporter says {reason}; expected a place that can be written", path) from error
    finally:
        bpy.app.handlers.frame_change_post.remove(hear)
        bpy.data.batch_remove([item, item.data, item.animation_data.action])
        bpy.data.scenes.remove(scene)
