# SPDX-License-Identifier: GPL-3.0-or-later
"""Placement quality in the sidebar and over the 3D view: markers in the colour of their clearness, pairs, advice."""

import bpy
import numpy as np

from ..scene.markerset_edit import edited_collection
from ..scene.quality import changed_since, kept_report, marker_items, targets
from .marks import CYAN, GREEN, ORANGE, RED
from .overlay import BLOB_RADIUS, RING_RADIUS, Canvas, draw_colours
from .parts import Step, draw_text

PAIRS_SHOWN = 6  # of the list
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
    shown = context.scene.mocap_autolabel.show_overlay and context.space_data.overlay.show_overlays
    if report is None or not shown or collection.hide_viewport:
        return
    with Canvas(context) as canvas:
        _draw_markers(canvas, report, marker_items(collection))
        _draw_targets(canvas, targets(collection))
        title = f"{report['model']}: placement of its markers"
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


class MOCAP_AUTOLABEL_PT_quality(Step, bpy.types.Panel):
    """Which markers are easily taken for each other."""

    bl_label = "Placement Quality"
    bl_parent_id = "MOCAP_AUTOLABEL_PT_markerset"

    @classmethod
    def poll(cls, context):
        return edited_collection(context.scene) is not None

    def draw(self, context):
        layout, collection = self.layout, edited_collection(context.scene)
        layout.operator("mocap_autolabel.judge_markers", icon="VIEWZOOM")
        report = kept_report(collection)
        if report is None:
            return
        if changed_since(collection):
            draw_text(context, layout, "Markers have changed since; judge them again", icon="ERROR")
        _draw_list(layout.column(align=True), report)
        for number, row in enumerate(report["advice"], 1):
            box = layout.box()
            gain = f"{' and '.join(row['for'])} from {row['before']:.1f} to {row['after']:.1f}"
            draw_text(context, box, f"{number}. {row['words'][0].upper()}{row['words'][1:]}. {gain}", icon="LIGHT")
            box.operator("mocap_autolabel.take_advice", icon="EMPTY_ARROWS").number = number


def _draw_list(column: bpy.types.UILayout, report: dict):
    """The whole set, then the pairs that are ambiguous."""
    if report["whole"]:
        worst = report["whole"][0]
        words = "Turned round" if worst["kind"] == "turn" else "Left for right"
        _draw_row(column, words, worst["separation"], report["goal"])
    poor = [pair for pair in report["pairs"] if pair["separation"] < report["goal"]]
    for pair in poor[:PAIRS_SHOWN]:
        _draw_row(column, " and ".join(pair["markers"]), pair["separation"], report["goal"])
    if not poor:
        column.label(text="No ambiguous pairs", icon="CHECKMARK")
    elif len(poor) > PAIRS_SHOWN:
        column.label(text=f"and {len(poor) - PAIRS_SHOWN} more pairs")


def _draw_row(column: bpy.types.UILayout, words: str, separation: float, goal: float):
    row = column.split(factor=0.75)
    row.label(text=words, icon="ERROR" if separation < goal else "CHECKMARK")
    row.label(text=f"{separation:.1f}")


CLASSES = (MOCAP_AUTOLABEL_PT_quality,)
