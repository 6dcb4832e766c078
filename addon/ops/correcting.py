# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person says of the labels of a take of 3D points: each time one edit more, and the scene follows it."""

from collections.abc import Sequence
from pathlib import Path

import bpy
import numpy as np
from bpy.props import EnumProperty, IntProperty
from bpy_extras.view3d_utils import location_3d_to_region_2d

from ..core.data.errors import InputError
from ..core.data.takes import NO_MARKER, rows_in_frame
from ..core.edits.kinds import NO_EDITS, AssignPoint, Edit, Edits, Right, Swap, UnlabelPoint
from ..io.edits import EDITS_ENDING, write_edits
from ..props import NOTHING_PICKED, refresh_review
from ..scene import naming
from ..scene.corrections import keep_edits
from ..scene.opened import opened
from ..scene.stored import Stored
from ..scene.take import holds_points, show_edits
from .reporting import reports_trouble

PICK_RADIUS = 20.0  # px of the interface from the mouse to a dot that is meant, as for Blender's own picking of points
SCOPES = (
    ("FRAME", "This Frame", "In the current frame"),
    ("ON", "From Here On", "From the current frame to the last"),
    ("BACK", "Back to the Start", "From the first frame to the current one"),
    ("WHOLE", "Whole Trajectory", "In all frames of the take"),
    ("RANGE", "Selected Range", "In the scene's preview range"),
)

# Blender keeps no reference to the texts of a dynamic enumeration; they must outlive the drawing.
_kept_names: list[tuple[str, str, str]] = []


def _marker_items(_self, context) -> list[tuple[str, str, str]]:
    scene = None if context is None else context.scene
    if scene is not None and holds_points(scene.mocap_autolabel.take):
        _kept_names[:] = [(name, name, "") for name in opened.take(scene.mocap_autolabel.take, scene).names]
    return _kept_names


def selected_markers(context: bpy.types.Context) -> list[str]:
    """The markers of the active take whose empties are selected, that of the active object first."""
    take = context.scene.mocap_autolabel.take
    items = [item for item in context.selected_objects if naming.MARKER in item and item.name in take.all_objects]
    return [str(item[naming.MARKER]) for item in sorted(items, key=lambda item: item != context.object)]


def correct(context: bpy.types.Context, edits: Edits):
    """Gives the active take other edits, and shows what follows; InputError where the new ones find nothing."""
    scene, collection = context.scene, context.scene.mocap_autolabel.take
    before = opened.take(collection, scene)
    after = opened.take_with(collection, scene, edits)
    for outcome in after.outcomes[len(before.edits) :]:
        if not outcome.labels:
            raise InputError(f"{outcome.reason}; expected frames in which there is something to correct")
    keep_edits(collection, edits)
    show_edits(collection, before, after, scene.mocap_autolabel.keep_unnamed)
    scene.frame_set(scene.frame_current)
    refresh_review(context.window_manager, scene)


def frames_in_scope(scope: str, stored: Stored, scene: bpy.types.Scene) -> tuple[int, int] | None:
    """First and last frame of a scope, in the source's numbers, None for all; InputError where there are none."""
    first, last = int(stored.motion.frames[0]), int(stored.motion.frames[-1])
    if scope == "WHOLE":
        return None
    if scope == "RANGE":
        if not scene.use_preview_range:
            raise InputError("no range is selected; expected a preview range, which P in a timeline draws")
        begin = max(scene.frame_preview_start - stored.shift, first)
        end = min(scene.frame_preview_end - stored.shift, last)
        if begin > end:
            words = f"frames {scene.frame_preview_start} to {scene.frame_preview_end} are selected"
            raise InputError(f"{words}; expected some of the take, {first + stored.shift} to {last + stored.shift}")
        return begin, end
    frame = stored.source_frame(scene.frame_current)
    return {"FRAME": (frame, frame), "ON": (frame, last), "BACK": (first, frame)}[scope]


def points_here(stored: Stored, frame: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(K,) the trajectories that have a point in a frame, (K,) the markers that they are, and (K, 3) m where."""
    rows = rows_in_frame(stored.rows, frame - int(stored.motion.frames[0]))
    return stored.rows.trajectory[rows], stored.labels.marker[rows], stored.rows.xyz[rows]


def trajectory_of(stored: Stored, marker: str, frame: int) -> int:
    """The trajectory that is a marker in a frame; InputError where none is."""
    trajectory, named, _ = points_here(stored, frame)
    found = trajectory[named == stored.names.index(marker)]
    if not len(found):
        raise InputError(f"{marker} is not named in frame {frame + stored.shift}; expected one in which it is")
    return int(found[0])


class OfPoints:
    """Operators on the active take, which is one of 3D points."""

    @classmethod
    def poll(cls, context):
        if not holds_points(context.scene.mocap_autolabel.take):
            cls.poll_message_set("Label a take of 3D points first")
            return False
        if context.mode != "OBJECT":
            cls.poll_message_set("Go to object mode first")
            return False
        return True


class Corrects(OfPoints):
    """What the edits share: their frames. They differ in `edits`, which makes them; UserError if it cannot."""

    bl_options = {"REGISTER", "UNDO"}
    scope: EnumProperty(name="Scope", description="The frames that are corrected", items=SCOPES, default="WHOLE")

    @reports_trouble
    def execute(self, context):
        scene = context.scene
        stored = opened.take(scene.mocap_autolabel.take, scene)
        frames = frames_in_scope(self.scope, stored, scene)
        correct(context, stored.edits.added(*self.edits(context, stored, frames)))
        return {"FINISHED"}


def chosen_trajectories(context: bpy.types.Context, stored: Stored) -> list[int]:
    """The trajectories of the selected markers in the current frame, else the one that was picked."""
    frame = stored.source_frame(context.scene.frame_current)
    if names := selected_markers(context):
        return [trajectory_of(stored, name, frame) for name in names]
    picked = context.scene.mocap_autolabel.picked
    if picked == NOTHING_PICKED:
        raise InputError("nothing is selected; expected a marker, or a picked point")
    return [picked]


class MOCAP_AUTOLABEL_OT_name_point(Corrects, bpy.types.Operator):
    """Say which marker the selected marker, or the picked point, really is."""

    bl_idname = "mocap_autolabel.name_point"
    bl_label = "Name"
    bl_property = "marker"

    marker: EnumProperty(name="Marker", description="What the trajectory is", items=_marker_items)

    def invoke(self, context, event):
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The trajectory is the marker."""
        chosen = chosen_trajectories(context, stored)
        if len(chosen) > 1:
            raise InputError(f"{len(chosen)} markers are selected; expected one")
        return [AssignPoint(chosen[0], self.marker, frames=frames)]


class MOCAP_AUTOLABEL_OT_unlabel(Corrects, bpy.types.Operator):
    """Take the names of the selected markers away from the points that have them in this frame."""

    bl_idname = "mocap_autolabel.unlabel"
    bl_label = "Unlabel"

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The trajectories have no name."""
        return [UnlabelPoint(point, frames=frames) for point in chosen_trajectories(context, stored)]


class MOCAP_AUTOLABEL_OT_swap_markers(Corrects, bpy.types.Operator):
    """Give two selected markers each other's names."""

    bl_idname = "mocap_autolabel.swap_markers"
    bl_label = "Swap"

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The two markers exchanged."""
        names = sorted(selected_markers(context))
        if len(names) != 2:
            raise InputError(f"{len(names)} markers are selected; expected the two that have each other's names")
        return [Swap((names[0], names[1]), frames=frames)]


class MOCAP_AUTOLABEL_OT_is_right(Corrects, bpy.types.Operator):
    """Say that the selected markers were looked at and are right: what is doubted of them is no longer asked."""

    bl_idname = "mocap_autolabel.is_right"
    bl_label = "It Is Right"

    def edits(self, context, stored: Stored, frames: tuple[int, int] | None) -> Sequence[Edit]:
        """The markers are right."""
        names = selected_markers(context)
        if not names:
            raise InputError("no marker is selected; expected those that are right")
        return [Right(name, frames=frames) for name in names]


def point_at(
    stored: Stored,
    frame: int,
    region: bpy.types.Region,
    view: bpy.types.RegionView3D,
    mouse: tuple[float, float],
    radius: float,
) -> int:
    """The trajectory whose point in a frame is nearest to the mouse, px of the region; InputError if none is near."""
    trajectory, _, xyz = points_here(stored, frame)
    places = [location_3d_to_region_2d(region, view, where, default=None) for where in xyz]
    there = [number for number, place in enumerate(places) if place is not None]
    off = np.array([np.hypot(places[number][0] - mouse[0], places[number][1] - mouse[1]) for number in there])
    if not len(off) or off.min() > radius:
        raise InputError("no point is there; expected a click on one")
    return int(trajectory[there[int(off.argmin())]])


def pick(context: bpy.types.Context, stored: Stored, point: int):
    """Selects the marker that a trajectory is in the current frame, or remembers the trajectory.

    Raises InputError where the trajectory has no point in the frame.
    """
    scene = context.scene
    trajectory, named, _ = points_here(stored, stored.source_frame(scene.frame_current))
    found = named[trajectory == point]
    if not len(found):
        raise InputError(f"trajectory {point} has no point in frame {scene.frame_current}; expected one that has")
    for item in context.selected_objects:
        item.select_set(False)
    marker, settings = int(found[0]), scene.mocap_autolabel
    settings.picked = point if marker == NO_MARKER else NOTHING_PICKED
    for item in settings.take.all_objects if marker != NO_MARKER else ():
        if item.get(naming.MARKER) == stored.names[marker]:
            item.select_set(True)
            context.view_layer.objects.active = item


class MOCAP_AUTOLABEL_OT_pick_point(OfPoints, bpy.types.Operator):
    """Click a point in the view: a named one is selected as its marker, of another the trajectory is remembered."""

    bl_idname = "mocap_autolabel.pick_point"
    bl_label = "Pick a Point"
    bl_options = {"REGISTER", "UNDO"}

    point: IntProperty(name="Trajectory", description="Its number in the file", min=0, options={"SKIP_SAVE"})

    @reports_trouble
    def execute(self, context):
        scene = context.scene
        pick(context, opened.take(scene.mocap_autolabel.take, scene), self.point)
        return {"FINISHED"}

    def invoke(self, context, event):
        if context.area is None or context.area.type != "VIEW_3D":
            self.report({"ERROR"}, "this is no 3D view; expected one to click into")
            return {"CANCELLED"}
        context.window.cursor_modal_set("EYEDROPPER")
        context.workspace.status_text_set("Click a point. Esc cancels")
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type in ("ESC", "RIGHTMOUSE"):
            self.cancel(context)
            return {"CANCELLED"}
        if event.type != "LEFTMOUSE" or event.value != "PRESS":
            return {"PASS_THROUGH"}  # meanwhile the view can be turned and the time changed
        self.cancel(context)
        self._mouse = event.mouse_x, event.mouse_y
        return self._clicked(context)

    def cancel(self, context):
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)

    @reports_trouble
    def _clicked(self, context) -> set[str]:
        """Picks what is nearest to the mouse."""
        scene, area = context.scene, context.area
        stored = opened.take(scene.mocap_autolabel.take, scene)
        region = next(region for region in area.regions if region.type == "WINDOW")
        mouse = self._mouse[0] - region.x, self._mouse[1] - region.y
        radius = PICK_RADIUS * context.preferences.system.ui_scale
        view = area.spaces.active.region_3d
        self.point = point_at(stored, stored.source_frame(scene.frame_current), region, view, mouse, radius)
        return self.execute(context)


class HasEdits(OfPoints):
    """Operators on the edits that there are."""

    @classmethod
    def poll(cls, context):
        if not super().poll(context):
            return False
        if len(context.window_manager.mocap_autolabel.corrections):
            return True
        cls.poll_message_set("Nothing was corrected")
        return False


class MOCAP_AUTOLABEL_OT_remove_correction(HasEdits, bpy.types.Operator):
    """Take a correction back: the labels are as if it had never been made."""

    bl_idname = "mocap_autolabel.remove_correction"
    bl_label = "Remove Correction"
    bl_options = {"REGISTER", "UNDO"}

    index: IntProperty(name="Index", description="Which of the list, from 0", min=0, options={"SKIP_SAVE"})

    @reports_trouble
    def execute(self, context):
        edits = opened.take(context.scene.mocap_autolabel.take, context.scene).edits
        if self.index >= len(edits):
            raise InputError(f"there is no correction {self.index + 1}; expected one of the {len(edits)} in the list")
        correct(context, edits.without(self.index))
        state = context.window_manager.mocap_autolabel
        state.correction_index = max(min(state.correction_index, len(edits) - 2), 0)
        return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_clear_corrections(HasEdits, bpy.types.Operator):
    """Take all corrections back."""

    bl_idname = "mocap_autolabel.clear_corrections"
    bl_label = "Clear All Corrections"
    bl_options = {"REGISTER", "UNDO"}

    def invoke(self, context, event):
        return context.window_manager.invoke_confirm(self, event)

    @reports_trouble
    def execute(self, context):
        correct(context, NO_EDITS)
        return {"FINISHED"}


class MOCAP_AUTOLABEL_OT_save_corrections(OfPoints, bpy.types.Operator):
    """Write the corrections beside the take, where the command line and other scenes take them up."""

    bl_idname = "mocap_autolabel.save_corrections"
    bl_label = "Save Corrections"
    bl_options = {"REGISTER"}

    def invoke(self, context, event):
        source = opened.take(context.scene.mocap_autolabel.take, context.scene).source
        asks = bool(source) and _file_beside(source).exists()
        return context.window_manager.invoke_confirm(self, event) if asks else self.execute(context)

    @reports_trouble
    def execute(self, context):
        stored = opened.take(context.scene.mocap_autolabel.take, context.scene)
        if not stored.source:
            raise InputError(f"take {stored.name} names no file; expected the file that it was labelled from")
        path = _file_beside(stored.source)
        write_edits(path, stored.edits)
        self.report({"INFO"}, f"Saved {path}")
        return {"FINISHED"}


def _file_beside(source: str) -> Path:
    """The file of the edits of a take beside its own, `source`."""
    path = Path(bpy.path.abspath(source))
    return path.with_name(path.stem + EDITS_ENDING)


CLASSES = (
    MOCAP_AUTOLABEL_OT_pick_point,
    MOCAP_AUTOLABEL_OT_name_point,
    MOCAP_AUTOLABEL_OT_unlabel,
    MOCAP_AUTOLABEL_OT_swap_markers,
    MOCAP_AUTOLABEL_OT_is_right,
    MOCAP_AUTOLABEL_OT_remove_correction,
    MOCAP_AUTOLABEL_OT_clear_corrections,
    MOCAP_AUTOLABEL_OT_save_corrections,
)
