# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab "Mocap": a take and what is known of it, and what to do with it in the end."""

from functools import lru_cache
from pathlib import Path

import bpy

from ..core.data.errors import InputError
from ..core.data.wording import count_of
from ..io.markersets import AUTO_MODEL, SUFFIX, builtin_markersets, open_markerset
from ..io.qtm.capture import is_qtm
from ..ops.importing import USE_ITEMS, cameras_at_hand
from ..ops.long_work import done_elsewhere
from ..ops.reposing import words_behind
from ..ops.retargeting import active_rig
from ..props import OWN_FILE, found_here, is_opened, opened_file
from ..scene.cameras import originals
from ..scene.clock import fps_of, plays_at
from ..scene.performers import homes
from ..scene.retargeting import preview_on
from ..scene.rig_preview import is_left_behind
from ..scene.take import is_take, takes_of
from ..scene.timing import RATE, is_timed_otherwise
from .advanced import draw_folder
from .parts import (
    DrawsRows,
    draw_choice,
    draw_operators,
    draw_performers,
    draw_text,
    fold,
    letters_across,
    panel,
    shows,
)

FORMATS = "3D points, blobs with their calibration, a .qtm or pictures"
# Of the sidebar's, for a part of the body beside its bone; where both have no room they are in two rows.
PART_WIDTH = 0.35
FIELD_ICONS = 6  # letters that the icons in the field of a bone take
TEACH = "To teach a marker set of your own, open a take of it that has names, such as a standing trial"


@panel("Take")
def take(layout, context):
    """What is open: nothing, a take and what will be done with it, or, in one line, one that is labelled."""
    settings, state = context.scene.mocap_autolabel, context.window_manager.mocap_autolabel
    path, labelled = settings.source.points_path or settings.source.blobs_path, is_take(settings.take)
    if not labelled and takes_of(context.scene):
        layout.prop(settings, "take", text="Labelled")
    if not (path or labelled):
        _draw_nothing(layout, context, settings, state)
        return
    row = layout.row(align=True)
    if labelled:
        icon = "DOWNARROW_HLT" if state.unfolded else "RIGHTARROW"
        row.prop(state, "unfolded", text="", icon=icon, emboss=False)
        row.prop(settings, "take", text="")
    else:
        row.label(text=bpy.path.basename(path), icon="FILE")
    row.operator("mocap_autolabel.import_take", text="", icon="FILE_FOLDER")
    if not labelled:
        row.operator("mocap_autolabel.close_take", text="", icon="X")
    else:
        row.operator("mocap_autolabel.clear", text="", icon="TRASH")
        _draw_rates(layout, context.scene, settings.take, settings.take[RATE])
    if path and (state.unfolded or not labelled):
        _draw_card(layout, context, path)
    _draw_progress(layout, state)
    if not state.doing:
        _draw_refused(layout, context, state)
    if labelled:
        layout.row(align=True).prop(settings.display, "stage", expand=True)


def _draw_nothing(layout: bpy.types.UILayout, context, settings, state):
    """What to begin with, where nothing is open."""
    row = layout.row()
    row.scale_y = 1.6
    row.operator("mocap_autolabel.import_take", icon="FILE_FOLDER")
    if settings.folder.path:
        draw_folder(layout, context)
    elif cameras_at_hand(context.scene):
        draw_text(context, layout, f"{_cameras_here(settings)}: open the blobs or pictures of them too", "INFO")
    elif not state.doing:
        draw_text(context, layout, f"Or drop files here: {FORMATS}", icon="INFO")
    _draw_progress(layout, state)


def draw_import(self, _context):
    """The entry of the menu File > Import."""
    self.layout.operator("mocap_autolabel.import_take", text="Mocap Take (.c3d, .trc, .tsv, .csv, .qtm, …)")


def _cameras_here(settings: bpy.types.PropertyGroup) -> str:
    items = settings.source.cameras.all_objects if settings.source.cameras else ()
    return count_of(len(originals(items)), "camera")


def _draw_card(layout: bpy.types.UILayout, context, path: str):
    """What a take is, what will be done with it, and the button that does it."""
    settings, state = context.scene.mocap_autolabel, context.window_manager.mocap_autolabel
    source, subjects, points = settings.source, settings.subjects, settings.source.points_path
    again = is_take(settings.take) and is_opened(settings)
    column = layout.column(align=True)
    if is_take(settings.take) and not again:
        column.label(text=bpy.path.basename(path), icon="FILE")
    frames, cameras = source.last_frame - source.first_frame + 1, _cameras_here(settings)
    words = f"{count_of(frames, 'frame')} at {source.rate:g} Hz"
    if source.blob_count:  # a take that was never read as a whole was not counted
        words += f", {count_of(round(source.blob_count / frames), 'point' if points else 'blob')} in a frame"
    draw_text(context, column, words if points else f"{words} of {cameras}")
    if points:
        row = column.split(factor=0.45, align=True)
        row.label(text="Up:")
        axes = row.operator_menu_enum("mocap_autolabel.import_take", "up", text=source.up.upper() or source.up_found)
        axes.filepath, axes.mirror, axes.rate, axes.at_1 = path, source.mirror, source.rate, source.at_1
        axes.use = "points" if is_qtm(Path(path)) else USE_ITEMS[0][0]
    else:
        draw_choice(column, source, "rate")
    if not is_take(settings.take):
        _draw_rates(column, context.scene, source.preview, source.rate)
    column = layout.column(align=True)
    row = column.split(factor=0.45, align=True)
    row.label(text="Marker Set:")
    row = row.row(align=True)
    row.prop(subjects, "markerset", text="")
    row.operator("mocap_autolabel.open_markerset", text="", icon="FILE_FOLDER")
    if subjects.markerset == OWN_FILE:
        column.prop(subjects, "markerset_path", text="")
    if subjects.markerset == AUTO_MODEL and subjects.performing != "LISTED":
        _draw_found(context, column, subjects, state)
    draw_performers(layout, subjects)
    crowded = crowded_here(state, settings)
    if state.doing or (asks_which(state, settings) and not crowded):
        return
    row = layout.row(align=True)
    row.scale_y = 1.6
    if crowded:
        row.operator("mocap_autolabel.label", text="Label All Performers", icon="COMMUNITY").everybody = True
    else:
        row.operator("mocap_autolabel.label", text="Label Again" if again else "Label", icon="PLAY")


def _draw_rates(layout: bpy.types.UILayout, scene: bpy.types.Scene, block: bpy.types.ID | None, rate: float):
    """The scene's rate where it is not that of a take, kept in a block, and how each gets the other's."""
    otherwise = block is not None and is_timed_otherwise(scene, block)
    if plays_at(scene, rate) and not otherwise:
        return
    row = layout.row(align=True)
    mapped = block is not None and RATE in block and not otherwise  # no file older than mapping
    row.label(text=f"{'Mapped to' if mapped else 'The scene plays'} {fps_of(scene):g} Hz", icon="INFO")
    if otherwise:
        row.operator("mocap_autolabel.follow_rate", text="", icon="FILE_REFRESH")
    if not plays_at(scene, rate):
        row.operator("mocap_autolabel.play_as_take", text="", icon="TIME")


def _draw_found(context, layout: bpy.types.UILayout, subjects, state):
    """What Automatic found in the take, or the sets that it may be, a user's own ones first."""
    if found := found_here(subjects):
        draw_text(context, layout, _set_in_words(found), icon="CHECKMARK")
        if crowded_here(state, context.scene.mocap_autolabel):
            layout.label(text="Two performers or more", icon="ERROR")
    elif asks_which(state, context.scene.mocap_autolabel):
        words = "More than one fits. Which was worn?" if len(state.likely) > 1 else "It may be this one. Was it worn?"
        draw_text(context, layout, words, icon="ERROR")
        for one in state.likely:
            draw_text(context, layout, _set_in_words(one.name))
            text = Path(one.name).name.removesuffix(SUFFIX)
            layout.operator("mocap_autolabel.label", text=f"Label as {text}", icon="PLAY").markerset = one.name
        _draw_teaching(context, layout)
    elif state.unsure and told_here(state, context.scene.mocap_autolabel):
        draw_text(context, layout, f"The take {state.unsure}", icon="ERROR")
        _draw_teaching(context, layout)


def _draw_teaching(context, layout: bpy.types.UILayout):
    """How a set that none of the known ones is becomes known."""
    if context.scene.mocap_autolabel.source.named:
        layout.operator("mocap_autolabel.learn_file", icon="PLAY")
    elif context.scene.mocap_autolabel.source.points_path:
        draw_text(context, layout, TEACH, icon="INFO")


@lru_cache
def _set_in_words(model: str) -> str:
    """What a marker set is, such as "Plug-in Gait full body: 39 markers (body39)"; its name where it is gone."""
    try:
        markerset = open_markerset(model)
    except InputError:
        return model
    words = markerset.description.partition(":")[0] if model in builtin_markersets() else "Your own marker set"
    return f"{words}: {count_of(len(markerset), 'marker')} ({markerset.name})"


def _draw_progress(layout: bpy.types.UILayout, state: bpy.types.PropertyGroup):
    if state.doing:
        row = layout.row(align=True)
        row.scale_y = 1.6
        row.progress(factor=state.share, text=state.doing)
        row.operator("mocap_autolabel.cancel", text="", icon="X")
    for doing, file in done_elsewhere():
        text = f"{doing} is done: open {bpy.path.basename(file)}"
        row = layout.row(align=True)
        opens = row.operator("wm.open_mainfile", text=text, icon="FILE_BLEND")
        opens.filepath, opens.display_file_selector = file, False
        row.operator("mocap_autolabel.give_up_done", text="", icon="X").file = file


def _draw_refused(layout: bpy.types.UILayout, context, state: bpy.types.PropertyGroup):
    """Why a take was not labelled, where it can be all the same."""
    if state.refused and told_here(state, context.scene.mocap_autolabel):
        draw_text(context, layout, f"The take {state.refused}", icon="ERROR")
        layout.operator("mocap_autolabel.label", text="Label Regardless", icon="PLAY").force = True


def crowded_here(state: bpy.types.PropertyGroup, settings: bpy.types.PropertyGroup) -> bool:
    """Whether the take that is opened was found to show more people than the one who is asked for."""
    return settings.subjects.performing == "ONE" and state.crowded != "" and told_here(state, settings)


def asks_which(state: bpy.types.PropertyGroup, settings: bpy.types.PropertyGroup) -> bool:
    """Whether a person has to say first which of the sets that may be worn is, or Label would only ask the same."""
    subjects = settings.subjects
    unknown = subjects.markerset == AUTO_MODEL and subjects.performing != "LISTED" and not found_here(subjects)
    return unknown and len(state.likely) > 0 and told_here(state, settings)


def told_here(state: bpy.types.PropertyGroup, settings: bpy.types.PropertyGroup) -> bool:
    """Whether what the sidebar knows is of the take that is opened, which an undo may have changed."""
    return state.about == opened_file(settings.source) != ""


class MOCAP_AUTOLABEL_UL_performers(DrawsRows, bpy.types.UIList):
    """Those who are asked for."""

    def draw_row(self, context, layout, item, index):
        row = layout.split(factor=0.5, align=True)
        named = row.row(align=True)
        colour = named.row()
        colour.scale_x = 0.3
        colour.prop(item, "colour", text="")
        named.prop(item, "name", text="", emboss=False)
        row.prop(item, "markerset", text="", emboss=False)


@panel("Use It", seen=lambda context: shows(context, "USE"))
def use_it(layout, context):
    """The motion on a rig, and files for other programs."""
    settings = context.scene.mocap_autolabel
    if words := words_behind(context):
        draw_text(context, layout, words, icon="ERROR")
    rig = active_rig(context)
    if rig is None:
        draw_text(context, layout, "Select the armature of your rig to move it by the take", icon="INFO")
    else:
        _draw_rig(context, layout, rig)
    column = layout.column(align=True)
    column.separator()
    draw_choice(column, settings, "bone_names")
    column.operator("mocap_autolabel.add_character", icon="OUTLINER_OB_ARMATURE")
    layout.label(text="Export the Take:")
    grid = layout.grid_flow(columns=2, even_columns=True, align=True)
    for words in ("C3D", "FBX", "BVH", "TRC", "Labels", "Report"):
        grid.operator(f"mocap_autolabel.export_{words.lower()}", text=words)


def _draw_rig(context: bpy.types.Context, layout: bpy.types.UILayout, rig: bpy.types.Object):
    own = rig.mocap_autolabel
    row = layout.row()
    row.scale_y = 1.6
    row.operator("mocap_autolabel.retarget", text=f"Retarget to {rig.name}", icon="ARMATURE_DATA")
    if preview_on(rig):
        draw_operators(layout.row(align=True), "bake_retarget", "discard_retarget")
    if is_left_behind(context, rig):
        draw_text(context, layout, "The rig is behind: press Retarget", icon="ERROR")
    if homes(context.scene.mocap_autolabel.take):
        layout.prop(own, "performer")
    row = layout.row(align=True)
    row.prop(own, "keep_feet", toggle=True)
    row.prop(own, "keep_hands", toggle=True)
    body = fold(layout, "Bones")
    if body:
        draw_operators(body.row(align=True), "match_bones", "read_bone_map")
        column = body.column(align=True)
        letters = letters_across(context)
        for row in own.bones:
            words = row.name[:1].upper() + row.name[1:].replace("_", " ")
            fits = len(words) <= PART_WIDTH * letters and len(row.bone) + FIELD_ICONS <= (1 - PART_WIDTH) * letters
            pair = column.split(factor=PART_WIDTH, align=True) if fits else column
            pair.label(text=words)
            pair.prop_search(row, "bone", rig.data, "bones", text="")
