# SPDX-License-Identifier: GPL-3.0-or-later
"""Somebody's rig that goes as a body does while that is recorded, without keys, and then is as it was."""

import bpy
import numpy as np
from mathutils import Matrix

from ..core.posing.character import Character
from ..core.retarget.matching import match_bones
from ..core.retarget.retargeting import retarget
from .retargeting import ReadyRig, checked, rest_bones
from .units import metre_in


class MovedRig:
    """A rig in the hands of a stream. It is asked for anew by its number each time, as undoing makes other objects."""

    def __init__(self, scene: bpy.types.Scene, rig: bpy.types.Object, character: Character):
        """Readies it; InputError, and the rig as it was, where it is no person's or cannot be moved."""
        rows = rig.mocap_autolabel.bones
        matched = {row.name: row.bone for row in rows if row.bone} if rows else match_bones(rest_bones(rig))
        self.number = rig.session_uid
        self._ready = ReadyRig.of(rig, *checked(rig, matched, character, Matrix.Scale(metre_in(scene), 4)))

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
        """Puts what moved back as it was, if it is still there."""
        rig = next((one for one in bpy.data.objects if one.session_uid == self.number), None)
        if rig is not None:
            self._ready.before.put_back(rig)
