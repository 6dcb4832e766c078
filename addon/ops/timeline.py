# SPDX-License-Identifier: GPL-3.0-or-later
"""The trajectory timeline: rows over the Dope Sheet that are clicked, dragged along and scrolled."""

from dataclasses import dataclass, replace

import bpy
from bpy.props import BoolProperty, FloatProperty, IntProperty, StringProperty

from ..core.data.takes import NO_MARKER
from ..scene.clock import TakeClock
from ..scene.later import redraw
from ..scene.opened import opened
from ..scene.take import is_take
from ..scene.timing import pick_range, show_range
from ..scene.trajectories import FOLDED, KeptRows, Runs
from .base import Ours, PicksOfTake, WithTake, once, operator, taken
from .gestures import Drags, window_region
from .picking import picked_points, selected_markers, show_picked
from .viewing import fit_timelines

# px of the interface; the first is Blender's, of the frame numbers
SCRUB_HEIGHT, ROW_HEIGHT, LEGEND_HEIGHT = 24, 17, 22
DRAG = 4  # px of the interface that the mouse moves before a click is a drag
WHEEL_ROWS = 3  # rows that a notch of the wheel scrolls
MIN_ROWS = 5  # that there must be room for beside a legend


def timeline_shown(context: bpy.types.Context) -> bool:
    """Whether the rows lie over the editor of the context."""
    space, settings = context.space_data, context.scene.mocap_autolabel
    over = space is not None and space.type == "DOPESHEET_EDITOR" and space.mode == "DOPESHEET"
    return over and settings.display.show_timeline and is_take(settings.take)


def shown_runs(context: bpy.types.Context) -> Runs:
    """The rows of the active take."""
    _, rows = opened.looked_at.setdefault("rows", (None, KeptRows()))
    return rows.runs(taken(context), context.window_manager.mocap_autolabel.timeline_unfolded)


@dataclass(frozen=True)
class RowPlaces:
    """Where rows are in a region of the editor, px of the region from its lower left corner."""

    height: float  # of the region
    scale: float  # px for one of the interface
    scroll: float  # rows above the first that is seen

    @classmethod
    def of(cls, context: bpy.types.Context, region: bpy.types.Region, rows: int) -> "RowPlaces":
        scroll = context.window_manager.mocap_autolabel.timeline_scroll
        asked = cls(region.height, context.preferences.system.ui_scale, scroll)
        # The rows were more, or the editor lower, when it was scrolled.
        return replace(asked, scroll=min(scroll, asked.most_scroll(rows)))

    @property
    def top(self) -> float:
        """Where the rows end below the frame numbers."""
        return self.height - SCRUB_HEIGHT * self.scale

    @property
    def bottom(self) -> float:
        """Where they end above the legend; a low editor has none."""
        return LEGEND_HEIGHT * self.scale if self.top > MIN_ROWS * self.row else 0.0

    @property
    def row(self) -> float:
        return ROW_HEIGHT * self.scale

    def upper(self, row: float) -> float:
        return self.top + (self.scroll - row) * self.row

    def at(self, y: float) -> int:
        """The row there, whether there is one or not; -1 outside."""
        return int((self.top - y) / self.row + self.scroll) if self.bottom < y < self.top else -1

    def most_scroll(self, rows: int) -> float:
        return max(rows - (self.top - self.bottom) / self.row, 0.0)


def frame_at(region: bpy.types.Region, x: float, clock: TakeClock) -> int:
    """The take's frame, by the source's number, that is nearest to a place of the editor's main region."""
    return clock.at(region.view2d.region_to_view(x, 0)[0])


class OnTimeline(Ours):
    """Operators in an editor that shows the rows; elsewhere their keys are Blender's."""

    bl_options = {"INTERNAL"}

    @classmethod
    def poll(cls, context):
        return timeline_shown(context)


@operator(
    of=PicksOfTake,
    label="Pick in the Timeline",
    marker=once(StringProperty, "Marker", "The marker to select"),
    trajectory=once(IntProperty, "Trajectory", "Or the trajectory to pick", default=-1),
    first=IntProperty(name="First", description="The file's number of the frame to go to, or the first of the range"),
    last=IntProperty(name="Last", description="The last frame of the range; the first where only one is meant"),
    extend=once(BoolProperty, "Extend", "Keep what is selected"),
    options={"UNDO"},
)  # with REGISTER, its panel would lie over the legend
def timeline_pick(self, context):
    """Go to this frame of a marker or trajectory and pick it, or select a range of frames by dragging."""
    scene, clock = context.scene, taken(context).clock
    if self.first != self.last:
        pick_range(scene, clock, self.first, self.last)
    if self.first == self.last or not self.first <= clock.at(scene.frame_float) <= self.last:
        clock.go_to(scene, self.first)
    markers = selected_markers(context) if self.extend else []
    points = picked_points(context) if self.extend else []
    markers += [self.marker] if self.marker else []
    points += [self.trajectory] if self.trajectory >= 0 else []
    stored = taken(context)
    show_picked(context, stored, points, [stored.names.index(name) for name in markers if name in stored.names])


class MOCAP_AUTOLABEL_OT_timeline_click(Drags, OnTimeline, bpy.types.Operator):
    """Click a row to go there and pick; drag along it to select a range; a click on the short ones unfolds them."""

    bl_label = "Pick or Select a Range in the Timeline"

    extend: once(BoolProperty, "Extend", "Keep what is selected")

    def invoke(self, context, event):
        runs, region = shown_runs(context), context.region
        places = RowPlaces.of(context, region, len(runs))
        row = places.at(event.mouse_region_y)
        if event.mouse_region_y >= places.top:
            return {"PASS_THROUGH"}
        if not 0 <= row < len(runs):
            return {"CANCELLED"}  # nothing is there, and the channels below are not meant
        self._row, self._x = row, event.mouse_region_x
        scene = context.scene
        self._along = region.type == "WINDOW"
        here, clock = event.mouse_region_x, runs.clock
        self._frame = frame_at(region, here, clock) if self._along else clock.at(scene.frame_float)
        self._before = scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end
        self._dragged = False
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def drag(self, context, event):
        off = abs(event.mouse_region_x - self._x)
        if self._along and (self._dragged or off > DRAG * context.preferences.system.ui_scale):
            self._dragged = True
            show_range(context.scene, *map(shown_runs(context).clock.whole, self._range(context, event)))
            redraw("DOPESHEET_EDITOR")

    def _range(self, context, event) -> tuple[int, int]:
        runs = shown_runs(context)
        first, last = runs.span
        ends = sorted((self._frame, frame_at(context.region, event.mouse_region_x, runs.clock)))
        return min(max(ends[0], first), last), max(min(ends[1], last), first)

    def let_go(self, context, event) -> set[str]:
        runs, state = shown_runs(context), context.window_manager.mocap_autolabel
        if self._row >= len(runs):
            return {"CANCELLED"}  # something else made the rows fewer meanwhile
        first = last = runs.nearest_frame(self._row, self._frame)
        if self._dragged:
            first, last = self._range(context, event)
        elif runs.names[self._row].endswith(FOLDED) and runs.marker[self._row] == NO_MARKER:
            state.timeline_unfolded = True
            redraw("DOPESHEET_EDITOR")
            return {"FINISHED"}
        marker = runs.names[self._row] if runs.marker[self._row] != NO_MARKER else ""
        if self._dragged:
            self.cancel(context)  # so that undo goes back to what was there before the drag
        if context.mode != "OBJECT":
            runs.clock.go_to(context.scene, first)
            return {"FINISHED"}
        return bpy.ops.mocap_autolabel.timeline_pick(
            "EXEC_DEFAULT",
            True,  # an undo step of its own: this operator is none
            marker=marker,
            trajectory=int(runs.trajectory[self._row]),
            first=first,
            last=last,
            extend=self.extend,
        )

    def cancel(self, context):
        if self._dragged:
            used, first, last = self._before
            show_range(context.scene, first, last)
            context.scene.use_preview_range = used


class MOCAP_AUTOLABEL_OT_timeline_scroll(OnTimeline, bpy.types.Operator):
    """Scroll the rows."""

    bl_label = "Scroll the Timeline"

    rows: FloatProperty(name="Rows", description="How many, down the list")
    on_names: once(BoolProperty, "On Names", "Only with the mouse on the names: on the rows the wheel zooms")

    def invoke(self, context, event):
        if self.on_names and context.region.type != "CHANNELS":
            return {"PASS_THROUGH"}
        return self.execute(context)

    def work(self, context):
        scroll_by(context, window_region(context.area), self.rows)


def scroll_by(context: bpy.types.Context, region: bpy.types.Region, rows: float):
    """Scrolls so many rows down the list, no further than there are rows."""
    count = len(shown_runs(context))
    places = RowPlaces.of(context, region, count)
    scroll = min(max(places.scroll + rows, 0.0), places.most_scroll(count))
    context.window_manager.mocap_autolabel.timeline_scroll = scroll
    redraw("DOPESHEET_EDITOR")


class MOCAP_AUTOLABEL_OT_timeline_pan(OnTimeline, bpy.types.Operator):
    """Drag the rows and the time, as in any of Blender's editors."""

    bl_label = "Pan the Timeline"

    def invoke(self, context, event):
        if event.type == "TRACKPADPAN":
            self._pan(context, event.mouse_x - event.mouse_prev_x, event.mouse_y - event.mouse_prev_y)
            return {"FINISHED"}
        self._last = event.mouse_x, event.mouse_y
        context.window_manager.modal_handler_add(self)
        return {"RUNNING_MODAL"}

    def modal(self, context, event):
        if event.type == "MOUSEMOVE":
            self._pan(context, event.mouse_x - self._last[0], event.mouse_y - self._last[1])
            self._last = event.mouse_x, event.mouse_y
        if event.type == "ESC" or (event.type == "MIDDLEMOUSE" and event.value == "RELEASE"):
            return {"FINISHED"}
        return {"RUNNING_MODAL"}

    def _pan(self, context, right: float, up: float):
        region = window_region(context.area)
        with context.temp_override(region=region):
            bpy.ops.view2d.pan("EXEC_DEFAULT", deltax=round(-right), deltay=0)
        scroll_by(context, region, up / (ROW_HEIGHT * context.preferences.system.ui_scale))


@operator(of=WithTake, label="Show in the Dope Sheet", options={"REGISTER"})
def show_timeline(self, context):
    """Show every trajectory as a row over time, in a Dope Sheet: the one that there is, or the timeline made one."""
    context.scene.mocap_autolabel.display.show_timeline = True
    areas = [area for area in context.screen.areas if area.type == "DOPESHEET_EDITOR"] if context.screen else []
    if areas and not any(area.spaces.active.mode == "DOPESHEET" for area in areas):
        area = max(areas, key=lambda area: area.width * area.height)
        area.ui_type = "DOPESHEET"
        area.spaces.active.show_region_channels = True
        fit_timelines(context)
    if not areas:
        self.report({"INFO"}, "Open a Dope Sheet to see it")


@operator(of=OnTimeline, label="Leave the Keys Below")
def timeline_keys(self, _context):
    """Keys that lie below the rows are not seen, and follow the labels: what would change them does nothing here."""
    self.report({"INFO"}, "The markers' keys follow the labels. Turn Trajectories off to edit keys by hand")


# Of each event: its type, its modifiers, the operator of MOCAP_AUTOLABEL and its properties.
_CLICKS = (
    ("LEFTMOUSE", {}, "timeline_click", {}),
    ("LEFTMOUSE", {"shift": True}, "timeline_click", {"extend": True}),
    ("X", {}, "timeline_keys", {}),
    ("DEL", {}, "timeline_keys", {}),
)
_ON_ROWS = (
    *((key, {}, "timeline_keys", {}) for key in "GSETVR"),
    ("D", {"shift": True}, "timeline_keys", {}),
    ("V", {"ctrl": True}, "timeline_keys", {}),
)
# Blender asks this keymap of all its views of two dimensions before an editor's own.
_MOVING = (
    ("WHEELDOWNMOUSE", {"shift": True}, "timeline_scroll", {"rows": WHEEL_ROWS}),
    ("WHEELUPMOUSE", {"shift": True}, "timeline_scroll", {"rows": -WHEEL_ROWS}),
    ("WHEELDOWNMOUSE", {}, "timeline_scroll", {"rows": WHEEL_ROWS, "on_names": True}),
    ("WHEELUPMOUSE", {}, "timeline_scroll", {"rows": -WHEEL_ROWS, "on_names": True}),
    ("MIDDLEMOUSE", {}, "timeline_pan", {}),
    ("TRACKPADPAN", {}, "timeline_pan", {}),
)
# By Blender's keymap and the kind of editor that it is for.
KEYS = {
    ("View2D", "EMPTY"): _MOVING,
    ("Dopesheet", "DOPESHEET_EDITOR"): _CLICKS + _ON_ROWS,
    ("Animation Channels", "EMPTY"): _CLICKS,
}
