# SPDX-License-Identifier: GPL-3.0-or-later
"""Label Folder: a folder of takes labelled in the background by the command line, and its takes in the sidebar."""

import shutil
import time
from types import SimpleNamespace

import bpy
import pytest

from addon.core.pipelines.known_sets import HOW_TO_CHOOSE, HOW_TO_FIND, HOW_TO_TURN
from addon.core.points.possible import HOW_TO_MIRROR
from addon.core.points.refusals import HOW_TO_ASK
from addon.io.batch import read_table
from addon.scene.take import is_take

from .conftest import write_room
from .hands import ours, press, refused, session

PATIENCE = 120.0  # s; a busy machine labels slowly


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """A calibration, a marker set, and a folder with a take of blobs and one that is none."""
    files = write_room(tmp_path_factory.mktemp("files"), 6)
    (files.folder / "in").mkdir()
    shutil.move(files.blobs, files.folder / "in")
    (files.folder / "in" / "bad.csv").write_text("no,blobs\n")
    return files.folder


@pytest.fixture
def ready(empty, settings, files, tmp_path):
    """A scene in which only the button is left to press."""
    press("import_cameras", filepath=files / "room.toml")
    press("open_markerset", filepath=files / "small.markerset.json")
    settings.folder.path, settings.folder.out = str(files / "in"), str(tmp_path / "out")
    settings.source.rate = 60.0
    module = ours("ops.label_folder")
    yield SimpleNamespace(context=empty, settings=settings, module=module, out=tmp_path / "out")
    module.leave_batch()


def test_a_folder_is_labelled_and_its_takes_opened(ready):
    press("label_folder")
    rows = [(row.name, row.state, row.measured) for row in session().folder_takes]
    assert rows == [("bad", "failed", False), ("walk", "labelled", True)]
    assert "holds neither blobs nor 3D points" in session().folder_takes[0].reason
    assert (session().folder_doing, session().folder_trouble) == ("", "")
    assert (ready.out / "walk.report.html").is_file()
    refused("is not there; expected a take that Label Folder labelled", "open_folder_take", index=0)
    refused("no take is chosen", "open_folder_take", index=5)
    press("open_folder_take", index=1)
    assert is_take(bpy.context.scene.mocap_autolabel.take)
    assert [row.name for row in session().folder_takes] == ["bad", "walk"]


def test_where_all_takes_are_labelled_nothing_is_said(ready, files, tmp_path):
    (tmp_path / "alone").mkdir()
    shutil.copy(files / "in" / "walk.csv", tmp_path / "alone")
    ready.settings.folder.path = str(tmp_path / "alone")
    press("label_folder")
    assert ([row.state for row in session().folder_takes], session().folder_trouble) == (["labelled"], "")


def test_a_folder_that_is_watched_goes_on_beside_blender_until_it_is_stopped(ready, files):
    settings, module = ready.settings, ready.module
    settings.folder.watch = True
    line, table, blobs = module.folder_line(settings)
    assert blobs
    assert "--idle=0" not in line
    batch = module.FolderBatch(
        line, table, module.scene_cameras.cameras_of(settings.source.cameras, ready.context.scene)
    )
    module._latest[:] = [batch]
    assert not bpy.ops.mocap_autolabel.label_folder.poll()
    until = time.monotonic() + PATIENCE
    while session().folder_doing != "2 of 2 takes, 1 failed":
        assert module.follow() == module.FOLLOWED_EVERY
        assert time.monotonic() < until
        time.sleep(0.05)
    assert session().folder_share == 1.0
    press("stop_folder")
    while module.follow() is not None:
        assert time.monotonic() < until
        time.sleep(0.05)
    assert (session().folder_doing, session().folder_trouble, module.follow()) == ("", "", None)
    assert [row.state for row in read_table(table)] == ["failed", "labelled"]
    assert bpy.ops.mocap_autolabel.label_folder.poll()


def test_what_can_be_done_about_a_take_is_told_as_in_the_sidebar(extension):
    told = {"take": "walk", "state": "failed", "at_stake": 0, "measured": False, "trouble": 0, "on_body": 0}
    reason = (
        f"expected one, {HOW_TO_CHOOSE} body39; {HOW_TO_FIND}; or {HOW_TO_TURN} y; or {HOW_TO_ASK}; or {HOW_TO_MIRROR}"
    )
    _, _, words, *_ = ours("ops.label_folder")._row(SimpleNamespace(**told, reason=reason, named=None, found=0.0))
    assert "--" not in words and "MODEL" not in words
    assert "under Marker Set, as body39" in words


def test_what_stops_a_folder_is_said(ready, files, tmp_path):
    settings = ready.settings
    settings.folder.path = ""
    assert not bpy.ops.mocap_autolabel.label_folder.poll()
    settings.folder.path = str(tmp_path / "none")
    refused("is no folder; expected one with takes", "label_folder")
    settings.folder.path = str(files / "in")
    ready.out.mkdir()
    shutil.copy(files / "in" / "walk.csv", ready.out / "summary.csv")
    refused("exists already", "label_folder")
    assert "exists already" in session().folder_trouble
