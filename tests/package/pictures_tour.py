# SPDX-License-Identifier: GPL-3.0-or-later
"""Movies of two cameras chosen in a real Blender's window, found as blobs while somebody works, and cancelled once.

Runs as the window's script, on the `task.json` in the folder MOCAP_OUT: the zip, the cameras and the folder of movies.
It judges nothing: what it saw goes to `seen.json` beside its pictures.
"""

import json
import os
import sys
from collections.abc import Iterator
from pathlib import Path

import bpy

sys.path.insert(0, str(Path(__file__).resolve().parents[2] / "scripts"))

import window

OUT = Path(os.environ["MOCAP_OUT"])
FIND = "mocap_autolabel.find_blobs"


def walk() -> Iterator[float]:
    """Choose a folder and cancel; choose it again and wait; look through a camera; take it back."""
    task, seen = json.loads((OUT / "task.json").read_text()), {}
    bpy.ops.extensions.package_install_files(filepath=task["zip"], repo="user_default", enable_on_install=True)
    bpy.data.batch_remove(list(bpy.data.objects))
    yield from window.open_tab("Mocap")
    bpy.ops.mocap_autolabel.import_cameras(filepath=task["cameras"])
    bpy.ops.ed.undo_push(message="Cameras")
    settings = bpy.context.scene.mocap_autolabel

    with window.held():
        yield from window.choose_folder(FIND, task["movies"], picture="pictures-1-asked")
        seen["doing"] = state().doing
        yield from window.press("ESC", 500, 500)
        yield from window.until(lambda: not state().doing)
    seen["cancelled"] = [settings.source.blobs_path, sorted(path.name for path in Path(task["movies"]).iterdir())]

    yield from window.choose_folder(FIND, task["movies"])
    yield from window.until(lambda: settings.source.blobs_path and not state().doing)
    seen["found"] = [
        Path(settings.source.blobs_path).name,
        settings.source.rate,
        settings.source.first_frame,
        settings.source.last_frame,
    ]
    seen["files"] = sorted(path.name for path in Path(task["movies"]).iterdir())
    yield from window.look_through_first()
    yield from window.screenshot("pictures-2-found")
    bpy.ops.ed.undo()
    yield 1
    seen["taken back"] = bpy.context.scene.mocap_autolabel.source.blobs_path
    (OUT / "seen.json").write_text(json.dumps(seen, indent=1))


def state() -> bpy.types.PropertyGroup:
    """What the sidebar knows."""
    return bpy.context.window_manager.mocap_autolabel


window.play(walk())
