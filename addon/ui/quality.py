# SPDX-License-Identifier: GPL-3.0-or-later
"""Placement quality over the 3D view: markers in the colour of their clearness, ambiguous pairs, advice."""

import bpy
import numpy as np

from ..scene.markerset_edit import edited_collection, kept_report, marker_items, targets
from .marks import CYAN, GREEN, ORANGE, RED
from .overlay import BLOB_RADIUS, RING_RADIUS, Canvas, draw_colours, legend_ends

HEAD, BARB = 11.0, 0.45  # px of an arrow's head, and how wide it is of that
FAINTEST = 0.35  # opacity of a pair that is only just ambiguous
QUALITY_LEGEND = (("easily mistaken", RED), ("ambiguous", ORANGE), ("clear", GREEN), ("advised", CYAN))


def clearness(separation: float, goal: float) -> np.ndarray:
    """(4,) colour of a separation: red at nothing, orange at the goal, green at twice that."""
    red, orange, green = (np.array(colour) for colour in (RED, ORANGE, GREEN))
    share = separation / goal
    return red + (orange - red) * share if share < 1 else orange + (green - orange) * min(share - 1, 1)


def draw():
    """Draws over the current 3D view; Blender calls this at every redraw."""
    context = bpy.context
    collection = edited_collection(context.scene)
    report = kept_report(collection)
    shown = context.scene.mocap_autolabel.display.show_overlay and context.space_data.overlay.show_overlays
    if report is None or not shown or collection.hide_viewport:
        return
    with Canvas(context) as canvas:
        _draw_markers(canvas, report, marker_items(collection))
        _draw_targets(canvas, targets(collection))
        title = f"{report['model']}: placement of its markers"
        canvas.foot = legend_ends.get(canvas.region, canvas.foot)  # above that of a take
        draw_colours(canvas, title, [(words, colour) for words, colour in QUALITY_LEGEND])


def _draw_markers(canvas: Canvas, report: dict, items: dict[str, bpy.types.Object]):
    """The markers in the colours of their clearness, over lines between ambiguous pairs."""
    items = {name: item for name, item in items.items() if item.visible_get()}
    at = {name: canvas.place(np.array(item.matrix_world.translation)) for name, item in items.items()}
    _draw_pairs(canvas, report, at)
    names = [name for name in report["markers"] if name in at]
    colours = [clearness(report["markers"][name]["separation"], report["goal"]) for name in names]
    places = np.array([at[name] for name in names]).reshape(-1, 2)
    canvas.discs(places, np.array(colours).reshape(-1, 4), BLOB_RADIUS + 0.3, 1.2)


def _draw_pairs(canvas: Canvas, report: dict, at: dict[str, np.ndarray]):
    """Lines between ambiguous pairs, the worse the thicker."""
    goal = report["goal"]
    for pair in report["pairs"]:
        one, two = pair["markers"]
        if pair["separation"] >= goal or one not in at or two not in at:
            continue
        bad = 1 - pair["separation"] / goal
        colour = clearness(pair["separation"], goal) * [1, 1, 1, FAINTEST + (1 - FAINTEST) * bad]
        canvas.lines(np.array([[at[one], at[two]]]), np.broadcast_to(colour, (1, 2, 4)), 1.5 + 4 * bad)


def _draw_targets(canvas: Canvas, found):
    """An arrow from where each marker sits to a ghost of it where it should, with the number of the advice."""
    for target in found:
        begin, end = canvas.place(np.array([target.begin, target.end]))
        way = end - begin
        length = np.linalg.norm(way)
        if not np.isfinite(length) or length < 1:
            continue
        along, head = way / length, min(HEAD * canvas.scale, length / 2)
        side = np.array([-along[1], along[0]]) * head * BARB
        barbs = [end - along * head + side, end - along * head - side]
        lines = np.array([[begin, end], [barbs[0], end], [barbs[1], end]])
        canvas.lines(lines, np.broadcast_to(np.array(CYAN), (3, 2, 4)), 2.0)
        canvas.rings(end[None], CYAN, RING_RADIUS)
        # Above the line on which Blender writes the name of a marker that sits there.
        beside = end + np.array([RING_RADIUS + 3, RING_RADIUS + 9]) * canvas.scale
        canvas.text(f"{target.number}: {target.marker}", *beside, CYAN)
