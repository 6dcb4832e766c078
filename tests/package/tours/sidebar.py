# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's way through the sidebar, walked in a real Blender's window by pointer and keys."""

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stage import OUT, TASK, play, running, settings, state, window

LABEL, CLEAR, LOOK = "mocap_autolabel.label", "mocap_autolabel.clear", "mocap_autolabel.look_through"


def walk(seen: dict) -> Iterator[float]:
    """Install, import, label and stop, label, look through a camera."""
    yield from window.open_tab("Mocap")
    yield from window.screenshot("1-empty")
    seen["at first"] = yield from window.all_buttons()

    bpy.ops.mocap_autolabel.import_cameras(filepath=TASK["cameras"])
    bpy.ops.mocap_autolabel.import_blobs(filepath=TASK["blobs"])
    settings().subjects.markerset, settings().source.rate = TASK["markerset"], 60
    bpy.ops.ed.undo_push(message="Imported")
    yield 1
    yield from window.screenshot("2-imported")
    places = yield from window.all_buttons()
    seen["imported"] = places

    with window.held():
        yield from window.click(*places[LABEL])
        seen["running after the click"] = running()
        yield from window.press("ESC", *places[LABEL])
        yield from window.until(lambda: not running())
    seen["after Esc"] = {"running": running(), "take": settings().take is not None, "actions": len(bpy.data.actions)}

    yield from window.click(*places[LABEL])
    yield from window.until(lambda: not running())
    yield 1
    seen["labelled"] = settings().take is not None
    window.show_all()
    yield from window.screenshot("3-labelled")
    seen["to review"] = yield from window.scroll_to(CLEAR)

    places = yield from window.scroll_to(LOOK)
    yield from window.click(*places[LOOK])
    yield 1
    seen["view"] = window.area().spaces.active.region_3d.view_perspective
    yield from window.screenshot("4-through-a-camera")

    file = str(OUT / "tour.blend")
    bpy.ops.wm.save_as_mainfile(filepath=file)
    with window.held():
        with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
            bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
        seen["running before another file"] = running()
        bpy.ops.wm.open_mainfile(filepath=file)
        yield 1
    seen["another file"] = {"running": running(), "doing": state().doing, "take": settings().take is not None}
    yield from window.screenshot("5-given-up")


play(walk)
