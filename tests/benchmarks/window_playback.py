# SPDX-License-Identifier: GPL-3.0-or-later
"""Plays 60 frames a second in a real Blender's window, first alone, then while a long take is labelled; its script.

Which part of the frames was shown goes to `seen.json`.
"""

import sys
import time
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[1] / "package" / "tours"))

from stage import OUT, play, running, settings, window

RATE, SECONDS = 60, 15  # frames a second, s of playback


def walk(seen: dict) -> Iterator[float]:
    """A cube that moves is played."""
    scene, shown = bpy.context.scene, []
    bpy.ops.mocap_autolabel.import_points(filepath=str(OUT / "walk.c3d"))
    settings().subjects.markerset = "body26"
    scene.render.fps, scene.frame_start, scene.frame_end = RATE, 1, 10 * RATE
    cube = bpy.data.objects["Cube"]
    for frame in (1, 10 * RATE):
        cube.location.x = frame / RATE
        cube.keyframe_insert("location", frame=frame)
    yield from window.open_tab("Mocap")
    bpy.app.handlers.frame_change_post.append(lambda *_: shown.append(time.monotonic()))
    bpy.ops.screen.animation_play()
    yield 2
    shown.clear()
    yield SECONDS
    seen["nothing else goes on"] = len(shown) / RATE / (shown[-1] - shown[0])
    with bpy.context.temp_override(area=window.area(), region=window.region("WINDOW")):
        bpy.ops.mocap_autolabel.label("INVOKE_DEFAULT")
    yield 5
    shown.clear()
    yield SECONDS
    assert running()
    seen["the take is labelled"] = len(shown) / RATE / (shown[-1] - shown[0])
    bpy.ops.screen.animation_cancel()
    bpy.ops.mocap_autolabel.cancel()
    yield from window.until(lambda: not running())


play(walk)
