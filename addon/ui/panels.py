# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar tab "Mocap": the steps from files to named markers, in the order a person takes them."""

from pathlib import Path

import bpy

from ..core.data.wording import count_of
from ..io.markersets import SUFFIX
from ..io.names import written
from ..ops.importing import cameras_at_hand
from ..ops.picking import picked_points, selected_markers, words_of_picked
from ..ops.reposing import words_behind
from ..props import OWN_FILE
from ..scene import naming
from ..scene.cameras import camera_name
from ..scene.markerset_edit import edited_collection
from ..scene.performers import homes
from ..scene.take import is_take
from . import label_folder, performers, trouble
from .parts import Reviewing, Step, draw_choice, draw_text

FEW_MARKERS_SHOWN = 5  # cameras that fit below each other


class MOCAP_AUTOLABEL_PT_cameras(Step, bpy.types.Panel):
    """The cameras that recorded the take."""

    bl_label = "1. Cameras"

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        if settings.points_path:
            layout.label(text="3D points need no cameras", icon="INFO")
        layout.operator("mocap_autolabel.import_cameras", icon="IMPORT")
        if settings.points_path:
            return
        if not cameras_at_hand(context.scene):
            layout.label(text="Or drop a calibration here", icon="INFO")
            if any(item.type == "CAMERA" for item in context.scene.objects):
                layout.operator("mocap_autolabel.use_cameras", icon="OUTLINER_OB_CAMERA")
            return
        cameras = [item for item in settings.cameras.all_objects if item.type == "CAMERA"]
        grid = layout.grid_flow(columns=1 if len(cameras) <= FEW_MARKERS_SHOWN else 2, even_columns=True, align=True)
        for camera in cameras:
            icon = "OUTLINER_OB_CAMERA" if context.scene.camera == camera else "CAMERA_DATA"
            button = grid.operator("mocap_autolabel.look_through", text=camera_name(camera), icon=icon)
            button.camera = camera.name


class MOCAP_AUTOLABEL_PT_take(Step, bpy.types.Panel):
    """What the cameras saw, or the points that another program made of it."""

    bl_label = "2. Blobs or 3D Points"

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        column = layout.column(align=True)
        column.operator("mocap_autolabel.import_blobs", icon="IMPORT")
        column.operator("mocap_autolabel.import_points", icon="IMPORT")
        if not settings.points_path:
            column = layout.column(align=True)
            column.operator("mocap_autolabel.find_blobs", icon="FILE_MOVIE")
            if len(bpy.data.movieclips):
                column.operator("mocap_autolabel.import_clip_tracks", icon="TRACKER")
        path = settings.points_path or settings.blobs_path
        if not path:
            layout.label(text="Or drop a .csv, .c3d, .trc or .qtm here", icon="INFO")
            return
        column = layout.column(align=True)
        column.label(text=bpy.path.basename(path), icon="FILE")
        frames = f"Frames {settings.first_frame} to {settings.last_frame}"
        if settings.points_path:
            column.label(text=_counted(frames, settings.trajectories, "trajectory"))
            column.label(text=f"{settings.rate:g} frames a second")
        else:
            column.label(text=_counted(frames, settings.blob_count, "blob"))
            layout.prop(settings, "rate")


def _counted(frames: str, count: int, thing: str) -> str:
    """What is in a take; of one that was never read as a whole nobody has counted it."""
    return f"{frames}, {count_of(count, thing)}" if count else frames


class MOCAP_AUTOLABEL_PT_markerset(Step, bpy.types.Panel):
    """What the subject wears."""

    bl_label = "3. Marker Set"

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        row = layout.row(align=True)
        row.prop(settings, "markerset", text="")
        row.operator("mocap_autolabel.open_markerset", text="", icon="FILE_FOLDER")
        if settings.markerset == OWN_FILE:
            layout.prop(settings, "markerset_path", text="")


class MOCAP_AUTOLABEL_PT_markerset_edit(Step, bpy.types.Panel):
    """A marker set of one's own."""

    bl_label = "See and Edit"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_markerset"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout = self.layout
        layout.operator("mocap_autolabel.edit_markerset", icon="OUTLINER_OB_ARMATURE")
        if edited_collection(context.scene) is None:
            return
        item = context.object
        if item is not None and naming.MARKER in item:
            layout.prop(item, f'["{naming.MARKER}"]', text="Marker")
            layout.label(text=f"On {item.parent_bone or 'no segment'}", icon="BONE_DATA")
        layout.operator("mocap_autolabel.reattach", icon="CONSTRAINT_BONE")
        layout.operator("mocap_autolabel.save_markerset", icon="EXPORT")


class MOCAP_AUTOLABEL_PT_train(Step, bpy.types.Panel):
    """A marker set learned from labelled takes."""

    bl_label = "Train from Labelled Takes"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_markerset"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        row = layout.row(align=True)
        row.operator("mocap_autolabel.add_training_takes", icon="ADD")
        row.operator("mocap_autolabel.remove_training_take", text="", icon="REMOVE")
        if len(settings.training_takes):
            layout.template_list(
                "MOCAP_AUTOLABEL_UL_training_takes",
                "",
                settings,
                "training_takes",
                settings,
                "training_take_index",
                rows=3,
            )
            chosen = settings.training_takes[min(settings.training_take_index, len(settings.training_takes) - 1)]
            layout.label(text=count_of(chosen.markers, "named marker"))
        own = settings.markerset == OWN_FILE or settings.markerset.endswith(SUFFIX)
        if own:
            layout.prop(settings, "train_on", text="Train the Chosen One On")
        if not (own and settings.train_on):
            layout.prop(settings, "trained_name")
        layout.operator("mocap_autolabel.train", icon="PLAY")
        layout.operator("mocap_autolabel.learn_take", icon="PLAY")
        layout.operator("mocap_autolabel.learn_frame", icon="PLAY")
        state = context.window_manager.mocap_autolabel
        if len(state.differences):
            box = layout.box()
            box.label(text="Known takes, labelled anew", icon="ERROR" if state.candidate else "CHECKMARK")
            for difference in state.differences:
                draw_text(context, box, difference.name)
            if state.candidate:
                box.operator("mocap_autolabel.adopt_model", icon="CHECKMARK")
        for doubt in state.doubts:
            draw_text(context, layout, doubt.name, icon="ERROR")


class MOCAP_AUTOLABEL_PT_label(Step, bpy.types.Panel):
    """The one button."""

    bl_label = "4. Label"

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        draw_choice(layout, settings, "method")
        if settings.points_path or settings.method not in ("auto", "fit"):
            layout.prop(settings, "target")
        if settings.points_path:
            layout.prop(settings, "keep_unnamed")
        else:
            draw_choice(layout, settings, "occlusion")
            if settings.occlusion == "bvh":
                draw_choice(layout, settings, "body")
        state = context.window_manager.mocap_autolabel
        row = layout.row(align=True)
        row.scale_y = 1.6
        if not state.doing:
            row.operator("mocap_autolabel.label", icon="PLAY")
            if crowded_here(state, settings):
                draw_text(context, layout, "The take shows two performers or more", icon="ERROR")
                layout.operator("mocap_autolabel.label", text="Label All Performers", icon="COMMUNITY").everybody = True
            if state.refused:
                draw_text(context, layout, state.refused, icon="ERROR")
                layout.operator("mocap_autolabel.label", text="Label Regardless", icon="PLAY").force = True
            return
        row.progress(factor=state.share, text=state.doing)
        row.operator("mocap_autolabel.cancel", text="", icon="X")


def crowded_here(state: bpy.types.PropertyGroup, settings: bpy.types.PropertyGroup) -> bool:
    """Whether the take that is chosen was refused because it shows more people than the one who is asked for."""
    source = settings.points_path or settings.blobs_path
    return settings.performing == "ONE" and state.crowded == written(str(Path(bpy.path.abspath(source))))


class MOCAP_AUTOLABEL_PT_hints(Step, bpy.types.Panel):
    """What may be told, and never has to be."""

    bl_label = "Hints"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_label"
    bl_options = {"DEFAULT_CLOSED"}

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        layout.label(text="Never needed; they narrow the search")
        for name in ("height", "facing"):
            row = layout.row(heading=name.capitalize())
            row.prop(settings, f"use_{name}", text="")
            value = row.row()
            value.active = getattr(settings, f"use_{name}")
            value.prop(settings, name, text="")
        row = layout.row(heading="Frames")
        row.prop(settings, "use_range", text="")
        value = row.row(align=True)
        value.active = settings.use_range
        value.prop(settings, "range_first", text="")
        value.prop(settings, "range_last", text="")


class MOCAP_AUTOLABEL_PT_review(Step, bpy.types.Panel):
    """The labelled take."""

    bl_label = "5. Review"

    def draw(self, context):
        layout, settings = self.layout, context.scene.mocap_autolabel
        layout.prop(settings, "take", text="")
        row = layout.row(align=True)
        row.prop(settings, "show_overlay", toggle=True, icon="OVERLAY")
        row.prop(settings, "show_names", toggle=True)
        row = layout.row(align=True)
        row.prop(settings, "show_figure", toggle=True)
        row.prop(settings, "show_trails", toggle=True)
        if not settings.points_path:
            row.prop(settings, "show_links", toggle=True)
        if words := words_behind(context):
            draw_text(context, layout, words, icon="ERROR")
        if is_take(settings.take):
            layout.operator("mocap_autolabel.clear", icon="TRASH")


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


class MOCAP_AUTOLABEL_PT_markers(Reviewing, bpy.types.Panel):
    """Every marker with its gaps and residual, the one that was found least first."""

    bl_label = "Markers"

    def draw(self, context):
        state, layout = context.window_manager.mocap_autolabel, self.layout
        measured = has_residuals(context)
        words = ("Marker", "Found", "Gaps", "mm") if measured else ("Marker", "Found", "Gaps")
        for cell, heading in zip(cells(layout, measured), words, strict=True):
            cell.label(text=heading)
        layout.template_list("MOCAP_AUTOLABEL_UL_markers", "", state, "markers", state, "marker_index", rows=6)


class MOCAP_AUTOLABEL_PT_corrections(Reviewing, bpy.types.Panel):
    """What a person says of the labels."""

    bl_label = "Corrections"

    def draw(self, context):
        layout, state = self.layout, context.window_manager.mocap_autolabel
        layout.operator("mocap_autolabel.pick_point", icon="EYEDROPPER")
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
        if homes(context.scene.mocap_autolabel.take):
            column = layout.column(align=True)
            column.operator("mocap_autolabel.other_performer", icon="COMMUNITY")
            column.operator("mocap_autolabel.exchange_performers", icon="UV_SYNC_SELECT")
        if len(state.corrections):
            row = layout.row()
            row.template_list(
                "MOCAP_AUTOLABEL_UL_corrections", "", state, "corrections", state, "correction_index", rows=3, maxrows=8
            )
            column = row.column(align=True)
            remove = column.operator("mocap_autolabel.remove_correction", text="", icon="REMOVE")
            remove.index = state.correction_index
            column.operator("mocap_autolabel.clear_corrections", text="", icon="TRASH")
            if state.correction_index < len(state.corrections):
                row = state.corrections[state.correction_index]
                draw_text(context, layout, f"{row.name}: {row.idle}" if row.idle else row.name)
        layout.operator("mocap_autolabel.save_corrections", icon="FILE_TICK")


class MOCAP_AUTOLABEL_PT_export(Step, bpy.types.Panel):
    """Files for other programs."""

    bl_label = "6. Export"

    def draw(self, context):
        column = self.layout.column(align=True)
        column.operator("mocap_autolabel.export_labels", icon="EXPORT")
        column.operator("mocap_autolabel.export_c3d", icon="EXPORT")
        column.operator("mocap_autolabel.export_trc", icon="EXPORT")
        column.operator("mocap_autolabel.export_report", icon="DOCUMENTS")


class MOCAP_AUTOLABEL_UL_training_takes(bpy.types.UIList):
    """Labelled takes, each with its subject."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        row = layout.row(align=True)
        row.label(text=item.name)
        row.prop(item, "subject", text="", emboss=False, icon="USER")
        row.prop(item, "kept", text="", emboss=False, icon="LOCKED" if item.kept else "UNLOCKED")


class MOCAP_AUTOLABEL_UL_corrections(bpy.types.UIList):
    """Edits in the order in which they are applied."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        layout.label(text=item.name, icon="ERROR" if item.idle else "NONE")


class MOCAP_AUTOLABEL_UL_markers(bpy.types.UIList):
    """A marker a row."""

    def draw_item(self, context, layout, data, item, icon, active_data, active_property, index=0, flt_flag=0):
        name, found, gaps, *residual = cells(layout, has_residuals(context))
        name.label(text=item.name)
        found.label(text=f"{item.labelled:.1%}")
        if item.gaps:
            jump = gaps.operator("mocap_autolabel.jump", text=f"{item.gaps} (≤{item.longest_gap})", emboss=False)
            jump.frame, jump.marker = item.first_gap, item.name
        else:
            gaps.label(text="–")
        for cell in residual:
            cell.label(text=f"{item.residual:.1f}" if item.residual == item.residual else "–")


CLASSES = (
    MOCAP_AUTOLABEL_UL_training_takes,
    MOCAP_AUTOLABEL_UL_corrections,
    MOCAP_AUTOLABEL_UL_markers,
    MOCAP_AUTOLABEL_PT_cameras,
    MOCAP_AUTOLABEL_PT_take,
    MOCAP_AUTOLABEL_PT_markerset,
    MOCAP_AUTOLABEL_PT_markerset_edit,
    MOCAP_AUTOLABEL_PT_train,
    MOCAP_AUTOLABEL_PT_label,
    *performers.ASKED_FIRST,
    MOCAP_AUTOLABEL_PT_hints,
    *label_folder.CLASSES,
    MOCAP_AUTOLABEL_PT_review,
    *trouble.CLASSES,
    MOCAP_AUTOLABEL_PT_markers,
    MOCAP_AUTOLABEL_PT_corrections,
    MOCAP_AUTOLABEL_PT_export,
)
