# SPDX-License-Identifier: GPL-3.0-or-later
"""The sidebar, and what is drawn over the 3D view."""

from contextlib import ExitStack

import bpy

from ..ops.correcting import review_now
from ..ops.label_folder import follow, leave_batch
from ..ops.reposing import forget_reposing
from ..ops.timeline import forget_rows
from ..props import list_trouble
from ..scene.opened import opened
from ..scene.trouble import forget_trouble
from . import figure, handlers, label_tool, overlay, panels, quality, review, timeline

PANEL_MODULES = (panels, review, label_tool)  # a panel behind the one that it is in


def add_handlers(stack: ExitStack):
    """Adds the overlay and what listens to Blender; each brings its way back to `stack`."""
    for draw in (figure.draw, overlay.draw, quality.draw, label_tool.draw):
        drawing = bpy.types.SpaceView3D.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")
        stack.callback(bpy.types.SpaceView3D.draw_handler_remove, drawing, "WINDOW")
    timeline.add_timeline(stack)
    label_tool.add_tool(stack)
    stack.callback(opened.forget)
    stack.callback(forget_trouble)
    stack.callback(forget_rows)
    stack.callback(forget_reposing)
    stack.callback(overlay.letters.forget)
    stack.callback(overlay.discs.forget)
    stack.callback(_stop_timer, list_trouble)
    events = bpy.app.handlers
    for listeners, function in (
        (events.load_post, handlers.after_load),
        (events.undo_pre, handlers.before_undo),
        (events.redo_pre, handlers.before_undo),
        (events.undo_post, handlers.after_undo),
        (events.redo_post, handlers.after_undo),
    ):
        listeners.append(function)
        stack.callback(listeners.remove, function)
    # While an extension is being enabled the file is out of bounds; a moment later it is not. The timer is persistent
    # because Blender 4.5 as a module hangs at its end when a file is opened under one that is not.
    bpy.app.timers.register(handlers.adopt_takes, first_interval=0.0, persistent=True)
    stack.callback(_stop_timer, handlers.adopt_takes)
    stack.callback(_stop_timer, review_now)
    stack.callback(leave_batch)
    stack.callback(_stop_timer, follow)


def _stop_timer(function):
    if bpy.app.timers.is_registered(function):
        bpy.app.timers.unregister(function)
