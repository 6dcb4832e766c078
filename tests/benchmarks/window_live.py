# SPDX-License-Identifier: GPL-3.0-or-later
"""A stream in a real Blender's window: how often it is drawn, and how old what is drawn is."""

import time
from collections.abc import Iterator

import bpy
from stage import TASK, module, settings, window

SECONDS, SETTLED_S = 20.0, 5.0


def walk(seen: dict) -> Iterator[float]:
    """Connect, wait until all are named, and count for a while; without performers Blender draws alone."""
    bpy.context.preferences.system.use_online_access = True
    bpy.context.preferences.system.viewport_aa = "OFF"
    bpy.data.batch_remove(list(bpy.data.objects))
    bpy.ops.preferences.addon_enable(module="rigify")
    large, small = window.area(), window.area("PROPERTIES")
    large.type, small.type = "INFO", "VIEW_3D"  # few pixels, which a processor draws
    yield 1
    live, area = module("ops.live"), window.area()
    seen["size"] = area.width, area.height
    with bpy.context.temp_override(area=area, region=window.region("WINDOW")):
        ask(TASK["many"])
        bpy.ops.view3d.view_all()
    if TASK["many"]:
        bpy.ops.mocap_autolabel.connect()
        yield from window.until(lambda: all(one.body is not None for one in live.going_on().performers))
        yield SETTLED_S
    stream, counted = live.going_on(), {"redraws": 0, "shown": 0, "delays": [], "named": []}
    latest = None

    def count():
        nonlocal latest
        counted["redraws"] += 1
        if stream is not None and stream.came != latest:
            latest = stream.came
            counted["shown"] += 1
            counted["delays"].append(1000 * (time.time() - latest))
            counted["named"].append(len(stream.names))

    def again() -> float:
        area.tag_redraw()
        return live.SHOWN_EVERY

    handler = bpy.types.SpaceView3D.draw_handler_add(count, (), "WINDOW", "POST_PIXEL")
    if stream is None:
        bpy.app.timers.register(again)
    else:
        first, late = stream.frame, stream.late
    begin, core = time.monotonic(), time.process_time()
    yield SECONDS
    core = time.process_time() - core
    seen.update(counted, seconds=time.monotonic() - begin, core=core, frames=0, late=0)
    if stream is not None:
        seen.update(frames=stream.frame - first, late=stream.late - late, words=stream.words)
    bpy.types.SpaceView3D.draw_handler_remove(handler, "WINDOW")
    yield from window.screenshot("live")
    live.leave_live()


def ask(many: int):
    """Chooses the marker set, so many performers, a rig for each, and the source."""
    subjects, live = settings().subjects, settings().live
    live.source, subjects.markerset = TASK["source"], TASK["markerset"]
    subjects.performing = "LISTED" if many > 1 else "ONE"
    for number in range(many):
        bpy.ops.object.armature_basic_human_metarig_add()
        rig = bpy.context.view_layer.objects.active
        if many == 1:
            live.rig = rig
            return
        row = subjects.performers.add()
        row.name, row.markerset, row.rig = f"p{number + 1}", TASK["markerset"], rig
