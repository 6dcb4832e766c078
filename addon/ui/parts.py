# SPDX-License-Identifier: GPL-3.0-or-later
"""What the panels of the sidebar share: where they live, their lists, and how they write a sentence or frames."""

import textwrap
from collections.abc import Callable

import bpy

from ..props import OWN_FILE
from ..scene.take import is_take

LETTER = 6.6  # px of the interface that a letter of a panel is wide, on average
PANEL_NAME = "MOCAP_AUTOLABEL_PT_"
MARGIN = 56  # px of the interface beside the words of a panel


def shows(context: bpy.types.Context, stage: str) -> bool:
    """Whether there is a labelled take, and the sidebar is for this stage of its way."""
    settings = context.scene.mocap_autolabel
    return is_take(settings.take) and settings.display.stage == stage


def fold(layout: bpy.types.UILayout, words: str) -> bpy.types.UILayout | None:
    """What lies under a heading that is folded at first; None while it is."""
    header, body = layout.panel(f"mocap_autolabel_{words}", default_closed=True)
    header.label(text=words)
    return body


def panel(
    label: str,
    under: str = "",
    closed: bool = False,
    seen: Callable[[bpy.types.Context], object] = lambda _: True,
    header: Callable[[bpy.types.UILayout, bpy.types.Context], None] | None = None,
) -> Callable[[Callable[[bpy.types.UILayout, bpy.types.Context], None]], type[bpy.types.Panel]]:
    """Makes a panel of the sidebar, called `MOCAP_AUTOLABEL_PT_` as well, of what draws it in a layout.

    It has a label, lies under another panel of ours, is closed at first, and is seen when something holds. What draws a
    header writes beside the label.
    """

    def made(draw) -> type[bpy.types.Panel]:
        words = {
            "bl_space_type": "VIEW_3D",
            "bl_region_type": "UI",
            "bl_category": "Mocap",
            "bl_label": label,
            "poll": classmethod(lambda _, context: bool(seen(context))),
            "draw": lambda self, context: draw(self.layout, context),
        }
        words |= {"bl_parent_id": f"{PANEL_NAME}{under}"} if under else {}
        words |= {"bl_options": {"DEFAULT_CLOSED"}} if closed else {}
        words |= {"draw_header_preset": lambda self, context: header(self.layout, context)} if header else {}
        of = {"__module__": draw.__module__, "__doc__": draw.__doc__}
        return type(f"{PANEL_NAME}{draw.__name__}", (bpy.types.Panel,), words | of)

    return made


class DrawsRows:
    """A list, whose rows `draw_row` draws: `MOCAP_AUTOLABEL_UL_` and what holds the rows, or their kind."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        self.draw_row(context, layout, item, index)


def draw_list(layout: bpy.types.UILayout, owner: bpy.types.PropertyGroup, name: str, rows: int = 3, kind: str = ""):
    """The list of a property group's rows of a name, such as `fills`; the chosen one is kept in `fill_index`."""
    index, kind = f"{name.removesuffix('s')}_index", f"MOCAP_AUTOLABEL_UL_{kind or name}"
    layout.template_list(kind, name, owner, name, owner, index, rows=rows, maxrows=max(2 * rows, 8))


def letters_across(context: bpy.types.Context) -> float:
    """How many letters the sidebar's width takes."""
    return (context.region.width / context.preferences.system.ui_scale - MARGIN) / LETTER


def draw_text(context: bpy.types.Context, layout: bpy.types.UILayout, words: str, icon: str = "NONE"):
    """A sentence on as many lines as the sidebar's width takes."""
    column = layout.column(align=True)
    column.scale_y = 0.75
    for number, line in enumerate(textwrap.wrap(words, max(int(letters_across(context)), 12))):
        column.label(text=line, icon="BLANK1" if number and icon != "NONE" else icon)


def draw_choice(layout: bpy.types.UILayout, group: bpy.types.PropertyGroup, name: str, factor: float = 0.45, words=""):
    """A choice with its whole name, or other words, before it; Blender by itself leaves a narrow sidebar a third."""
    row = layout.split(factor=factor, align=True)
    row.label(text=f"{words or group.bl_rna.properties[name].name}:")
    row.prop(group, name, text="")


def draw_optional(layout: bpy.types.UILayout, group: bpy.types.PropertyGroup, heading: str, used: str, *names: str):
    """Values that count where the box before them is ticked."""
    row = layout.row(heading=heading)
    row.prop(group, used, text="")
    values = row.row(align=True)
    values.active = getattr(group, used)
    for name in names:
        values.prop(group, name, text="")


def draw_operators(layout: bpy.types.UILayout, *names: str, icon: str = "NONE"):
    """A button for each of our operators, such as `smooth`, and a gap for each empty name."""
    for name in names:
        if name:
            layout.operator(f"mocap_autolabel.{name}", icon=icon)
        else:
            layout.separator()


def draw_cells(layout: bpy.types.UILayout, *cells: str):
    """A row of a table, its cells of the same width."""
    row = layout.row(align=True)
    for words in cells:
        row.label(text=words)


def frames_in_short(first: float, last: float) -> str:
    """Frames from the first to the last, as a row of a list has room for them."""
    ends = f"{first:.0f}", f"{last:.0f}"
    return ends[0] if ends[0] == ends[1] else "–".join(ends)


def in_short(stake: float) -> str:
    """A number of frames that fits beside a name."""
    return f"{stake:.0f}" if round(stake) < 1000 else f"{stake / 1000:.0f}k"


def draw_performers(layout: bpy.types.UILayout, subjects: bpy.types.PropertyGroup):
    """How many are asked for, and who, where that is by name."""
    draw_choice(layout, subjects, "performing")
    if subjects.performing == "SO_MANY":
        layout.prop(subjects, "performer_count")
    if subjects.performing != "LISTED":
        return
    row = layout.row()
    draw_list(row, subjects, "performers")
    column = row.column(align=True)
    column.operator("mocap_autolabel.add_performer", text="", icon="ADD")
    column.operator("mocap_autolabel.remove_performer", text="", icon="REMOVE")
    if subjects.performer_index < len(subjects.performers):
        chosen = subjects.performers[subjects.performer_index]
        if chosen.markerset == OWN_FILE:
            layout.prop(chosen, "markerset_path", text="")
