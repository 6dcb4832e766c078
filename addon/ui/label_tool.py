# SPDX-License-Identifier: GPL-3.0-or-later
"""The tool Label in the 3D view: its keys, its menus, and what it draws over the view."""

from collections.abc import Sequence
from contextlib import ExitStack

import bpy
import numpy as np

from ..core.data.takes import NO_MARKER, PointRows
from ..core.filling.kept import KeptFill
from ..ops.base import lacks_take
from ..ops.correcting import likely_here
from ..ops.filling import proposed
from ..ops.gestures import gesture
from ..ops.picking import image_in, picked_points, selected_markers, take_to_view
from ..scene.blob_dots import blob_dots, marker_dots, on_rays
from ..scene.opened import opened
from ..scene.performers import homes
from ..scene.picking import NEAREST, Dots, dots_of, path_of
from ..scene.stored import Stored
from ..scene.take import is_hidden, is_take
from .marks import ORANGE, WHITE
from .overlay import BLOB_RADIUS, Canvas
from .parts import draw_operators

TOOL = "mocap_autolabel.label_tool"
GLOW, GLOW_RADIUS, HALO_RADIUS = (1.0, 1.0, 1.0, 0.3), 6.5, 11.0
NAMED_PATH, UNNAMED_PATH = (0.3, 0.85, 1.0, 0.9), (0.85, 0.85, 0.85, 0.8)
ASKED = (1.0, 0.9, 0.2, 1.0)
PATH_SECONDS = 2.0  # to each side of the current frame: farther off a walk covers itself
PATH_LINES = 400  # most that are drawn of one path: a redraw has 6 ms
Path = tuple[np.ndarray, np.ndarray]  # lines (S, 2, 3) m, and which of them (S,) lead from where there was a name
SCOPE_WIDTH = 11  # in buttons' heights: its name and the longest of its choices
MENU = "MOCAP_AUTOLABEL_MT_label"
BEFORE_TEXTS = "_draw_orig"  # where Blender keeps how it draws the status bar while a text of a program's own is there


def _key(operator: str, key: str, value: str = "PRESS", held: str = "", **properties):
    """A row of a tool's keymap; `held` are the keys held with it."""
    event = {"type": key, "value": value} | dict.fromkeys(held.split(), True)
    return (operator, event, {"properties": list(properties.items())} if properties else None)


KEYMAP = (
    _key("mocap_autolabel.pick", "LEFTMOUSE", "CLICK", mode="SET"),
    _key("mocap_autolabel.pick", "LEFTMOUSE", "CLICK", "shift", mode="TOGGLE"),
    _key("mocap_autolabel.pick_region", "LEFTMOUSE", "CLICK_DRAG", shape="BOX", mode="SET"),
    _key("mocap_autolabel.pick_region", "LEFTMOUSE", "CLICK_DRAG", "shift", shape="BOX", mode="ADD"),
    _key("mocap_autolabel.pick_region", "LEFTMOUSE", "CLICK_DRAG", "ctrl", shape="LASSO", mode="SET"),
    _key("mocap_autolabel.pick_region", "LEFTMOUSE", "CLICK_DRAG", "shift ctrl", shape="LASSO", mode="ADD"),
    _key("mocap_autolabel.pick_none", "A", held="alt"),
    _key("wm.call_menu_pie", "L", name="MOCAP_AUTOLABEL_MT_names_pie"),
    _key("wm.call_menu_pie", "V", name="MOCAP_AUTOLABEL_MT_names_from_here_pie"),
    _key("mocap_autolabel.name_point", "RET"),
    _key("mocap_autolabel.quick_label", "F"),
    _key("mocap_autolabel.unlabel", "U"),
    _key("mocap_autolabel.swap_markers", "E"),
    _key("mocap_autolabel.other_performer", "E", held="shift"),
    _key("mocap_autolabel.no_marker", "X"),
    _key("mocap_autolabel.no_marker", "DEL"),
    _key("mocap_autolabel.is_right", "Y"),
    _key("mocap_autolabel.place_marker", "P"),
    _key("mocap_autolabel.next_trouble", "J", back=False),
    _key("mocap_autolabel.next_trouble", "J", held="shift", back=True),
)
# Of the keymap what the status bar shows, and the words for it; as Blender finds it, whatever keys a person gave it.
OF_TOOL = "3D View Tool: Object, Label"
SHOWN_KEYS = (
    ("mocap_autolabel.pick", {"mode": "SET"}, "Pick"),
    ("mocap_autolabel.pick", {"mode": "TOGGLE"}, "Add"),
    ("mocap_autolabel.pick_region", {"shape": "BOX", "mode": "SET"}, "Box"),
    ("mocap_autolabel.pick_region", {"shape": "LASSO", "mode": "SET"}, "Lasso"),
    ("wm.call_menu_pie", {"name": "MOCAP_AUTOLABEL_MT_names_pie"}, "Name"),
    ("wm.call_menu_pie", {"name": "MOCAP_AUTOLABEL_MT_names_from_here_pie"}, "Name from Here On"),
    ("mocap_autolabel.quick_label", {}, "Quick Label"),
    ("mocap_autolabel.unlabel", {}, "Unlabel"),
    ("mocap_autolabel.swap_markers", {}, "Swap"),
    ("mocap_autolabel.no_marker", {}, "No Marker"),
    ("mocap_autolabel.is_right", {}, "It Is Right"),
    ("mocap_autolabel.place_marker", {}, "It Is Here"),
    ("mocap_autolabel.next_trouble", {"back": False}, "Next Trouble"),
)


class LabelTool(bpy.types.WorkSpaceTool):
    """Pick the dots of a take and say what they are."""

    bl_space_type = "VIEW_3D"
    bl_context_mode = "OBJECT"
    bl_idname = TOOL
    bl_label = "Label"
    bl_description = "Pick dots and say what they are; the status bar has the keys"
    bl_icon = "ops.paint.eyedropper_add"
    bl_cursor = "DEFAULT"
    bl_keymap = KEYMAP

    @staticmethod
    def draw_settings(context, layout, _tool):
        if words := lacks_take(context):
            layout.label(text=words, icon="INFO")
            return
        row = layout.row()
        row.ui_units_x = SCOPE_WIDTH
        row.prop(context.scene.mocap_autolabel, "scope")
        layout.operator("mocap_autolabel.quick_label", icon="SORTALPHA")
        layout.operator("mocap_autolabel.show_graph", text="Graph", icon="GRAPH")


class NamesPie:
    """The likeliest names of what is picked, in the frames `scope`, None for those that the tool is set to."""

    scope = None

    @classmethod
    def poll(cls, context):
        return is_take(context.scene.mocap_autolabel.take)

    def draw(self, context):
        pie = self.layout.menu_pie()
        settings = context.scene.mocap_autolabel
        if not picked_points(context):
            pie.label(text="Pick a dot first", icon="INFO")
            return
        stored = opened.take(settings.take, context.scene)
        scope = self.scope or settings.scope
        pie.operator_context = "EXEC_REGION_WIN"
        own = selected_markers(context)  # what it is called already needs no button
        names = [marker for marker in likely_here(context, stored) if stored.names[marker] not in own]
        for marker in names[:NEAREST]:
            row = pie.operator("mocap_autolabel.name_point", text=stored.names[marker])
            row.marker, row.scope = stored.names[marker], scope
        pie.operator("mocap_autolabel.unlabel", icon="X").scope = scope
        pie.operator_context = "INVOKE_REGION_WIN"
        pie.operator("mocap_autolabel.name_point", text="Type a Name…", icon="VIEWZOOM").scope = scope


class MOCAP_AUTOLABEL_MT_names_pie(NamesPie, bpy.types.Menu):
    """What the picked dot is."""

    bl_label = "Name"


class MOCAP_AUTOLABEL_MT_names_from_here_pie(NamesPie, bpy.types.Menu):
    """What the picked dot is from the current frame on: its trajectory is split there."""

    bl_label = "Another Name from Here On"
    scope = "ON"


class MOCAP_AUTOLABEL_MT_label(bpy.types.Menu):
    """What can be said of dots."""

    bl_label = "Label"

    def draw(self, context):
        layout = self.layout
        layout.operator_context = "INVOKE_REGION_WIN"
        layout.operator("wm.call_menu_pie", text="Name").name = "MOCAP_AUTOLABEL_MT_names_pie"
        layout.operator("mocap_autolabel.name_point", text="Type a Name…")
        other = layout.operator("wm.call_menu_pie", text="Another Name from Here On")
        other.name = "MOCAP_AUTOLABEL_MT_names_from_here_pie"
        several = bool(homes(context.scene.mocap_autolabel.take))
        draw_operators(layout, "quick_label", "", "swap_markers")
        draw_operators(layout, *("other_performer", "exchange_performers") * several)
        draw_operators(layout, "unlabel", "no_marker", "is_right", "place_marker", "", "next_trouble")
        layout.operator("mocap_autolabel.next_trouble", text="Previous Trouble").back = True
        draw_operators(layout, "", "pick_none")


def draw_menu(self, context):
    """The menu *Label* in the 3D view's header, where there is something to label."""
    if context.mode == "OBJECT" and is_take(context.scene.mocap_autolabel.take):
        self.layout.menu(MENU)


def draw_keys(self, context):
    """The tool's keys in the status bar, where it is the one in hand."""
    tool = context.workspace.tools.from_space_view3d_mode(context.mode, create=False)
    configs = context.window_manager.keyconfigs
    keymap = configs.user.keymaps.get(OF_TOOL) or configs.addon.keymaps.get(OF_TOOL)
    if tool is None or tool.idname != TOOL or keymap is None or lacks_take(context):
        return
    row = self.layout.row(align=True)
    for operator, properties, words in SHOWN_KEYS:
        items = [one for one in keymap.keymap_items if is_for(one, operator, properties)]
        if items:
            row.template_event_from_keymap_item(min(items, key=lambda one: one.id), text=words)


def is_for(item: bpy.types.KeyMapItem, operator: str, properties: dict[str, object]) -> bool:
    """Whether an active key is for an operator with these properties."""
    wanted = item.active and item.idname == operator
    return wanted and all(getattr(item.properties, key) == value for key, value in properties.items())


def draw():
    """Draws what is picked with its trajectory, and what the hand does; Blender calls this at every redraw."""
    context = bpy.context
    scene = context.scene
    collection, space = scene.mocap_autolabel.take, context.space_data
    if not space.overlay.show_overlays or not is_take(collection) or is_hidden(collection, context.view_layer):
        return
    stored = opened.take(collection, scene)
    index = stored.index_of(scene.frame_float)
    with Canvas(context) as canvas:
        canvas.perspective = canvas.perspective @ take_to_view(context, stored, context.area)
        draw_proposed(canvas, proposed(context))
        if index >= 0:
            draw_picked(canvas, stored, index, *shown_of(context, stored, index))
        if gesture.is_in(context.region):
            draw_gesture(canvas)


def shown_of(context: bpy.types.Context, stored: Stored, index: int) -> tuple[Dots, list[int], list[Path]]:
    """The dots of frame `index` in the current view, which of them are picked, and the paths of these."""
    points, paths = picked_points(context), []
    reach = max(1, round(PATH_SECONDS * stored.rate))
    if isinstance(stored.rows, PointRows):
        paths = [path_of(stored, opened.rows_of(stored, one), index, reach, PATH_LINES) for one in points]
        return dots_of(stored, index), points, paths
    image = image_in(stored, context.scene, context.area)
    if image is None:
        return marker_dots(stored, index), [], []
    camera, pose = image
    points = [row for row in points if stored.rows.camera[row] == camera]
    tracks = opened.tracks(context.scene.mocap_autolabel.take, context.scene)
    for row in points:
        track = tracks.rows(row)
        rows = track[np.abs(stored.rows.frame[track] - stored.rows.frame[row]) <= reach]
        places = on_rays(stored, rows, pose)
        paths.append((np.stack([places[:-1], places[1:]], axis=1), stored.labels.marker[rows[:-1]] != NO_MARKER))
    return blob_dots(stored, index, camera, pose), points, paths


def draw_picked(canvas: Canvas, stored: Stored, index: int, dots: Dots, points: list[int], paths: list[Path]):
    """The picked dots glow, with where they come from and go to; a ring is around what a person placed."""
    placed = [marker for frame, marker in stored.placed if frame == index]
    canvas.rings(canvas.place(stored.motion.markers[index, placed]), ASKED, GLOW_RADIUS)
    for ends, named in paths:
        colours = np.where(named[:, None], NAMED_PATH, UNNAMED_PATH)
        canvas.lines(canvas.place(ends), np.repeat(colours[:, None], 2, axis=1), 1.6)
    picked = dots.of(points)
    places = canvas.place(dots.xyz[picked])
    canvas.discs(places, np.broadcast_to(np.array(GLOW), (len(places), 4)), HALO_RADIUS)
    colours = np.where((dots.marker[picked] != NO_MARKER)[:, None], ORANGE, WHITE)
    canvas.discs(places, colours, BLOB_RADIUS)
    canvas.rings(places, WHITE, GLOW_RADIUS)


def draw_proposed(canvas: Canvas, fills: Sequence[KeptFill]):
    """The paths of fills that are not kept yet, dashed: from every second sample to the next."""
    for fill in fills:
        path = canvas.place(fill.path)
        ends = np.stack([path[:-1], path[1:]], axis=1)[::2]
        canvas.lines(ends, np.broadcast_to(np.array(ORANGE), (len(ends), 2, 4)), 2.2)


def draw_gesture(canvas: Canvas):
    """A box or a lasso; or a marker that is asked for, with its name at the pointer."""
    if len(gesture.outline) > 1:
        corners = np.array(gesture.outline, dtype=float)
        ends = np.stack([corners, np.roll(corners, -1, axis=0)], axis=1)
        canvas.lines(ends, np.broadcast_to(np.array(WHITE), (len(ends), 2, 4)), 1.2)
    if gesture.place is not None:
        place = canvas.place(np.array([gesture.place]))
        canvas.rings(place, ASKED, HALO_RADIUS)
        canvas.rings(place, ASKED, 1.5)
    if gesture.words:
        x, y = gesture.mouse
        canvas.text(gesture.words, x + 14 * canvas.scale, y + 10 * canvas.scale, ASKED)


def add_tool(stack: ExitStack):
    """Adds the tool, its keys and the menu; each brings its way back to `stack`."""
    bpy.utils.register_tool(LabelTool, after={"builtin.measure"}, separator=True)
    stack.callback(bpy.utils.unregister_tool, LabelTool)
    add_keys(stack)
    bpy.types.VIEW3D_MT_editor_menus.append(draw_menu)
    stack.callback(bpy.types.VIEW3D_MT_editor_menus.remove, draw_menu)


def add_keys(stack: ExitStack):
    """Lets the status bar say the tool's keys; brings its way back to `stack`."""
    header = status_bar()
    header.prepend(draw_keys)
    if hasattr(header, BEFORE_TEXTS):
        setattr(header, BEFORE_TEXTS, header.draw)
    stack.callback(lambda: status_bar().remove(draw_keys))


def status_bar() -> type[bpy.types.Header]:
    """The status bar as it is when no program has put a text of its own in its place, such as Blender's installer."""
    header = bpy.types.STATUSBAR_HT_header
    header.draw = getattr(header, BEFORE_TEXTS, header.draw)
    return header
