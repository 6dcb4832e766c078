# SPDX-License-Identifier: GPL-3.0-or-later
"""The list of what is the matter with a take in the sidebar: the worst first, in full, with what helps."""

import bpy

from ..core.review.trouble import IN_DOUBT, LEFT_OVER, MISSING, NOBODY_THERE, OF_CAMERA, OFF_BODY
from ..ops.reviewing import is_listed, words_for
from ..scene.trouble import known_cameras, known_trouble
from .parts import Reviewing, draw_text, frames_in_short

ICONS = {
    NOBODY_THERE: "GHOST_DISABLED",
    MISSING: "EMPTY_AXIS",
    LEFT_OVER: "DOT",
    OFF_BODY: "ARMATURE_DATA",
    IN_DOUBT: "QUESTION",
    OF_CAMERA: "CAMERA_DATA",
}


def in_short(stake: float) -> str:
    """A number of frames that fits beside a name."""
    return f"{stake:.0f}" if stake < 1000 else f"{stake / 1000:.1f}k"


class MOCAP_AUTOLABEL_PT_trouble(Reviewing, bpy.types.Panel):
    """What to look at before trusting the take."""

    bl_label = "To Look at"

    def draw_header_preset(self, context):
        rows = context.window_manager.mocap_autolabel.troubles
        left = sum(not row.answered for row in rows)
        self.layout.label(text=f"{left} open" if left else "nothing open", icon="NONE" if left else "CHECKMARK")

    def draw(self, context):
        layout, state = self.layout, context.window_manager.mocap_autolabel
        if not len(state.troubles):
            layout.label(text="Nothing", icon="CHECKMARK")
            return
        row = layout.row(align=True)
        row.prop(state, "trouble_done", expand=True)
        row = layout.row(align=True)
        row.prop(state, "trouble_kind", text="")
        row.prop_search(state, "trouble_marker", state, "markers", text="", icon="EMPTY_AXIS")
        layout.template_list(
            "MOCAP_AUTOLABEL_UL_trouble", "", state, "troubles", state, "trouble_index", rows=5, maxrows=10
        )
        row = layout.row(align=True)
        row.operator("mocap_autolabel.next_trouble", text="Previous", icon="TRIA_LEFT").back = True
        row.operator("mocap_autolabel.next_trouble", text="Next", icon="TRIA_RIGHT").back = False
        found = known_trouble(context.scene.mocap_autolabel.take, context.scene) or ()
        if state.trouble_index < len(found) == len(state.troubles) and is_listed(
            state, state.troubles[state.trouble_index]
        ):
            self._draw_one(context, found[state.trouble_index], state.trouble_index)

    def _draw_one(self, context, trouble, index: int):
        box = self.layout.box()
        sentence = trouble.reason[0].upper() + trouble.reason[1:]
        draw_text(context, box, sentence, ICONS[trouble.kind])
        if trouble.answered:
            box.label(text="Looked at", icon="CHECKMARK")
            return
        draw_text(context, box, trouble.advice, "INFO")
        column = box.column(align=True)
        if words := words_for(trouble):
            column.operator("mocap_autolabel.mend_trouble", text=words, icon="PLAY").index = index
        answer = column.operator("mocap_autolabel.accept_trouble", text=trouble.answer, icon="CHECKMARK")
        answer.index = index


class MOCAP_AUTOLABEL_UL_trouble(bpy.types.UIList):
    """A trouble a row, the worst first: where it is, what it is about, and how many frames of a marker are at stake."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        split = layout.split(factor=0.46, align=True)
        frames = frames_in_short(item.first, item.last)
        split.operator("mocap_autolabel.show_trouble", text=frames, icon=ICONS[item.kind]).index = index
        split = split.split(factor=0.62, align=True)
        split.label(text=item.name or item.kind)
        split.label(text="", icon="CHECKMARK") if item.answered else split.label(text=in_short(item.stake))

    def filter_items(self, context, data, property_name):
        """Which rows the choices above let be seen; their order stays."""
        rows = getattr(data, property_name)
        return [self.bitflag_filter_item if is_listed(data, row) else 0 for row in rows], []


class MOCAP_AUTOLABEL_PT_camera_blobs(Reviewing, bpy.types.Panel):
    """How well each camera's blobs are named, and how far they are off."""

    bl_label = "Cameras"
    bl_options = {"DEFAULT_CLOSED"}

    @classmethod
    def poll(cls, context):
        return super().poll(context) and bool(known_cameras(context.scene.mocap_autolabel.take, context.scene))

    def draw(self, context):
        grid = self.layout.grid_flow(row_major=True, columns=4, even_columns=False, align=True)
        for words in ("Camera", "Named", "Beside", "px"):
            grid.label(text=words)
        for one in known_cameras(context.scene.mocap_autolabel.take, context.scene):
            named = f"{one.named / one.blobs:.0%}" if one.blobs else "–"
            error = f"{one.error_px:.2f}" if one.error_px == one.error_px else "–"
            for words in (one.name, named, str(one.unnamed_beside), error):
                grid.label(text=words)


class MOCAP_AUTOLABEL_PT_changes(Reviewing, bpy.types.Panel):
    """What labelling again changed."""

    bl_label = "Changed by Labelling Again"

    @classmethod
    def poll(cls, context):
        return bool(len(context.window_manager.mocap_autolabel.changes))

    def draw(self, context):
        state = context.window_manager.mocap_autolabel
        self.layout.template_list(
            "MOCAP_AUTOLABEL_UL_changes", "", state, "changes", state, "change_index", rows=3, maxrows=8
        )
        if state.change_index < len(state.changes):
            draw_text(context, self.layout, state.changes[state.change_index].words)


class MOCAP_AUTOLABEL_UL_changes(bpy.types.UIList):
    """A change a row, the longest first."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        row = layout.row(align=True)
        jump = row.operator("mocap_autolabel.jump", text=str(item.first), icon="TIME")
        jump.frame, jump.marker = item.first, item.name
        row.label(text=item.words)


CLASSES = (
    MOCAP_AUTOLABEL_UL_trouble,
    MOCAP_AUTOLABEL_UL_changes,
    MOCAP_AUTOLABEL_PT_trouble,
    MOCAP_AUTOLABEL_PT_camera_blobs,
    MOCAP_AUTOLABEL_PT_changes,
)
