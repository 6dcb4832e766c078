# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigs of people as animators have them: of any names, proportions and rest pose, with bones that roll."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace

import numpy as np

from addon.core.geometry.rotations import turn_of
from addon.core.posing.character import both_sides

T_POSE, A_POSE, HANGING = 0.0, 45.0, 82.0  # degrees that the arms are below the horizontal

MIXAMO = both_sides(
    "Hips Spine Spine2 Neck Head",
    "*Shoulder *Arm *ForeArm *Hand *UpLeg *Leg *Foot *ToeBase",
    ("Left", "Right"),
) | {"between": "Spine1"}
MIXAMO = {part: f"mixamorig:{name}" for part, name in MIXAMO.items()}
UNREAL = both_sides(
    "pelvis spine_01 spine_03 neck_01 head",
    "clavicle_* upperarm_* lowerarm_* hand_* thigh_* calf_* foot_* ball_*",
    ("l", "r"),
) | {"between": "spine_02"}
VRM = both_sides(
    "J_Bip_C_Hips J_Bip_C_Spine J_Bip_C_UpperChest J_Bip_C_Neck J_Bip_C_Head",
    "J_Bip_*_Shoulder J_Bip_*_UpperArm J_Bip_*_LowerArm J_Bip_*_Hand "
    "J_Bip_*_UpperLeg J_Bip_*_LowerLeg J_Bip_*_Foot J_Bip_*_ToeBase",
    ("L", "R"),
) | {"between": "J_Bip_C_Chest"}
MAYA = both_sides(
    "Pelvis Spine1 Spine3 Neck Head",
    "*_Collar *_Shoulder *_Elbow *_Wrist *_Hip *_Knee *_Ankle *_Foot",
    ("L", "R"),
) | {"between": "Spine2"}
NAMELESS = {part: f"Bone.{number:03d}" for number, part in enumerate(MIXAMO)}


@dataclass(frozen=True)
class RigBone:
    """A bone at rest: its part, the part it hangs on, head (3,) and tail (3,) m, and roll, rad."""

    part: str
    parent: str | None
    head: np.ndarray
    tail: np.ndarray
    roll: float = 0.0


def rig_bones(arms: float = T_POSE, size: float = 1.0, thigh: float = 0.5, roll: float = 0.0) -> list[RigBone]:
    """A person's bones, 1.8 m tall times `size`, looking along -y; `thigh` is its part of the leg; bones roll so."""
    joints: dict[str, tuple[str | None, tuple[float, float, float], str | tuple[float, float, float]]] = {
        "hips": (None, (0, 0.02, 1.0), "spine"),
        "spine": ("hips", (0, 0.03, 1.1), "between"),
        "between": ("spine", (0, 0.02, 1.22), "chest"),
        "chest": ("between", (0, 0.025, 1.34), "neck"),
        "neck": ("chest", (0, 0.04, 1.52), "head"),
        "head": ("neck", (0, 0.02, 1.6), (0, 0.0, 1.82)),
    }
    knee = 0.94 - thigh * 0.85
    for side, sign in (("L", 1), ("R", -1)):
        joints |= {
            f"shoulder.{side}": ("chest", (0.03 * sign, 0.0, 1.46), f"upper_arm.{side}"),
            f"upper_arm.{side}": (f"shoulder.{side}", (0.19 * sign, 0.03, 1.45), f"forearm.{side}"),
            f"forearm.{side}": (f"upper_arm.{side}", (0.48 * sign, 0.04, 1.45), f"hand.{side}"),
            f"hand.{side}": (f"forearm.{side}", (0.74 * sign, 0.02, 1.45), (0.84 * sign, 0.02, 1.45)),
            f"thigh.{side}": ("hips", (0.1 * sign, 0.01, 0.94), f"shank.{side}"),
            f"shank.{side}": (f"thigh.{side}", (0.1 * sign, -0.01, knee), f"foot.{side}"),
            f"foot.{side}": (f"shank.{side}", (0.1 * sign, 0.03, 0.09), f"toes.{side}"),
            f"toes.{side}": (f"foot.{side}", (0.12 * sign, -0.11, 0.02), (0.13 * sign, -0.2, 0.02)),
        }
    bones = []
    for number, (part, (parent, head, tail)) in enumerate(joints.items()):
        ends = [np.array(joints[end][1] if isinstance(end, str) else end, float) for end in (head, tail)]
        name, _, side = part.partition(".")
        if name in ("upper_arm", "forearm", "hand", "shoulder") and arms:
            turn = turn_of(np.array([0, np.radians(arms if side == "L" else -arms), 0]))
            pivot = np.array(joints[f"upper_arm.{side}"][1])
            ends = [end if name == "shoulder" else pivot + turn @ (end - pivot) for end in ends]
        bones.append(RigBone(part, parent, *(end * size for end in ends), roll * number))
    return bones


def add_rig(bones: list[RigBone], names: Mapping[str, str], place: Callable = lambda head: head):
    """The rig as an armature in the scene; `place` puts points into its own axes and unit."""
    import bpy
    from mathutils import Vector

    data = bpy.data.armatures.new("rig")
    rig = bpy.data.objects.new("rig", data)
    bpy.context.scene.collection.objects.link(rig)
    with bones_of(rig) as own_bones:
        for bone in bones:
            own = own_bones.new(names[bone.part])
            own.head, own.tail, own.roll = Vector(place(bone.head)), Vector(place(bone.tail)), bone.roll
            if bone.parent:
                own.parent = own_bones[names[bone.parent]]
    return rig


@contextmanager
def bones_of(rig) -> Iterator:
    """The bones of a rig at rest, to be changed; it is the active object from then on."""
    import bpy

    bpy.context.view_layer.objects.active = rig
    bpy.ops.object.mode_set(mode="EDIT")
    yield rig.data.edit_bones
    bpy.ops.object.mode_set(mode="OBJECT")


def as_fbx(point: np.ndarray) -> tuple[float, float, float]:
    """A point in centimetres with y up, as imported files have it."""
    return point[0] * 100, point[2] * 100, -point[1] * 100


def mixamo():
    """As Mixamo's FBX files come in."""
    rig = add_rig(rig_bones(size=1.05, thigh=0.52), MIXAMO, as_fbx)
    rig.rotation_euler, rig.scale = (np.pi / 2, 0, 0), (0.01, 0.01, 0.01)
    return rig


def unreal():
    """In an A-pose, elsewhere in the scene, with bones that roll."""
    rig = add_rig(rig_bones(A_POSE, 1.02, 0.48, 0.7), UNREAL)
    rig.location, rig.rotation_euler = (1, 2, 0), (0, 0, 1)
    return rig


def hanging():
    """Small, with arms that hang, and VRM's names."""
    return add_rig(rig_bones(HANGING, 0.9, 0.54, -0.4), VRM)


def nameless():
    """Large, between two poses, and without names."""
    return add_rig(rig_bones(30, 1.3, 0.5, 1.1), NAMELESS)


def drawn():
    """A drawn figure, whose hips are twice as wide as a person's, and feet twice as long."""
    bones = []
    for bone in rig_bones():
        part, _, side = bone.part.partition(".")
        ends = np.array([bone.head, bone.tail])
        if part in ("thigh", "shank", "foot", "toes"):
            ends[:, 0] += 0.1 if side == "L" else -0.1
        if part in ("foot", "toes"):
            ends[:, 1] = 2 * ends[:, 1] - 0.03
        bones.append(replace(bone, head=ends[0], tail=ends[1]))
    return add_rig(bones, NAMELESS)


def metarig():
    """Rigify's human as it is laid out."""
    import bpy

    bpy.ops.object.armature_basic_human_metarig_add()
    return bpy.context.object


def generated():
    """Rigify's human with its controls."""
    import bpy

    metarig()
    bpy.ops.pose.rigify_generate()
    return bpy.context.object
