# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's way through the sidebar, walked in a real Blender's window by pointer and keys."""

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stage import OUT, TASK, play, running, settings, window

LABEL, CLEAR, LOOK = "mocap_autolabel.label", "mocap_autolabel.clear", "mocap_autolabel.look_through"


def walk(seen: dict) -> Iterator[float]:
    """Install, import, label and stop, label, export, look through a camera, clear, undo, save a marker set."""
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

    yield from window.scroll_sidebar()
    seen["at the end"] = yield from window.all_buttons()
    for kind, name in (("labels", "take.labels.csv"), ("c3d", "take.c3d"), ("trc", "take.trc")):
        getattr(bpy.ops.mocap_autolabel, f"export_{kind}")(filepath=str(OUT / name))

    places = yield from window.scroll_to(LOOK)
    yield from window.click(*places[LOOK])
    yield 1
    seen["view"] = window.area().spaces.active.region_3d.view_perspective
    yield from window.screenshot("4-through-a-camera")
    places = yield from window.scroll_to(CLEAR)
    yield from window.click(*places[CLEAR])
    yield 1
    seen["cleared"] = settings().take is None
    bpy.ops.ed.undo()
    yield 1
    seen["back after undo"] = settings().take is not None
    bpy.ops.mocap_autolabel.edit_markerset()
    bpy.ops.mocap_autolabel.save_markerset(filepath=str(OUT / "mine.markerset.json"))
    seen["marker set"] = Path(settings().subjects.markerset_path).name
    yield from window.screenshot("5-marker-set")


play(walk)
