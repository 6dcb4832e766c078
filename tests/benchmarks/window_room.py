# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person waits for in a real Blender's window with a long take in it, everything on; runs as its script.

What it measured goes to `seen.json`, for each thing by the clock and of the processor, s.
"""

import sys
import time
from collections.abc import Callable, Iterator
from itertools import cycle
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "package" / "tours"))

from stage import EXTENSION, OUT, module, now, play, set_tool, settings, window
from timeline_take import make_take

FRAMES, TIMES = 20_000, 5
WAIT_S, MOST_WAITS, IDLE = 0.1, 100, 0.05  # s of a wait, how many at most, and of a processor that is idle


class Clock:
    """What things took, in `seen`."""

    def __init__(self, seen: dict):
        self.seen = seen

    def spent(self, what: str, job: Callable[[], object]):
        """Runs a job when the software that draws, in threads of its own, has done what was before."""
        for _ in range(MOST_WAITS):
            begin = time.process_time()
            time.sleep(WAIT_S)
            if time.process_time() - begin < IDLE * WAIT_S:
                break
        begin, begin_core = time.perf_counter(), time.process_time()
        job()
        self.seen.setdefault(what, []).append((time.perf_counter() - begin, time.process_time() - begin_core))


def redraw():
    """Has the window drawn at once."""
    with bpy.context.temp_override(window=bpy.context.window_manager.windows[0]):  # after a file is opened as well
        bpy.ops.wm.redraw_timer(type="DRAW_WIN", iterations=1)


def undo_push():
    """A step of undo, without an edit."""
    bpy.ops.ed.undo_push(message="Step")


def walk(seen: dict) -> Iterator[float]:
    """Show the take, redraw, pick, correct, undo, save and open it, each several times."""
    clock = Clock(seen)
    bpy.data.batch_remove(list(bpy.data.objects))
    take = make_take(EXTENSION, FRAMES)

    def show():
        settings().take = module("scene.take").show_take(bpy.context, take)
        redraw()

    clock.spent("a take is shown, to the first redraw", show)
    clock.spent("a step of undo alone", undo_push)
    yield 1
    bpy.context.scene.frame_set(FRAMES // 2)
    settings().display.show_trails = True
    bpy.ops.mocap_autolabel.show_timeline()
    yield 1
    yield from window.grow("DOPESHEET_EDITOR", 250)
    set_tool()
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.view3d.view_all()
    yield 3
    yield from redraws(clock)
    yield from edits(clock)
    file = str(OUT / "long.blend")
    clock.spent("the file is saved", lambda: bpy.ops.wm.save_as_mainfile(filepath=file))

    def load():
        bpy.ops.wm.open_mainfile(filepath=file)
        redraw()

    for _ in range(2):
        clock.spent("a file is opened, to the first redraw", load)
        yield 1
        now()


def redraws(clock: Clock) -> Iterator[float]:
    """The 3D view and the Dope Sheet are drawn while time is scrubbed, with the trails of three markers."""
    _select(now()[0].names[3:6])
    for step in range(TIMES):
        bpy.context.scene.frame_set(12000 + 37 * step)
        yield 0.05
        for editor in ("VIEW_3D", "DOPESHEET_EDITOR"):
            with bpy.context.temp_override(area=window.area(editor), region=window.region("WINDOW", editor)):
                clock.spent(f"{editor} is drawn", lambda: bpy.ops.wm.redraw_timer(type="DRAW", iterations=1))


def edits(clock: Clock) -> Iterator[float]:
    """Markers are swapped, dots picked and named, with the step of undo, the tables and the rows that follow."""
    numbers, picking = cycle(range(60)), module("ops.picking")

    def swap(scope: str):
        one = next(numbers)
        _select(now()[0].names[one : one + 2])
        bpy.context.window_manager.mocap_autolabel.picked.clear()
        bpy.ops.mocap_autolabel.swap_markers("EXEC_DEFAULT", True, scope=scope)

    def pick() -> str:
        take, at = now()[0], next(numbers)
        here = picking.dots_here(take, bpy.context.scene)
        picking.show_picked(bpy.context, take, [int(here.trajectory[at])])
        return take.names[here.marker[at]]

    for what, job in (
        ("two markers swapped in one frame", lambda: swap("FRAME")),
        ("two markers swapped in the whole take", lambda: swap("WHOLE")),
        ("a dot picked", pick),
        ("a dot named", lambda: bpy.ops.mocap_autolabel.name_point("EXEC_DEFAULT", True, marker=pick(), scope="WHOLE")),
    ):
        for _ in range(TIMES):
            clock.spent(what, job)
            clock.spent(f"{what}: the tables", module("ops.correcting").review_now)
            clock.spent(f"{what}: the list", module("props").list_trouble)
            with bpy.context.temp_override(area=window.area("DOPESHEET_EDITOR")):
                clock.spent(f"{what}: the rows", lambda: module("ops.timeline").shown_runs(bpy.context))
            clock.spent(f"{what}: the redraw", redraw)
            clock.spent("a step of undo alone", undo_push)
            yield 0.3


def _select(names):
    for item in settings().take.all_objects:
        item.select_set(item.get("mocap_marker") in names)


play(walk)
