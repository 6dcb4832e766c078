# SPDX-License-Identifier: GPL-3.0-or-later
"""The panel *Live*, and the latest frame of a stream drawn over the 3D view, with bodies as stick figures."""

import bpy
import numpy as np

from ..ops.live import going_on, how_it_ended
from ..props import colours_asked
from ..scene.performers import usual_colour
from ..scene.units import enlarged, metre_in
from .figure import bone_colours, draw_lines
from .marks import GREY, ORANGE
from .overlay import BLOB_RADIUS, Canvas
from .parts import draw_choice, draw_performers, draw_text, panel


@panel("Live", under="advanced", closed=True)
def live(layout, context):
    """What a capture program streams, named while it is recorded."""
    settings, stream = context.scene.mocap_autolabel.live, going_on()
    column = layout.column(align=True)
    column.active = stream is None
    subjects = context.scene.mocap_autolabel.subjects
    if subjects.performing != "LISTED":
        draw_choice(column, subjects, "markerset", factor=0.35)
    draw_performers(column, subjects)
    for name in ("source", "up", "folder"):
        draw_choice(column, settings, name, factor=0.35)
    if subjects.performing == "ONE":
        draw_choice(layout, settings, "rig", factor=0.35)
    for performer in subjects.performers if subjects.performing == "LISTED" else ():
        draw_choice(layout, performer, "rig", factor=0.35, words=f"Rig of {performer.name}")
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
    settings = context.scene.mocap_autolabel
    display, asked = settings.display, colours_asked(settings.subjects)
    if stream is None or not display.show_overlay or not context.space_data.overlay.show_overlays:
        return
    with Canvas(context) as canvas:
        canvas.perspective = canvas.perspective @ enlarged(metre_in(context.scene))
        for number, one in enumerate(stream.performers):
            if display.show_figure and one.body is not None:
                above = one.worn.skeleton.parents
                own = asked.get(one.name, usual_colour(number)) if one.name else None
                draw_lines(canvas, one.body.bones, bone_colours(one.sides, above, own), above)
        for points, colour, radius in ((stream.unnamed, GREY, 1.5), (stream.named, ORANGE, 1)):
            colours = np.broadcast_to(np.array(colour), (len(points), 4))
            canvas.discs(canvas.place(points), colours, BLOB_RADIUS - radius, 1.0)
        if display.show_names:
            canvas.names(stream.names, canvas.place(stream.named))
