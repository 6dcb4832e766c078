# SPDX-License-Identifier: GPL-3.0-or-later
"""The skeleton as an armature, one bone a segment, posed per frame.

A bone rests along its segment, so its own axes are not the segment's: B, the bone's rest matrix, stands between them.
A segment with world rotation R and joint p puts its bone at [R B | p] in the armature, which stands at the origin.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import bpy
import numpy as np
from mathutils import Matrix

from ..core.data.markersets import MarkerSet
from ..core.data.takes import Motion
from ..core.geometry.rotations import matrix_to_quaternion
from ..core.points.motion import PosedFrames
from . import animation
from .sides import keep_sides

MIN_BONE_M = 0.02  # m; Blender deletes bones without length
SCALE = "mocap_scale"  # m for one unit of the marker set, (3,), on the armature
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
    offsets = np.median(_local_offsets(skeleton.parents, motion.joints[found], motion.rotations[found]), axis=0)
    offsets[0] = skeleton.offsets[0] * scale
    return Build(_summed(skeleton.parents, offsets), scale)


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
    keep_sides(armature, markerset)
    return armature


def lay_bones(context: bpy.types.Context, armature: bpy.types.Object, markerset: MarkerSet, build: Build):
    """Gives an armature the bones of a build at rest; those that it has get other places. Needs object mode."""
    layer, data = context.view_layer, armature.data
    before = layer.objects.active
    layer.objects.active = armature
    bpy.ops.object.mode_set(mode="EDIT")
    tails = bone_tails(markerset, build)
    for index, segment in enumerate(markerset.skeleton.segments):
        bone = data.edit_bones.get(segment) or data.edit_bones.new(segment)
        bone.head, bone.tail, bone.roll = build.joints[index], tails[index], 0.0
        parent = markerset.skeleton.parents[index]
        if parent >= 0:
            bone.parent = data.edit_bones[markerset.skeleton.segments[parent]]
    bpy.ops.object.mode_set(mode="OBJECT")
    layer.objects.active = before
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
        if len(children):
            ahead = build.joints[children]
            tails[index] = ahead[np.argmin(np.abs(ahead[:, 1] - joint[1]).round(3) - ahead[:, 2] * 1e-6)]
        else:
            tails[index] = joint + _reach(markerset, index) * build.scale
        if np.linalg.norm(tails[index] - joint) < MIN_BONE_M:
            tails[index] = joint + MIN_BONE_M * np.array([0.0, 0.0, 1.0])
    return tails


def pose_armature(
    armature: bpy.types.Object,
    actions: animation.TakeActions,
    markerset: MarkerSet,
    motion: Motion,
    frames: np.ndarray,
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
        local = _inverse(before) @ posed[:, index]
        yield local[:, :3, 3], _quaternions(local[:, :3, :3])


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


def _local_offsets(parents: np.ndarray, joints: np.ndarray, rotations: np.ndarray) -> np.ndarray:
    """(F, J, 3) each joint in its parent's axes, m; the root's are not set."""
    offsets = np.zeros_like(joints)
    above = parents[1:]
    offsets[:, 1:] = np.einsum("fjba,fjb->fja", rotations[:, above], joints[:, 1:] - joints[:, above])
    return offsets


def _summed(parents: np.ndarray, offsets: np.ndarray) -> np.ndarray:
    joints = offsets.copy()
    for index, parent in enumerate(parents):
        if parent >= 0:
            joints[index] += joints[parent]
    return joints


def _reach(markerset: MarkerSet, segment: int) -> np.ndarray:
    """(3,) the far end of a segment without children, from its joint, heights: of its capsules, else its markers."""
    capsules = markerset.capsules
    mine = np.asarray(capsules.segment) == segment
    ends = np.concatenate(
        [capsules.start[mine], capsules.end[mine], markerset.offsets[markerset.attachment == segment]]
    )
    if mine.any():
        ends = ends[: 2 * int(mine.sum())]
    if not len(ends):
        return np.zeros(3)
    return ends[np.argmax(np.linalg.norm(ends, axis=1))]


def _inverse(matrices: np.ndarray) -> np.ndarray:
    """Inverse of rigid transforms (F, 4, 4); NaN stays NaN."""
    inverse = np.tile(np.eye(4), (len(matrices), 1, 1))
    turned = matrices[:, :3, :3].transpose(0, 2, 1)
    inverse[:, :3, :3] = turned
    inverse[:, :3, 3] = -(turned @ matrices[:, :3, 3:])[..., 0]
    return inverse


def _quaternions(matrices: np.ndarray) -> np.ndarray:
    """(F, 4) w x y z of rotations (F, 3, 3), each on the side of the one before so that in-betweens are short.

    NaN stays NaN.
    """
    there = np.isfinite(matrices).all(axis=(1, 2))
    quaternions = np.full((len(matrices), 4), np.nan)
    quaternions[there] = matrix_to_quaternion(matrices[there])
    return quaternions * _signs(quaternions)[:, None]


def _signs(quaternions: np.ndarray) -> np.ndarray:
    """(F,) +1 or -1 that keeps each quaternion near the last one that is known."""
    signs = np.ones(len(quaternions))
    known = np.flatnonzero(np.isfinite(quaternions).all(axis=1))
    if len(known):
        along = np.sign(np.einsum("fi,fi->f", quaternions[known[1:]], quaternions[known[:-1]]))
        first = 1.0 if quaternions[known[0], 0] >= 0 else -1.0
        signs[known] = np.cumprod(np.concatenate([[first], np.where(along < 0, -1.0, 1.0)]))
    return signs
