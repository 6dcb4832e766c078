# SPDX-License-Identifier: GPL-3.0-or-later
"""What the hand does in a view just now, for the overlay to draw: a box, a lasso, a question beside the pointer."""

from dataclasses import dataclass, field

import bpy


@dataclass
class Gesture:
    """One at a time, in one region; pixels are the region's."""

    region: int = 0  # which region, by its pointer; 0 for none
    outline: list[tuple[float, float]] = field(default_factory=list)  # corners of the box or the lasso that is drawn
    mouse: tuple[float, float] = (0.0, 0.0)  # where the pointer is
    words: str = ""  # what is asked beside it
    marker: int | None = None  # the index of the marker that it is asked of, None for none
    place: tuple[float, float, float] | None = None  # x y z in m where the marker would be put, None for nowhere

    def clear(self):
        self.region, self.outline, self.words, self.marker, self.place = 0, [], "", None, None

    def is_in(self, region: bpy.types.Region) -> bool:
        return self.region == region.as_pointer()


gesture = Gesture()


class Drags:
    """A modal operator that goes on as long as the left button is held.

    It differs in `drag`, the pointer was moved, `let_go`, which ends it, and `cancel`.
    """

    def modal(self, context, event):
        if event.type in ("ESC", "RIGHTMOUSE"):
            self.cancel(context)
            return {"CANCELLED"}
        if event.type in ("MOUSEMOVE", "INBETWEEN_MOUSEMOVE"):
            self.drag(context, event)
        released = event.type == "LEFTMOUSE" and event.value == "RELEASE"
        return self.let_go(context, event) if released else {"RUNNING_MODAL"}


def window_region(area: bpy.types.Area) -> bpy.types.Region:
    """The main region of an editor, which in a 3D view shows the scene."""
    return next(region for region in area.regions if region.type == "WINDOW")


def place_in(region: bpy.types.Region | bpy.types.Area, event: bpy.types.Event) -> tuple[int, int]:
    """Where the pointer is, px of a region."""
    return event.mouse_x - region.x, event.mouse_y - region.y


def is_over_view(area: bpy.types.Area, event: bpy.types.Event) -> bool:
    """Whether the pointer is over what a 3D view shows, and not over its sidebar, its toolbar or another editor."""
    over = [region for region in area.regions if region.width > 1 and is_over(region, event)]
    return [region.type for region in over] == ["WINDOW"]


def is_over(part: bpy.types.Region | bpy.types.Area, event: bpy.types.Event) -> bool:
    """Whether the pointer is over a region or an area."""
    x, y = place_in(part, event)
    return 0 <= x < part.width and 0 <= y < part.height
