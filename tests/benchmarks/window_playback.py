# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays 60 frames a second in a real Blender's window, alone and while a long take is labelled."""

import time
from collections.abc import Iterator

import bpy
from stage import TASK, module, running, settings, window

RATE, SETTLED, SECONDS, ROUNDS = 60, 3, 5, 7  # frames a second, s before and of what is counted, and how often


def walk(seen: dict) -> Iterator[float]:
    """A cube that moves is played, by turns without and with work beside it."""
    scene, shown, held = bpy.context.scene, [], []
    bpy.ops.mocap_autolabel.import_points(filepath=TASK["points"])
    settings().subjects.markerset = "body26"
    scene.render.fps, scene.frame_start, scene.frame_end = RATE, 1, 10 * RATE
    cube = bpy.data.objects["Cube"]
    for frame in (1, 10 * RATE):
        cube.location.x = frame / RATE
        cube.keyframe_insert("location", frame=frame)
    work = module("ops.long_work").LongWork
    tick = work._tick

    def timed(self, context) -> set[str]:
        begin = time.perf_counter()
        answer = tick(self, context)
        held.append(time.perf_counter() - begin)
        return answer

    work._tick = timed
    large, small = window.area(), window.area("PROPERTIES")
    large.type, small.type = "INFO", "VIEW_3D"  # few pixels, which a processor draws
    yield 1
    yield from window.open_tab("Mocap")
    bpy.app.handlers.frame_change_post.append(lambda *_: shown.append(time.monotonic()))
    bpy.ops.screen.animation_play()
    for _ in range(ROUNDS):
        for what in ("alone", "beside"):
            if what == "beside":
                with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
                    bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
            yield SETTLED
            shown.clear(), held.clear()
            yield SECONDS
            assert running() == (what == "beside")
            rate = len(shown) / (shown[-1] - shown[0])
            seen.setdefault(what, []).append((rate, sum(held) / SECONDS, max(held, default=0.0)))
            if running():
                bpy.ops.mocap_autolabel.cancel()
                yield from window.until(lambda: not running())
    bpy.ops.screen.animation_cancel()
