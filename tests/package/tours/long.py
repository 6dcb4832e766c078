# SPDX-License-Identifier: GPL-3.0-or-later
"""A part of a long take opened by a click in a real Blender's window, taken back, and opened from where it is now."""

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stage import TASK, play, settings, window

OPEN = "mocap_autolabel.open_part"


def walk(seen: dict) -> Iterator[float]:
    """Open, undo, move the take, choose it."""
    bpy.ops.wm.open_mainfile(filepath=TASK["blend"])
    yield 1
    scene = bpy.context.scene
    scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end = True, 20, 49
    bpy.ops.ed.undo_push(message="Opened")
    yield from window.open_tab("Mocap")
    window.show_all()
    places = yield from window.scroll_to(OPEN)
    yield from window.screenshot("long-1-plays")
    yield from window.click(*places[OPEN])
    yield from window.until(lambda: settings().take is not None)
    seen["opened"] = scene_now()
    yield from window.scroll_to(OPEN)
    yield from window.screenshot("long-2-a-part")
    bpy.ops.ed.undo()
    yield 1
    seen["undone"] = scene_now()
    shutil.move(TASK["take"], TASK["moved"])
    moved = Path(TASK["moved"])
    yield from window.choose_folder(OPEN, str(moved.parent), "long-3-where-it-is", moved.name)
    yield from window.until(lambda: settings().take is not None)
    seen["from elsewhere"] = scene_now()


def scene_now() -> dict:
    """What there is in the scene."""
    take, played = settings().take, next(one for one in bpy.data.collections if "mocap_played" in one)
    keyed = [curve for item in take.all_objects for curve in curves(item)] if take else []
    ends = {tuple(curve.range()) for curve in keyed}
    return {
        "take": take is not None,
        "keys": [min((end[0] for end in ends), default=0), max((end[1] for end in ends), default=0)],
        "hidden": played.hide_viewport,
        "points": settings().source.points_path,
        "frames": [settings().labelling.range_first, settings().labelling.range_last],
    }


def curves(item: bpy.types.Object) -> list[bpy.types.FCurve]:
    """The curves of an object."""
    action = item.animation_data.action if item.animation_data else None
    bags = action.layers[0].strips[0].channelbags if action else ()
    return [curve for bag in bags for curve in bag.fcurves]


play(walk)
