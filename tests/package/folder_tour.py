# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of takes labelled in the background of a real Blender's window, and one of its takes opened by a click.

Runs as the window's script, on the `task.json` in the folder MOCAP_OUT: the zip, the cameras and the folder of takes.
It judges nothing: what it saw goes to `seen.json` beside its pictures.
"""

import json
import os
import sys
from collections.abc import Iterator
from importlib import import_module
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))

import window

OUT = Path(os.environ["MOCAP_OUT"])
LABEL, OPEN = "mocap_autolabel.label_folder", "mocap_autolabel.open_folder_take"
FROM_RIGHT = 50  # px from the sidebar's right end to the middle of the cross beside the progress


def walk() -> Iterator[float]:
    """Start, stop, go on, open the take."""
    task, seen = json.loads((OUT / "task.json").read_text()), {}
    bpy.ops.extensions.package_install_files(filepath=task["zip"], repo="user_default", enable_on_install=True)
    panel = import_module("bl_ext.user_default.mocap_autolabel.addon.ui.label_folder").MOCAP_AUTOLABEL_PT_label_folder
    bpy.utils.unregister_class(panel)
    panel.bl_options = set()  # open from the start
    bpy.utils.register_class(panel)
    bpy.ops.mocap_autolabel.import_cameras(filepath=task["cameras"])
    settings = bpy.context.scene.mocap_autolabel
    settings.subjects.markerset, settings.source.rate, settings.folder.watch = task["markerset"], 60, True
    settings.folder.path, settings.folder.out = task["takes"], str(OUT / "labelled")
    yield from window.open_tab("Mocap")
    places = yield from window.scroll_to(LABEL)
    yield from window.screenshot("folder-1-ready")
    yield from window.click(*places[LABEL])
    seen["doing"] = state().folder_doing
    yield from window.until(lambda: any(row.state != "waiting" for row in state().folder_takes))
    yield from window.screenshot("folder-2-at-work")
    seen["cube moved meanwhile"] = move_cube()
    yield from window.until(lambda: len(state().folder_takes) == 2 and all(done(row) for row in state().folder_takes))
    seen["watched"] = [(row.name, row.state) for row in state().folder_takes]
    yield from window.screenshot("folder-3-watching")
    sidebar = window.region("UI")
    yield from window.click(sidebar.x + sidebar.width - FROM_RIGHT, places[LABEL][1])
    yield from window.until(lambda: not state().folder_doing)
    state().folder_take_index = 1
    places = yield from window.scroll_to(LABEL, OPEN)
    yield from window.screenshot("folder-4-done")
    seen["said"] = state().folder_said
    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / "mine.blend"))  # so that nobody is asked
    yield from window.click(*places[OPEN])
    yield from window.until(lambda: Path(bpy.data.filepath).name == "take.blend")
    yield 1
    yield from window.open_tab("Mocap")
    seen["opened"] = bpy.context.scene.mocap_autolabel.take is not None
    seen["listed still"] = [row.name for row in state().folder_takes]
    yield from window.screenshot("folder-5-opened")
    (OUT / "seen.json").write_text(json.dumps(seen, indent=1))


def state() -> bpy.types.PropertyGroup:
    """What the sidebar knows; Blender's own references go stale when a file is opened."""
    return bpy.context.window_manager.mocap_autolabel


def done(row: bpy.types.PropertyGroup) -> bool:
    """Whether a take has come to its end."""
    return row.state in ("failed", "labelled", "done before")


def move_cube() -> bool:
    """Goes on working."""
    before = bpy.data.objects["Cube"].location.x
    bpy.data.objects["Cube"].location.x += 1
    bpy.ops.ed.undo_push(message="Moved")
    return bpy.data.objects["Cube"].location.x > before


window.play(walk())
