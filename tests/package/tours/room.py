# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole way of a take through a real Blender's window: imported, labelled, corrected, filled, exported, labelled
again, undone, redone, saved and reopened."""

import hashlib
from collections.abc import Iterator

import bpy
import numpy as np
import stage
from stage import window

RANGE = (5, 25)  # frames that a person takes off the scene at its start and end
LOST, RIGHT = "LKNE", "RKNE"


def walk(seen: dict) -> Iterator[float]:
    """Does all of it, once."""
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.mocap_autolabel.import_points(filepath=stage.TASK["points"])
    bpy.context.scene.mocap_autolabel.subjects.markerset = stage.TASK["markerset"]
    bpy.ops.ed.undo_push(message="Imported")
    yield from stage.label()
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = scene.frame_start + RANGE[0], scene.frame_end - RANGE[1]
    scene.frame_set(stage.TASK["frame"])
    bpy.ops.ed.undo_push(message="Range")
    stage.set_tool()
    stage.look_at_the_person()
    yield 1
    seen["labelled"] = take_now("labelled")

    yield from window.click(*stage.dot(LOST))
    yield from window.press("U", *stage.dot(RIGHT))
    view, here = window.area().spaces.active.region_3d, stage.dot(RIGHT)
    view.view_location, turn = (9, 9, 9), list(view.view_rotation)
    yield from window.press("J", *here)
    yield 1
    seen["view"] = [list(view.view_location), turn, list(view.view_rotation)]
    worst = stage.state().trouble_index
    bpy.ops.mocap_autolabel.accept_trouble("INVOKE_DEFAULT", index=worst)
    bpy.ops.ed.undo_push(message="It Is Right")
    scene.frame_set(stage.TASK["frame"])
    yield 1
    seen["corrected"] = take_now("corrected")
    bpy.ops.mocap_autolabel.fill_gaps("INVOKE_DEFAULT", extent="TAKE")
    yield from window.until(lambda: len(stage.state().fills))
    yield 1
    seen["filled"] = take_now("filled")
    yield from window.screenshot("1-filled")

    yield from stage.label()
    seen["labelled again"] = take_now("labelled-again")
    yield from stage.press_held("Z", stage.middle(), ctrl=True)
    yield 1
    seen["undone"] = take_now("undone")
    yield from stage.press_held("Z", stage.middle(), ctrl=True, shift=True)
    yield 1
    seen["redone"] = take_now("redone")

    bpy.ops.wm.save_as_mainfile(filepath=str(stage.OUT / "room.blend"))
    bpy.ops.wm.read_homefile(app_template="")
    yield 1
    bpy.ops.wm.open_mainfile(filepath=str(stage.OUT / "room.blend"))
    yield 2
    seen["reopened"] = take_now("reopened")
    yield from window.screenshot("2-reopened")


def take_now(name: str) -> dict:
    """What a person has at a step: names, corrections, fills, answers, the scene's frames, and the file exported."""
    file, scene, take = stage.OUT / f"{name}.c3d", bpy.context.scene, stage.now()[0]
    bpy.ops.mocap_autolabel.export_c3d(filepath=str(file))
    troubles = stage.module("scene.trouble").trouble_of(stage.settings().take, scene)
    return {
        "range": [scene.frame_start, scene.frame_end],
        "edits": stage.corrections(),
        "fills": [[fill.marker, fill.first, fill.last] for fill in take.fitting],
        "answered": sorted(one.topic for one in troubles if one.answered),
        "lost": int((take.labels.marker == take.names.index(LOST)).sum()),
        "labels": hashlib.sha256(np.ascontiguousarray(take.labels.marker)).hexdigest(),
        "file": hashlib.sha256(file.read_bytes()).hexdigest(),
    }
