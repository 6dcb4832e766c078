# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of takes in the sidebar: what is to be labelled, how far it is, and its takes, the worst first."""

import bpy

from ..io.batch import AT_WORK, FAILING, WAITING
from .parts import Step, draw_text
from .trouble import in_short

STATE_ICONS = {FAILING: "ERROR", AT_WORK: "PLAY", WAITING: "TIME"}


class MOCAP_AUTOLABEL_PT_label_folder(Step, bpy.types.Panel):
    """Takes of a folder, labelled in the background."""

    bl_label = "Label Folder"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_label"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        state = context.window_manager.mocap_autolabel
        column = layout.column(align=True)
        column.active = not state.folder_doing
        for name in ("folder_path", "folder_out"):
            row = column.split(factor=0.28, align=True)
            row.label(text=f"{settings.bl_rna.properties[name].name}:")
            row.prop(settings, name, text="")
        row = column.row(align=True)
        row.prop(settings, "folder_watch", toggle=True)
        row.prop(settings, "folder_anew", toggle=True)
        column.prop(settings, "folder_jobs")
        row = layout.row(align=True)
        row.scale_y = 1.4
        if state.folder_doing:
            row.progress(factor=state.folder_share, text=state.folder_doing)
            row.operator("mocap_autolabel.stop_folder", text="", icon="X")
        else:
            row.operator("mocap_autolabel.label_folder", icon="PLAY")
        if state.folder_said:
            draw_text(context, layout, state.folder_said, icon="ERROR")
        if len(state.folder_takes):
            self._draw_takes(context)

    def _draw_takes(self, context):
        layout, state = self.layout, context.window_manager.mocap_autolabel
        layout.template_list(
            "MOCAP_AUTOLABEL_UL_folder_takes", "", state, "folder_takes", state, "folder_index", rows=4, maxrows=10
        )
        index = min(state.folder_index, len(state.folder_takes) - 1)
        take = state.folder_takes[index]
        box = layout.box()
        if not take.measured:
            draw_text(context, box, f"{take.name}: {take.reason or take.state}", STATE_ICONS.get(take.state, "NONE"))
            return
        named = f"{take.named:.1%} named, " if take.named >= 0 else ""
        words = f"{named}{take.found:.1%} of all samples found, {take.on_body} on the body without a name"
        draw_text(context, box, f"{take.name}: {words}. {take.reason}")
        row = box.row(align=True)
        row.operator("mocap_autolabel.open_folder_take", icon="FILE_BLEND").index = index
        row.operator("mocap_autolabel.open_folder_page", icon="DOCUMENTS").index = index


class MOCAP_AUTOLABEL_UL_folder_takes(bpy.types.UIList):
    """A take a row, the worst first: how much there is to look at, and how many frames of a marker are at stake."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        split = layout.split(factor=0.5, align=True)
        split.label(text=item.name, icon=STATE_ICONS.get(item.state, "CHECKMARK"))
        if not item.measured:
            split.label(text=item.state)
            return
        split = split.split(factor=0.62, align=True)
        split.label(text=f"{item.trouble} open")
        split.label(text=in_short(item.stake))


CLASSES = (MOCAP_AUTOLABEL_UL_folder_takes, MOCAP_AUTOLABEL_PT_label_folder)
