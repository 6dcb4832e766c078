# SPDX-License-Identifier: GPL-3.0-or-later
"""What Blender does a moment later: it draws editors again, in all windows, or calls what it is asked to."""

from collections.abc import Callable

import bpy


def redraw(editor: str, region: str = ""):
    """Lets every editor of a type, such as VIEW_3D, be drawn again; with `region` only its regions of that type."""
    for area in (area for window in bpy.context.window_manager.windows for area in window.screen.areas):
        if area.type != editor:
            continue
        if not region:
            area.tag_redraw()
        for part in (one for one in area.regions if one.type == region):
            part.tag_redraw()


def soon(function: Callable, after: float = 0.0, persistent: bool = False):
    """Has a function called in so many s, once however often it is asked for; without a window at once."""
    if bpy.app.background:
        function()
    elif not bpy.app.timers.is_registered(function):
        bpy.app.timers.register(function, first_interval=after, persistent=persistent)


def never(function: Callable):
    """Has a function not called any more."""
    if bpy.app.timers.is_registered(function):
        bpy.app.timers.unregister(function)
