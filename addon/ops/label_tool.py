# SPDX-License-Identifier: GPL-3.0-or-later
"""What the tool Label does beside picking: names dot after dot, puts a marker where none was seen, and more."""

from contextlib import suppress

import bpy
import numpy as np
from bpy.props import EnumProperty, FloatVectorProperty
from bpy_extras.view3d_utils import region_2d_to_origin_3d, region_2d_to_vector_3d

from ..core.data.errors import InputError, UserError
from ..core.data.takes import NO_MARKER, NO_POINT, PointRows
from ..core.edits.kinds import AssignBlob, AssignPoint, Edit, Place
from ..props import SCOPES, keeps_items
from ..scene.blob_dots import asked_in_image, ray_of
from ..scene.picking import missing, on_ray, predicted
from ..scene.stored import Stored
from .base import OfTake, reports_trouble, taken
from .correcting import correct, edit_of, frames_in_scope, marker_items
from .gestures import gesture, is_over_view, place_in, window_region
from .picking import InView, dot_at, image_in, selected_markers, show_picked, take_to_view

# Keys that change what is looked at, which go on meaning what they mean while dots are named.
LOOKING = ("ARROW", "NUMPAD", "WHEEL", "MOUSE", "TRACKPAD", "TIMER", "HOME", "ACCENT_GRAVE", "NDOF", "WINDOW")

# Spaces that the icons of keys are wider than Blender takes them for.
WIDER = {"EVENT_SPACEKEY": 6, "EVENT_BACKSPACE": 2, "EVENT_RETURN": 2, "EVENT_ESC": 3}


def camera_of(context: bpy.types.Context, stored: Stored, area: bpy.types.Area) -> int:
    """Which of a take's cameras a view looks through; InputError where through none."""
    image = image_in(stored, context.scene, area)
    if image is None:
        raise InputError("the view looks through no camera of the take; expected one, as blobs are named in its image")
    return image[0]


class WorksInView:
    """A modal operator in a 3D view that asks something beside the pointer, and lets one look around meanwhile."""

    def begin(self, context: bpy.types.Context, event: bpy.types.Event):
        self._area, self._region = context.area, window_region(context.area)
        gesture.clear()
        gesture.region, gesture.mouse = self._region.as_pointer(), place_in(self._region, event)
        context.window.cursor_modal_set("CROSSHAIR")
        context.window_manager.modal_handler_add(self)

    def tell(self, context: bpy.types.Context, beside: str, **below: str):
        """Asks something beside the pointer, and says in the status bar what mouse buttons and keys do, by icon."""
        gesture.words = beside

        def draw(header, _context):
            for icon, words in below.items():
                header.layout.label(text=" " * WIDER.get(icon, 0) + words, icon=icon)

        context.workspace.status_text_set(draw)
        self._area.tag_redraw()

    def cancel(self, context):
        gesture.clear()
        context.window.cursor_modal_restore()
        context.workspace.status_text_set(None)
        self._area.tag_redraw()

    def modal(self, context, event):
        if event.type == "MOUSEMOVE":
            gesture.mouse = place_in(self._region, event)
            self._area.tag_redraw()
            self.moved(context)
            return {"PASS_THROUGH"}
        if event.type in ("ESC", "RIGHTMOUSE") and event.value == "PRESS":
            self.cancel(context)
            return {"CANCELLED"}
        if event.type == "TIMER" or not is_over_view(self._area, event):
            return self.waited(context)
        if event.value == "PRESS" and (event.type, event.ctrl) in self.keys:
            gesture.mouse = place_in(self._region, event)
            try:  # trouble is told, and the work goes on
                return getattr(self, self.keys[event.type, event.ctrl])(context)
            except UserError as error:
                self.report({"ERROR"}, str(error))
                return {"RUNNING_MODAL"}
        looks = any(event.type.startswith(word) or event.type.endswith(word) for word in LOOKING)
        return {"PASS_THROUGH"} if looks and event.type not in ("LEFTMOUSE", "RIGHTMOUSE") else {"RUNNING_MODAL"}

    def moved(self, context: bpy.types.Context):
        """The pointer was moved."""

    def waited(self, context: bpy.types.Context) -> set[str]:
        """Something else happened, which goes on to whoever it is for."""
        return {"PASS_THROUGH"}


class MOCAP_AUTOLABEL_OT_quick_label(WorksInView, InView, bpy.types.Operator):
    """Name dot after dot: you are asked for each marker that is missing in this frame, and click where it is."""

    bl_options = {"REGISTER"}

    scope: EnumProperty(name="Frames", description="The frames in which the names are given", items=SCOPES)
    keys = {
        ("LEFTMOUSE", False): "click",
        ("SPACE", False): "skip",
        ("BACK_SPACE", False): "take_back",
        ("Z", True): "take_back",
    }

    @reports_trouble
    def invoke(self, context, event):
        if not self.properties.is_property_set("scope"):
            self.scope = context.scene.mocap_autolabel.scope
        self._skipped: set[int] = set()
        self._edits: list[Edit] = []
        self._last = -1
        stored = taken(context)
        if not isinstance(stored.rows, PointRows):
            camera_of(context, stored, context.area)
        self.begin(context, event)
        return self._ask(context)

    def waited(self, context) -> set[str]:
        # The frame may be another one now, and what is missing in it.
        ended = self._asked_in != context.scene.frame_float and self._ask(context) == {"FINISHED"}
        return {"FINISHED"} if ended else {"PASS_THROUGH"}

    def moved(self, context):
        if self._asked_in != context.scene.frame_float:
            self._ask(context)

    def _ask(self, context) -> set[str]:
        """Asks for the next marker that is missing; without one it ends, and says so.

        After the last one, and from the first again at the end; those that were skipped never.
        """
        stored, self._asked_in, asked = taken(context), context.scene.frame_float, []
        with suppress(InputError):
            asked = np.flatnonzero(self._asked(context, stored)).tolist()
        free = [marker for marker in asked if marker not in self._skipped]
        if not free:
            self.cancel(context)
            self.report({"INFO"}, f"No marker is missing in frame {context.scene.frame_float:g}")
            return {"FINISHED"}
        gesture.marker = next((marker for marker in free if marker > self._last), free[0])
        place = predicted(stored, stored.index_here(context.scene.frame_float))[gesture.marker]
        gesture.place = tuple(place) if np.isfinite(place).all() else None
        left, name = len(asked), stored.names[gesture.marker]
        self.tell(
            context,
            f"{name}?",
            MOUSE_LMB=f"{name}, {left} missing here",
            EVENT_SPACEKEY="Not Here",
            EVENT_BACKSPACE="Take the Last Back",
            EVENT_ESC="End",
        )
        return {"RUNNING_MODAL"}

    def _asked(self, context, stored: Stored) -> np.ndarray:
        """(M,) True for the markers that are asked for; of blobs in the camera that the view looks through."""
        index = stored.index_here(context.scene.frame_float)
        if isinstance(stored.rows, PointRows):
            return missing(stored, index)
        return asked_in_image(stored, index, camera_of(context, stored, self._area))

    def click(self, context) -> set[str]:
        stored = taken(context)
        dots, found = dot_at(context, stored, self._area, gesture.mouse)
        if found is None or dots.trajectory[found] == NO_POINT:
            raise InputError("no dot is there; expected a click on one")
        name, point = stored.names[gesture.marker], int(dots.trajectory[found])
        frames = frames_in_scope(self.scope, stored, context.scene)
        edit = edit_of((AssignPoint, AssignBlob), stored, point, frames, name)
        after = correct(context, stored.edits.added(edit))
        show_picked(context, after, [point], follow=False)
        self._edits.append(edit)
        bpy.ops.ed.undo_push(message=f"Label {name}")
        self._last = gesture.marker
        return self._ask(context)

    def skip(self, context) -> set[str]:
        self._skipped.add(gesture.marker)
        self._last = gesture.marker
        return self._ask(context)

    def take_back(self, context) -> set[str]:
        """The last name that was given is taken back, and asked for again."""
        stored = taken(context)
        if not self._edits or not len(stored.edits) or stored.edits[-1] != self._edits[-1]:
            raise InputError("no name was given yet; expected one to take back")
        name = self._edits.pop().marker
        show_picked(context, correct(context, stored.edits.without(-1)), [])
        bpy.ops.ed.undo_push(message=f"Take {name} Back")
        self._last = stored.names.index(name) - 1
        return self._ask(context)


class MOCAP_AUTOLABEL_OT_place_marker(WorksInView, OfTake, bpy.types.Operator):
    """It is here: put the selected marker where it must be in this frame, though no point was seen."""

    bl_label = "It Is Here"

    marker: EnumProperty(name="Marker", description="What is here", items=marker_items)
    location: FloatVectorProperty(name="Location", description="Where it is", subtype="TRANSLATION", unit="LENGTH")
    keys = {("LEFTMOUSE", False): "click", ("RET", False): "confirm", ("NUMPAD_ENTER", False): "confirm"}

    def work(self, context):
        scene = context.scene
        stored = taken(context)
        edit = Place(self.marker, stored.source_frame(scene.frame_float), tuple(map(float, self.location)))
        after = correct(context, stored.edits.added(edit))
        show_picked(context, after, [], [stored.names.index(self.marker)], follow=False)

    @reports_trouble
    def invoke(self, context, event):
        if context.area is None or context.area.type != "VIEW_3D":
            raise InputError("this is no 3D view; expected one to click into")
        self._at = None
        stored = taken(context)
        index = stored.index_here(context.scene.frame_float)
        free = [stored.names[marker] for marker in np.flatnonzero(missing(stored, index))]
        if not self.properties.is_property_set("marker"):
            names = [name for name in selected_markers(context) if name in free]
            if len(names) != 1 and len(free) != 1:
                return bpy.ops.mocap_autolabel.place_which("INVOKE_DEFAULT")
            self.marker = (names or free)[0]
        marker = stored.names.index(self.marker)
        self.begin(context, event)
        gesture.marker, self._stored = marker, stored
        self._near = predicted(stored, index)[marker]
        if not np.isfinite(self._near).all():
            ahead = self._area.spaces.active.region_3d.view_location
            self._near = (np.linalg.inv(take_to_view(context, stored, self._area)) @ [*ahead, 1.0])[:3]
        self.moved(context)
        self.tell(context, f"{self.marker}: click where it is", **self._keys())
        return {"RUNNING_MODAL"}

    def moved(self, context):
        if self._at is None:
            gesture.place = tuple(self._under_pointer())

    def _under_pointer(self) -> np.ndarray:
        """(3,) m on the ray under the pointer: as deep as the place where it was put, or should be.

        Through a camera that is the ray of the blob there, unless that is another marker.
        """
        view = self._area.spaces.active.region_3d
        near = self._near if self._at is None else self._at
        stored = self._stored
        if not isinstance(stored.rows, PointRows) and image_in(stored, bpy.context.scene, self._area) is not None:
            dots, found = dot_at(bpy.context, stored, self._area, gesture.mouse)
            if found is not None and dots.marker[found] in (NO_MARKER, gesture.marker):
                return on_ray(*ray_of(stored, int(dots.trajectory[found])), near)
        ways = region_2d_to_origin_3d, region_2d_to_vector_3d
        origin, direction = (np.array(way(self._region, view, gesture.mouse), dtype=float) for way in ways)
        back = np.linalg.inv(take_to_view(bpy.context, stored, self._area))
        origin, direction = back[:3, :3] @ origin + back[:3, 3], back[:3, :3] @ direction
        if view.is_perspective:
            return on_ray(origin, direction, near)
        return origin + direction * float((near - origin) @ direction) / float(direction @ direction)

    def click(self, context) -> set[str]:
        self._at = self._under_pointer()
        gesture.place = tuple(self._at)
        self.tell(context, f"{self.marker}: Enter, or click again", **self._keys())
        return {"RUNNING_MODAL"}

    def _keys(self) -> dict[str, str]:
        place = f"{self.marker} Is Here" if self._at is None else "From Another Side"
        return {"MOUSE_LMB": place} | {"EVENT_RETURN": "Confirm", "EVENT_ESC": "Cancel"}

    def confirm(self, context) -> set[str]:
        if self._at is None:
            raise InputError("nothing was clicked; expected a click where the marker is, then Enter")
        self.location = self._at
        self.cancel(context)
        return self.execute(context)


class MOCAP_AUTOLABEL_OT_place_which(InView, bpy.types.Operator):
    """Choose which of the missing markers is here."""

    bl_label = "It Is Here"
    bl_options = {"INTERNAL"}
    bl_property = "marker"

    @keeps_items
    def _missing(self, context) -> list[tuple[str, str, str, str, int]]:
        stored = taken(context)
        lacking = np.flatnonzero(missing(stored, stored.index_here(context.scene.frame_float)))
        names = {stored.names[at] for at in lacking}
        return [item for item in marker_items(self, context) if item[0] in names]

    marker: EnumProperty(name="Marker", description="What is here", items=_missing)

    @reports_trouble
    def invoke(self, context, event):
        if not self._missing(context):
            raise InputError("every marker is there; expected a frame in which one is missing")
        context.window_manager.invoke_search_popup(self)
        return {"RUNNING_MODAL"}

    def execute(self, context):
        return bpy.ops.mocap_autolabel.place_marker("INVOKE_DEFAULT", marker=self.marker)
