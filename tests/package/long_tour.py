# SPDX-License-Identifier: GPL-3.0-or-later
"""A part of a long take opened by a click in a real Blender's window, taken back, and opened from where it was moved.

Runs as the window's script, on the `task.json` in the folder MOCAP_OUT: the zip, the Blender file, the file of the
take, and where that is moved. It judges nothing: what it saw goes to `seen.json` beside its pictures.
"""

import json
import os
import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))

import window

OUT = Path(os.environ["MOCAP_OUT"])
OPEN = "mocap_autolabel.open_part"


def walk() -> Iterator[float]:
    """Open, undo, move the take, choose it."""
    task, seen = json.loads((OUT / "task.json").read_text()), {}
    bpy.ops.extensions.package_install_files(filepath=task["zip"], repo="user_default", enable_on_install=True)
    bpy.ops.wm.open_mainfile(filepath=task["blend"])
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
    seen["opened"] = state()
    yield from window.scroll_to(OPEN)
    yield from window.screenshot("long-2-a-part")
    bpy.ops.ed.undo()
    yield 1
    seen["undone"] = state()
    shutil.move(task["take"], task["moved"])
    moved = Path(task["moved"])
    yield from window.choose_folder(OPEN, str(moved.parent), "long-3-where-it-is", moved.name)
    yield from window.until(lambda: settings().take is not None)
    seen["from elsewhere"] = state()
    (OUT / "seen.json").write_text(json.dumps(seen, indent=1))


def settings() -> bpy.types.PropertyGroup:
    """The scene's choices; Blender's own references go stale with undo."""
    return bpy.context.scene.mocap_autolabel


def state() -> dict:
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


window.play(walk())
