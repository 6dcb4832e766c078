# SPDX-License-Identifier: GPL-3.0-or-later
"""Lets 3D views show a place, and timelines all frames that the scene plays."""

import bpy
import numpy as np

ROOM = 4.0  # times the reach of what is meant that a view shows around it
MIN_ROOM = 1.2  # m that a view shows at least, so that one knows the limb
MAX_PLACES = 5000  # that the extent of a take is told from


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
            view.view_distance = max(room * reach, MIN_ROOM)


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
