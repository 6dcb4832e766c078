# SPDX-License-Identifier: GPL-3.0-or-later
"""The trajectory timeline in a real Blender's window: clicked, dragged along and scrolled."""

from collections.abc import Iterator

import bpy
import numpy as np
from stage import TASK, module, settings, window

RATE, HEIGHT = 120.0, 1.75
GHOSTS, FLICKERS = 20, 600  # trajectories without a name, long and short ones


def walk(seen: dict) -> Iterator[float]:
    """Show a take, open the timeline, click, drag, undo, scroll and unfold."""
    take = make_take(TASK["frames"])
    settings().take = module("scene.take").show_take(bpy.context, take)
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
    state.timeline_scroll = 51.0
    yield from window.screenshot("timeline-ghosts")
    with bpy.context.temp_override(area=window.area("DOPESHEET_EDITOR"), region=main):
        now = timeline.RowPlaces.of(bpy.context, main, len(runs))
    ghost = 54
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


def make_take(frames: int):
    """A `Take` of points, so long: 53 markers with gaps, doubts and ghosts, nothing measured."""
    data, rng = module("core.data.takes"), np.random.default_rng(5)
    markerset = module("io.markersets").open_markerset("actor53")
    joints, count = len(markerset.skeleton), len(markerset)
    time = np.arange(frames) / RATE
    way = np.column_stack([np.sin(time), np.sin(0.7 * time), 0 * time])
    markers = HEIGHT * markerset.rest_markers + way[:, None]
    bodies = HEIGHT * markerset.skeleton.rest_joints + way[:, None]
    whole = markers.copy()
    for marker in range(0, count, 2):
        for start in rng.integers(0, frames, max(2, frames // 400)):
            markers[start : start + rng.integers(1, 90), marker] = np.nan
    present = np.isfinite(markers[..., 0])
    residual = np.where(present, 0.0003, np.nan)
    unturned = np.broadcast_to(np.eye(3), (frames, joints, 3, 3)).copy()
    motion = data.Motion(
        1 + np.arange(frames), markers, residual, residual * np.nan, np.zeros(present.shape, int), whole,
        bodies, unturned, np.full((frames, 3), HEIGHT), np.ones(frames),
    )  # fmt: skip
    frame, marker = np.nonzero(present)
    rows = [(frame, marker, markers[present], marker)]
    for ghost in range(GHOSTS + FLICKERS):
        length = rng.integers(frames // 3, frames) if ghost < GHOSTS else rng.integers(1, 60)
        start = rng.integers(0, frames - length + 1)
        own = start + np.arange(length)
        place = np.tile(rng.uniform(-2, 2, 3), (length, 1))
        rows.append((own, np.full(length, count + ghost), place, np.full(length, data.NO_MARKER)))
    frame, trajectory, xyz, name = (np.concatenate(column) for column in zip(*rows, strict=True))
    order = np.lexsort((trajectory, frame))
    frame, trajectory, xyz, name = frame[order], trajectory[order], xyz[order], name[order]
    named = name != data.NO_MARKER
    sure = np.where((name % 7 == 3) & ((frame // 50) % 9 == 4), 0.9, 0.999)
    labels = data.Labels(name, np.where(named, data.BY_LIKELIHOOD, data.NO_STEP), np.where(named, sure, 0.0))
    points = data.PointRows(motion.frames, frame, trajectory, xyz, np.full(len(frame), 0.0003))
    doubts = tuple(
        data.Suspect(int(at), int(at) + 30, f"{markerset.markers[at % count]} jumps", None)
        for at in rng.integers(1, frames, 20)
    )
    cameras = module("core.geometry.cameras").NO_CAMERAS
    return module("scene.take").Take("long", RATE, cameras, markerset, points, labels, motion, doubts)
