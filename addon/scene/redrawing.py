# SPDX-License-Identifier: GPL-3.0-or-later
"""Lets editors be drawn again, in all windows."""

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
