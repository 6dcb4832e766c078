# SPDX-License-Identifier: GPL-3.0-or-later
"""Label Folder: a folder of takes labelled in the background by the command line, and its takes in the sidebar."""

import importlib
import shutil
import time
from types import SimpleNamespace

import bpy
import pytest

from addon.io.batch import read_table
from addon.io.blobs import write_blobs
from addon.io.cameras import write_cameras
from addon.io.markersets import write_markerset
from addon.scene.take import is_take

PATIENCE = 120.0  # s; a busy machine labels slowly


@pytest.fixture(scope="module")
def files(tmp_path_factory, made):
    """A calibration, a marker set, and a folder with a take of blobs and one that is none."""
    folder = tmp_path_factory.mktemp("files")
    markerset, cameras = made.markerset(), made.cameras()
    blobs, _ = made.blobs(markerset, cameras, made.motion(markerset, 6))
    (folder / "in").mkdir()
    write_cameras(folder / "room.toml", cameras)
    write_markerset(folder / "small.markerset.json", markerset)
    write_blobs(folder / "in" / "walk.csv", blobs, cameras)
    (folder / "in" / "bad.csv").write_text("no,blobs\n")
    return folder


@pytest.fixture
def ready(extension, empty, files, tmp_path):
    """A scene in which only the button is left to press."""
    settings = empty.scene.mocap_autolabel
    bpy.ops.mocap_autolabel.import_cameras(filepath=str(files / "room.toml"))
    bpy.ops.mocap_autolabel.open_markerset(filepath=str(files / "small.markerset.json"))
    settings.folder.path, settings.folder.out = str(files / "in"), str(tmp_path / "out")
    settings.source.rate = 60.0
    module = importlib.import_module(f"{extension}.addon.ops.label_folder")
    yield SimpleNamespace(context=empty, settings=settings, module=module, out=tmp_path / "out")
    module.leave_batch()


def state():
    return bpy.context.window_manager.mocap_autolabel


def test_a_folder_is_labelled_and_its_takes_opened(ready):
    assert bpy.ops.mocap_autolabel.label_folder() == {"FINISHED"}
    rows = [(row.name, row.state, row.measured) for row in state().folder_takes]
    assert rows == [("bad", "failed", False), ("walk", "labelled", True)]
    assert "holds neither blobs nor 3D points" in state().folder_takes[0].reason
    assert (state().folder_doing, state().folder_said) == ("", "")
    assert (ready.out / "walk.report.html").is_file()
    with pytest.raises(RuntimeError, match="is not there; expected a take that Label Folder labelled"):
        bpy.ops.mocap_autolabel.open_folder_take(index=0)
    with pytest.raises(RuntimeError, match="no take is chosen"):
        bpy.ops.mocap_autolabel.open_folder_take(index=5)
    assert bpy.ops.mocap_autolabel.open_folder_take(index=1) == {"FINISHED"}
    assert is_take(bpy.context.scene.mocap_autolabel.take)
    assert [row.name for row in state().folder_takes] == ["bad", "walk"]


def test_a_folder_that_is_watched_goes_on_beside_blender_until_it_is_stopped(ready, files):
    settings, module = ready.settings, ready.module
    settings.folder.watch = True
    line, table, blobs = module.folder_line(settings)
    assert blobs
    assert "--idle=0" not in line
    batch = module.FolderBatch(
        line, table, module.scene_cameras.cameras_of(settings.source.cameras, ready.context.scene)
    )
    module._latest[:] = module._going[:] = [batch]
    assert not bpy.ops.mocap_autolabel.label_folder.poll()
    until = time.monotonic() + PATIENCE
    while state().folder_doing != "2 of 2 takes, 1 failed":
        assert module.follow() == module.FOLLOWED_EVERY
        assert time.monotonic() < until
        time.sleep(0.05)
    assert state().folder_share == 1.0
    assert bpy.ops.mocap_autolabel.stop_folder() == {"FINISHED"}
    while module.follow() is not None:
        assert time.monotonic() < until
        time.sleep(0.05)
    assert (state().folder_doing, state().folder_said, module.follow()) == ("", "", None)
    assert [row.state for row in read_table(table)] == ["failed", "labelled"]
    assert bpy.ops.mocap_autolabel.label_folder.poll()


def test_what_stops_a_folder_is_said(ready, files, tmp_path):
    settings = ready.settings
    settings.folder.path = ""
    assert not bpy.ops.mocap_autolabel.label_folder.poll()
    settings.folder.path = str(tmp_path / "none")
    with pytest.raises(RuntimeError, match="is no folder; expected one with takes"):
        bpy.ops.mocap_autolabel.label_folder()
    settings.folder.path = str(files / "in")
    ready.out.mkdir()
    shutil.copy(files / "in" / "walk.csv", ready.out / "summary.csv")
    with pytest.raises(RuntimeError, match="exists already"):
        bpy.ops.mocap_autolabel.label_folder()
    assert "exists already" in state().folder_said
