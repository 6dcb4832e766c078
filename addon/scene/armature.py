# SPDX-License-Identifier: GPL-3.0-or-later
"""The skeleton as an armature, one bone a segment, posed per frame.

A bone rests along its segment, so its own axes are not the segment's: B, the bone's rest matrix, stands between them.
A segment with world rotation R and joint p puts its bone at [R B | p] in the armature, which stands at the origin.
"""

import json
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace

import bpy
import numpy as np
from mathutils import Matrix

from ..core.body.sides import side_in
from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.takes import Motion
from ..core.filling.ground import offsets_of, settled
from ..core.geometry.rotations import matrix_to_quaternion
from ..core.points.motion import PosedFrames
from . import animation

KEPT_SIDES = "mocap_sides"  # on an armature: those of its segments, as JSON

# Of the left, the right and the middle; sRGB. Blue against orange differs by brightness and for every kind of
# colour-blindness; the middle is neither.
SIDE_COLOURS = {"L": (0.13, 0.47, 0.95), "R": (1.0, 0.56, 0.1), "": (0.93, 0.93, 0.88)}


def segment_sides(markerset: MarkerSet) -> dict[str, str]:
    """The side of each segment by its name: that of its name, else the one that most of its markers are on."""
    segments, markers = markerset.skeleton.segments, set(markerset.markers)
    sides = {}
    for index, name in enumerate(segments):
        own = [side_in(markerset.markers[one], markers) for one in np.flatnonzero(markerset.attachment == index)]
        most = max(("L", "R"), key=own.count)
        sides[name] = side_in(name, segments) or (most if own.count(most) > len(own) / 2 else "")
    return sides


MIN_BONE_M = 0.02  # m; Blender deletes bones without length
SCALE = "mocap_scale"  # m for one unit of the marker set, (3,), on the armature
UPRIGHT = 2e-6  # rad, as Blender's own; nearer than that to its pole the first and the third angle are about one axis
MOVED_BONE = 1e-6  # m; a joint that wanders less than this against its parent needs no location keys


@dataclass(frozen=True, eq=False)
class Build:
    """One subject's body at rest: joints (J, 3) m in model axes, and scale (3,) m for one unit of the marker set."""

    joints: np.ndarray
    scale: np.ndarray


def build_of(markerset: MarkerSet, motion: Motion) -> Build:
    """The subject's own body: the median of what was fitted, or the marker set's mean where nobody was found."""
    skeleton = markerset.skeleton
    found = np.isfinite(motion.joints).all(axis=(1, 2)) & np.isfinite(motion.scale).all(axis=1)
    if not found.any():
        return mean_build(markerset)
    scale = np.median(motion.scale[found], axis=0)
    local = offsets_of(motion.joints[found], motion.rotations[found], skeleton.parents)
    offsets = np.concatenate([skeleton.offsets[:1] * scale, local])
    return Build(replace(skeleton, offsets=offsets).rest_joints, scale)


def mean_build(markerset: MarkerSet) -> Build:
    """The body of the mean person of a marker set."""
    scale = np.full(3, float(markerset.spread.height))
    return Build(markerset.skeleton.rest_joints * scale, scale)


def add_armature(
    context: bpy.types.Context, collection: bpy.types.Collection, name: str, markerset: MarkerSet, build: Build
) -> bpy.types.Object:
    """Adds an armature at the world's origin, in the rest pose: model axes are world axes.

    `collection` must be in the context's scene, and the context in object mode: bones can only be made in edit mode.
    """
    data = bpy.data.armatures.new(name)
    armature = bpy.data.objects.new(name, data)
    armature.show_in_front = True
    data.display_type = "STICK"
    collection.objects.link(armature)
    lay_bones(context, armature, markerset, build)
    for bone in armature.pose.bones:
        bone.rotation_mode = "QUATERNION"
    armature[KEPT_SIDES] = json.dumps(segment_sides(markerset))
    return armature


def armature_of(collection: bpy.types.Collection) -> bpy.types.Object:
    """The armature of a take or a marker set that is laid out; InputError when it was deleted."""
    for item in collection.all_objects:
        if item.type == "ARMATURE" and SCALE in item:
            return item
    raise InputError(f"{collection.name} has lost its armature; expected it to be labelled, or shown, again")


@contextmanager
def edited_bones(context: bpy.types.Context, armature: bpy.types.Object) -> Iterator[bpy.types.ArmatureEditBones]:
    """The bones of an armature to be changed, from object mode; what is active stays so."""
    layer, place = context.view_layer, context.scene.collection.objects
    lent = context.scene.collection not in armature.users_collection  # its own may be excluded from the view layer
    if lent:
        place.link(armature)
    before, layer.objects.active = layer.objects.active, armature
    try:
        bpy.ops.object.mode_set(mode="EDIT")
        yield armature.data.edit_bones
    finally:
        if armature.mode == "EDIT":
            bpy.ops.object.mode_set(mode="OBJECT")
        layer.update()  # else its pose points at the bones before, and a redo later ends Blender (5.2)
        layer.objects.active = before
        if lent:
            place.unlink(armature)


def lay_bones(context: bpy.types.Context, armature: bpy.types.Object, markerset: MarkerSet, build: Build):
    """Gives an armature the bones of a build at rest; those that it has get other places. Needs object mode."""
    segments, tails = markerset.skeleton.segments, bone_tails(markerset, build)
    with edited_bones(context, armature) as bones:
        for index, (segment, parent) in enumerate(zip(segments, markerset.skeleton.parents, strict=True)):
            bone = bones.get(segment) or bones.new(segment)
            bone.head, bone.tail, bone.roll = build.joints[index], tails[index], 0.0
            if parent >= 0:
                bone.parent = bones[segments[parent]]
    armature[SCALE] = [float(value) for value in build.scale]


def is_laid(armature: bpy.types.Object, markerset: MarkerSet, build: Build) -> bool:
    """Whether the bones of an armature are at rest where a build has them."""
    rest = rest_matrices(armature, markerset)[:, :3, 3]
    return bool(np.abs(rest - build.joints).max() <= MOVED_BONE and np.allclose(armature[SCALE], build.scale))


def bone_tails(markerset: MarkerSet, build: Build) -> np.ndarray:
    """(J, 3) m where each bone ends at rest: at the child joint nearest the body's middle, or where its flesh ends."""
    parents, tails = markerset.skeleton.parents, np.empty_like(build.joints)
    for index, joint in enumerate(build.joints):
        children = np.flatnonzero(parents == index)
        if len(children) and not markerset.skeleton.segments[index].startswith("hand."):  # which ends ahead of knuckles
            ahead = build.joints[children]
            tails[index] = ahead[np.argmin(np.abs(ahead[:, 1] - joint[1]).round(3) - ahead[:, 2] * 1e-6)]
        else:
            tails[index] = joint + _reach(markerset, index) * build.scale
        if np.linalg.norm(tails[index] - joint) < MIN_BONE_M:
            tails[index] = joint + MIN_BONE_M * np.array([0.0, 0.0, 1.0])
    return tails


def on_ground(motion: Motion, markerset: MarkerSet, build: Build, rate: float, cutoff: float | None = None) -> Motion:
    """The motion of one subject as its armature shows it: with planted feet, and smoothed by a cut-off, Hz."""
    skeleton, ends = markerset.skeleton, bone_tails(markerset, build) - build.joints
    pose = motion.joints, motion.rotations, skeleton.segments, skeleton.parents
    joints, rotations = settled(*pose, ends, rate, cutoff)
    return replace(motion, joints=joints, rotations=rotations)


def pose_armature(
    armature: bpy.types.Object, actions: animation.TakeActions, markerset: MarkerSet, motion: Motion, frames: np.ndarray
):
    """Keys every bone at Blender's `frames` (F,) so that its head is the joint and it turns as its segment does."""
    segments, channels = markerset.skeleton.segments, list(pose_channels(armature, markerset, motion))
    keys = sum(int(np.isfinite(values).sum()) for _, _, values in keyed_channels(segments, channels))
    key_bones(armature, actions.for_keys(keys), segments, channels, frames)


def key_bones(
    armature: bpy.types.Object,
    action: bpy.types.Action,
    names: Sequence[str],
    channels: Sequence[tuple[np.ndarray, np.ndarray]],
    frames: np.ndarray,
):
    """Keys the bones that are called so, the root first, with their channels at Blender's `frames` (F,)."""
    bag = animation.bind(armature, action)
    for name, channel, values in keyed_channels(names, channels):
        animation.key(bag, bone_path(name, channel), frames, values, name)


def bone_path(name: str, channel: str) -> str:
    """Where Blender has a channel of a bone."""
    return f'pose.bones["{bpy.utils.escape_identifier(name)}"].{channel}'


def keyed_channels(
    names: Sequence[str], channels: Sequence[tuple[np.ndarray, np.ndarray]]
) -> Iterator[tuple[str, str, np.ndarray]]:
    """The bones that are called so, the root first, with the channels that need keys, and the values of these."""
    for index, (name, (location, quaternion)) in enumerate(zip(names, channels, strict=True)):
        yield name, "rotation_quaternion", quaternion
        if index == 0 or moves(location):
            yield name, "location", location


def moves(location: np.ndarray) -> bool:
    """Whether a bone below the root, by its location channel (F, 3), begins elsewhere than at rest."""
    return bool(np.nanmax(np.abs(location), initial=0.0) > MOVED_BONE)


def pose_channels(
    armature: bpy.types.Object, markerset: MarkerSet, motion: Motion | PosedFrames
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """For each of the J bones its location (F, 3) and rotation quaternion (F, 4), in Blender's bone channels.

    Blender composes matrix = parent matrix · parent rest⁻¹ · rest · channels; this solves for the channels.
    """
    rest = rest_matrices(armature, markerset)
    return bone_channels(markerset.skeleton.parents, rest, motion.rotations, motion.joints)


def bone_channels(
    parents: np.ndarray, rest: np.ndarray, rotations: np.ndarray, heads: np.ndarray
) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """The channels of bones with rest matrices (J, 4, 4) that are turned from the rest by rotations (F, J, 3, 3).

    `heads` (F, J, 3) m is where they begin, both in the armature's space.
    """
    posed = np.tile(np.eye(4), (*heads.shape[:2], 1, 1))
    posed[..., :3, :3] = rotations @ rest[:, :3, :3]
    posed[..., :3, 3] = heads
    for index, parent in enumerate(parents):
        if parent >= 0:
            before = posed[:, parent] @ (np.linalg.inv(rest[parent]) @ rest[index])
        else:
            before = np.broadcast_to(rest[index], posed[:, 0].shape)
        back = before[:, :3, :3].transpose(0, 2, 1)
        location = (back @ (posed[:, index, :3, 3:] - before[:, :3, 3:]))[..., 0]
        yield location, continuous_quaternions(back @ posed[:, index, :3, :3])


def rest_matrices(armature: bpy.types.Object, markerset: MarkerSet) -> np.ndarray:
    """(J, 4, 4) rest matrix of each segment's bone in the armature's space."""
    bones = armature.data.bones
    return np.array([bones[segment].matrix_local for segment in markerset.skeleton.segments], dtype=float)


def attach(item: bpy.types.Object, armature: bpy.types.Object, segment: str, place: np.ndarray):
    """Parents `item` to a bone so that in the segment's axes, from its joint, it sits at `place` (4, 4) m."""
    bone = armature.data.bones[segment]
    rest = np.array(bone.matrix_local, dtype=float)
    to_tail = np.eye(4)
    to_tail[1, 3] = bone.length  # Blender hangs the children of a bone on its tail
    turned = np.eye(4)
    turned[:3, :3] = rest[:3, :3]
    item.parent, item.parent_type, item.parent_bone = armature, "BONE", segment
    item.rotation_mode = "QUATERNION"  # Euler angles lose half their digits near the poles
    item.matrix_basis = Matrix((np.linalg.inv(turned @ to_tail) @ place).tolist())


def _reach(markerset: MarkerSet, segment: int) -> np.ndarray:
    """(3,) the far end of a segment without children, from its joint, heights: of its capsules, else its markers."""
    capsules = markerset.capsules
    mine = np.asarray(capsules.segment) == segment
    ends = np.concatenate([capsules.start[mine], capsules.end[mine]])
    ends = ends if len(ends) else markerset.offsets[markerset.attachment == segment]
    return ends[np.argmax(np.linalg.norm(ends, axis=1))] if len(ends) else np.zeros(3)


def continuous_quaternions(matrices: np.ndarray) -> np.ndarray:
    """(F, 4) w x y z of rotations (F, 3, 3), each on the side of the one before so that in-betweens are short.

    NaN stays NaN.
    """
    there = np.isfinite(matrices).all(axis=(1, 2))
    quaternions = np.full((len(matrices), 4), np.nan)
    known = matrix_to_quaternion(matrices[there])
    along = np.append(known[:1, 0], np.einsum("fi,fi->f", known[1:], known[:-1]))
    quaternions[there] = known * np.cumprod(np.where(along < 0, -1.0, 1.0))[:, None]
    return quaternions


def rotation_channel(mode: str, matrices: np.ndarray) -> tuple[str, np.ndarray]:
    """The channel of a bone with a rotation mode, and its values of rotations (F, 3, 3), without jumps."""
    if mode not in ("QUATERNION", "AXIS_ANGLE"):
        return "rotation_euler", continuous_angles(mode, matrices)
    quaternions = continuous_quaternions(matrices)
    if mode == "QUATERNION":
        return "rotation_quaternion", quaternions
    length = np.linalg.norm(quaternions[:, 1:], axis=1, keepdims=True)
    angle = 2 * np.arctan2(length, quaternions[:, :1])
    return "rotation_axis_angle", np.hstack([angle, quaternions[:, 1:] / np.maximum(length, 1e-12)])


def continuous_angles(mode: str, matrices: np.ndarray) -> np.ndarray:
    """(F, 3) rad about x, y and z, in the order of a rotation mode, of rotations (F, 3, 3); the first ones least.

    Of the two triples of angles that are one rotation each is the one nearer to those before it.
    """
    first, second, third = order = ["XYZ".index(axis) for axis in mode]
    own = matrices[:, :, order][:, order]
    across = np.hypot(own[:, 0, 0], own[:, 1, 0])
    upright = across < UPRIGHT
    angles = np.zeros((1 + len(matrices), 3))  # from none
    angles[1:, first] = np.arctan2(*np.where(upright, (-own[:, 1, 2], own[:, 1, 1]), (own[:, 2, 1], own[:, 2, 2])))
    angles[1:, second] = np.arctan2(-own[:, 2, 0], across)
    angles[1:, third] = np.where(upright, 0, np.arctan2(own[:, 1, 0], own[:, 0, 0]))
    angles *= 1 if (second - first) % 3 == 1 else -1
    other = np.pi + np.where(np.arange(3) == second, -angles, angles)
    far = [np.abs((one[1:] - angles[:-1] + np.pi) % (2 * np.pi) - np.pi).sum(axis=1) for one in (angles, other)]
    changes = np.cumsum(far[1] < far[0], axis=0) % 2 == 1
    angles[1:][changes] = other[1:][changes]
    return np.unwrap(angles, axis=0)[1:]
