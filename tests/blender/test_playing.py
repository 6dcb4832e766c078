# SPDX-License-Identifier: GPL-3.0-or-later
"""A take that plays from a file moves as with keys, keeps its size whatever its length, and tells of its file."""

import shutil
from dataclasses import fields, replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.data.takes import Motion, Suspect
from addon.io.poses import PoseFile
from addon.scene import naming, playing
from addon.scene import take as takes


def places(context, collection, frames):
    """Where markers, by name, and bones are in frames that Blender counts: (F, M, 3) and (F, J, 4, 4)."""
    empties = sorted(
        (one for one in collection.all_objects if naming.MARKER in one), key=lambda one: one[naming.MARKER]
    )
    armatures = [one for one in collection.all_objects if one.type == "ARMATURE"]
    markers, bones = [], []
    for frame in frames:
        context.scene.frame_set(int(frame))
        graph = context.evaluated_depsgraph_get()
        markers.append([one.evaluated_get(graph).matrix_world.translation[:] for one in empties])
        bones.append([np.array(bone.matrix) for one in armatures for bone in one.evaluated_get(graph).pose.bones])
    return np.array(markers), np.array(bones)


def saved(context, take, folder, size=3):
    """The take saved as one that plays from a file beside it."""
    motion, folder = take.motion, folder / "out"
    folder.mkdir()
    with PoseFile(folder.parent) as poses:
        for start in range(0, len(motion.frames), size):
            part = slice(start, start + size)
            poses.append(Motion(*(getattr(motion, field.name)[part] for field in fields(Motion))))
        asked = playing.Playing(
            "walk", take.rate, take.markerset, lambda part: motion.markers[part], poses, take.suspects, "walk.csv"
        )
        playing.show_playing(context, asked, folder / "walk.motion.pc2")
    bpy.ops.wm.save_as_mainfile(filepath=str(folder / "walk.blend"))
    return folder / "walk.blend"


def opened(path):
    bpy.ops.wm.open_mainfile(filepath=str(path))
    [collection] = playing.played_takes(bpy.context.scene)
    return collection


@pytest.fixture
def both(empty, made, tmp_path):
    """Where all is with keys, and the saved file of the same take that plays."""
    take = made.take()
    markers = take.motion.markers.copy()
    markers[2:4, 1] = np.nan
    take = replace(take, motion=replace(take.motion, markers=markers))
    collection = takes.show_take(empty, take)
    frames = take.motion.frames
    keyed = places(empty, collection, frames)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    path = saved(bpy.context, take, tmp_path)
    return SimpleNamespace(path=path, frames=frames, keyed=keyed, take=take)


def test_it_moves_as_with_keys(both):
    collection = opened(both.path)
    markers, bones = places(bpy.context, collection, both.frames)
    np.testing.assert_allclose(markers, both.keyed[0], atol=1e-6)
    np.testing.assert_allclose(bones, both.keyed[1], atol=2e-6)
    assert np.ptp(markers, axis=0).max() > 0.01  # or nothing was tried
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end) == (both.frames[0], both.frames[-1])
    assert not bpy.data.actions
    assert not takes.is_take(collection)


def test_it_moves_when_saved_elsewhere_and_opened_from_there(both, tmp_path):
    opened(both.path)
    other = tmp_path / "other"
    other.mkdir()
    bpy.ops.wm.save_as_mainfile(filepath=str(other / "again.blend"))
    markers, _ = places(bpy.context, opened(other / "again.blend"), both.frames)
    np.testing.assert_allclose(markers, both.keyed[0], atol=1e-6)


def test_the_file_is_told_of_and_found_again(both, tmp_path):
    collection = opened(both.path)
    assert playing.what_is_wrong(collection) == ""
    motion = playing.motion_path(collection)
    elsewhere = tmp_path / "elsewhere.pc2"
    shutil.move(motion, elsewhere)
    assert "is not there" in playing.what_is_wrong(collection)
    playing.find_motion(collection, elsewhere)
    assert playing.what_is_wrong(collection) == ""
    markers, _ = places(bpy.context, collection, both.frames)
    np.testing.assert_allclose(markers, both.keyed[0], atol=1e-6)
    with elsewhere.open("r+b") as file:
        file.truncate(100)
    assert "is shorter" in playing.what_is_wrong(collection)


def test_what_to_look_at_is_bounded_and_kept(both, tmp_path, monkeypatch):
    monkeypatch.setattr(playing, "MOST_SUSPECTS", 2)
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    suspects = (Suspect(3, 9, "long"), Suspect(5, 5, "short"), Suspect(1, 4, "middling"))
    folder = tmp_path / "more"
    folder.mkdir()
    collection = opened(saved(bpy.context, replace(both.take, suspects=suspects), folder))
    assert [(first, last, reason) for first, last, reason in playing.suspects_of(collection)] == [
        (1, 4, "middling"),
        (3, 9, "long"),
    ]


def test_the_sidebars_operators_step_and_find(extension, both, tmp_path):
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    folder = tmp_path / "more"
    folder.mkdir()
    suspects = (Suspect(2, 3, "one"), Suspect(4, 4, "two"))
    path = saved(bpy.context, replace(both.take, suspects=suspects), folder)
    collection, scene = opened(path), bpy.context.scene
    scene.frame_set(1)
    assert bpy.ops.mocap_autolabel.next_suspect() == {"FINISHED"}
    assert scene.frame_current == 2
    bpy.ops.mocap_autolabel.next_suspect()
    assert scene.frame_current == 4
    assert bpy.ops.mocap_autolabel.next_suspect() == {"CANCELLED"}
    bpy.ops.mocap_autolabel.next_suspect(back=True)
    assert scene.frame_current == 2
    playing.modifier_of(collection).filepath = "//gone/walk.motion.pc2"
    assert "is not there" in playing.what_is_wrong(collection)
    assert bpy.ops.mocap_autolabel.find_motion() == {"FINISHED"}
    assert playing.what_is_wrong(collection) == ""
    shutil.move(folder / "out" / "walk.motion.pc2", folder / "hidden.pc2")
    with pytest.raises(RuntimeError, match="not beside the Blender file"):
        bpy.ops.mocap_autolabel.find_motion()
    with pytest.raises(RuntimeError, match="plays from a file and has no keys"):
        bpy.ops.mocap_autolabel.fill_gaps()
