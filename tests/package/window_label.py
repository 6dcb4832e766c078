# SPDX-License-Identifier: GPL-3.0-or-later
"""A hand that corrects a take with the tool Label in a real Blender's window, by pointer and keys.

Runs as the window's script. Its task is the JSON file `task.json` in the folder MOCAP_OUT: the zip and a take of
points. It judges nothing: what it saw goes to `seen.json` beside its pictures.
"""

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
Place = tuple[int, int]


def walk() -> Iterator[float]:
    """Install, import, label; pick in every way, name, swap, unlabel and relabel, place, play; two people."""
    task, seen = json.loads((OUT / "task.json").read_text()), {}
    bpy.ops.extensions.package_install_files(filepath=task["zip"], repo="user_default", enable_on_install=True)
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.mocap_autolabel.import_points(filepath=task["points"])
    bpy.context.scene.mocap_autolabel.subjects.markerset = task["markerset"]
    bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    yield from window.until(lambda: bpy.context.scene.mocap_autolabel.take is not None)
    bpy.context.scene.frame_set(task["frame"])
    look_at_the_person()
    set_tool()
    bpy.ops.ed.undo_push(message="Labelled")
    yield 1
    yield from picking(seen)
    yield from naming(seen)
    yield from quick_labelling(seen)
    yield from placing(seen)
    yield from playing(seen)
    yield from of_two(seen, task)
    (OUT / "seen.json").write_text(json.dumps(seen, indent=1))


def picking(seen: dict) -> Iterator[float]:
    """Clicks, a box, a lasso."""
    left, right = dot("LKNE"), dot("RKNE")
    seen["knees"] = [trajectory("LKNE"), trajectory("RKNE")]
    yield from window.click(*left)
    seen["clicked"] = picked()
    seen["selected"] = [item.name for item in bpy.context.selected_objects]
    yield from window.click(*right, shift=True)
    seen["with Shift"] = picked()
    yield from window.screenshot("1-picked")
    yield from window.click(*left, shift=True)
    seen["with Shift again"] = picked()
    yield from window.click(left[0] + 150, left[1])
    seen["beside"] = picked()
    corners = [min(left[0], right[0]) - 25, min(left[1], right[1]) - 25, max(left[0], right[0]) + 25]
    corners.append(max(left[1], right[1]) + 25)
    yield from window.drag((corners[0], corners[1]), (corners[2], corners[3]))
    seen["in a box"] = picked()
    x, y = right
    yield from lasso([(x - 25, y - 25), (x + 25, y - 25), (x + 25, y + 25), (x - 25, y + 25), (x - 25, y - 15)])
    seen["in a lasso"] = picked()


def naming(seen: dict) -> Iterator[float]:
    """Two exchanged, taken back; a pie, a typed name."""
    left, right = dot("LKNE"), dot("RKNE")
    yield from window.click(*left)
    yield from window.click(*right, shift=True)
    yield from window.press("E", *left)
    seen["swapped"] = corrections()
    yield from press_held("Z", left, ctrl=True)
    yield 1
    seen["undone"] = corrections()
    seen["picked after undo"] = picked()
    yield from window.click(*dot("LANK"))
    yield from window.press("U", *left)
    seen["unlabelled"] = corrections()
    yield from window.tap("L", *left)
    yield from window.screenshot("2-pie")
    yield from window.press("FOUR", *left)  # the pie's first piece
    seen["named by the pie"] = corrections()
    yield from window.press("RET", *left)
    yield from window.screenshot("3-typed")
    yield from window.press("ESC", *left)
    seen["after Esc"] = corrections()


def quick_labelling(seen: dict) -> Iterator[float]:
    """Three names taken away and given again, one after the other, with second thoughts."""
    places = {name: dot(name) for name in ("LELB", "RELB", "LTOE")}
    seen["truth"] = {name: trajectory(name) for name in places}
    for place in places.values():
        yield from window.click(*place)
        yield from window.press("U", *place)
    begun = len(corrections())
    aside = places["LELB"]
    yield from window.press("F", *aside)
    yield from window.screenshot("4-quick-label")
    yield from skip_to(places, aside)
    seen["asked"] = [asked()]
    yield from window.click(*places.pop(asked()))
    seen["asked"].append(asked())
    yield from window.press("BACK_SPACE", *aside)
    seen["asked"].append(asked())
    yield from window.press("SPACE", *aside)
    seen["asked"].append(asked())
    yield from skip_to(places, aside)
    seen["asked"].append(asked())
    yield from window.click(*places.pop(asked()))
    yield from window.press("ESC", *aside)
    seen["given"] = corrections()[begun:]
    seen["quick label runs"] = running()


def skip_to(wanted: dict[str, Place], aside: Place) -> Iterator[float]:
    """Pass over the markers that are asked for until it is one of those wanted."""
    for _ in range(30):
        if asked() in wanted:
            return
        yield from window.press("SPACE", *aside)


def placing(seen: dict) -> Iterator[float]:
    """A marker put where nothing was seen."""
    stored, _ = now()
    hidden = np.isnan(stored.motion.markers[..., 0]) & np.isfinite(stored.motion.expected[..., 0])
    [frame, marker] = np.argwhere(hidden & np.isfinite(stored.motion.markers[..., 0]).any(axis=0))[0]
    bpy.context.scene.frame_set(int(stored.motion.frames[frame]) + stored.shift)
    look_at_the_person()
    yield 1
    seen["gap"] = stored.names[marker]
    item = next(item for item in take().all_objects if item.get("mocap_marker") == seen["gap"])
    bpy.context.view_layer.objects.active = item
    for other in bpy.context.selected_objects:
        other.select_set(False)
    item.select_set(True)
    place = in_window(stored.motion.expected[frame, marker])
    yield from window.press("P", *place)
    yield from window.click(*place)
    yield from window.screenshot("5-it-is-here")
    yield from window.press("RET", *place)
    seen["placed"] = [corrections()[-1], [float(value) for value in item.matrix_world.translation]]


def playing(seen: dict) -> Iterator[float]:
    """Playback goes on with the tool."""
    before = bpy.context.scene.frame_current
    middle = window.region("WINDOW")
    place = middle.x + 200, middle.y + 200
    yield from window.press("SPACE", *place)
    yield 2
    yield from window.press("SPACE", *place)
    seen["played"] = bpy.context.scene.frame_current != before
    seen["tool"] = bpy.context.workspace.tools.from_space_view3d_mode("OBJECT").idname


def of_two(seen: dict, task: dict) -> Iterator[float]:
    """Two performers labelled beside the window, and a knee that is the other one's; taken back."""
    settings = bpy.context.scene.mocap_autolabel
    bpy.ops.mocap_autolabel.import_points(filepath=task["pair"])
    settings.subjects.performing = "SO_MANY"
    bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    yield from window.until(lambda: take() is not None and "duet" in take().name)
    bpy.context.scene.frame_set(bpy.context.scene.frame_start + 20)
    look_at_the_person()
    window.area().spaces.active.region_3d.view_distance = 5.0
    bpy.ops.ed.undo_push(message="Labelled")
    yield 1
    seen["performers"] = [child.name for child in take().children]
    seen["their knees"] = [trajectory("1:LKNE"), trajectory("2:LKNE")]
    place = dot("1:LKNE")
    yield from window.click(*place)
    yield from press_held("E", place, shift=True)
    yield from window.until(lambda: len(corrections()) == 2)
    seen["the other one's"] = corrections()
    seen["their knees then"] = [trajectory("1:LKNE"), trajectory("2:LKNE")]
    yield from window.screenshot("6-performers")
    yield from press_held("Z", place, ctrl=True)
    yield from window.until(lambda: not corrections())
    seen["their knees again"] = [trajectory("1:LKNE"), trajectory("2:LKNE")]


def set_tool():
    """Makes Label the active tool."""
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.wm.tool_set_by_id(name="mocap_autolabel.label_tool")


def look_at_the_person():
    """Turn the 3D view to the person of the current frame."""
    stored, index = now()
    view = window.area().spaces.active.region_3d
    view.view_perspective, view.view_distance = "PERSP", 3.0
    view.view_location = np.nanmean(stored.motion.markers[index], axis=0)
    view.view_rotation = Euler((math.radians(75), 0, math.radians(65))).to_quaternion()


def take() -> bpy.types.Collection:
    return bpy.context.scene.mocap_autolabel.take


def now():
    """The take, and the index of the current frame."""
    stored = importlib.import_module(f"{ADDON}.scene.opened").opened.take(take(), bpy.context.scene)
    return stored, bpy.context.scene.frame_current - stored.shift - int(stored.motion.frames[0])


def dots():
    """The dots of the current frame, and the names of the markers."""
    stored, index = now()
    return importlib.import_module(f"{ADDON}.scene.picking").dots_of(stored, index), stored.names


def trajectory(marker: str) -> int:
    """The trajectory that is a marker now."""
    here, names = dots()
    return int(here.trajectory[here.marker == names.index(marker)][0])


def dot(marker: str) -> Place:
    """Where a marker's dot is in the window."""
    here, names = dots()
    return in_window(here.xyz[here.marker == names.index(marker)][0])


def in_window(xyz) -> Place:
    """Where a place of the world is in the window."""
    region = window.region("WINDOW")
    x, y = location_3d_to_region_2d(region, window.area().spaces.active.region_3d, xyz)
    return int(region.x + x), int(region.y + y)


def picked() -> list[int]:
    return [row.point for row in bpy.context.window_manager.mocap_autolabel.picked]


def corrections() -> list[str]:
    """What was said so far; the sidebar's list comes a moment later."""
    stored, _ = now()
    words_of = importlib.import_module(f"{ADDON}.core.edits.wording").words_of
    return [words_of(edit, stored.shift) for edit in stored.edits]


def asked() -> str:
    """The marker that Quick Label asks for."""
    return importlib.import_module(f"{ADDON}.ops.gestures").gesture.words.rstrip("?")


def running() -> bool:
    """True while a modal operator of ours runs in the window."""
    operators = bpy.context.window_manager.windows[0].modal_operators
    return any(operator.bl_idname.startswith("MOCAP_AUTOLABEL") for operator in operators)


def event(kind: str, value: str, place: Place, **held: bool):
    """One event of the pointer or a key."""
    bpy.context.window_manager.windows[0].event_simulate(type=kind, value=value, x=place[0], y=place[1], **held)


def press_held(key: str, place: Place, **held: bool) -> Iterator[float]:
    """Press and release a key while others are held."""
    for value in ("PRESS", "RELEASE"):
        event(key, value, place, **held)
        yield 0.3


def lasso(path: list[Place]) -> Iterator[float]:
    """Drag along a path with Ctrl held, which Blender has to see pressed before a drag counts as such."""
    event("MOUSEMOVE", "NOTHING", path[0])
    yield 0.2
    event("LEFT_CTRL", "PRESS", path[0], ctrl=True)
    event("LEFTMOUSE", "PRESS", path[0], ctrl=True)
    for place in path[1:]:
        yield 0.3
        event("MOUSEMOVE", "NOTHING", place, ctrl=True)
    yield 0.3
    event("LEFTMOUSE", "RELEASE", path[-1], ctrl=True)
    event("LEFT_CTRL", "RELEASE", path[-1])
    yield 0.5


window.play(walk())
