# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is in the take: how many are asked for or who, and the colours of those who were found."""

import bpy

from ..props import OWN_FILE
from ..scene.performers import body_material, homes
from .parts import Reviewing, Step, draw_choice


class MOCAP_AUTOLABEL_PT_performers(Step, bpy.types.Panel):
    """Who is asked for."""

    bl_label = "Performers"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_label"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        draw_choice(layout, settings, "performing")
        if settings.performing == "SO_MANY":
            layout.prop(settings, "performer_count")
        elif settings.performing == "LISTED":
            self._draw_list(settings)

    def _draw_list(self, settings):
        row = self.layout.row()
        row.template_list(
            "MOCAP_AUTOLABEL_UL_performers", "", settings, "performers", settings, "performer_index", rows=3
        )
        column = row.column(align=True)
        column.operator("mocap_autolabel.add_performer", text="", icon="ADD")
        column.operator("mocap_autolabel.remove_performer", text="", icon="REMOVE")
        if settings.performer_index < len(settings.performers):
            chosen = settings.performers[settings.performer_index]
            if chosen.markerset == OWN_FILE:
                self.layout.prop(chosen, "markerset_path", text="")


class MOCAP_AUTOLABEL_PT_people(Reviewing, bpy.types.Panel):
    """Those who were found."""

    bl_label = "Performers"

    @classmethod
    def poll(cls, context):
        return super().poll(context) and bool(homes(context.scene.mocap_autolabel.take))

    def draw(self, context):
        column = self.layout.column(align=True)
        for name, home in homes(context.scene.mocap_autolabel.take).items():
            row, material = column.row(align=True), body_material(home)
            if material is not None:
                colour = row.row()
                colour.scale_x = 0.3
                colour.prop(material, "diffuse_color", text="")
            row.label(text=name)


class MOCAP_AUTOLABEL_UL_performers(bpy.types.UIList):
    """A performer a row."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        row = layout.split(factor=0.5, align=True)
        named = row.row(align=True)
        colour = named.row()
        colour.scale_x = 0.3
        colour.prop(item, "colour", text="")
        named.prop(item, "name", text="", emboss=False)
        row.prop(item, "markerset", text="", emboss=False)


ASKED_FIRST = (MOCAP_AUTOLABEL_UL_performers, MOCAP_AUTOLABEL_PT_performers)  # right below the button
CLASSES = (MOCAP_AUTOLABEL_PT_people,)
