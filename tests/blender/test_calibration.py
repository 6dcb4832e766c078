# SPDX-License-Identifier: GPL-3.0-or-later
"""Refine Calibration in Blender: the new file is written and chosen, errors are told, what is good stays."""

import json
from pathlib import Path
from types import SimpleNamespace

import bpy
import pytest

from addon.io.cameras import read_cameras, write_cameras
from addon.scene import cameras as scene_cameras
from addon.scene.cameras import kept_health, kept_refinement
from tests.blender.conftest import open_room, write_room
from tests.core.calibration.test_adjusting import image_error, moved

from .hands import ours, refused

MOVED = 2


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    """The true room, one in which a camera was moved since, and a second of blobs."""
    files = write_room(tmp_path_factory.mktemp("files"), 60)
    write_cameras(files.folder / "moved.toml", moved(files.room, [MOVED], 0.3, 10, seed=3))
    return files


@pytest.fixture
def scene(extension, empty, files):
    """A function that makes a scene in which only *Refine Calibration* is left to press, of a room."""

    def make(room: str):
        open_room(SimpleNamespace(**vars(files) | {"cameras": str(files.folder / room)}))
        return empty.scene

    return make


def test_a_moved_camera_is_refined_and_the_new_file_chosen(scene, files):
    made = scene("moved.toml")
    settings, true = made.mocap_autolabel, files.room
    scene_cameras.look_through(made, settings.source.cameras.objects[MOVED])
    before = settings.source.cameras
    assert bpy.ops.mocap_autolabel.refine_calibration() == {"FINISHED"}
    path = files.folder / "walk.refined.toml"
    written, chosen = read_cameras(path), scene_cameras.cameras_of(settings.source.cameras, made)
    assert settings.source.cameras != before
    assert before.hide_viewport
    assert image_error(written, true).max() < 0.2
    assert image_error(chosen, written).max() < 0.01
    assert scene_cameras.camera_name(made.camera) == true.names[MOVED]
    assert made.camera.name in settings.source.cameras.objects
    report = kept_refinement(settings.source.cameras)
    assert Path(report["out"]) == path
    moved_row = report["cameras"][true.names[MOVED]]
    assert moved_row["after_px"] < 0.2 < moved_row["before_px"]
    # With the cameras as they are now there is nothing left to do, and nothing is written.
    assert bpy.ops.mocap_autolabel.refine_calibration() == {"FINISHED"}
    assert sorted(each.name for each in files.folder.glob("*.refined.toml")) == ["walk.refined.toml"]
    assert kept_refinement(settings.source.cameras) == report
    path.unlink()


def test_cameras_that_were_changed_meanwhile_stay(extension, scene, files, monkeypatch):
    made = scene("moved.toml")
    settings = made.mocap_autolabel
    module = ours("ops.calibration")
    other = scene_cameras.add_cameras(made, files.room)

    def changed_meanwhile(_):
        yield 0.5
        settings.source.cameras = other
        report = {"cameras": {"cam 0": {"before_px": 2.0, "after_px": 0.4}}, "camera_doubts": [], "refined": True}
        return module.Refined({**report, "out": "there/new.toml"}, files.room)

    monkeypatch.setattr(module, "beside", changed_meanwhile)
    refused(r"which are in new\.toml; expected them to stay", "refine_calibration")
    assert settings.source.cameras == other
    assert not other.hide_viewport


def test_the_panel_tells_errors_and_offers_to_label_again(extension, scene, files):
    made = scene("room.toml")
    panel = ours("ui.panels")
    settings = made.mocap_autolabel
    row = {"before_px": 2.19, "after_px": 0.41}
    settings.source.cameras["mocap_refined"] = json.dumps({"cameras": {"cam 0": row, "cam 1": dict.fromkeys(row)}})
    said, buttons = [], []

    class Layout:
        def __getattr__(self, name):
            return lambda *given, **more: self

        def label(self, text="", icon="NONE"):
            said.append(text)

        def operator(self, name, text="", icon="NONE"):
            buttons.append((name, text))

    draw = panel.calibration.draw
    draw(SimpleNamespace(layout=Layout()), bpy.context)
    assert buttons == [("mocap_autolabel.refine_calibration", ""), ("mocap_autolabel.label", "Label Again")]
    assert said[-6:] == ["cam 0", "2.19 px", "0.41 px", "cam 1", "–", "–"]
    assert "Shown when a take is labelled" in said


def test_what_is_odd_about_cameras_stays_with_the_take(scene, files):
    made = scene("moved.toml")
    assert bpy.ops.mocap_autolabel.label() == {"FINISHED"}
    [words] = kept_health(made.mocap_autolabel.take)
    assert words.startswith(f"camera {files.room.names[MOVED]} seems to have moved since the calibration")


def test_without_cameras_or_blobs_the_button_says_why(extension, empty, files):
    module = ours("ops.calibration")
    operator, said = module.MOCAP_AUTOLABEL_OT_refine_calibration, []
    cls = SimpleNamespace(poll_message_set=said.append, lacks=operator.lacks)
    assert not operator.poll.__func__(cls, empty)
    assert bpy.ops.mocap_autolabel.import_cameras(filepath=str(files.folder / "room.toml")) == {"FINISHED"}
    assert not operator.poll.__func__(cls, empty)
    empty.scene.mocap_autolabel.source.points_path = "walk.c3d"
    assert not operator.poll.__func__(cls, empty)
    assert [words.split(":")[0] for words in said] == [
        "Import the calibration of the cameras first",
        "Import the blobs first",
        "3D points need no cameras",
    ]
