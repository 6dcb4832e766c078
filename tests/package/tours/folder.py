# SPDX-License-Identifier: GPL-3.0-or-later
"""A folder of takes labelled in the background of a real Blender's window, and one of its takes opened by a click."""

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stage import OUT, TASK, module, opened, play, settings, state, window

LABEL, OPEN = "mocap_autolabel.label_folder", "mocap_autolabel.open_folder_take"
FROM_RIGHT = 50  # px from the sidebar's right end to the middle of the cross beside the progress


def walk(seen: dict) -> Iterator[float]:
    """Start, stop, go on, open the take."""
    opened(module("ui.panels").label_folder)
    bpy.ops.mocap_autolabel.import_cameras(filepath=TASK["cameras"])
    given = settings()
    given.subjects.markerset, given.source.rate, given.folder.watch = TASK["markerset"], 60, True
    given.folder.path, given.folder.out = TASK["takes"], str(OUT / "labelled")
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


def done(row: bpy.types.PropertyGroup) -> bool:
    """Whether a take has come to its end."""
    return row.state in ("failed", "labelled", "done before")


def move_cube() -> bool:
    """Goes on working."""
    before = bpy.data.objects["Cube"].location.x
    bpy.data.objects["Cube"].location.x += 1
    bpy.ops.ed.undo_push(message="Moved")
    return bpy.data.objects["Cube"].location.x > before


play(walk)
