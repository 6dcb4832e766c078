# SPDX-License-Identifier: GPL-3.0-or-later
"""A take's motion as an action of somebody's rig, whatever its bones hang on.

Blender itself is asked what carries each bone: all are turned at once, and what turns as another one does follows it.
So constraints, drivers and bones in between count as they are.
"""

from collections.abc import Mapping

import bpy
import numpy as np
from mathutils import Euler, Matrix, Vector

from ..core.data.errors import InputError
from ..core.retarget.matching import PARTS, RestBones
from ..core.retarget.retargeting import Rig, axes_at_rest, retarget
from . import animation
from .armature import armature_of, bone_path, continuous_quaternions
from .character import moving_in
from .ownership import is_keyed_by_us, is_made_for, is_untouched, role_of, sign
from .stored import Stored

# What bones of control rigs are switched to, by the name of their property: limbs by FK, and all follow what is above.
SWITCHES = {"IK_FK": 1.0, "ik_fk_switch": 1.0, "FK_limb_follow": 0.0, "neck_follow": 1.0, "head_follow": 1.0}
NEEDED_PARTS = ("hips", "thigh.L", "thigh.R", "shank.L", "shank.R")
PROBE_TURN, PROBE_STEP = 0.5, 0.9  # rad by which bones are turned to see what follows them, and between their axes
SAME_SCALE = 1.001  # of the axes of a rig that is scaled evenly


def rest_bones(rig: bpy.types.Object) -> RestBones:
    """The bones of an armature at rest."""
    bones = rig.data.bones
    parents = np.array([-1 if bone.parent is None else bones.find(bone.parent.name) for bone in bones])
    heads, tails = (
        np.array([getattr(bone, end) for bone in bones]).reshape(-1, 3) for end in ("head_local", "tail_local")
    )
    return RestBones(tuple(bone.name for bone in bones), parents, heads, tails)


def retarget_take(
    context: bpy.types.Context,
    rig: bpy.types.Object,
    collection: bpy.types.Collection,
    stored: Stored,
    matched: Mapping[str, str],
    feet: bool,
    hands: bool,
) -> bpy.types.Action:
    """Gives a rig an action of its own that moves it as the take's body; `matched` has its bones by the body's parts.

    An action that was made so before of the same take is replaced where nobody changed it; any other one stays.
    Raises InputError where the body or the rig is no person's.
    """
    body = moving_in(collection, stored)
    character = body.character
    bones = _bones_by_part(rig, {part: bone for part, bone in matched.items() if part in character.names})
    source = armature_of(collection)
    place = np.array(source.matrix_world.inverted() @ rig.matrix_world)
    sizes = np.linalg.norm(place[:3, :3], axis=0)
    if np.linalg.det(place[:3, :3]) <= 0 or sizes.max() > SAME_SCALE * sizes.min():
        raise InputError(f"{rig.name} is mirrored or scaled unevenly; expected its scale applied, with Ctrl A")
    joints, rotated = body.settled()
    there = np.isfinite(joints).all(axis=(1, 2))
    if not there.any():
        raise InputError(f"{stored.name} has nobody in any frame; expected a take in which the body was found")
    action = _own_action(rig, collection, stored.name)
    rig.data.pose_position = "POSE"
    switched = _switch(rig)
    follows, rest, steps = _probe(context, rig, [bone for _, bone in bones])
    parts = tuple(part for part, _ in bones)
    axes = axes_at_rest({part: matrix[:3, 3] for part, matrix in zip(parts, rest, strict=True)})
    unit = sizes.mean()
    heads = rest[:, :3, 3] @ axes * unit
    lengths = np.array([rig.data.bones[bone].length for _, bone in bones])[:, None]
    tails = heads + rest[:, :3, 1] @ axes * unit * lengths
    motion = joints[there], rotated[there]
    turns, hips = retarget(character, motion, stored.rate, Rig(parts, follows, heads, tails), feet, hands)
    turns = (place[:3, :3] / unit).T @ turns @ axes.T  # in the armature's own axes
    hips = (hips - place[:3, 3]) @ np.linalg.inv(place[:3, :3]).T
    bag = animation.bind(rig, action)
    frames = body.frames[there]
    first, way = bones[0][1], (hips - rest[0, :3, 3]) @ np.linalg.inv(steps)
    animation.key(bag, bone_path(first, "location"), frames, way, first)
    for index, (_, bone) in enumerate(bones):
        above, own = follows[index], rest[index, :3, :3]
        carried = own.T if above < 0 else own.T @ turns[:, above].swapaxes(1, 2)
        mode = rig.pose.bones[bone].rotation_mode
        path, values = _rotation_channel(mode, carried @ turns[:, index] @ own)
        animation.key(bag, bone_path(bone, path), frames, values, bone)
    for path, value, bone in switched:
        animation.key(bag, path, frames[:1], np.array([[value]]), bone)
    sign(action, _role(rig, stored.name), collection)
    context.scene.frame_set(context.scene.frame_current)
    return action


def _bones_by_part(rig: bpy.types.Object, matched: Mapping[str, str]) -> list[tuple[str, str]]:
    """The parts with their bones, the hips first, with those between the lowest bone of the spine and the chest."""
    there = [part for part in PARTS if matched.get(part, "") in rig.pose.bones]
    if lacking := [part for part in NEEDED_PARTS if part not in there]:
        raise InputError(
            f"{rig.name} has no bone for {', '.join(lacking)}; expected one for each, under Bones of the Rig"
        )
    found = [(part, matched[part]) for part in there]
    if {"spine", "chest"} <= set(there):
        between, bone = [], rig.data.bones[matched["chest"]].parent
        while bone is not None and bone.name != matched["spine"]:
            between.insert(0, ("between", bone.name))
            bone = bone.parent
        at = there.index("chest")
        found[at:at] = between if bone is not None else []
    if twice := [bone for number, (_, bone) in enumerate(found) if bone in [one for _, one in found[:number]]]:
        raise InputError(f"{twice[0]} of {rig.name} stands for two parts of the body; expected a bone for each")
    return found


def _role(rig: bpy.types.Object, name: str) -> str:
    return f"{name} on {rig.name}"


def _own_action(rig: bpy.types.Object, collection: bpy.types.Collection, name: str) -> bpy.types.Action:
    """A new action of a rig, in the place of the one that was made for the same; what a person made is kept."""
    data = rig.animation_data_create()
    if data.use_tweak_mode:
        raise InputError(f"a strip of {rig.name} is in tweak mode; expected you to leave that, with Tab in the editor")
    former, called = data.action, f"{name} retargeted"
    for one in [one for one in bpy.data.actions if is_made_for(one, collection)]:
        if role_of(one).endswith(f"\n{_role(rig, name)}") and is_untouched(one) and one.slots:
            data.action, data.action_slot = one, one.slots[0]
            if one.users == 1 + one.use_fake_user and is_keyed_by_us(rig):
                former = None if former == one else former
                bpy.data.actions.remove(one)
    if former is not None:
        former.use_fake_user = True
    action = bpy.data.actions.new(called)
    data.action = action
    return action


def _switch(rig: bpy.types.Object) -> list[tuple[str, float, str]]:
    """Switches a control rig to FK; the paths, values and bones of what is switched."""
    switched = []
    for bone in rig.pose.bones:
        for name in SWITCHES.keys() & bone.keys():
            bone[name] = type(bone[name])(SWITCHES[name])
            switched.append((f'{bone_path(bone.name, "")[:-1]}["{name}"]', SWITCHES[name], bone.name))
    rig.update_tag()
    return switched


def _probe(
    context: bpy.types.Context, rig: bpy.types.Object, names: list[str]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """What carries each of C bones (C,), -1 for none; where they are unturned (C, 4, 4), in the armature's axes.

    And (3, 3) how far the first one goes there for a unit of each of its location's channels. Leaves them unturned.
    """
    bones = [rig.pose.bones[name] for name in names]

    def posed(basis: list[Matrix]) -> np.ndarray:
        for bone, matrix in zip(bones, basis, strict=True):
            bone.matrix_basis = matrix
        context.view_layer.update()
        return np.array([bone.matrix for bone in bones])

    still = [Matrix()] * len(bones)
    rest = posed(still)
    steps = [posed([Matrix.Translation(np.eye(3)[axis]), *still[1:]])[0, :3, 3] - rest[0, :3, 3] for axis in range(3)]
    axes = [
        Vector((np.sin(PROBE_STEP * index), np.cos(PROBE_STEP * index), np.sin(index))) for index in range(len(bones))
    ]
    basis = [Matrix.Rotation(PROBE_TURN + PROBE_STEP * index, 4, axis) for index, axis in enumerate(axes)]
    found = posed(basis)
    posed(still)
    rest[:, :3, :3] /= np.linalg.norm(rest[:, :3, :3], axis=1)[:, None]
    turned = _turns(found, rest)
    before = _turns(found @ np.linalg.inv(np.array(basis)), rest)  # of what carries each
    follows = np.full(len(bones), -1)
    for index in range(1, len(bones)):
        # The cosine of the angle between, which is one for what carries it.
        near = [np.trace(before[index]), *(np.trace(before[index] @ turn.T) for turn in turned[:index])]
        follows[index] = int(np.argmax(near)) - 1
    return follows, rest, np.array(steps)


def _turns(posed: np.ndarray, rest: np.ndarray) -> np.ndarray:
    """(C, 3, 3) how bones are turned from rest, by where they are (C, 4, 4) and were."""
    axes = posed[:, :3, :3] / np.linalg.norm(posed[:, :3, :3], axis=1)[:, None]
    return axes @ rest[:, :3, :3].swapaxes(1, 2)


def _rotation_channel(mode: str, matrices: np.ndarray) -> tuple[str, np.ndarray]:
    """The channel of a bone with a rotation mode, and its values of rotations (F, 3, 3), without jumps."""
    quaternions = continuous_quaternions(matrices)
    if mode == "QUATERNION":
        return "rotation_quaternion", quaternions
    if mode == "AXIS_ANGLE":
        length = np.linalg.norm(quaternions[:, 1:], axis=1, keepdims=True)
        angle = 2 * np.arctan2(length, quaternions[:, :1])
        return "rotation_axis_angle", np.hstack([angle, quaternions[:, 1:] / np.maximum(length, 1e-12)])
    angles = np.empty((len(matrices), 3))
    before = Euler((0, 0, 0), mode)
    for row, matrix in enumerate(matrices.tolist()):
        before = Matrix(matrix).to_euler(mode, before)
        angles[row] = before
    return "rotation_euler", angles
