# SPDX-License-Identifier: GPL-3.0-or-later
"""A rig that is moved by a take in a real Blender's window: it follows a choice, a correction and undo, and is kept."""

from collections.abc import Iterator

import bpy
import stage
from stage import settings, window

RIG, SWAPPED, BAKE = "Hero", ("LKNE", "RKNE"), "mocap_autolabel.bake_retarget"
ROW = 25  # px from a row of buttons to the next one's


def walk(seen: dict) -> Iterator[float]:
    """Labels, corrects, retargets, and goes back and forth behind both."""
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.preferences.addon_enable(module="rigify")
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.object.armature_human_metarig_add()
    bpy.context.object.name = RIG
    yield from window.open_tab("Mocap")
    bpy.ops.mocap_autolabel.import_points(filepath=stage.TASK["points"])
    settings().subjects.markerset = stage.TASK["markerset"]
    yield from stage.label()
    settings().display.stage = "USE"
    yield 1
    yield from swap()
    bpy.context.view_layer.objects.active = bpy.data.objects[RIG]
    yield 1
    yield from stage.press_button("retarget")
    seen["retargeted"] = yield from moved()
    places = yield from window.scroll_to(BAKE)
    yield from window.click(window.region("UI").x + 60, places[BAKE][1] - ROW)
    seen["feet left"] = yield from moved()
    yield from window.screenshot("1-preview")
    yield from swap()
    seen["corrected"] = yield from moved()
    for number, key in enumerate(("undo", "undo", "undo", "redo", "redo", "redo", "undo", "redo")):
        yield from stage.press_held("Z", stage.middle(), ctrl=True, shift=key == "redo")
        seen[f"{key} {number}"] = yield from moved()
    bpy.context.view_layer.objects.active = bpy.data.objects[RIG]
    yield 1
    yield from stage.press_button("bake_retarget")
    yield from swap()
    seen["baked"] = yield from moved()
    bpy.ops.wm.save_as_mainfile(filepath=str(stage.OUT / "rig.blend"))
    bpy.ops.wm.read_homefile(app_template="")
    yield 1
    bpy.ops.wm.open_mainfile(filepath=str(stage.OUT / "rig.blend"))
    seen["reopened"] = yield from moved()


def swap() -> Iterator[float]:
    """Exchanges two markers, and lets the body follow before anything else is done."""
    bpy.ops.object.select_all(action="DESELECT")
    for name in SWAPPED:
        bpy.data.objects[name].select_set(True)
    bpy.context.view_layer.objects.active = bpy.data.objects[SWAPPED[0]]
    bpy.ops.mocap_autolabel.swap_markers("EXEC_DEFAULT", True, scope="WHOLE")
    yield from moved()


def moved() -> Iterator[float]:
    """What moves the rig once all has followed: its action's name, whether feet are kept, and the sum of its keys."""
    yield 0.5
    yield from window.until(lambda: not stage.module("ops.reposing").is_behind(bpy.context))
    yield from window.until(lambda: not is_left_behind())
    rig = bpy.data.objects[RIG]
    keys = [key.co.y for curve in stage.module("scene.ownership").curves_of(rig) for key in curve.keyframe_points]
    action = None if rig.animation_data is None else rig.animation_data.action
    return action and [action.name, rig.mocap_autolabel.keep_feet, sum(keys)]


def is_left_behind() -> bool:
    """Whether the rig's preview is to be made again."""
    return stage.module("scene.rig_preview").is_left_behind(bpy.context, bpy.data.objects[RIG])
