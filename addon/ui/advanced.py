# SPDX-License-Identifier: GPL-3.0-or-later
"""What nobody has to know in the tab "Mocap": how names are found, cameras, marker sets of one's own, whole folders."""

import bpy

from ..core.data.wording import count_of
from ..io.batch import AT_WORK, FAILING, WAITING
from ..ops.importing import cameras_at_hand
from ..props import wears_own
from ..scene import naming
from ..scene.cameras import camera_name, is_adopted, kept_health, kept_refinement, originals
from ..scene.markerset_edit import changed_since, edited_collection, kept_report
from ..scene.take import holds_points, is_take
from .parts import (
    DrawsRows,
    draw_cells,
    draw_choice,
    draw_list,
    draw_operators,
    draw_optional,
    draw_text,
    fold,
    in_short,
    panel,
)

FEW_SHOWN = 5  # cameras that fit below each other
PAIRS_SHOWN = 6  # of the list of ambiguous markers
STATE_ICONS = {FAILING: "ERROR", AT_WORK: "PLAY", WAITING: "TIME"}


@panel("Advanced", closed=True)
def advanced(layout, context):
    """What nobody has to know: how names are found, and what is drawn."""
    settings = context.scene.mocap_autolabel
    labelling, points = settings.labelling, settings.source.points_path
    draw_choice(layout, labelling, "method")
    layout.prop(labelling, "target")
    if not points:
        draw_choice(layout, labelling, "occlusion")
        if labelling.occlusion == "bvh":
            draw_choice(layout, labelling, "body")
    draw_optional(layout, labelling, "Height", "use_height", "height")
    draw_optional(layout, labelling, "Facing", "use_facing", "facing")
    draw_optional(layout, labelling, "Frames", "use_range", "range_first", "range_last")
    display, grid = settings.display, layout.grid_flow(columns=3, even_columns=True, align=True)
    for name in (
        "show_overlay",
        "show_names",
        "show_figure",
        "show_trails",
        *("show_links", "show_rays") * (not points),
    ):
        grid.prop(display, name, toggle=True)
    if display.show_timeline or not is_take(settings.take):
        grid.prop(display, "show_timeline", toggle=True)
    else:
        grid.operator("mocap_autolabel.show_timeline", text="Trajectories")
    if display.show_timeline:
        layout.prop(context.window_manager.mocap_autolabel, "timeline_unfolded")


@panel("Cameras", under="advanced", closed=True)
def cameras(layout, context):
    """The cameras that recorded the take, whether they go together, and what to do where they do not."""
    settings = context.scene.mocap_autolabel
    column = layout.column(align=True)
    column.operator("mocap_autolabel.import_cameras", icon="IMPORT")
    brought = cameras_at_hand(context.scene) and not is_adopted(settings.source.cameras)
    if not brought and any(item.type == "CAMERA" for item in context.scene.objects):
        column.operator("mocap_autolabel.use_cameras", icon="OUTLINER_OB_CAMERA")
    column.operator("mocap_autolabel.find_blobs", icon="FILE_MOVIE")
    if len(bpy.data.movieclips):
        column.operator("mocap_autolabel.import_clip_tracks", icon="TRACKER")
    if not cameras_at_hand(context.scene):
        return
    cameras = originals(settings.source.cameras.all_objects)
    grid = layout.grid_flow(columns=1 if len(cameras) <= FEW_SHOWN else 2, even_columns=True, align=True)
    for camera in cameras:
        icon = "OUTLINER_OB_CAMERA" if context.scene.camera == camera else "CAMERA_DATA"
        button = grid.operator("mocap_autolabel.look_through", text=camera_name(camera), icon=icon)
        button.camera = camera.name
    if settings.source.blobs_path and not settings.source.points_path:
        draw_health(layout, context)


def draw_health(layout: bpy.types.UILayout, context):
    """Whether the cameras go together, and what to do where they do not."""
    settings = context.scene.mocap_autolabel
    report = kept_refinement(settings.source.cameras)
    take = settings.take if is_take(settings.take) and not holds_points(settings.take) else None
    health = kept_health(take)
    for words in health or ():
        draw_text(context, layout, words[0].upper() + words[1:], icon="ERROR")
    if health == []:
        layout.label(text="All cameras go together", icon="CHECKMARK")
    layout.operator("mocap_autolabel.refine_calibration", icon="CON_CAMERASOLVER")
    if report is not None:
        column = layout.column(align=True)
        draw_cells(column, "Camera", "Before", "After")
        for name, row in report["cameras"].items():
            errors = row["before_px"], row["after_px"]
            draw_cells(column, name, *("–" if None in errors else f"{error:.2f} px" for error in errors))
        layout.operator("mocap_autolabel.label", text="Label Again", icon="PLAY")


@panel("Marker Set", under="advanced", closed=True)
def markerset(layout, context):
    """A marker set of one's own, laid out by hand or learned from labelled takes."""
    subjects = context.scene.mocap_autolabel.subjects
    row = layout.row(align=True)
    row.prop(subjects, "markerset", text="")
    row.operator("mocap_autolabel.edit_markerset", text="Show and Edit")
    if edited_collection(context.scene) is not None:
        item = context.object
        if item is not None and naming.MARKER in item:
            layout.prop(item, f'["{naming.MARKER}"]', text="Marker")
            layout.label(text=f"On {item.parent_bone or 'no segment'}", icon="BONE_DATA")
        layout.operator("mocap_autolabel.reattach", icon="CONSTRAINT_BONE")
        layout.operator("mocap_autolabel.save_markerset", icon="EXPORT")
        _draw_quality(layout, context)
    if body := fold(layout, "Train from Labelled Takes"):
        _draw_training(body, context)


def _draw_training(layout: bpy.types.UILayout, context):
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
    own = wears_own(settings.subjects)
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


def _draw_quality(layout: bpy.types.UILayout, context):
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


@panel("Label Folder", under="advanced", closed=True)
def label_folder(layout, context):
    """Takes of a folder, labelled in the background."""
    draw_folder(layout, context)


def draw_folder(layout: bpy.types.UILayout, context):
    """How the takes of a folder are labelled, and what became of them."""
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
