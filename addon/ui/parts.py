# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panels of the sidebar share: where they live, and how they write a sentence or frames."""

import textwrap

import bpy

from ..scene.take import is_take

LETTER = 6.6  # px of the interface that a letter of a panel is wide, on average
MARGIN = 56  # px of the interface beside the words of a panel


class Step:
    """Where every panel of ours lives."""

    bl_space_type = "VIEW_3D"
    bl_region_type = "UI"
    bl_category = "Mocap"


class Reviewing(Step):
    """A panel below Review, shown only with a take to review."""

    bl_parent_id = "MOCAP_AUTOLABEL_PT_review"

    @classmethod
    def poll(cls, context):
        return is_take(context.scene.mocap_autolabel.take)


def draw_text(context: bpy.types.Context, layout: bpy.types.UILayout, words: str, icon: str = "NONE"):
    """A sentence on as many lines as the sidebar's width takes."""
    width = context.region.width / context.preferences.system.ui_scale
    column = layout.column(align=True)
    column.scale_y = 0.75
    for number, line in enumerate(textwrap.wrap(words, max(int((width - MARGIN) / LETTER), 12))):
        column.label(text=line, icon="BLANK1" if number and icon != "NONE" else icon)


def draw_choice(layout: bpy.types.UILayout, settings: bpy.types.PropertyGroup, name: str):
    """A choice with its whole name before it, of which Blender by itself leaves a narrow sidebar a third."""
    row = layout.split(factor=0.45, align=True)
    row.label(text=f"{settings.bl_rna.properties[name].name}:")
    row.prop(settings, name, text="")


def frames_in_short(first: int, last: int) -> str:
    """Frames from the first to the last, as a row of a list has room for them."""
    return str(first) if first == last else f"{first}–{last}"
