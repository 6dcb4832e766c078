# SPDX-License-Identifier: GPL-3.0-or-later
"""Somebody's rig that goes as a body does while that is recorded, without keys, and then is as it was."""

import bpy
import numpy as np
from mathutils import Matrix

from ..core.posing.character import Character
from ..core.retarget.matching import match_bones
from ..core.retarget.retargeting import retarget
from .retargeting import ReadyRig, checked, rest_bones

BONE_CHANNELS = "location", "rotation_quaternion", "rotation_euler", "rotation_axis_angle", "scale"


class MovedRig:
    """A rig in the hands of a stream. It is asked for anew by its number each time, as undoing makes other objects."""

    def __init__(self, context: bpy.types.Context, rig: bpy.types.Object, character: Character):
        """Readies it; InputError, and the rig as it was, where it is no person's or has no bone for what must move."""
        rows = rig.mocap_autolabel.bones
        matched = {row.name: row.bone for row in rows if row.bone} if rows else match_bones(rest_bones(rig))
        self.number, self._shown = rig.session_uid, rig.data.pose_position
        self._before = {bone.name: [getattr(bone, name)[:] for name in BONE_CHANNELS] for bone in rig.pose.bones}
        self._ready = ReadyRig.of(context, rig, *checked(rig, matched, character, Matrix()))

    def move(self, rig: bpy.types.Object, character: Character, joints: np.ndarray, rotations: np.ndarray):
        """Puts it where a body is, by the joints (J, 3) m and the rotations (J, 3, 3) of its segments.

        Feet may slide: whether they are planted is known afterwards.
        """
        motion, hands = (joints[None], rotations[None]), rig.mocap_autolabel.keep_hands
        moved = retarget(character, motion, 1.0, self._ready.rest, False, hands)
        for bone, channel, values in self._ready.channels(*moved):
            if bone in rig.pose.bones:
                setattr(rig.pose.bones[bone], channel, values[0])

    def leave(self):
        """Puts it back as it was, if it is still there."""
        rig = next((one for one in bpy.data.objects if one.session_uid == self.number), None)
        if rig is None:
            return
        for name, values in self._before.items():
            if (bone := rig.pose.bones.get(name)) is not None:
                for channel, value in zip(BONE_CHANNELS, values, strict=True):
                    setattr(bone, channel, value)
        for bone, name, value in self._ready.switched:
            if bone in rig.pose.bones:
                rig.pose.bones[bone][name] = value
        rig.data.pose_position = self._shown
        rig.update_tag()
