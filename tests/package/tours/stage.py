# SPDX-License-Identifier: GPL-3.0-or-later
"""What the ways through a real Blender's window share: the task, the extension, and what a person sees there.

This is the window's script. Its task is the JSON file `task.json` in the folder MOCAP_OUT, with the zip, the way, which
is a module beside this one or of the benchmarks, and what else that names. A way judges nothing: what it saw goes to
`seen.json` beside its pictures, for a test to judge.
"""

import importlib
import json
import math
import os
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import bpy
import numpy as np
from bpy_extras.view3d_utils import location_3d_to_region_2d
from mathutils import Euler

sys.path.insert(0, str(Path(__file__).resolve().parents[3] / "scripts"))
sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "benchmarks"))
sys.path.insert(0, str(Path(__file__).resolve().parent))

import window

OUT = Path(os.environ["MOCAP_OUT"])
TASK = json.loads((OUT / "task.json").read_text())
EXTENSION = "bl_ext.user_default.mocap_autolabel"
Place = tuple[int, int]


def play(walk: Callable[[dict], Iterator[float]]):
    """Installs the zip, goes a way, which notes what it sees, and writes that down."""

    def whole() -> Iterator[float]:
        bpy.ops.extensions.package_install_files(filepath=TASK["zip"], repo="user_default", enable_on_install=True)
        seen: dict = {}
        yield from walk(seen)
        (OUT / "seen.json").write_text(json.dumps(seen, indent=1))

    window.play(whole())


def module(name: str):
    return importlib.import_module(f"{EXTENSION}.addon.{name}")


def settings() -> bpy.types.PropertyGroup:
    """The scene's choices; Blender's own references go stale with undo."""
    return bpy.context.scene.mocap_autolabel


def state() -> bpy.types.PropertyGroup:
    return bpy.context.window_manager.mocap_autolabel


def running() -> bool:
    """True while a modal operator of ours runs in the window."""
    operators = bpy.context.window_manager.windows[0].modal_operators
    return any(operator.bl_idname.startswith("MOCAP_AUTOLABEL") for operator in operators)


def now():
    """The take as it is, and the index of the current frame."""
    stored = module("scene.opened").opened.take(settings().take, bpy.context.scene)
    return stored, stored.index_of(bpy.context.scene.frame_float)


def corrections() -> list[str]:
    """What was said so far; the sidebar's list comes a moment later."""
    stored, _ = now()
    words_of = module("core.edits.kinds").words_of
    return [words_of(edit, stored.clock.whole) for edit in stored.edits]


def picked() -> list[int]:
    return [row.point for row in state().picked]


def asked() -> str:
    """What is asked beside the pointer."""
    return module("ops.gestures").gesture.words


def set_tool():
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.wm.tool_set_by_id(name="mocap_autolabel.label_tool")


def look_at_the_person():
    """Turns the 3D view to the person of the current frame."""
    stored, index = now()
    view = window.area().spaces.active.region_3d
    view.view_perspective, view.view_distance = "PERSP", 3.0
    view.view_location = np.nanmean(stored.motion.markers[index], axis=0)
    view.view_rotation = Euler((math.radians(75), 0, math.radians(65))).to_quaternion()


def dot(marker: str) -> Place:
    """Where a marker's dot of the current frame is in the window."""
    stored, index = now()
    return in_window(stored.motion.markers[index, stored.names.index(marker)])


def in_window(xyz: np.ndarray) -> Place:
    """Where a place of the world is in the window."""
    region = window.region("WINDOW")
    x, y = location_3d_to_region_2d(region, window.area().spaces.active.region_3d, xyz)
    return int(region.x + x), int(region.y + y)


def event(kind: str, value: str, place: Place, **held: bool):
    """One event of the pointer or a key."""
    bpy.context.window_manager.windows[0].event_simulate(type=kind, value=value, x=place[0], y=place[1], **held)


def press_held(key: str, place: Place, **held: bool) -> Iterator[float]:
    """Presses and releases a key while others are held."""
    for value in ("PRESS", "RELEASE"):
        event(key, value, place, **held)
        yield 0.4


def press_button(name: str) -> Iterator[float]:
    """Scrolls to a button of ours in the sidebar, and clicks it."""
    places = yield from window.scroll_to(f"mocap_autolabel.{name}")
    yield from window.click(*places[f"mocap_autolabel.{name}"])


def done(so: Callable[[], object]) -> Iterator[float]:
    """Waits until something is so and nothing goes on."""
    yield from window.until(lambda: so() and not state().doing)


def label() -> Iterator[float]:
    """Labels the take, and waits until it is shown and nothing goes on."""
    bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    yield 0.5
    yield from done(lambda: settings().take is not None)
    yield 1


def middle() -> Place:
    """The middle of the 3D view."""
    region = window.region("WINDOW")
    return region.x + region.width // 2, region.y + region.height // 2


if __name__ == "__main__":
    play(importlib.import_module(TASK["way"]).walk)
