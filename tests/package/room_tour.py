# SPDX-License-Identifier: GPL-3.0-or-later
"""The whole way of a take through a real Blender's window: imported, labelled, corrected, filled, exported, labelled
again, undone, redone, saved and reopened.

Runs as the window's script. Its task is the JSON file `task.json` in the folder MOCAP_OUT: the zip and a take of
points. It judges nothing: what the take was at each of these steps goes to `seen.json` beside its pictures.
"""

import hashlib
import importlib
import json
import math
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))

import window

OUT = Path(os.environ["MOCAP_OUT"])
ADDON = "bl_ext.user_default.mocap_autolabel.addon"
RANGE = (5, 25)  # frames that a person takes off the scene at its start and end
LOST, RIGHT = "LKNE", "RKNE"
Place = tuple[int, int]


def walk() -> Iterator[float]:
    """Does all of it, once."""
    task, seen = json.loads((OUT / "task.json").read_text()), {}
    bpy.ops.extensions.package_install_files(filepath=task["zip"], repo="user_default", enable_on_install=True)
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.mocap_autolabel.import_points(filepath=task["points"])
    bpy.context.scene.mocap_autolabel.subjects.markerset = task["markerset"]
    bpy.ops.ed.undo_push(message="Imported")
    yield from label()
    scene = bpy.context.scene
    scene.frame_start, scene.frame_end = scene.frame_start + RANGE[0], scene.frame_end - RANGE[1]
    scene.frame_set(task["frame"])
    bpy.ops.ed.undo_push(message="Range")
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.wm.tool_set_by_id(name="mocap_autolabel.label_tool")
    view = window.area().spaces.active.region_3d
    take = stored()
    middle = np.nanmean(take.motion.markers[scene.frame_current - take.shift - int(take.motion.frames[0])], axis=0)
    view.view_perspective, view.view_distance, view.view_location = "PERSP", 3.0, middle
    view.view_rotation = Euler((math.radians(75), 0, math.radians(65))).to_quaternion()
    yield 1
    seen["labelled"] = state("labelled")

    yield from window.click(*dot(LOST))
    yield from window.press("U", *dot(RIGHT))
    yield from window.press("J", *dot(RIGHT))
    yield 1
    worst = bpy.context.window_manager.mocap_autolabel.trouble_index
    bpy.ops.mocap_autolabel.accept_trouble("INVOKE_DEFAULT", index=worst)
    bpy.ops.ed.undo_push(message="It Is Right")
    scene.frame_set(task["frame"])
    yield 1
    seen["corrected"] = state("corrected")
    bpy.ops.mocap_autolabel.fill_gaps("INVOKE_DEFAULT", extent="TAKE")
    yield from window.until(lambda: len(bpy.context.window_manager.mocap_autolabel.fills))
    yield 1
    seen["filled"] = state("filled")
    yield from window.screenshot("1-filled")

    yield from label()
    seen["labelled again"] = state("labelled-again")
    yield from press_held("Z", ctrl=True)
    yield 1
    seen["undone"] = state("undone")
    yield from press_held("Z", ctrl=True, shift=True)
    yield 1
    seen["redone"] = state("redone")

    bpy.ops.wm.save_as_mainfile(filepath=str(OUT / "room.blend"))
    bpy.ops.wm.read_homefile(app_template="")
    yield 1
    bpy.ops.wm.open_mainfile(filepath=str(OUT / "room.blend"))
    yield 2
    seen["reopened"] = state("reopened")
    yield from window.screenshot("2-reopened")
    (OUT / "seen.json").write_text(json.dumps(seen, indent=1))


def label() -> Iterator[float]:
    """Label the take, and wait until it is shown and nothing goes on."""
    bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    yield 0.5
    yield from window.until(
        lambda: settings().take is not None and not bpy.context.window_manager.mocap_autolabel.doing
    )
    yield 1


def state(name: str) -> dict:
    """What a person has at a step: names, corrections, fills, answers, the scene's frames, and the file exported."""
    file, scene, take = OUT / f"{name}.c3d", bpy.context.scene, stored()
    bpy.ops.mocap_autolabel.export_c3d(filepath=str(file))
    words_of = importlib.import_module(f"{ADDON}.core.edits.wording").words_of
    troubles = importlib.import_module(f"{ADDON}.scene.trouble").trouble_of(settings().take, scene)
    return {
        "range": [scene.frame_start, scene.frame_end],
        "edits": [words_of(edit, take.shift) for edit in take.edits],
        "fills": [[fill.marker, fill.first, fill.last] for fill in take.fitting],
        "answered": sorted(one.topic for one in troubles if one.answered),
        "lost": int((take.labels.marker == take.names.index(LOST)).sum()),
        "labels": hashlib.sha256(np.ascontiguousarray(take.labels.marker)).hexdigest(),
        "file": hashlib.sha256(file.read_bytes()).hexdigest(),
    }


def settings() -> bpy.types.PropertyGroup:
    return bpy.context.scene.mocap_autolabel


def stored():
    """The take as it is with all corrections and fills."""
    return importlib.import_module(f"{ADDON}.scene.opened").opened.take(settings().take, bpy.context.scene)


def dot(marker: str) -> Place:
    """Where a marker's dot of the current frame is in the window."""
    take = stored()
    index = bpy.context.scene.frame_current - take.shift - int(take.motion.frames[0])
    region = window.region("WINDOW")
    place = take.motion.markers[index, take.names.index(marker)]
    x, y = location_3d_to_region_2d(region, window.area().spaces.active.region_3d, place)
    return int(region.x + x), int(region.y + y)


def press_held(key: str, **held: bool) -> Iterator[float]:
    """Press and release a key over the 3D view while others are held."""
    middle = window.region("WINDOW")
    place = {"x": middle.x + middle.width // 2, "y": middle.y + middle.height // 2}
    for value in ("PRESS", "RELEASE"):
        bpy.context.window_manager.windows[0].event_simulate(type=key, value=value, **place, **held)
        yield 0.3


window.play(walk())
