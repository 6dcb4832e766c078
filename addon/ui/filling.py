# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel of gaps: filled, what error to expect, and taken back."""

import bpy

from ..core.data.wording import count_of
from ..ops.correcting import selected_markers
from ..ops.filling import EXTENTS
from ..scene.opened import opened
from .parts import Reviewing, draw_text, frames_in_short


class MOCAP_AUTOLABEL_PT_fill_gaps(Reviewing, bpy.types.Panel):
    """Gaps and what they were filled with."""

    bl_label = "Fill Gaps"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        state = context.window_manager.mocap_autolabel
        split = layout.split(factor=0.35, align=True)
        split.label(text="Method:")
        split.prop(settings, "fill_method", text="")
        row = layout.row(heading="Longest")
        row.prop(settings, "use_fill_longest", text="")
        value = row.row()
        value.active = settings.use_fill_longest
        value.prop(settings, "fill_longest", text="")
        extent_buttons(layout, "mocap_autolabel.fill_gaps")
        for words, icon in here(context):
            layout.label(text=words, icon=icon)
        if len(state.fills):
            draw_fills(context, layout, state)
        if len(state.left_gaps):
            layout.label(text=f"{count_of(len(state.left_gaps), 'gap')} left:")
            layout.template_list("MOCAP_AUTOLABEL_UL_left_gaps", "", state, "left_gaps", state, "left_index", rows=2)
            if state.left_index < len(state.left_gaps):
                draw_text(context, layout, f"The gap {state.left_gaps[state.left_index].reason}")


def extent_buttons(layout: bpy.types.UILayout, operator: str):
    """A button for each extent of an operator."""
    row = layout.row(align=True)
    for extent, words, _ in EXTENTS:
        row.operator(operator, text=words).extent = extent


def draw_fills(context: bpy.types.Context, layout: bpy.types.UILayout, state: bpy.types.PropertyGroup):
    """The fills, and what takes them back."""
    row = layout.row()
    row.template_list("MOCAP_AUTOLABEL_UL_fills", "", state, "fills", state, "fill_index", rows=3, maxrows=8)
    row.operator("mocap_autolabel.take_back_fills", text="", icon="REMOVE").index = state.fill_index
    if state.fill_index < len(state.fills):
        fill = state.fills[state.fill_index]
        if fill.reason:
            draw_text(context, layout, f"Left out: {fill.reason}. Fill the gap again, or take this back", "ERROR")
        else:
            layout.label(text=f"By {fill.method}")
            if fill.rests_on != "both ends":
                layout.label(text=f"Rests on {fill.rests_on} alone, and what moves with it", icon="INFO")
    unfit = sum(bool(fill.reason) for fill in state.fills)
    if unfit:
        layout.label(text=f"{unfit} no longer fit the labels", icon="ERROR")
    layout.label(text="Take Back Fills of:")
    extent_buttons(layout, "mocap_autolabel.take_back_fills")


def here(context: bpy.types.Context) -> list[tuple[str, str]]:
    """What the current frame is for the selected markers: words and an icon for each that is missing or filled."""
    scene = context.scene
    stored = opened.take(scene.mocap_autolabel.take, scene)
    frame, lines = scene.frame_current - stored.shift, []
    for name in selected_markers(context)[:3]:
        fill = next((one for one in stored.fitting if one.marker == name and one.first <= frame <= one.last), None)
        if fill is not None:
            off = f"±{1000 * fill.expected:.1f} mm" if fill.expected == fill.expected else "error unknown"
            lines.append(
                (
                    f"{name}: filled {fill.first + stored.shift}–{fill.last + stored.shift}, {off}",
                    "KEYTYPE_GENERATED_VEC",
                )
            )
    return lines


class MOCAP_AUTOLABEL_UL_fills(bpy.types.UIList):
    """A filled gap a row, with the error to expect."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        draw_gap(layout, item, f"{item.expected:.1f} mm" if item.expected >= 0 else "–")


class MOCAP_AUTOLABEL_UL_left_gaps(bpy.types.UIList):
    """A gap that was left a row."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        draw_gap(layout, item, "")


def draw_gap(layout: bpy.types.UILayout, item: bpy.types.PropertyGroup, words: str):
    """A row of a gap: its marker, its frames, which jump there, and words at the end."""
    row = layout.row(align=True)
    row.label(text=item.name, icon="ERROR" if item.reason and words else "NONE")
    jump = row.operator("mocap_autolabel.jump", text=frames_in_short(item.first, item.last), emboss=False)
    jump.frame, jump.marker = item.first, item.name
    row.label(text=words)


CLASSES = (MOCAP_AUTOLABEL_UL_fills, MOCAP_AUTOLABEL_UL_left_gaps, MOCAP_AUTOLABEL_PT_fill_gaps)
