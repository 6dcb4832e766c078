# SPDX-License-Identifier: GPL-3.0-or-later
"""What a hand does to the take of points of the fixture `labelled`, and what is seen then."""

import importlib
from pathlib import Path
from types import ModuleType

import bpy
import numpy as np
import pytest

from addon.scene import naming
from addon.scene.ownership import curves_of

MODULE = "bl_ext.mocap_tests.mocap_autolabel"
FRAMES = 30
GHOST = 18  # the trajectory that nobody wears; before it each is the marker of its number


def ours(name: str) -> ModuleType:
    """A module of the extension as the fixture `extension` has enabled it, such as "scene.opened"."""
    return importlib.import_module(f"{MODULE}.addon.{name}")


def stored_take():
    """The active take as the sidebar has it."""
    scene = bpy.context.scene
    return ours("scene.opened").opened.take(scene.mocap_autolabel.take, scene)


def shown(take: bpy.types.Collection | None = None) -> dict[str, bpy.types.Object]:
    """The empties of a take, or of the active one."""
    items = (take or bpy.context.scene.mocap_autolabel.take).all_objects
    return {item[naming.MARKER]: item for item in items if naming.MARKER in item}


def only(collection: bpy.types.Collection, kind: str) -> list[bpy.types.Object]:
    return [item for item in collection.all_objects if item.type == kind and naming.TAKE_ROOT not in item]


def bones(frames=range(101, 101 + FRAMES), home=None) -> np.ndarray:
    """(F, J, 4, 4) where the bones of the active take are."""
    scene = bpy.context.scene
    [armature] = only(home or scene.mocap_autolabel.take, "ARMATURE")
    now, found = scene.frame_current, []
    for frame in frames:
        scene.frame_set(frame)
        found.append([np.array(bone.matrix) for bone in armature.pose.bones])
    scene.frame_set(now)
    return np.array(found)


def add_object(name: str, data: bpy.types.ID | None = None) -> bpy.types.Object:
    """Something of a person's own in the scene, an empty unless it has data."""
    item = bpy.data.objects.new(name, data)
    bpy.context.scene.collection.objects.link(item)
    return item


def list_performers(folder: Path, *names: str):
    """Puts performers into the list, who wear the toy marker set of a folder."""
    subjects = bpy.context.scene.mocap_autolabel.subjects
    subjects.performing = "LISTED"
    for name in names:
        press("add_performer")
        row = subjects.performers[-1]
        row.name, row.markerset, row.markerset_path = name, "FILE", str(folder / "toy.markerset.json")


def session():
    """What the window shows and no file keeps: lists, what is picked, what is going on."""
    return bpy.context.window_manager.mocap_autolabel


def suspects() -> list[tuple[int, int, str]]:
    """What is doubted of the active take: first and last of Blender's frames, and why."""
    stored = stored_take()
    return [(stored.clock.shown(one.first), stored.clock.shown(one.last), one.reason) for one in stored.suspects]


def picked() -> list[int]:
    return [row.point for row in session().picked]


def choose(*names: str):
    """Selects markers, the first as the active one."""
    for item in bpy.context.selected_objects:
        item.select_set(False)
    for name in reversed(names):
        shown()[name].select_set(True)
        bpy.context.view_layer.objects.active = shown()[name]


def keys_of(name: str) -> np.ndarray:
    """(K, 4) the keyed frames of a marker, and where it is in them."""
    own = [curve for curve in curves_of(shown()[name]) if curve.data_path == "location"]
    keys = [np.array([key.co for key in curve.keyframe_points]) for curve in own]
    assert len(keys) in (0, 3)
    return np.column_stack([keys[0][:, 0], *(one[:, 1] for one in keys)]) if keys else np.empty((0, 4))


def follows(files, name: str, point: int, frames: slice = slice(None)):
    """Asserts that a marker is keyed where a trajectory is, in some of the take's frames, and there only."""
    keys = keys_of(name)
    wanted = np.arange(FRAMES)[frames]
    wanted = wanted[np.isfinite(files.xyz[wanted, point, 0])]
    mine = keys[np.isin(keys[:, 0], 101 + np.arange(FRAMES)[frames])]
    assert mine[:, 0].tolist() == (101 + wanted).tolist()
    np.testing.assert_allclose(mine[:, 1:], files.xyz[wanted, point], atol=1e-5)


def call(operator: str, *how: str | bool, **given) -> set[str]:
    """What an operator of ours comes to, as a script calls it; paths of files are given as they are."""
    given = {name: str(value) if isinstance(value, Path) else value for name, value in given.items()}
    return getattr(bpy.ops.mocap_autolabel, operator)(*how, **given)


def press(operator: str, *how: str | bool, **given):
    """Asserts that an operator of ours does what it is for."""
    assert call(operator, *how, **given) == {"FINISHED"}


def refused(words: str, operator: str, *how: str | bool, **given):
    """Asserts that an operator of ours ends with an error that says that."""
    with pytest.raises(RuntimeError, match=words):
        call(operator, *how, **given)


def out_of_another_file(path: Path, name: str, link: bool = True) -> bpy.types.Collection:
    """Saves the file, begins a new one, and brings a take into it, linked or appended; no scene has it yet."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.read_homefile(use_empty=True)
    with bpy.data.libraries.load(str(path), link=link) as (_, wanted):
        wanted.collections = [name]
    return wanted.collections[0]


def reopen(path: Path | str):
    """Saves the file and opens what was saved."""
    bpy.ops.wm.save_as_mainfile(filepath=str(path))
    bpy.ops.wm.open_mainfile(filepath=str(path))
