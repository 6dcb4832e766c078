# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker set of one's own, learned from labelled takes in the sidebar, and used at once."""

import importlib
from pathlib import Path
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.data.takes import Points
from addon.io.models import open_model
from addon.io.points import write_c3d


@pytest.fixture(scope="module")
def files(tmp_path_factory, made):
    """Two labelled takes of one person and one without labels."""
    folder = tmp_path_factory.mktemp("lessons")
    markerset = made.markerset()
    for name, names in (("one", markerset.markers), ("two", markerset.markers), ("raw", [""] * len(markerset))):
        motion = made.motion(markerset, 60)
        residual = np.where(np.isfinite(motion.markers[..., 0]), 0.0, np.nan)
        write_c3d(folder / f"{name}.c3d", Points(tuple(names), motion.markers, residual, 60.0, 1))
    return SimpleNamespace(folder=folder, markers=markerset.markers)


@pytest.fixture
def listed(extension, empty, files):
    """A scene with both takes in the list."""
    chosen = [{"name": "one.c3d"}, {"name": "two.c3d"}]
    assert bpy.ops.mocap_autolabel.add_lessons(directory=str(files.folder), files=chosen) == {"FINISHED"}
    return empty


@pytest.fixture
def own_folder(extension, monkeypatch, tmp_path):
    """The folder of the user's own marker sets, for this test alone."""
    for module in ("ops.training", "props"):
        found = importlib.import_module(f"{extension}.addon.{module}")
        monkeypatch.setattr(found, "markerset_folder", lambda create=False: tmp_path)
    return tmp_path


def test_takes_are_listed_once_with_their_subject(listed, files):
    lessons = listed.scene.mocap_autolabel.lessons
    assert [(row.name, row.markers, row.subject) for row in lessons] == [
        ("one.c3d", 13, files.folder.name),
        ("two.c3d", 13, files.folder.name),
    ]
    bpy.ops.mocap_autolabel.add_lessons(filepath=str(files.folder / "one.c3d"))
    assert len(lessons) == 2
    with pytest.raises(RuntimeError, match=r"raw\.c3d: has no named markers"):
        bpy.ops.mocap_autolabel.add_lessons(filepath=str(files.folder / "raw.c3d"))
    listed.scene.mocap_autolabel.lesson_index = 1
    bpy.ops.mocap_autolabel.remove_lesson()
    assert [row.name for row in lessons] == ["one.c3d"]
    assert listed.scene.mocap_autolabel.lesson_index == 0


def test_what_was_learned_is_saved_chosen_and_names_points(listed, files, own_folder):
    settings = listed.scene.mocap_autolabel
    settings.trained_name = "ours"
    settings.lessons[1].subject = "bob"
    assert bpy.ops.mocap_autolabel.train() == {"FINISHED"}
    path = own_folder / "ours.markerset.json"
    assert Path(settings.markerset) == Path(settings.markerset_path) == path
    model = open_model(path)
    assert model.markerset.markers == files.markers
    assert {lesson.subject for lesson in model.lessons} == {files.folder.name, "bob"}
    with pytest.raises(RuntimeError, match=r"ours\.markerset\.json: is there already"):
        bpy.ops.mocap_autolabel.train()

    bpy.ops.mocap_autolabel.import_points(filepath=str(files.folder / "raw.c3d"))
    assert bpy.ops.mocap_autolabel.label() == {"FINISHED"}
    take = importlib.import_module("addon.scene.take").stored_take(settings.take, listed.scene)
    named = take.labels.marker >= 0
    assert named.mean() > 0.8
    assert (take.labels.marker[named] == take.blobs.camera[named]).all()


def test_a_job_is_what_the_list_says(listed, files, own_folder, extension, monkeypatch):
    given = []

    def train_file(job):
        given.append(job)
        yield SimpleNamespace(fraction=0.5)
        body = {"segments": {"all": list(files.markers)}}
        known = {"out": str(job.out), "model": "mine", "markers": files.markers, "body": body}
        return {**known, "doubts": ["one subject"], "replaced": []}

    monkeypatch.setattr(importlib.import_module(f"{extension}.addon.jobs.train"), "train_file", train_file)
    settings = listed.scene.mocap_autolabel
    settings.lessons[0].subject = "ann [2]"
    assert bpy.ops.mocap_autolabel.train() == {"FINISHED"}
    job = given[0]
    assert [path.name for path in job.takes] == ["one.c3d", "two.c3d"]
    assert (job.name, job.base, job.overwrite) == ("mine", None, False)
    assert [name for name, _ in job.subjects] == ["ann [2]", files.folder.name]
    assert [row.name for row in listed.window_manager.mocap_autolabel.doubts] == ["one subject"]
    settings.train_on = True
    bpy.ops.mocap_autolabel.train()
    assert (given[1].base, given[1].out, given[1].overwrite) == (str(job.out), job.out, True)
    settings.markerset = "gait15"
    settings.trained_name = "../elsewhere"
    with pytest.raises(RuntimeError, match="no name for a marker set"):
        bpy.ops.mocap_autolabel.train()


def test_nothing_can_be_learned_from_nothing(extension, empty):
    with pytest.raises(RuntimeError, match="Add labelled takes first"):
        bpy.ops.mocap_autolabel.train()
