# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel Review: one list of what to look at, the worst first, of markers, or of what was done."""

import bpy

from ..core.data.wording import count_of, listed, words_of_frames
from ..core.review.trouble import IN_DOUBT, LEFT_OVER, MISSING, NOBODY_THERE, OF_CAMERA, OFF_BODY
from ..ops.correcting import review_now
from ..ops.filling import EXTENTS
from ..ops.listing import is_listed
from ..ops.picking import picked_points, selected_markers, words_of_picked
from ..ops.reposing import words_behind
from ..ops.reviewing import words_for
from ..props import is_opened
from ..scene.fills import kept_cutoff
from ..scene.later import soon
from ..scene.performers import body_material, homes, without_armature
from ..scene.playing import PLAYED, part_here, played_takes, suspects_of, what_is_wrong
from ..scene.take import SOURCE, is_take
from ..scene.trouble import known_trouble
from .label_tool import TOOL
from .parts import (
    DrawsRows,
    draw_choice,
    draw_list,
    draw_operators,
    draw_optional,
    draw_text,
    frames_in_short,
    in_short,
    panel,
    shows,
)

ICONS = {
    NOBODY_THERE: "GHOST_DISABLED",
    MISSING: "EMPTY_AXIS",
    LEFT_OVER: "DOT",
    OFF_BODY: "ARMATURE_DATA",
    IN_DOUBT: "QUESTION",
    OF_CAMERA: "CAMERA_DATA",
}
NO_KEYS = "It plays from a file beside this one and has no keys."
SAVE_THEM = "Save Corrections keeps them for the whole take, when it is labelled again from the command line."


def _open_header(layout: bpy.types.UILayout, context):
    state, take = context.window_manager.mocap_autolabel, context.scene.mocap_autolabel.take
    left = sum(not row.answered for row in state.troubles)
    here = state.of_scene == context.scene.session_uid
    if here and is_take(take) and (left or known_trouble(take, context.scene) is not None):
        layout.label(text=f"{left} open" if left else "nothing open", icon="NONE" if left else "CHECKMARK")


@panel("Review", seen=lambda context: shows(context, "REVIEW") or played_takes(context.scene), header=_open_header)
def review(layout, context):
    """One list of the take, a box with what is the matter with the chosen row, and what mends all of it."""
    settings, state = context.scene.mocap_autolabel, context.window_manager.mocap_autolabel
    if is_take(settings.take):
        _draw_lists(layout, context, state)
        column = layout.column(align=True)
        column.operator("wm.tool_set_by_id", text="Pick Markers to Name", icon="EYEDROPPER").name = TOOL
        row = column.row(align=True)
        row.scale_y = 1.4
        fill = row.operator("mocap_autolabel.fill_gaps", text="Fill", icon="KEYTYPE_GENERATED_VEC")
        fill.extent, fill.propose = "TAKE", settings.filling.propose
        row.operator("mocap_autolabel.smooth", icon="MOD_SMOOTH")
        refit = row.row(align=True)
        refit.enabled = is_opened(settings)
        refit.operator("mocap_autolabel.label", text="Refit", icon="FILE_REFRESH")
        cutoff = kept_cutoff(settings.take)
        row = column.row(align=True)
        row.prop(settings.filling, "cutoff", text="Smooth above (Hz)" if cutoff is None else "Above (Hz)")
        if cutoff is not None:
            row.operator("mocap_autolabel.take_back_smoothing", text=f"Smoothed at {cutoff:g}", icon="X")
        if settings.take[SOURCE] and not is_opened(settings):
            draw_text(context, layout, f"To refit, open {bpy.path.basename(settings.take[SOURCE])} again", icon="INFO")
        # At the end, as they come and go: nothing moves from below the pointer.
        if lost := without_armature(settings.take):
            draw_text(context, layout, f"No armature in {listed(lost)}; Refit shows it again", icon="ERROR")
        if words := words_behind(context):
            draw_text(context, layout, words, icon="ERROR")
    _draw_played(layout, context)


def _draw_lists(layout: bpy.types.UILayout, context, state):
    """The list that is chosen; where they are another scene's they are filled, as Blender does not tell of new scenes.

    Two windows that show different scenes would do so in turns without end: in one of them they are asked for.
    """
    if state.of_scene == context.scene.session_uid:
        row = layout.row(align=True)
        row.prop(state, "listed", text="")
        if state.listed == "TROUBLES" and len(state.troubles):
            row.prop(state, "trouble_done", text="")
        DRAWN[state.listed](layout, context, state)
    elif any(window.scene.session_uid == state.of_scene for window in context.window_manager.windows):
        draw_text(context, layout, "The lists are of the scene in another window", icon="INFO")
        layout.operator("mocap_autolabel.list_here", icon="FILE_REFRESH")
    else:
        soon(review_now)


def _draw_troubles(layout: bpy.types.UILayout, context, state):
    """What to look at before trusting the take."""
    found, index = known_trouble(context.scene.mocap_autolabel.take, context.scene), state.trouble_index
    if not len(state.troubles):
        done = found is not None
        layout.label(text="Nothing to look at" if done else "Being looked for", icon="CHECKMARK" if done else "TIME")
        return
    row = layout.row()
    draw_list(row, state, "troubles", rows=5)
    column = row.column(align=True)
    column.operator("mocap_autolabel.next_trouble", text="", icon="TRIA_UP").back = True
    column.operator("mocap_autolabel.next_trouble", text="", icon="TRIA_DOWN").back = False
    if index < len(found or ()) == len(state.troubles) and is_listed(state, state.troubles[index]):
        _draw_one(layout, context, found[index], index)


def _draw_one(layout: bpy.types.UILayout, context, trouble, index: int):
    box = layout.box()
    draw_text(context, box, trouble.reason[0].upper() + trouble.reason[1:], ICONS[trouble.kind])
    if trouble.answered:
        box.label(text="Looked at", icon="CHECKMARK")
        return
    draw_text(context, box, trouble.advice, "INFO")
    column = box.column(align=True)
    if words := words_for(trouble):
        column.operator("mocap_autolabel.mend_trouble", text=words, icon="PLAY").index = index
    column.operator("mocap_autolabel.accept_trouble", text=trouble.answer, icon="CHECKMARK").index = index


class MOCAP_AUTOLABEL_UL_troubles(DrawsRows, bpy.types.UIList):
    """Troubles, the worst first: where, what about, and how many frames of a marker are at stake."""

    def draw_row(self, context, layout, item, index):
        split = layout.split(factor=0.49, align=True)
        frames = frames_in_short(item.first, item.last)
        split.operator("mocap_autolabel.show_trouble", text=frames, icon=ICONS[item.kind]).index = index
        split = split.split(factor=0.68, align=True)
        split.label(text=item.name or item.kind)
        split.label(text="", icon="CHECKMARK") if item.answered else split.label(text=in_short(item.stake))

    def filter_items(self, context, data, property_name):
        """Which rows the choices above let be seen; their order stays."""
        rows = getattr(data, property_name)
        return [self.bitflag_filter_item if is_listed(data, row) else 0 for row in rows], []


def _draw_changes(layout: bpy.types.UILayout, context, state):
    """What labelling again changed."""
    if not len(state.changes):
        layout.label(text="Labelling again changed nothing", icon="INFO")
        return
    draw_list(layout, state, "changes")
    if state.change_index < len(state.changes):
        draw_text(context, layout, state.changes[state.change_index].words)


class MOCAP_AUTOLABEL_UL_changes(DrawsRows, bpy.types.UIList):
    """Changes, the longest first."""

    def draw_row(self, context, layout, item, index):
        row = layout.row(align=True)
        draw_jump(row, frames_in_short(item.first, item.first), item.first, item.name, icon="TIME")
        row.label(text=item.words)


def draw_jump(layout: bpy.types.UILayout, words: str, frame: float, marker: str, **how):
    """A button that goes to a frame and selects a marker."""
    jump = layout.operator("mocap_autolabel.jump", text=words, **how)
    jump.frame, jump.marker = frame, marker


def cells(layout: bpy.types.UILayout, measured: bool) -> list[bpy.types.UILayout]:
    """The cells of a row of the markers' table, the gaps' the widest; the last only where residuals were measured."""
    row, made = layout.row(), []
    for factor in (0.28, 0.35, 0.68) if measured else (0.34, 0.4):
        row = row.split(factor=factor, align=True)
        made.append(row.row())
    return [*made, row.row()]


def has_residuals(context: bpy.types.Context) -> bool:
    """Whether the residual of any marker is known and not nothing."""
    return any(row.residual > 0 for row in context.window_manager.mocap_autolabel.markers)


def _draw_markers(layout: bpy.types.UILayout, context, state):
    """Every marker with its gaps and residual, the one that was found least first."""
    measured = has_residuals(context)
    for cell, heading in zip(cells(layout, measured), ("Marker", "Found", "Gaps", "mm"), strict=False):
        cell.label(text=heading)
    draw_list(layout, state, "markers", rows=6)


class MOCAP_AUTOLABEL_UL_markers(DrawsRows, bpy.types.UIList):
    """Markers."""

    def draw_row(self, context, layout, item, index):
        name, found, gaps, *residual = cells(layout, has_residuals(context))
        name.label(text=item.name)
        found.label(text=f"{item.labelled:.1%}")
        if item.gaps:
            draw_jump(gaps, f"{item.gaps} (≤{item.longest_gap})", item.first_gap, item.name, emboss=False)
        else:
            gaps.label(text="–")
        for cell in residual:
            cell.label(text=f"{item.residual:.1f}" if item.residual == item.residual else "–")


def _draw_corrections(layout: bpy.types.UILayout, context, state):
    """What a person says of the labels, and of whom they are."""
    names, points = selected_markers(context), picked_points(context)
    if names:
        layout.label(text=", ".join(names), icon="EMPTY_DATA")
    elif points:
        layout.label(text=words_of_picked(context, points), icon="DOT")
    grid = layout.grid_flow(columns=2, even_columns=True, align=True)
    grid.operator("mocap_autolabel.name_point", icon="SORTALPHA")
    grid.operator("mocap_autolabel.unlabel", icon="X")
    grid.operator("mocap_autolabel.swap_markers", icon="UV_SYNC_SELECT")
    grid.operator("mocap_autolabel.is_right", icon="CHECKMARK")
    people = homes(context.scene.mocap_autolabel.take)
    if people:
        column = layout.column(align=True)
        for name, home in people.items():
            row, material = column.row(align=True), body_material(home)
            if material is not None:
                colour = row.row()
                colour.scale_x = 0.3
                colour.prop(material, "diffuse_color", text="")
            row.label(text=name)
        column.operator("mocap_autolabel.other_performer", icon="COMMUNITY")
        column.operator("mocap_autolabel.exchange_performers", icon="UV_SYNC_SELECT")
    if len(state.corrections):
        row = layout.row()
        draw_list(row, state, "corrections")
        column = row.column(align=True)
        remove = column.operator("mocap_autolabel.remove_correction", text="", icon="REMOVE")
        remove.index = state.correction_index
        column.operator("mocap_autolabel.clear_corrections", text="", icon="TRASH")
        if state.correction_index < len(state.corrections):
            row = state.corrections[state.correction_index]
            draw_text(context, layout, f"{row.name}: {row.idle}" if row.idle else row.name)
    layout.operator("mocap_autolabel.save_corrections", icon="FILE_TICK")


class MOCAP_AUTOLABEL_UL_corrections(DrawsRows, bpy.types.UIList):
    """Edits in the order in which they are applied."""

    def draw_row(self, context, layout, item, index):
        layout.label(text=item.name, icon="ERROR" if item.idle else "NONE")


def _draw_played(layout: bpy.types.UILayout, context):
    """Takes that are too long for keys."""
    for take in played_takes(context.scene):
        box = layout.box()
        row = box.row(align=True)
        row.label(text=str(take[PLAYED]), icon="PLAY")
        row.prop(take, "hide_viewport", text="", emboss=False)
        if wrong := what_is_wrong(take):
            draw_text(context, box, wrong, "ERROR")
            box.operator("mocap_autolabel.find_motion", icon="FILE_FOLDER").take = take.name
        _draw_suspects(context, box, take)
        box.operator("mocap_autolabel.open_part", icon="ZOOM_SELECTED").take = take.name
        first, last = part_here(take, context.scene)
        words = f"Open Part labels {words_of_frames(first, last)} again with keys, to correct them. {SAVE_THEM}"
        draw_text(context, box, f"{NO_KEYS} {words}", "INFO")


def _draw_suspects(context, box: bpy.types.UILayout, take: bpy.types.Collection):
    rows = suspects_of(take)
    if not rows:
        box.label(text="Nothing to look at", icon="CHECKMARK")
        return
    row = box.row(align=True)
    for words, icon, back in (("Previous", "TRIA_LEFT", True), ("Next", "TRIA_RIGHT", False)):
        button = row.operator("mocap_autolabel.next_suspect", text=words, icon=icon)
        button.back, button.take = back, take.name
    now = context.scene.frame_current
    for first, last, reason in [row for row in rows if row[0] <= now <= row[1]][:4]:
        draw_text(context, box, f"{frames_in_short(first, last)}: {reason}", "DOT")


def _draw_gaps(layout: bpy.types.UILayout, context, state):
    """Gaps and what they were filled with."""
    filling = context.scene.mocap_autolabel.filling
    draw_choice(layout, filling, "method", factor=0.35)
    draw_optional(layout, filling, "Longest", "use_longest", "longest")
    row = layout.row(align=True)
    row.prop(filling, "propose")
    row.operator("mocap_autolabel.show_graph", text="Graph", icon="GRAPH")
    layout.label(text="Fill Gaps of:")
    for button in extent_buttons(layout, "mocap_autolabel.fill_gaps"):
        button.propose = filling.propose
    if len(state.proposed_fills):
        _draw_proposed(layout, state)
    if len(state.fills):
        _draw_fills(layout, context, state)
    if len(state.left_gaps):
        layout.label(text=f"{count_of(len(state.left_gaps), 'gap')} left:")
        draw_list(layout, state, "left_gaps", rows=2, kind="gaps")
        if state.left_gap_index < len(state.left_gaps):
            draw_text(context, layout, f"The gap {state.left_gaps[state.left_gap_index].reason}")


def _draw_proposed(layout: bpy.types.UILayout, state: bpy.types.PropertyGroup):
    """The fills that are looked at before they are kept, all of them or one by one."""
    box = layout.box()
    box.label(text="Previewed, Not Kept Yet:")
    row = box.row()
    draw_list(row, state, "proposed_fills", kind="gaps")
    column = row.column(align=True)
    for name, icon in (("keep_fills", "CHECKMARK"), ("discard_fills", "REMOVE")):
        column.operator(f"mocap_autolabel.{name}", text="", icon=icon).index = state.proposed_fill_index
    draw_operators(box.row(align=True), "keep_fills", "discard_fills")


def _draw_fills(layout: bpy.types.UILayout, context: bpy.types.Context, state: bpy.types.PropertyGroup):
    """The fills, and what takes them back."""
    row = layout.row()
    draw_list(row, state, "fills", kind="gaps")
    row.operator("mocap_autolabel.take_back_fills", text="", icon="REMOVE").index = state.fill_index
    if state.fill_index < len(state.fills):
        fill = state.fills[state.fill_index]
        if fill.reason:
            draw_text(context, layout, f"Left out: {fill.reason}. Fill the gap again, or take this back", "ERROR")
        else:
            layout.label(text=f"By {fill.method}")
            if fill.rests_on != "both ends":
                draw_text(context, layout, f"Rests on {fill.rests_on} alone, and what moves with it", icon="INFO")
    unfit = sum(bool(fill.reason) for fill in state.fills)
    if unfit:
        layout.label(text=f"{unfit} no longer fit the labels", icon="ERROR")
    layout.label(text="Take Back Fills of:")
    extent_buttons(layout, "mocap_autolabel.take_back_fills")


def extent_buttons(layout: bpy.types.UILayout, operator: str) -> list[bpy.types.OperatorProperties]:
    """A button for each extent of an operator."""
    row, buttons = layout.row(align=True), []
    for extent, words, _ in EXTENTS:
        buttons.append(row.operator(operator, text=words))
        buttons[-1].extent = extent
    return buttons


class MOCAP_AUTOLABEL_UL_gaps(DrawsRows, bpy.types.UIList):
    """Gaps that were filled, or that were left."""

    def draw_row(self, context, layout, item, index):
        row = layout.row(align=True)
        row.label(text=item.name, icon="ERROR" if item.method and item.reason else "NONE")
        draw_jump(row, frames_in_short(item.first, item.last), item.first, item.name, emboss=False)
        if item.method:
            row.label(text=f"{item.expected:.1f} mm" if item.expected >= 0 else "–")


DRAWN = {
    "TROUBLES": _draw_troubles,
    "MARKERS": _draw_markers,
    "CORRECTIONS": _draw_corrections,
    "FILLS": _draw_gaps,
    "CHANGES": _draw_changes,
}
