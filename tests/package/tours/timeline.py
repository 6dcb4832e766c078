# SPDX-License-Identifier: GPL-3.0-or-later
"""The trajectory timeline in a real Blender's window: clicked, dragged along, scrolled and timed."""

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy
import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stage import EXTENSION, TASK, module, play, settings, window
from timeline_take import make_take

REDRAWS = 40


def walk(seen: dict) -> Iterator[float]:
    """Show a take, open the timeline, click, drag, undo, scroll, unfold, and time redraws."""
    take = make_take(EXTENSION, TASK["frames"])
    begin = time.perf_counter()
    settings().take = module("scene.take").show_take(bpy.context, take)
    seen["s to show the take"] = time.perf_counter() - begin
    bpy.ops.ed.undo_push(message="Shown")
    yield 1
    bpy.ops.mocap_autolabel.show_timeline()
    yield 1
    yield from window.grow("DOPESHEET_EDITOR", 330)
    module("ops.viewing").fit_timelines(bpy.context)
    yield 1
    yield from window.screenshot("timeline-whole")

    main, names = window.region("WINDOW", "DOPESHEET_EDITOR"), window.region("CHANNELS", "DOPESHEET_EDITOR")
    timeline = module("ops.timeline")
    with bpy.context.temp_override(area=window.area("DOPESHEET_EDITOR"), region=main):
        runs = timeline.shown_runs(bpy.context)
        places = timeline.RowPlaces.of(bpy.context, main, len(runs))
    row_y = lambda row: int(main.y + places.upper(row) - 0.5 * places.row)  # noqa: E731
    x_of = lambda frame: main.x + main.view2d.view_to_region(frame, 0, clip=False)[0]  # noqa: E731
    span = runs.span[1] - runs.span[0]
    seen["rows"] = [len(runs), runs.names[:4]]

    at = runs.span[0] + span // 3
    yield from window.click(x_of(at), row_y(3))
    yield 0.5
    seen["click"] = looked(at)
    yield from window.drag((x_of(at), row_y(5)), (x_of(at + span // 4), row_y(5)))
    yield 0.5
    seen["drag"] = looked(at) | {"wanted": [at, at + span // 4], "row": runs.names[5]}
    yield from window.screenshot("timeline-range")
    bpy.ops.ed.undo()
    yield 0.5
    seen["undone"] = looked(at)
    yield from window.drag((x_of(at), row_y(6)), (x_of(at + span // 4), row_y(6)), stop="ESC")
    yield 0.5
    seen["stopped"] = looked(at)
    yield from window.click(names.x + 30, row_y(2))
    yield 0.5
    seen["name clicked"] = looked(at) | {"row": runs.names[2]}
    yield from window.click(x_of(at), row_y(0), shift=True)
    yield 0.5
    seen["added"] = sorted(item.name for item in bpy.context.selected_objects)

    before = len(bpy.data.actions[0].layers[0].strips[0].channelbags[0].fcurves)
    yield from window.press("X", x_of(at), row_y(8))
    yield 0.5
    seen["keys left"] = len(bpy.data.actions[0].layers[0].strips[0].channelbags[0].fcurves) == before
    state = bpy.context.window_manager.mocap_autolabel
    for _ in range(8):
        yield from window.turn_wheel("WHEELDOWNMOUSE", x_of(at), row_y(8), shift=True)
    seen["scrolled"] = state.timeline_scroll
    yield from window.turn_wheel("WHEELDOWNMOUSE", names.x + 20, row_y(8))
    seen["scrolled by names"] = state.timeline_scroll
    yield from window.drag((x_of(at), row_y(8)), (x_of(at), row_y(8) - int(4 * places.row)), button="MIDDLEMOUSE")
    seen["panned"] = state.timeline_scroll
    wide = lambda: main.view2d.region_to_view(main.width, 0)[0] - main.view2d.region_to_view(0, 0)[0]  # noqa: E731
    width = wide()
    yield from window.turn_wheel("WHEELUPMOUSE", x_of(at), row_y(8))
    yield 0.5
    seen["zoomed"] = wide() / width
    state.timeline_scroll = 60.0
    yield from window.screenshot("timeline-ghosts")
    with bpy.context.temp_override(area=window.area("DOPESHEET_EDITOR"), region=main):
        now = timeline.RowPlaces.of(bpy.context, main, len(runs))
    ghost = 63
    found = runs.runs[runs.runs[:, 0] == ghost][0]
    y = int(main.y + now.upper(ghost) - 0.5 * now.row)
    yield from window.click(min(max(x_of(int(found[1:3].mean())), main.x + 5), main.x + main.width - 40), y)
    yield 0.5
    seen["ghost"] = {
        "picked": bpy.context.window_manager.mocap_autolabel.picked[0].point,
        "wanted": int(runs.trajectory[ghost]),
    }

    module("ops.viewing").fit_timelines(bpy.context)
    state.timeline_scroll = 0.0
    seen["timing"] = yield from times()
    state.timeline_unfolded = True
    yield from window.screenshot("timeline-unfolded")
    with bpy.context.temp_override(area=window.area("DOPESHEET_EDITOR"), region=main):
        seen["rows unfolded"] = len(timeline.shown_runs(bpy.context))
    settings().display.show_timeline = False
    yield from window.screenshot("timeline-off")


def looked(at: int) -> dict:
    """What an action left in the scene."""
    scene = bpy.context.scene
    return {
        "frame": scene.frame_current,
        "asked": at,
        "selected": [item.name for item in bpy.context.selected_objects],
        "range": [scene.use_preview_range, scene.frame_preview_start, scene.frame_preview_end],
    }


def times() -> Iterator[float]:
    """Milliseconds of a redraw of rows and names while time is panned and rows scrolled, and of making them anew.

    Of each redraw: what the code takes by the clock and of its own core, and with the GPU, which is waited for.
    """
    drawing, clock, core, whole = module("ui.timeline"), [], [], []

    def timed(draw):
        import gpu

        if not drawing.timeline_shown(bpy.context):
            return
        pixel = gpu.state.active_framebuffer_get()
        pixel.read_color(0, 0, 1, 1, 4, 0, "UBYTE")
        begin, begin_core = time.perf_counter(), time.thread_time()
        draw()
        clock[-1] += 1000 * (time.perf_counter() - begin)
        core[-1] += 1000 * (time.thread_time() - begin_core)
        pixel.read_color(0, 0, 1, 1, 4, 0, "UBYTE")
        whole[-1] += 1000 * (time.perf_counter() - begin)

    kind, handlers = bpy.types.SpaceDopeSheetEditor, []
    for draw, part, when in (
        (drawing.draw_rows, "WINDOW", "POST_VIEW"),
        (drawing.draw_names_beside, "CHANNELS", "POST_PIXEL"),
    ):
        handlers.append((kind.draw_handler_add(timed, (draw,), part, when), part))
    area, main = window.area("DOPESHEET_EDITOR"), window.region("WINDOW", "DOPESHEET_EDITOR")
    for step in range(REDRAWS):
        for table in (clock, core, whole):
            table.append(0.0)
        with bpy.context.temp_override(area=area, region=main):
            bpy.ops.view2d.pan("EXEC_DEFAULT", deltax=7 if step % 2 else -5, deltay=0)
        bpy.context.window_manager.mocap_autolabel.timeline_scroll = step % 9
        area.tag_redraw()
        yield 0.05
    for handler, part in handlers:
        kind.draw_handler_remove(handler, part)
    stored, made = module("scene.opened").opened.take(bpy.context.scene.mocap_autolabel.take, bpy.context.scene), []
    for _ in range(3):
        begin = time.perf_counter()
        runs = module("scene.trajectories").KeptRows().runs(stored, False)
        made.append(1000 * (time.perf_counter() - begin))
    figures = {"redraws": sum(spent > 0 for spent in clock), "making the rows": min(made), "runs": len(runs.runs)}
    for name, table in (("by the clock", clock), ("of its core", core), ("with the GPU", whole)):
        spent = [value for value in table if value > 0]
        figures[name] = [float(np.median(spent)), float(np.min(spent)), float(np.max(spent))]
    return figures


play(walk)
