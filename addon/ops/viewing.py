# SPDX-License-Identifier: GPL-3.0-or-later
"""Looking around in a take: through its cameras, at its doubtful frames; and putting it away."""

from contextlib import suppress

import bpy
import numpy as np
from bpy.props import FloatProperty, StringProperty

from ..core.data.errors import InputError
from ..props import refresh_review
from ..scene import cameras as scene_cameras
from ..scene.clock import set_moment
from ..scene.opened import opened
from ..scene.ownership import persons_in
from ..scene.rig_preview import leave_take
from ..scene.roots import in_world
from ..scene.stored import Stored
from ..scene.take import adopt_copies, is_hidden, is_linked, is_take, remove_take, takes_of
from ..scene.units import metre_in
from .base import WithTake, lacks_object_mode, once, operator, taken, unless
from .gestures import window_region
from .picking import selected_markers, show_picked


@operator(camera=once(StringProperty, "Camera", "Name of the camera object"))
def look_through(self, context):
    """Look through this camera, with its own picture size and pixels."""
    camera = context.scene.objects.get(self.camera)
    if not scene_cameras.is_mocap_camera(camera):
        words = f"{self.camera or 'nothing'} is not a calibrated camera of this scene"
        raise InputError(f"{words}; expected one of those")
    scene_cameras.look_through(context.scene, camera)
    if context.space_data is not None and context.space_data.type == "VIEW_3D":
        context.space_data.region_3d.view_perspective = "CAMERA"


@operator(
    label="Jump to Frame",
    frame=FloatProperty(name="Frame", description="Frame to go to, or what part of one"),
    marker=once(StringProperty, "Marker", "Marker to select"),
)
def jump(self, context):
    """Go to this frame, select the marker if there is one to select, and bring it into views and graphs."""
    set_moment(context.scene, self.frame)
    collection = context.scene.mocap_autolabel.take
    if self.marker and is_take(collection) and context.mode == "OBJECT":
        stored = taken(context)
        markers = [stored.words[self.marker]] if self.marker in stored.words else []
        show_picked(context, stored, [], markers)
        index = stored.index_of(context.scene.frame_float)
        if index >= 0:
            bring_into_view(context, in_world(collection, marker_places(stored, index, markers)))
            frame, around = int(stored.motion.frames[index]), round(stored.rate)
            fit_graphs(context, frame - around, frame + around)


@operator(
    unless(lambda context: is_take(context.scene.mocap_autolabel.take), "There is no labelled take in this scene"),
    lacks_object_mode,
    label="Remove Take",
)
def clear(self, context):
    """Remove the labelled take with previews on rigs; its cameras and blobs stay, and all that you made or changed."""
    settings = context.scene.mocap_autolabel
    adopt_copies()
    leave_take(context, settings.take)
    collection, settings.take = settings.take, None
    others = [one for one in takes_of(context.scene) if one != collection]
    left = remove_take(collection, context.scene)
    # The latest of the others becomes the active one, if need be one that was hidden, as for other markers.
    seen = [one for one in others if not is_hidden(one, context.view_layer)]
    settings.take = next(reversed(seen or [one for one in others if not is_linked(one)]), None)
    opened.forget_read()
    refresh_review(context.window_manager, context.scene)
    if left is not None:
        self.report({"INFO"}, f"What is yours is kept in {left.name}: {persons_in(left) or 'collections'}")


TAB = "Mocap"


def open_sidebar(context: bpy.types.Context):
    """Opens the sidebar of the largest 3D view at what to do next, where no view shows that."""
    if bpy.app.background or context.screen is None:
        return
    views = [area for area in context.screen.areas if area.type == "VIEW_3D"]
    sidebars = [next(one for one in area.regions if one.type == "UI") for area in views]
    if views and not any(one.width > 1 and one.active_panel_category == TAB for one in sidebars):
        largest = max(views, key=lambda area: area.width * area.height)
        largest.spaces.active.show_region_ui = True
        _turn_to_tab(context.window, context.screen, list(context.screen.areas).index(largest))


def _turn_to_tab(window: bpy.types.Window, screen: bpy.types.Screen, index: int):
    """Chooses the tab of the sidebar of an area by its number, which has none before it is drawn.

    All is asked for anew then: an area that is gone would be a place in memory that is something else's.
    """
    of_window, of_screen = window.as_pointer(), screen.name

    def turn():
        windows = bpy.context.window_manager.windows
        shown = next((one.screen for one in windows if one.as_pointer() == of_window), None)
        if shown is None or shown.name != of_screen or index >= len(shown.areas):
            return
        for sidebar in (one for one in shown.areas[index].regions if one.type == "UI"):
            with suppress(TypeError):  # another editor is there by now
                sidebar.active_panel_category = TAB
                sidebar.tag_redraw()

    bpy.app.timers.register(turn, first_interval=0.2)


ROOM = 4.0  # times the reach of what is meant that a view shows around it
MIN_ROOM = 1.2  # m that a view shows at least, so that one knows the limb
MAX_PLACES = 5000  # that the extent of a take is told from


def marker_places(stored: Stored, index: int, markers: list[int]) -> np.ndarray:
    """(K, 3) m where markers are in a frame, or where the body has them."""
    found, expected = stored.motion.markers[index, markers], stored.motion.expected[index, markers]
    return np.where(np.isfinite(found), found, expected)


def bring_into_view(context: bpy.types.Context, places: np.ndarray, room: float = ROOM):
    """Lets every 3D view that looks through no camera show places (K, 3) m, from where it looks."""
    there = places[np.isfinite(places).all(axis=1)]
    if not len(there) or context.screen is None:
        return
    middle = (there.min(axis=0) + there.max(axis=0)) / 2
    reach = float(np.linalg.norm(there - middle, axis=1).max())
    for area in context.screen.areas:
        if area.type == "VIEW_3D" and area.spaces.active.region_3d.view_perspective != "CAMERA":
            view = area.spaces.active.region_3d
            view.view_location = middle.tolist()
            view.view_distance = max(room * reach, MIN_ROOM * metre_in(context.scene))


def show_take_whole(context: bpy.types.Context, points: np.ndarray):
    """Lets 3D views show points (N, 3) m but for the farthest few, which may be ghosts, and timelines all frames."""
    some = points[np.isfinite(points).all(axis=1)]
    if len(some):
        some = some[np.linspace(0, len(some) - 1, min(len(some), MAX_PLACES)).astype(int)]
        ends = np.percentile(some, [2, 98], axis=0)
        bring_into_view(context, ends, room=2.4)
    fit_timelines(context)


def fit_timelines(context: bpy.types.Context):
    """Lets Dope Sheets and timelines show all frames that the scene plays."""
    if context.screen is None:
        return
    for area in context.screen.areas:
        region = next((one for one in area.regions if one.type == "WINDOW"), None)
        if area.type == "DOPESHEET_EDITOR" and region is not None:
            with context.temp_override(area=area, region=region):
                if bpy.ops.action.view_all.poll():
                    bpy.ops.action.view_all()


GRAPH_SHARE = 0.35  # of the 3D view that a graph takes
GRAPH_ROOM = np.array([0.05, 0.25])  # of what is meant, along frames and values, that a graph shows beside it


@operator(of=WithTake, label="Show in the Graph Editor", options={"REGISTER"})
def show_graph(self, context):
    """Show x, y and z of the selected markers over time, with gaps and fills, in a Graph Editor below the view."""
    if not any(area.ui_type == "FCURVES" for area in context.screen.areas):
        _add_graph(context)
    frames = taken(context).motion.frames
    fit_graphs(context, int(frames[0]), int(frames[-1]))
    if not selected_markers(context):
        self.report({"INFO"}, "Pick a marker, or click the frames of a row, to see its curves")


def _add_graph(context: bpy.types.Context):
    """Splits the largest 3D view; InputError, and the views as they were, where that cannot be."""
    areas = list(context.screen.areas)
    view = max(
        (area for area in areas if area.type == "VIEW_3D"), key=lambda area: area.width * area.height, default=None
    )
    if view is None:
        raise InputError("there is no 3D view to split; expected one, or a Graph Editor")
    with context.temp_override(area=view, region=window_region(view)):
        if not bpy.ops.screen.area_split.poll():
            raise InputError("a maximized view cannot be split; expected it restored, with Ctrl Space")
        bpy.ops.screen.area_split(direction="HORIZONTAL", factor=GRAPH_SHARE)
    new = [area for area in context.screen.areas if area not in areas]
    if not new:
        raise InputError("the 3D view is too small to split; expected it larger, or a Graph Editor")
    graph = min([view, *new], key=lambda area: area.y)
    graph.ui_type, graph.spaces.active.show_region_ui = "FCURVES", False


def fit_graphs(context: bpy.types.Context, first: int, last: int):
    """Lets Graph Editors show the selected markers from the first to the last frame, of the source's numbers."""
    stored, names = taken(context), selected_markers(context)
    rows = slice(*np.searchsorted(stored.motion.frames, [first, last + 1]).tolist())
    seen = stored.motion.markers[rows, [stored.names.index(name) for name in names]]
    if context.screen is None or not np.isfinite(seen).any():
        return
    lower = np.array([stored.clock.shown(first), np.nanmin(seen)])
    upper = np.array([stored.clock.shown(last), np.nanmax(seen)])
    room = np.maximum(GRAPH_ROOM * (upper - lower), [1, 0.01])
    for area in (area for area in context.screen.areas if area.ui_type == "FCURVES"):
        region = window_region(area)
        for _ in range(2):  # whole pixels of a far view are coarse
            left, bottom = region.view2d.view_to_region(*(lower - room), clip=False)
            right, top = region.view2d.view_to_region(*(upper + room), clip=False)
            ends = {"xmin": left, "xmax": max(right, left + 1), "ymin": bottom, "ymax": max(top, bottom + 1)}
            with context.temp_override(area=area, region=region):
                bpy.ops.view2d.zoom_border(**ends, wait_for_input=False)
