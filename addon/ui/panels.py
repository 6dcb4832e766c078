# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab "Mocap": the steps from files to named markers, in the order a person takes them, and the export."""

from pathlib import Path

import bpy

from ..core.data.wording import count_of
from ..io.batch import AT_WORK, FAILING, WAITING
from ..io.markersets import SUFFIX
from ..io.text import written
from ..ops.importing import cameras_at_hand
from ..ops.reposing import words_behind
from ..ops.retargeting import active_rig
from ..props import OWN_FILE
from ..scene import naming
from ..scene.cameras import camera_name, kept_health, kept_refinement
from ..scene.markerset_edit import changed_since, edited_collection, kept_report
from ..scene.performers import homes
from ..scene.take import fps_of, holds_points, is_take, plays_at
from .parts import (
    DrawsRows,
    draw_cells,
    draw_choice,
    draw_list,
    draw_operators,
    draw_optional,
    draw_text,
    has_take,
    in_short,
    panel,
)

FEW_SHOWN = 5  # cameras that fit below each other
PAIRS_SHOWN = 6  # of the list of ambiguous markers
STATE_ICONS = {FAILING: "ERROR", AT_WORK: "PLAY", WAITING: "TIME"}


@panel("1. Cameras")
def cameras(layout, context):
    """The cameras that recorded the take."""
    source = context.scene.mocap_autolabel.source
    if source.points_path:
        layout.label(text="3D points need no cameras", icon="INFO")
    layout.operator("mocap_autolabel.import_cameras", icon="IMPORT")
    if source.points_path:
        return
    if not cameras_at_hand(context.scene):
        layout.label(text="Or drop a calibration here", icon="INFO")
        if any(item.type == "CAMERA" for item in context.scene.objects):
            layout.operator("mocap_autolabel.use_cameras", icon="OUTLINER_OB_CAMERA")
        return
    cameras = [item for item in source.cameras.all_objects if item.type == "CAMERA"]
    grid = layout.grid_flow(columns=1 if len(cameras) <= FEW_SHOWN else 2, even_columns=True, align=True)
    for camera in cameras:
        icon = "OUTLINER_OB_CAMERA" if context.scene.camera == camera else "CAMERA_DATA"
        button = grid.operator("mocap_autolabel.look_through", text=camera_name(camera), icon=icon)
        button.camera = camera.name


def _has_blobs_and_cameras(context: bpy.types.Context) -> bool:
    source = context.scene.mocap_autolabel.source
    return bool(source.blobs_path) and not source.points_path and cameras_at_hand(context.scene)


@panel("Calibration Health", under="cameras", seen=_has_blobs_and_cameras)
def calibration(layout, context):
    """Whether the cameras go together, and what to do where they do not."""
    settings = context.scene.mocap_autolabel
    report = kept_refinement(settings.source.cameras)
    take = settings.take if is_take(settings.take) and not holds_points(settings.take) else None
    health = kept_health(take)
    for words in health or ():
        draw_text(context, layout, words[0].upper() + words[1:], icon="ERROR")
    if health == []:
        layout.label(text="All cameras go together", icon="CHECKMARK")
    elif health is None:
        layout.label(text="Shown when a take is labelled", icon="INFO")
    layout.operator("mocap_autolabel.refine_calibration", icon="CON_CAMERASOLVER")
    if report is not None:
        column = layout.column(align=True)
        draw_cells(column, "Camera", "Before", "After")
        for name, row in report["cameras"].items():
            errors = row["before_px"], row["after_px"]
            draw_cells(column, name, *("–" if None in errors else f"{error:.2f} px" for error in errors))
        layout.operator("mocap_autolabel.label", text="Label Again", icon="PLAY")


@panel("2. Blobs or 3D Points")
def take(layout, context):
    """What the cameras saw, or the points that another program made of it."""
    source = context.scene.mocap_autolabel.source
    draw_operators(layout.column(align=True), "import_blobs", "import_points", icon="IMPORT")
    if not source.points_path:
        column = layout.column(align=True)
        column.operator("mocap_autolabel.find_blobs", icon="FILE_MOVIE")
        if len(bpy.data.movieclips):
            column.operator("mocap_autolabel.import_clip_tracks", icon="TRACKER")
    path = source.points_path or source.blobs_path
    if not path:
        layout.label(text="Or drop a .csv, .c3d, .trc or .qtm here", icon="INFO")
        return
    column = layout.column(align=True)
    column.label(text=bpy.path.basename(path), icon="FILE")
    frames = f"Frames {source.first_frame} to {source.last_frame}"
    count, thing = (source.trajectories, "trajectory") if source.points_path else (source.blob_count, "blob")
    # A take that was never read as a whole was not counted.
    column.label(text=f"{frames}, {count_of(count, thing)}" if count else frames)
    if source.points_path:
        column.label(text=f"{source.rate:g} frames a second")
    else:
        layout.prop(source, "rate")
    if not plays_at(context.scene, source.rate):
        layout.label(text=f"The scene plays {fps_of(context.scene):g} frames a second", icon="INFO")
        layout.operator("mocap_autolabel.play_as_take", icon="TIME")


@panel("3. Marker Set")
def markerset(layout, context):
    """What the subject wears."""
    subjects = context.scene.mocap_autolabel.subjects
    row = layout.row(align=True)
    row.prop(subjects, "markerset", text="")
    row.operator("mocap_autolabel.open_markerset", text="", icon="FILE_FOLDER")
    if subjects.markerset == OWN_FILE:
        layout.prop(subjects, "markerset_path", text="")


@panel("See and Edit", under="markerset", closed=True)
def markerset_edit(layout, context):
    """A marker set of one's own."""
    layout.operator("mocap_autolabel.edit_markerset", icon="OUTLINER_OB_ARMATURE")
    if edited_collection(context.scene) is None:
        return
    item = context.object
    if item is not None and naming.MARKER in item:
        layout.prop(item, f'["{naming.MARKER}"]', text="Marker")
        layout.label(text=f"On {item.parent_bone or 'no segment'}", icon="BONE_DATA")
    layout.operator("mocap_autolabel.reattach", icon="CONSTRAINT_BONE")
    layout.operator("mocap_autolabel.save_markerset", icon="EXPORT")


@panel("Train from Labelled Takes", under="markerset", closed=True)
def train(layout, context):
    """A marker set learned from labelled takes."""
    settings = context.scene.mocap_autolabel
    training, state = settings.training, context.window_manager.mocap_autolabel
    row = layout.row(align=True)
    row.operator("mocap_autolabel.add_training_takes", icon="ADD")
    row.operator("mocap_autolabel.remove_training_take", text="", icon="REMOVE")
    if len(training.takes):
        draw_list(layout, training, "takes")
        chosen = training.takes[min(training.take_index, len(training.takes) - 1)]
        layout.label(text=count_of(chosen.markers, "named marker"))
    own = settings.subjects.markerset == OWN_FILE or settings.subjects.markerset.endswith(SUFFIX)
    if own:
        layout.prop(training, "train_on", text="Train the Chosen One On")
    if not (own and training.train_on):
        layout.prop(training, "trained_name")
    draw_operators(layout, "train", "learn_take", "learn_frame", icon="PLAY")
    if len(state.differences):
        box = layout.box()
        box.label(text="Known takes, labelled again", icon="ERROR" if state.candidate else "CHECKMARK")
        for difference in state.differences:
            draw_text(context, box, difference.name)
        if state.candidate:
            box.operator("mocap_autolabel.adopt_model", icon="CHECKMARK")
    for doubt in state.doubts:
        draw_text(context, layout, doubt.name, icon="ERROR")


class MOCAP_AUTOLABEL_UL_takes(DrawsRows, bpy.types.UIList):
    """Labelled takes, each with its subject."""

    def draw_row(self, context, layout, item, index):
        row = layout.row(align=True)
        row.label(text=item.name)
        row.prop(item, "subject", text="", emboss=False, icon="USER")
        row.prop(item, "kept", text="", emboss=False, icon="LOCKED" if item.kept else "UNLOCKED")


@panel("Placement Quality", under="markerset", seen=lambda context: edited_collection(context.scene) is not None)
def quality(layout, context):
    """Which markers are easily taken for each other."""
    collection = edited_collection(context.scene)
    layout.operator("mocap_autolabel.judge_markers", icon="VIEWZOOM")
    report = kept_report(collection)
    if report is None:
        return
    if changed_since(collection):
        draw_text(context, layout, "Markers have changed since; judge them again", icon="ERROR")
    _draw_pairs(layout.column(align=True), report)
    for number, row in enumerate(report["advice"], 1):
        box = layout.box()
        gain = f"{' and '.join(row['for'])} from {row['before']:.1f} to {row['after']:.1f}"
        draw_text(context, box, f"{number}. {row['words'][0].upper()}{row['words'][1:]}. {gain}", icon="LIGHT")
        box.operator("mocap_autolabel.take_advice", icon="EMPTY_ARROWS").number = number


def _draw_pairs(column: bpy.types.UILayout, report: dict):
    """The whole set, then the pairs that are ambiguous."""
    poor = [pair for pair in report["pairs"] if pair["separation"] < report["goal"]]
    found = [(" and ".join(pair["markers"]), pair["separation"]) for pair in poor[:PAIRS_SHOWN]]
    for whole in report["whole"][:1]:
        words = "Turned round" if whole["kind"] == "turn" else "Left for right"
        found.insert(0, (words, whole["separation"]))
    for words, separation in found:
        row = column.split(factor=0.75)
        row.label(text=words, icon="ERROR" if separation < report["goal"] else "CHECKMARK")
        row.label(text=f"{separation:.1f}")
    if not poor:
        column.label(text="No ambiguous pairs", icon="CHECKMARK")
    elif len(poor) > PAIRS_SHOWN:
        column.label(text=f"and {len(poor) - PAIRS_SHOWN} more pairs")


@panel("4. Label")
def label(layout, context):
    """The one button."""
    settings, state = context.scene.mocap_autolabel, context.window_manager.mocap_autolabel
    labelling, points = settings.labelling, settings.source.points_path
    draw_choice(layout, labelling, "method")
    if points or labelling.method not in ("auto", "fit"):
        layout.prop(labelling, "target")
    if not points:
        draw_choice(layout, labelling, "occlusion")
        if labelling.occlusion == "bvh":
            draw_choice(layout, labelling, "body")
    row = layout.row(align=True)
    row.scale_y = 1.6
    if state.doing:
        row.progress(factor=state.share, text=state.doing)
        row.operator("mocap_autolabel.cancel", text="", icon="X")
        return
    row.operator("mocap_autolabel.label", icon="PLAY")
    if crowded_here(state, settings):
        draw_text(context, layout, "The take shows two performers or more", icon="ERROR")
        layout.operator("mocap_autolabel.label", text="Label All Performers", icon="COMMUNITY").everybody = True
    if state.refused:
        draw_text(context, layout, state.refused, icon="ERROR")
        layout.operator("mocap_autolabel.label", text="Label Regardless", icon="PLAY").force = True


def crowded_here(state: bpy.types.PropertyGroup, settings: bpy.types.PropertyGroup) -> bool:
    """Whether the take that is chosen was refused because it shows more people than the one who is asked for."""
    source = settings.source.points_path or settings.source.blobs_path
    return settings.subjects.performing == "ONE" and state.crowded == written(str(Path(bpy.path.abspath(source))))


@panel("Performers", under="label", closed=True)
def performers(layout, context):
    """Who is asked for."""
    subjects = context.scene.mocap_autolabel.subjects
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


@panel("Hints", under="label", closed=True)
def hints(layout, context):
    """What may be told, and never has to be."""
    labelling = context.scene.mocap_autolabel.labelling
    layout.label(text="Never needed; they narrow the search")
    draw_optional(layout, labelling, "Height", "use_height", "height")
    draw_optional(layout, labelling, "Facing", "use_facing", "facing")
    draw_optional(layout, labelling, "Frames", "use_range", "range_first", "range_last")


@panel("Label Folder", under="label", closed=True)
def label_folder(layout, context):
    """Takes of a folder, labelled in the background."""
    folder = context.scene.mocap_autolabel.folder
    state = context.window_manager.mocap_autolabel
    column = layout.column(align=True)
    column.active = not state.folder_doing
    for name in ("path", "out"):
        draw_choice(column, folder, name, factor=0.28)
    row = column.row(align=True)
    row.prop(folder, "watch", toggle=True)
    row.prop(folder, "overwrite", toggle=True)
    column.prop(folder, "jobs")
    row = layout.row(align=True)
    row.scale_y = 1.4
    if state.folder_doing:
        row.progress(factor=state.folder_share, text=state.folder_doing)
        row.operator("mocap_autolabel.stop_folder", text="", icon="X")
    else:
        row.operator("mocap_autolabel.label_folder", icon="PLAY")
    if state.folder_trouble:
        draw_text(context, layout, state.folder_trouble, icon="ERROR")
    if len(state.folder_takes):
        _draw_takes(layout, context, state)


def _draw_takes(layout: bpy.types.UILayout, context, state):
    draw_list(layout, state, "folder_takes", rows=4)
    index = min(state.folder_take_index, len(state.folder_takes) - 1)
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


class MOCAP_AUTOLABEL_UL_folder_takes(DrawsRows, bpy.types.UIList):
    """Takes, the worst first: how much there is to look at, and how many frames of a marker are at stake."""

    def draw_row(self, context, layout, item, index):
        split = layout.split(factor=0.5, align=True)
        split.label(text=item.name, icon=STATE_ICONS.get(item.state, "CHECKMARK"))
        if not item.measured:
            split.label(text=item.state)
            return
        split = split.split(factor=0.62, align=True)
        split.label(text=f"{item.trouble} open")
        split.label(text=in_short(item.stake))


@panel("5. Review")
def review(layout, context):
    """The labelled take."""
    settings = context.scene.mocap_autolabel
    layout.prop(settings, "take", text="")
    links = ("show_links",) * (not settings.source.points_path)
    for names in (("show_overlay", "show_names"), ("show_figure", "show_trails", *links)):
        row = layout.row(align=True)
        for name in names:
            row.prop(settings.display, name, toggle=True, icon="OVERLAY" if name == "show_overlay" else "NONE")
    if words := words_behind(context):
        draw_text(context, layout, words, icon="ERROR")
    if is_take(settings.take):
        layout.operator("mocap_autolabel.clear", icon="TRASH")


@panel("6. Export")
def export(layout, _context):
    """Files for other programs."""
    column = layout.column(align=True)
    draw_operators(column, "export_labels", "export_c3d", "export_trc", icon="EXPORT")
    draw_operators(column, "export_report", icon="DOCUMENTS")


@panel("Character", under="export", seen=has_take)
def character(layout, context):
    """The body as other rigs have it."""
    if words := words_behind(context):
        draw_text(context, layout, words, icon="ERROR")
    layout.prop(context.scene.mocap_autolabel, "bone_names", text="Bones")
    layout.operator("mocap_autolabel.add_character", icon="OUTLINER_OB_ARMATURE")
    draw_operators(layout.row(align=True), "export_bvh", "export_fbx", icon="EXPORT")


@panel("Retarget", under="export", closed=True, seen=has_take)
def retarget(layout, context):
    """The body's motion on the active armature."""
    rig = active_rig(context)
    if rig is None:
        draw_text(context, layout, "Make the armature of your rig the active object", icon="INFO")
        return
    own = rig.mocap_autolabel
    layout.operator("mocap_autolabel.retarget", text=f"Retarget to {rig.name}", icon="ARMATURE_DATA")
    if homes(context.scene.mocap_autolabel.take):
        layout.prop(own, "performer")
    row = layout.row(align=True)
    row.prop(own, "keep_feet", toggle=True)
    row.prop(own, "keep_hands", toggle=True)
    draw_operators(layout.row(align=True), "match_bones", "read_bone_map")
    column = layout.column(align=True)
    for row in own.bones:
        split = column.split(factor=0.35, align=True)
        split.label(text=row.name[:1].upper() + row.name[1:].replace("_", " "))
        split.prop_search(row, "bone", rig.data, "bones", text="")
