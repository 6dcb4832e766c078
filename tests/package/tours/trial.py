# SPDX-License-Identifier: GPL-3.0-or-later
"""A second person's way: a take opened, labelled, a swap mended, gaps filled, on a Rigify rig, exported; counted."""

import time
from collections.abc import Iterator
from contextlib import contextmanager

import bpy
import stage
from stage import settings, state, window

OPERATOR = "mocap_autolabel."
SWAPPED = ("LKNE", "RKNE")


def walk(seen: dict) -> Iterator[float]:
    """What is not counted is what a person has already: a scene with a rig in it, which is selected; a swap to mend."""
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.preferences.addon_enable(module="rigify")
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.object.armature_human_metarig_add()
        bpy.ops.pose.rigify_generate()
    rig, before = bpy.context.view_layer.objects.active, time_of_scene()
    steps = seen["steps"] = {}
    yield from window.open_tab("View")
    bpy.ops.mocap_autolabel.import_take("INVOKE_DEFAULT")  # File > Import: two clicks, then the file and its button
    yield from window.browse(stage.TASK["points"])
    with waited(steps, "open", clicks=5):
        yield from stage.done(lambda: settings().subjects.found)
    seen["tab"] = window.region("UI").active_panel_category
    with waited(steps, "label", clicks=1):
        yield from stage.press_button("label")
        yield from stage.done(lambda: settings().take is not None)

    bpy.context.scene.frame_set(stage.TASK["frame"])
    stage.look_at_the_person()
    yield 1
    knee, other = map(stage.dot, SWAPPED)
    for name in SWAPPED:
        bpy.data.objects[name].select_set(True)
    bpy.ops.mocap_autolabel.swap_markers(scope="WHOLE")
    seen["wrong"] = stage.corrections()
    with waited(steps, "mend a swap", clicks=3, keys=1):
        places = yield from window.all_buttons()
        yield from window.click(*places["wm.tool_set_by_id"])
        yield from window.click(*knee)
        yield from window.click(*other, shift=True)
        yield from window.press("E", *other)
    seen["mended"] = [stage.dot(name) for name in SWAPPED] == [knee, other]
    with waited(steps, "fill all gaps", clicks=1):
        places = yield from window.scroll_to(f"{OPERATOR}smooth")
        yield from window.click(window.region("UI").x + 60, places[f"{OPERATOR}smooth"][1])  # Fill, beside it
        yield from stage.done(lambda: len(state().fills))

    bpy.context.view_layer.objects.active = rig
    settings().display.stage = "USE"  # a click
    yield 1
    with waited(steps, "move a Rigify rig", clicks=2):
        yield from stage.press_button("retarget")
        yield from stage.done(lambda: rig.animation_data is not None and rig.animation_data.action is not None)
    for name in ("c3d", "fbx"):
        path = stage.OUT / f"trial.{name}"
        with waited(steps, f"export {name.upper()}", clicks=2):
            yield from window.choose(f"{OPERATOR}export_{name}", str(path))
            yield from stage.done(path.exists)
    seen["time is kept"] = before == time_of_scene()
    yield from window.screenshot("1-used")


def time_of_scene() -> tuple[int, int, int]:
    """The rate and the first and last frame that the scene plays."""
    scene = bpy.context.scene
    return scene.render.fps, scene.frame_start, scene.frame_end


@contextmanager
def waited(steps: dict, name: str, clicks: int, keys: int = 0) -> Iterator[None]:
    """Counts a step, and the seconds that it goes on for."""
    begun = time.monotonic()
    yield
    steps[name] = [clicks, keys, time.monotonic() - begun]
