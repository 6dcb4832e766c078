# SPDX-License-Identifier: GPL-3.0-or-later
"""A person's way through the sidebar, walked in a real Blender's window by pointer and keys, stage by stage."""

from collections.abc import Iterator
from pathlib import Path

import bpy
from stage import OUT, TASK, now, running, settings, state, window

OPEN, LABEL = "mocap_autolabel.import_take", "mocap_autolabel.label"
THEMES = ("Blender_Light", "Blender_Dark")


def walk(seen: dict) -> Iterator[float]:
    """Install, open, label and stop, label, review, use it."""
    yield from window.open_tab("Mocap")
    seen["heights"] = {}
    yield from look("1-empty", seen)
    seen["at first"] = yield from window.all_buttons()

    yield from window.choose(OPEN, TASK["points"])  # two clicks: the button, and Open Take in the browser
    yield from window.until(lambda: settings().subjects.found and not running())
    yield 1
    seen["found"] = settings().subjects.found
    yield from look("2-opened", seen)
    places = yield from window.all_buttons()
    seen["opened"] = places

    with window.held():
        yield from window.click(*places[LABEL])
        seen["running after the click"] = running()
        yield from window.press("ESC", *places[LABEL])
        yield from window.until(lambda: not running())
    seen["after Esc"] = {"running": running(), "take": settings().take is not None, "actions": len(bpy.data.actions)}

    yield from window.click(*places[LABEL])  # the third
    yield from window.until(lambda: not running())
    yield 1
    seen["labelled"] = settings().take is not None
    window.show_all()
    bpy.ops.mocap_autolabel.next_trouble(back=False)
    yield from look("3-review", seen)
    seen["to review"] = yield from window.all_buttons()
    settings().display.stage = "USE"
    yield from look("4-use-it", seen)
    seen["to use"] = yield from window.all_buttons()
    settings().display.stage = "REVIEW"

    bpy.ops.mocap_autolabel.clear()
    bpy.ops.mocap_autolabel.import_cameras(filepath=TASK["cameras"])
    bpy.ops.mocap_autolabel.import_blobs(filepath=TASK["blobs"])
    settings().source.rate = 60
    bpy.ops.ed.undo_push(message="Imported")
    yield from look("5-blobs", seen)
    places = yield from window.all_buttons()
    yield from window.click(*places[LABEL])
    yield 1
    yield from window.until(lambda: not running())
    yield from look("6-blobs-labelled", seen)

    file = str(OUT / "tour.blend")
    bpy.ops.mocap_autolabel.clear()
    with window.held():
        label(markerset="body26")
        bpy.ops.wm.save_as_mainfile(filepath=file)
        bpy.ops.wm.read_homefile()
        yield from window.until(running)
        yield from window.open_tab("Mocap")
        yield from window.screenshot("7-goes-on")
    yield from window.until(lambda: not running())
    seen["elsewhere"] = settings().take is not None
    places = yield from window.all_buttons()
    yield from window.click(*places["wm.open_mainfile"])
    yield from window.until(lambda: settings().take is not None)
    named = now()[0].labels.named.mean()
    seen["open again"] = {"file": bpy.data.filepath == file, "named": named, "doing": state().doing}
    seen["chosen"] = settings().subjects.markerset
    bpy.ops.ed.undo()
    seen["undone"] = settings().take is not None

    bpy.ops.wm.window_new()
    yield 1
    with window.held():
        with bpy.context.temp_override(window=bpy.context.window_manager.windows[-1]):
            bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
            bpy.ops.wm.window_close()
        yield from window.until(running)
    yield from window.until(lambda: not running())
    seen["window closed"] = settings().take is not None

    bpy.ops.wm.read_homefile()
    yield 1
    bpy.ops.mocap_autolabel.import_take(filepath=TASK["points"])
    yield from window.until(lambda: not running())
    with window.held():
        label()
        bpy.ops.wm.open_mainfile(filepath=file)
        yield 3
        seen["never saved"] = {"running": running(), "doing": state().doing, "take": settings().take is not None}
    yield from window.screenshot("8-given-up")


def label(**given):
    """Label goes on beside the window."""
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT", **given)


def look(name: str, seen: dict) -> Iterator[float]:
    """How high a stage is, and a picture of it in a light and in a dark theme."""
    seen["heights"][name] = yield from window.height()
    window.point(400, 300)  # off the buttons, which would tell what they are for
    for theme in THEMES:
        path = next(Path(folder, f"{theme}.xml") for folder in bpy.utils.preset_paths("interface_theme"))
        bpy.ops.script.execute_preset(filepath=str(path), menu_idname="USERPREF_MT_interface_theme_presets")
        yield from window.screenshot(f"{name}-{theme.removeprefix('Blender_').lower()}")
