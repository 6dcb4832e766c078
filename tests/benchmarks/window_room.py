# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person waits for in a real Blender's window with a long take in it, everything on; runs as its script.

Its task is `task.json` in the folder MOCAP_OUT: the zip. What it measured goes to `seen.json` there, for each thing
by the clock and of the processor, s.
"""

import importlib
import json
import os
import sys
import time
from collections.abc import Callable, Iterator
from functools import partial
from itertools import cycle
from pathlib import Path

import bpy
import gpu
import numpy as np

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT / "scripts"), str(ROOT)]

import window  # noqa: E402

OUT = Path(os.environ["MOCAP_OUT"])
EXTENSION = "bl_ext.user_default.mocap_autolabel"
TIMES, REDRAWS = 5, 10
WAIT_S, MOST_WAITS, IDLE = 0.1, 100, 0.05  # s of a wait, how many at most, and of a processor that is idle
SEEN: dict[str, list[tuple[float, float]]] = {}


def of(name: str):
    """A module of the extension."""
    return importlib.import_module(f"{EXTENSION}.addon.{name}")


def settle():
    """Waits for the software that draws, which goes on in threads of its own after a redraw."""
    for _ in range(MOST_WAITS):
        begin = time.process_time()
        time.sleep(WAIT_S)
        if time.process_time() - begin < IDLE * WAIT_S:
            return


def spent(what: str, job: Callable[[], object]):
    """Runs a job and keeps what it took, by the clock and of the whole processor."""
    settle()
    begin, begin_core = time.perf_counter(), time.process_time()
    job()
    SEEN.setdefault(what, []).append((time.perf_counter() - begin, time.process_time() - begin_core))


def redraw():
    """Has the window drawn at once."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):  # after a file is opened as well
        bpy.ops.wm.redraw_timer(type="DRAW_WIN", iterations=1)


def redraw_region(editor: str):
    """Has the main region of an editor drawn at once."""
    with bpy.context.temp_override(area=window.area(editor), region=window.region("WINDOW", editor)):
        bpy.ops.wm.redraw_timer(type="DRAW", iterations=1)


def settings():
    """The scene's choices."""
    return bpy.context.scene.mocap_autolabel


def walk() -> Iterator[float]:
    """Show the take, redraw, pick, correct, undo, save and open it, each several times."""
    task = json.loads((OUT / "task.json").read_text())
    bpy.ops.extensions.package_install_files(filepath=task["zip"], repo="user_default", enable_on_install=True)
    from addon.scene.take import show_take
    from tests.benchmarks.long_take import FRAMES, long_take

    for item in list(bpy.data.objects):
        bpy.data.objects.remove(item)
    take = long_take()

    def show():
        settings().take = show_take(bpy.context, take)
        redraw()

    spent("a take is shown, to the first redraw", show)
    spent("a step of undo alone", lambda: bpy.ops.ed.undo_push(message="Shown"))
    yield 1
    bpy.context.scene.frame_set(FRAMES // 2)
    settings().display.show_trails = True
    bpy.ops.mocap_autolabel.show_timeline()
    yield 1
    yield from window.grow("DOPESHEET_EDITOR", 250)
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.wm.tool_set_by_id(name="mocap_autolabel.label_tool")
        bpy.ops.view3d.view_all()
    yield 3
    for part in (picks, redraws, edits):
        yield from part()
        (OUT / "seen.json").write_text(json.dumps(SEEN, indent=1))
    file = OUT / "long.blend"
    spent("the file is saved", lambda: bpy.ops.wm.save_as_mainfile(filepath=str(file)))

    def load():
        bpy.ops.wm.open_mainfile(filepath=str(file))
        redraw()

    for _ in range(2):
        spent("a file is opened, to the first redraw", load)
        yield 1
        of("scene.opened").opened.take(settings().take, bpy.context.scene)
    (OUT / "seen.json").write_text(json.dumps(SEEN, indent=1))


def stored():
    """The take as it is now."""
    return of("scene.opened").opened.take(settings().take, bpy.context.scene)


def picks() -> Iterator[float]:
    """Dots are picked, one after another."""
    picking, dots = of("ops.picking"), of("scene.picking")
    area, region = window.area(), window.region("WINDOW")
    for number in range(TIMES):

        def pick(number=number):
            here = picking.dots_here(stored(), bpy.context.scene)
            perspective = np.array(area.spaces.active.region_3d.perspective_matrix)
            places = dots.to_region(here.xyz, perspective, (region.width, region.height))
            found = dots.nearest(places, tuple(places[5 * number]), 20.0)
            picking.show_picked(bpy.context, stored(), [int(here.trajectory[found])])

        spent("a pick", pick)
        yield 0.1


def redraws() -> Iterator[float]:
    """What the extension itself takes of redraws of the 3D view and of the Dope Sheet while time is scrubbed."""
    views = (("ui.overlay", "draw"), ("ui.figure", "draw"), ("ui.label_tool", "draw"))
    sheet = (("ui.timeline", "draw_rows"),)
    beside = (("ui.timeline", "draw_names_beside"),)
    items = {item.get("mocap_marker"): item for item in settings().take.all_objects}
    for name in stored().names[3:6]:  # their trails are drawn
        items[name].select_set(True)

    def timed(what: str, parts):
        gpu.state.active_framebuffer_get().read_color(0, 0, 1, 1, 4, 0, "UBYTE")
        for module, name in parts:
            begin, begin_core = time.perf_counter(), time.thread_time()
            getattr(of(module), name)()
            ended = time.perf_counter() - begin, time.thread_time() - begin_core
            SEEN.setdefault(f"{what}: {module.split('.')[1]}", []).append(ended)

    view, dope = bpy.types.SpaceView3D, bpy.types.SpaceDopeSheetEditor
    handlers = [
        (view, "WINDOW", view.draw_handler_add(timed, ("view", views), "WINDOW", "POST_PIXEL")),
        (dope, "WINDOW", dope.draw_handler_add(timed, ("rows", sheet), "WINDOW", "POST_VIEW")),
        (dope, "CHANNELS", dope.draw_handler_add(timed, ("names", beside), "CHANNELS", "POST_PIXEL")),
    ]
    for step in range(REDRAWS):
        bpy.context.scene.frame_set(8000 + 37 * step)
        yield 0.05
        redraw()
    for kind, part, handler in handlers:
        kind.draw_handler_remove(handler, part)
    for step in range(TIMES):
        bpy.context.scene.frame_set(12000 + 37 * step)
        yield 0.05
        for editor in ("VIEW_3D", "DOPESHEET_EDITOR"):
            spent(f"{editor}, drawn by Blender and the extension", partial(redraw_region, editor))


def edits() -> Iterator[float]:
    """Markers are swapped and dots are named, with the step of undo, the tables and the rows that follow."""
    items = {item.get("mocap_marker"): item for item in settings().take.all_objects}
    numbers = cycle(range(60))

    def swap(scope: str):
        one = next(numbers)
        for item in bpy.context.selected_objects:
            item.select_set(False)
        for name in stored().names[one : one + 2]:
            items[name].select_set(True)
        bpy.context.window_manager.mocap_autolabel.picked.clear()
        bpy.ops.mocap_autolabel.swap_markers("EXEC_DEFAULT", True, scope=scope)

    def name():
        here = of("ops.picking").dots_here(stored(), bpy.context.scene)
        at = next(numbers)
        of("ops.picking").show_picked(bpy.context, stored(), [int(here.trajectory[at])])
        marker = stored().names[here.marker[at]]
        bpy.ops.mocap_autolabel.name_point("EXEC_DEFAULT", True, marker=marker, scope="WHOLE")

    for what, job in (
        ("two markers swapped in one frame", lambda: swap("FRAME")),
        ("two markers swapped in the whole take", lambda: swap("WHOLE")),
        ("a dot named", name),
    ):
        for _ in range(TIMES):
            spent(what, job)
            spent(f"{what}: the tables", of("ops.correcting").review_now)
            spent(f"{what}: the list", of("props").list_trouble)
            with bpy.context.temp_override(area=window.area("DOPESHEET_EDITOR")):
                spent(f"{what}: the rows", lambda: of("ops.timeline").shown_runs(bpy.context))
            spent(f"{what}: the redraw", redraw)
            spent("a step of undo alone", lambda: bpy.ops.ed.undo_push(message="Step"))
            yield 0.3


window.play(walk())
