# SPDX-License-Identifier: GPL-3.0-or-later
"""Dots picked in the 3D view, by a click, a box or a lasso: trajectories or a camera's blobs, and what they are.

What is picked is no step of undo of its own, as for every step Blender looks the whole file through; it is kept beside
the file, and stays picked when a correction is undone.
"""

from collections.abc import Iterable, Sequence

import bpy
import numpy as np
from bpy.props import EnumProperty, IntProperty

from ..core.data.errors import InputError
from ..core.data.takes import NO_MARKER, NO_POINT, PointRows
from ..scene import naming
from ..scene.blob_dots import blob_dots, marker_dots, rows_now
from ..scene.cameras import camera_name, camera_through, room_pose
from ..scene.markers import marker_empties
from ..scene.opened import opened
from ..scene.picking import Dots, combined, dots_of, inside_box, inside_lasso, nearest, to_region
from ..scene.roots import placed
from ..scene.stored import Stored
from ..scene.take import holds_points, is_hidden, is_take
from ..scene.units import enlarged, metre_of
from .base import OfTake, PicksOfTake, once, operator, reports_trouble, taken
from .gestures import Drags, gesture, place_in, window_region
from .listing import lists_follow

PICK_RADIUS = 20.0  # px of the interface from the mouse to a dot that is meant, as for Blender's own picking of points
LASSO_STEP = 3.0  # px that the pointer moves between two corners of a lasso
MODES = (
    ("SET", "Set", "In place of what was picked"),
    ("ADD", "Add", "Beside what was picked"),
    ("TOGGLE", "Add or Take Away", "Each that was not picked is, and each that was is not"),
)


def selected_markers(context: bpy.types.Context) -> list[str]:
    """The markers of the active take whose empties are selected, that of the active object first."""
    take = context.scene.mocap_autolabel.take
    if take is None:
        return []
    items = [item for item in context.selected_objects if naming.MARKER in item and item.name in take.all_objects]
    return [str(item[naming.MARKER]) for item in sorted(items, key=lambda item: item != context.object)]


def picked_points(context: bpy.types.Context) -> list[int]:
    """The trajectories that are picked, or rows of blobs; none in another scene, or once other markers were selected.

    A blob is picked as its track in its camera: in another frame it is the row there.
    """
    state, scene = context.window_manager.mocap_autolabel, context.scene
    if not len(state.picked) or state.picked_with != _selection(context):
        return []
    picked, take = [row.point for row in state.picked], scene.mocap_autolabel.take
    if holds_points(take):
        return picked
    stored = opened.take(take, scene)
    return rows_now(stored, opened.tracks(take, scene), picked, stored.index_of(scene.frame_float))


def show_picked(
    context: bpy.types.Context,
    stored: Stored,
    points: Sequence[int],
    markers: Iterable[int] = (),
    follow: bool = True,
):
    """Picks trajectories, or rows of blobs, and selects the empties of what they are here and now, and of `markers`.

    The last one becomes the active object, and the lists of Review `follow`, not where a correction picks anew.
    """
    scene, state = context.scene, context.window_manager.mocap_autolabel
    for item in context.selected_objects:
        item.select_set(False)
    if not points:
        marker = {}
    elif isinstance(stored.rows, PointRows):
        dots = dots_here(stored, scene)
        marker = dict(zip(dots.trajectory.tolist(), dots.marker.tolist(), strict=True))
    else:
        marker = {row: int(stored.labels.marker[row]) for row in points if row < len(stored.rows)}
    wanted = [marker[point] for point in points if marker.get(point, NO_MARKER) != NO_MARKER]
    empties, names = marker_empties(scene.mocap_autolabel.take), [stored.names[index] for index in (*markers, *wanted)]
    for name in names:
        item = empties.get(name)
        if item is not None and item.visible_get():
            item.select_set(True)
            context.view_layer.objects.active = item
    state.picked.clear()
    for point in points:
        state.picked.add().point = point
    state.picked_with = _selection(context)
    if follow:
        lists_follow(context, stored, names, points if isinstance(stored.rows, PointRows) else ())


def words_of_picked(context: bpy.types.Context, points: Sequence[int]) -> str:
    """What is picked, in words: trajectories, or whose blobs."""
    take = context.scene.mocap_autolabel.take
    if holds_points(take):
        return f"Trajectory {', '.join(map(str, points))}"
    stored = opened.take(take, context.scene)
    return f"Blob of {', '.join(stored.cameras.names[stored.rows.camera[row]] for row in points)}"


def restore_picked(context: bpy.types.Context):
    """After a step was undone: what is picked still, and selected as what it is called now."""
    state, take = context.window_manager.mocap_autolabel, context.scene.mocap_autolabel.take
    if not len(state.picked):
        return
    if not is_take(take) or context.mode != "OBJECT":
        state.picked.clear()
        return
    show_picked(context, opened.take(take, context.scene), [row.point for row in state.picked])


def dots_here(stored: Stored, scene: bpy.types.Scene, area: bpy.types.Area | None = None) -> Dots:
    """The dots of the current frame, of blobs those of the camera that a view looks through; InputError outside."""
    index = stored.index_here(scene.frame_float)
    if isinstance(stored.rows, PointRows):
        return dots_of(stored, index)
    image = None if area is None else image_in(stored, scene, area)
    return marker_dots(stored, index) if image is None else blob_dots(stored, index, *image)


def image_in(stored: Stored, scene: bpy.types.Scene, area: bpy.types.Area) -> tuple[int, np.ndarray] | None:
    """Which of a take's cameras a view looks through, and Blender's pose (4, 4) of it, m; None where through none."""
    camera = camera_through(area.spaces.active, scene)
    if camera is None or camera_name(camera) not in stored.cameras.names:
        return None
    return stored.cameras.names.index(camera_name(camera)), room_pose(camera)


def take_to_view(context: bpy.types.Context, stored: Stored, area: bpy.types.Area) -> np.ndarray:
    """(4, 4) from a take's coordinates to where a view shows it: as its root is; the room's through its cameras."""
    if image_in(stored, context.scene, area) is not None:
        return enlarged(metre_of(camera_through(area.spaces.active, context.scene)))
    return placed(context.scene.mocap_autolabel.take)


def dots_in_view(context: bpy.types.Context, stored: Stored, area: bpy.types.Area) -> tuple[Dots, np.ndarray]:
    """The dots of the current frame, and (K, 2) where they are in a 3D view, px of its region; NaN where unseen."""
    dots, region = dots_here(stored, context.scene, area), window_region(area)
    perspective = np.array(area.spaces.active.region_3d.perspective_matrix) @ take_to_view(context, stored, area)
    places = to_region(dots.xyz, perspective, (region.width, region.height))
    hidden = is_hidden(context.scene.mocap_autolabel.take, context.view_layer)
    return dots, np.full_like(places, np.nan) if hidden else places


def dot_at(context: bpy.types.Context, stored: Stored, area: bpy.types.Area, mouse) -> tuple[Dots, int | None]:
    """The dots of the current frame, and which of them the mouse, px of the view's region, points at."""
    dots, places = dots_in_view(context, stored, area)
    return dots, nearest(places, mouse, PICK_RADIUS * context.preferences.system.ui_scale)


def _pick_dots(context: bpy.types.Context, stored: Stored, dots: Dots, found: np.ndarray, mode: str):
    """Picks the dots `found` (K,) of a frame: points as trajectories, blobs as rows, others as markers' empties."""
    points = dots.trajectory[found]
    placed = dots.marker[found][points == NO_POINT].tolist()
    show_picked(context, stored, combined(picked_points(context), points[points != NO_POINT].tolist(), mode), placed)


def _selection(context: bpy.types.Context) -> str:
    """The scene and its selected markers, as one word to compare."""
    return "\n".join([str(context.scene.session_uid), *sorted(selected_markers(context))])


class InView(OfTake):
    """Operators of a hand in a 3D view."""

    @classmethod
    def poll(cls, context):
        return super().poll(context) and context.area is not None and context.area.type == "VIEW_3D"


class Picks(PicksOfTake):
    """Operators that pick dots."""

    bl_options = {"INTERNAL"}
    mode: once(EnumProperty, "Mode", "What becomes of what was picked before", items=MODES)


class MOCAP_AUTOLABEL_OT_pick(Picks, bpy.types.Operator):
    """Pick the dot that you point at; beside all dots, nothing."""

    point: once(IntProperty, "Number", "A trajectory's, or a blob's row", min=0)

    @reports_trouble
    def invoke(self, context, event):
        stored = taken(context)
        dots, found = dot_at(context, stored, context.area, place_in(window_region(context.area), event))
        if found is not None or self.mode == "SET":
            chosen = np.arange(len(dots)) == (-1 if found is None else found)
            _pick_dots(context, stored, dots, chosen, self.mode)
        context.area.tag_redraw()

    def work(self, context):
        point, frame, stored = self.point, context.scene.frame_float, taken(context)
        if not isinstance(stored.rows, PointRows):
            if point >= len(stored.rows) or stored.rows.frame[point] != stored.index_of(frame):
                raise InputError(f"row {point} is no blob of frame {frame:g}; expected one of its blobs")
        elif not dots_here(stored, context.scene).of([point]).any():
            raise InputError(f"trajectory {point} has no point in frame {frame:g}; expected one that has")
        show_picked(context, stored, combined(picked_points(context), [point], self.mode))


class MOCAP_AUTOLABEL_OT_pick_region(Drags, Picks, bpy.types.Operator):
    """Pick the dots in a box or a lasso that you draw."""

    bl_label = "Pick Dots in a Region"

    shape: EnumProperty(
        name="Shape",
        description="What is drawn",
        items=(("BOX", "Box", "From corner to corner"), ("LASSO", "Lasso", "Around the dots by hand")),
    )

    def invoke(self, context, event):
        region = window_region(context.area)
        begin = event.mouse_prev_press_x - region.x, event.mouse_prev_press_y - region.y
        gesture.clear()
        gesture.region, gesture.outline = region.as_pointer(), [begin]
        self._area, self._region, self._begin = context.area, region, begin
        self.drag(context, event)
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def cancel(self, context):
        gesture.clear()
        self._area.tag_redraw()

    def drag(self, context, event):
        mouse = place_in(self._region, event)
        if self.shape == "BOX":
            (left, lower), (right, upper) = self._begin, mouse
            gesture.outline = [(left, lower), (right, lower), (right, upper), (left, upper)]
        elif np.hypot(*np.subtract(mouse, gesture.outline[-1])) >= LASSO_STEP:
            gesture.outline.append(mouse)
        self._area.tag_redraw()

    @reports_trouble
    def let_go(self, context, event):
        self.drag(context, event)
        outline = np.array(gesture.outline, dtype=float)
        self.cancel(context)
        stored = taken(context)
        dots, places = dots_in_view(context, stored, self._area)
        box = self.shape == "BOX"
        found = inside_box(places, outline[0], outline[2]) if box else inside_lasso(places, outline)
        _pick_dots(context, stored, dots, found, self.mode)


@operator(of=PicksOfTake, label="Pick Nothing", options={"INTERNAL"})
def pick_none(_self, context):
    """Pick nothing any more."""
    show_picked(context, taken(context), [])
