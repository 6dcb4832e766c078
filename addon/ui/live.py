# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel *Live*, and the latest frame of a stream drawn over the 3D view, with a stick figure."""

import bpy
import numpy as np

from ..core.data.markersets import MarkerSet
from ..ops.live import going_on, how_it_ended
from ..scene.armature import SIDE_COLOURS, segment_sides
from .figure import FIGURE_WIDTH
from .marks import GREY, ORANGE
from .overlay import BLOB_RADIUS, Canvas
from .parts import draw_choice, draw_text, panel


@panel("Live", under="advanced", closed=True)
def live(layout, context):
    """What a capture program streams, named while it is recorded."""
    settings, stream = context.scene.mocap_autolabel.live, going_on()
    column = layout.column(align=True)
    column.active = stream is None
    draw_choice(column, context.scene.mocap_autolabel.subjects, "markerset", factor=0.35)
    for name in ("source", "up", "folder"):
        draw_choice(column, settings, name, factor=0.35)
    row = layout.row(align=True)
    row.scale_y = 1.4
    if stream is None:
        row.operator("mocap_autolabel.connect", icon="PLAY")
    else:
        words = "Recording" if stream.recording else "Record"
        row.operator("mocap_autolabel.record", text=words, icon="REC", depress=stream.recording)
        row.operator("mocap_autolabel.stop_live", text="Stop", icon="SNAP_FACE")
    if words := stream.words if stream else how_it_ended():
        draw_text(context, layout, words, icon="INFO")


def draw():
    """Draws the latest frame over the current 3D view; Blender calls this at every redraw."""
    context, stream = bpy.context, going_on()
    display = context.scene.mocap_autolabel.display
    if stream is None or not display.show_overlay or not context.space_data.overlay.show_overlays:
        return
    with Canvas(context) as canvas:
        if display.show_figure:
            ends, colours = sticks(stream.worn, stream.names, stream.named)
            canvas.lines(canvas.place(ends), colours, FIGURE_WIDTH)
        for points, colour, radius in ((stream.unnamed, GREY, 1.5), (stream.named, ORANGE, 1)):
            colours = np.broadcast_to(np.array(colour), (len(points), 4))
            canvas.discs(canvas.place(points), colours, BLOB_RADIUS - radius, 1.0)
        if display.show_names:
            canvas.names(stream.names, canvas.place(stream.named))


def sticks(worn: MarkerSet, names: list[str], named: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Lines (L, 2, 3) between the middles of the named points (N, 3) m of segments, and the colours (L, 2, 4).

    A segment is joined to the one that it hangs on, past those of which nothing is named.
    """
    own, sides = worn.attachment[[worn.by_name[name] for name in names]].astype(int), segment_sides(worn)
    ends, colours = [], []
    for segment in np.unique(own).tolist():
        above = worn.skeleton.parents[segment]
        while above >= 0 and above not in own:
            above = worn.skeleton.parents[above]
        if above >= 0:
            ends.append([named[own == one].mean(axis=0) for one in (above, segment)])
            colours.append([(*SIDE_COLOURS[sides[worn.skeleton.segments[segment]]], 1.0)] * 2)
    return np.reshape(ends, (-1, 2, 3)), np.reshape(colours, (-1, 2, 4))
