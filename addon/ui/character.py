# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of what retargeting takes."""

import bpy

from ..scene.take import is_take


class MOCAP_AUTOLABEL_PT_character(bpy.types.Panel):
    """The body as other rigs have it."""

    bl_label = "Character"
    bl_space_type, bl_region_type, bl_category = "VIEW_3D", "UI", "Mocap"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_export"

    @classmethod
    def poll(cls, context):
        return is_take(context.scene.mocap_autolabel.take)

    def draw(self, context):
        layout = self.layout
        layout.prop(context.scene.mocap_autolabel, "bone_names", text="Bones")
        layout.operator("mocap_autolabel.add_character", icon="OUTLINER_OB_ARMATURE")
        row = layout.row(align=True)
        row.operator("mocap_autolabel.export_bvh", icon="EXPORT")
        row.operator("mocap_autolabel.export_fbx", icon="EXPORT")


CLASSES = (MOCAP_AUTOLABEL_PT_character,)
