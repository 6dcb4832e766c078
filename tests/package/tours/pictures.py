# SPDX-License-Identifier: GPL-3.0-or-later
"""Movies of two cameras chosen in a real Blender's window, found as blobs while somebody works, and cancelled once."""

import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parent))

from stage import TASK, play, settings, state, window

FIND = "mocap_autolabel.find_blobs"


def walk(seen: dict) -> Iterator[float]:
    """Choose a folder and cancel; choose it again and wait; look through a camera; take it back."""
    bpy.data.batch_remove(list(bpy.data.objects))
    yield from window.open_tab("Mocap")
    bpy.ops.mocap_autolabel.import_cameras(filepath=TASK["cameras"])
    bpy.ops.ed.undo_push(message="Cameras")
    source = settings().source

    with window.held():
        yield from window.choose_folder(FIND, TASK["movies"], picture="pictures-1-asked")
        seen["doing"] = state().doing
        yield from window.press("ESC", 500, 500)
        yield from window.until(lambda: not state().doing)
    seen["cancelled"] = [source.blobs_path, sorted(path.name for path in Path(TASK["movies"]).iterdir())]

    yield from window.choose_folder(FIND, TASK["movies"])
    yield from window.until(lambda: source.blobs_path and not state().doing)
    seen["found"] = [
        Path(source.blobs_path).name,
        source.rate,
        source.first_frame,
        source.last_frame,
    ]
    seen["files"] = sorted(path.name for path in Path(TASK["movies"]).iterdir())
    yield from window.look_through_first()
    yield from window.screenshot("pictures-2-found")
    bpy.ops.ed.undo()
    yield 1
    seen["taken back"] = bpy.context.scene.mocap_autolabel.source.blobs_path


play(walk)
