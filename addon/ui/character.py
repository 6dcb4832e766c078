# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of what retargeting takes."""

import bpy

from ..ops.reposing import words_behind
from .parts import Reviewing, draw_text


class MOCAP_AUTOLABEL_PT_character(Reviewing, bpy.types.Panel):
    """The body as other rigs have it."""

    bl_label = "Character"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_export"

    def draw(self, context):
        layout = self.layout
        if words := words_behind(context):
            draw_text(context, layout, words, icon="ERROR")
        layout.prop(context.scene.mocap_autolabel, "bone_names", text="Bones")
        layout.operator("mocap_autolabel.add_character", icon="OUTLINER_OB_ARMATURE")
        row = layout.row(align=True)
        row.operator("mocap_autolabel.export_bvh", icon="EXPORT")
        row.operator("mocap_autolabel.export_fbx", icon="EXPORT")


CLASSES = (MOCAP_AUTOLABEL_PT_character,)
