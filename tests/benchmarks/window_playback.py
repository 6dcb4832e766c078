# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays 60 frames a second in a real Blender's window, first alone, then while a long take is labelled; its script.

To `seen.json` go the part of the frames that was not shown, and how long the add-on held the window meanwhile.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "package" / "tours"))

from stage import OUT, module, play, running, settings, window

RATE, SECONDS = 60, 15  # frames a second, s of playback


def walk(seen: dict) -> Iterator[float]:
    """A cube that moves is played."""
    scene, shown, held = bpy.context.scene, [], []
    bpy.ops.mocap_autolabel.import_points(filepath=str(OUT / "walk.c3d"))
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
    yield from window.open_tab("Mocap")
    bpy.app.handlers.frame_change_post.append(lambda *_: shown.append(time.monotonic()))
    bpy.ops.screen.animation_play()
    for what in ("alone", "labelling"):
        if what == "labelling":
            with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
                bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
        yield 5
        shown.clear(), held.clear()
        yield SECONDS
        seen[what] = {"lost": 1 - len(shown) / RATE / (shown[-1] - shown[0])}
    assert running()
    seen[what] |= {"held": sum(held) / SECONDS, "longest": max(held)}
    bpy.ops.screen.animation_cancel()
    bpy.ops.mocap_autolabel.cancel()
    yield from window.until(lambda: not running())


play(walk)
