# SPDX-License-Identifier: GPL-3.0-or-later
"""Two markers of blobs that a lab wears the other way round: asked about once, answered by one blob or left unnamed."""

from dataclasses import replace
from types import SimpleNamespace

import bpy
import numpy as np
import pytest

from addon.core.data.progress import finished
from addon.core.review.trouble import OFF_BODY
from addon.io.blobs import write_blobs
from addon.io.cameras import write_cameras
from addon.io.models import open_model, write_model
from tests.core.pipelines.pair import CAMERAS, RATE, shot_of

from .hands import ours, press, reopen, session, stored_take

PAIR = "LTIB", "LANK"


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder, model = tmp_path_factory.mktemp("which"), open_model("gait15")
    own, order = model.markerset, np.arange(len(model.markerset))
    order[[own.by_name[name] for name in PAIR]] = [own.by_name[name] for name in PAIR[::-1]]
    worn = replace(own, name="worn", offsets=own.offsets[order], attachment=own.attachment[order])
    blobs, truth = shot_of(model, (1,))
    write_cameras(folder / "room.toml", CAMERAS)
    write_blobs(folder / "walk.csv", blobs, CAMERAS)
    write_model(folder / "worn.markerset.json", replace(model, markerset=worn))
    return SimpleNamespace(folder=folder, blobs=blobs, truth=np.array([one.removeprefix("1:") for one in truth]))


@pytest.fixture
def labelled(extension, empty, files):
    (files.folder / "walk.edits.json").unlink(missing_ok=True)
    press("import_cameras", filepath=files.folder / "room.toml")
    press("import_blobs", filepath=files.folder / "walk.csv")
    press("open_markerset", filepath=files.folder / "worn.markerset.json")
    settings = empty.scene.mocap_autolabel
    settings.source.rate, settings.labelling.occlusion = RATE, "capsules"
    press("label")
    return empty


def asked() -> list:
    """The rows of the list that are about the two."""
    scene = bpy.context.scene
    found = ours("scene.trouble").trouble_of(scene.mocap_autolabel.take, scene)
    return [one for one in found if set(one.markers) & set(PAIR)]


def named_right(files) -> list[float]:
    """The part of the blobs of each of the two that has its name."""
    stored = stored_take()
    return [(stored.labels.marker[files.truth == name] == stored.names.index(name)).mean() for name in PAIR]


def name_blob(files, name: str, frame: int, scope: str = "FRAME"):
    """Names a blob of a marker in the frame of that index."""
    bpy.context.scene.frame_set(int(files.blobs.frames[frame]))
    press("pick", point=int(np.flatnonzero((files.truth == name) & (files.blobs.frame == frame))[0]))
    press("name_point", marker=name, scope=scope)


def test_two_that_may_be_each_other_are_one_row_that_says_how_to_answer(labelled):
    [row] = asked()
    assert (row.first, row.last, row.answer, row.stake) == (1, 40, "Leave Unnamed", 80)
    assert "through a camera" in row.advice
    press("jump", frame=20, marker="SACR")
    ours("props").list_trouble()
    press("show_trouble", index=[line.reason for line in session().troubles].index(row.reason))
    assert labelled.scene.frame_current == 1


@pytest.mark.parametrize("name", PAIR)
@pytest.mark.parametrize(("frame", "scope"), [(0, "FRAME"), (35, "WHOLE")])
def test_one_blob_names_both_in_the_whole_take_also_by_command(labelled, files, name, frame, scope, tmp_path):
    assert named_right(files) == [0, 0]
    name_blob(files, name, frame, scope)
    assert [row.answered for row in asked()] == [True]
    press("label")
    assert named_right(files) == [1, 1]
    assert [row.answered for row in asked() if row.kind != OFF_BODY] == [True]
    press("save_corrections")
    press("export_labels", filepath=tmp_path / "walk.labels.csv")
    jobs = ours("jobs")
    given = files.folder / "walk.csv", files.folder / "room.toml", str(files.folder / "worn.markerset.json")
    finished(jobs.label_file(jobs.LabelJob(*given, tmp_path / "out", rate=RATE, html=True)))
    assert (tmp_path / "out/walk.labels.csv").read_text() == (tmp_path / "walk.labels.csv").read_text()
    assert ours("cli").main(["verify", str(tmp_path / "out")]) == 0
    assert "either way round" not in (tmp_path / "out/walk.report.html").read_text()


def test_what_is_left_unnamed_stays_so(labelled, files, tmp_path):
    ours("props").list_trouble()
    [row] = asked()
    press("accept_trouble", index=[line.reason for line in session().troubles].index(row.reason))
    assert [one.answered for one in asked()] == [True]
    for again in (lambda: press("label"), lambda: reopen(tmp_path / "walk.blend"), lambda: press("label")):
        again()
        assert [one for one in asked() if not one.answered] == []
        assert named_right(files) == [0, 0]
    press("clear_corrections")
    press("label")
    assert [one.answered for one in asked()] == [False]


def test_a_name_that_is_undone_asks_again(labelled, files):
    bpy.ops.ed.undo_push(message="before")
    name_blob(files, PAIR[0], 0)
    bpy.ops.ed.undo_push(message="named")
    assert [one.answered for one in asked()] == [True]
    bpy.ops.ed.undo()
    assert [one.answered for one in asked()] == [False]
    press("label")
    assert named_right(files) == [0, 0]


def test_how_sure_names_must_be_is_kept_with_the_take(labelled, tmp_path):
    labelled.scene.mocap_autolabel.labelling.target = 0.9
    reopen(tmp_path / "sure.blend")
    assert bpy.context.scene.mocap_autolabel.labelling.target == pytest.approx(0.9)
