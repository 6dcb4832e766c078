# SPDX-License-Identifier: GPL-3.0-or-later
"""`label`: the files, the options, and takes that a model is not for."""

import csv
import json
import shutil
from dataclasses import dataclass
from pathlib import Path

import ezc3d
import numpy as np
import pytest

from addon import blendfile
from addon.cli import main
from addon.demo.take import MODEL
from addon.io.markersets import open_markerset
from addon.io.models import open_model
from tests.accuracy import real_blobs
from tests.accuracy.registry import recorded

from .conftest import FRAMES, report_of, rows_of


@dataclass
class Done:
    """A take that was labelled: the folder of its results, and its labels."""

    out: Path
    labels: list[dict[str, str]]


@pytest.fixture(scope="module")
def done(room, tmp_path_factory) -> Done:
    out = tmp_path_factory.mktemp("done")
    words = ["label", room.blobs, "--model", MODEL, "--cameras", room.cameras, "--rate", "60", "--trc", "--out", out]
    assert main([str(word) for word in words]) == 0
    return Done(out, rows_of(out / "walk.labels.csv"))


def test_labels_are_right_and_have_every_row_of_the_input_in_its_order_and_its_own_text(done, room, figures):
    assert list(done.labels[0]) == ["frame", "camera", "x", "y", "marker", "step", "confidence"]
    with room.blobs.open(newline="") as file:
        assert [list(row.values())[:4] for row in done.labels] == [row[:4] for row in list(csv.reader(file))[1:]]
    assert {row["step"] for row in done.labels} <= {"", "exclusive", "conflict", "remaining"}
    assert all((row["marker"] == "") == (row["step"] == "") for row in done.labels)
    assert all(0 <= float(row["confidence"]) <= 1 for row in done.labels)
    found = figures(done.out / "walk.labels.csv", room.truth)
    assert found["precision"] > 0.995
    assert found["recall"] > 0.97
    assert found["rows_without_truth"] == 0


def test_c3d_has_the_models_markers_and_the_takes_frames_and_the_report_what_the_contract_asks(done):
    take = ezc3d.c3d(str(done.out / "walk.c3d"))
    markers = open_markerset(MODEL).markers
    assert tuple(take["parameters"]["POINT"]["LABELS"]["value"][: len(markers)]) == markers
    assert take["header"]["points"]["first_frame"] + 1 == FRAMES[0]
    assert take["header"]["points"]["frame_rate"] == 60
    assert take["data"]["points"].shape[2] == FRAMES[1] - FRAMES[0] + 1
    assert np.nanmax(take["data"]["points"][2]) > 1000
    assert (done.out / "walk.trc").read_text().startswith("PathFileType\t4\t(X/Y/Z)")
    report = report_of(done.out / "walk.c3d")
    assert {"take", "model", "frames", "rate", "markers", "unlabelled", "suspect", "timing", "version"} <= set(report)
    assert {"load", "place", "fit", "label", "write", "frames_per_second"} <= set(report["timing"])
    assert (report["take"], report["model"], report["frames"], report["rate"]) == ("walk", MODEL, 20, 60)
    assert (report["model_version"], report["model_fingerprint"]) == (1, open_model(MODEL).fingerprint)
    assert not report["rate_assumed"]
    assert set(report["steps"]) == {"exclusive", "conflict", "remaining"}


def test_options_are_followed_and_the_results_are_one_object(label, tmp_path):
    hints = "--height", "1.7", "--facing", "-30", "--method", "fit"
    answer = label("--json", "--progress", "--frames", "105:109", *hints)
    assert answer.err.startswith("walk: ")
    report = report_of(tmp_path / "out" / "walk.c3d")
    assert json.loads(answer.out) == {"takes": [report], "failed": []}
    assert (report["rate"], report["rate_assumed"]) == (100, True), "nobody gave it"
    frames = {row["frame"] for row in rows_of(tmp_path / "out" / "walk.labels.csv")}
    assert frames == {"105", "106", "107", "108", "109"}
    old = (tmp_path / "out" / "walk.report.json").read_bytes()
    assert "exists already" in label().reason
    assert (tmp_path / "out" / "walk.report.json").read_bytes() == old
    assert label("--overwrite", "--frames", "105:109", "--rate", "50").status == 0
    assert (tmp_path / "out" / "walk.report.json").read_bytes() != old


def test_inputs_that_would_have_the_same_results_are_refused_before_any_work(label, room, tmp_path):
    (tmp_path / "copy").mkdir()
    twin = tmp_path / "copy" / "Walk.csv"
    shutil.copy(room.blobs, twin)
    assert "same results" in label(blobs=[room.blobs, twin]).reason
    assert not (tmp_path / "out").exists()


@pytest.mark.blender
def test_blend_holds_the_take(label, tmp_path):
    assert label("--blend", "--rate", "60").status == 0
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "walk.blend"))
    assert set(open_markerset(MODEL).markers) <= {thing.name for thing in bpy.data.objects}
    assert any(thing.type == "ARMATURE" for thing in bpy.data.objects)
    assert (bpy.context.scene.frame_start, bpy.context.scene.frame_end) == FRAMES
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    again = label("--overwrite", "--rate", "60", cameras=shutil.copy(tmp_path / "out" / "walk.blend", tmp_path))
    assert (again.status, again.err) == (0, "")
    assert "20 frames" in again.out


def test_without_blender_no_blend(label, monkeypatch):
    monkeypatch.setattr("addon.cli.label.options.has_blender", lambda: False)
    assert "--blend needs Blender" in label("--blend").reason


@pytest.mark.parametrize("axis", ["x", "-y"])
def test_a_take_with_another_axis_up_says_which(run, room, tmp_path, axis):
    reason = run("label", room.c3d, "--model", MODEL, "--up", axis, "--out", tmp_path / "out").refusal(1)
    words = (
        f"stands with z up, as which it looks like a take of model {MODEL}; expected that axis to be given, by --up z"
    )
    assert reason.endswith(f"{words}; --force goes on regardless")


def test_a_take_of_another_marker_set_says_which_and_is_named_where_it_is_forced(run, room, tmp_path):
    words = "label", room.c3d, "--model", "actor41", "--out", tmp_path / "out"
    reason = run(*words).refusal(1)
    assert "does not look like a take of model actor41" in reason
    assert reason.endswith(f"it looks like a take of {MODEL}; --force goes on regardless")
    assert run(*words, "--force").status == 0
    assert report_of(tmp_path / "out" / f"{room.c3d.stem}.labels.csv")["model"] == "actor41"


@pytest.mark.blender
def test_rays_are_cast_where_nobody_chose_inside_blender(label, tmp_path, monkeypatch):
    """And they are what the labelling asks: without them nothing is looked up in a mesh."""
    from addon.scene.occlusion import MeshOcclusion  # and with it bpy: from here on this is Blender

    asked = []
    hidden = MeshOcclusion.hidden
    monkeypatch.setattr(MeshOcclusion, "hidden", lambda self, *given: asked.append(self) or hidden(self, *given))
    assert label("--occlusion", "capsules", "--frames", "100:101").status == 0
    assert not asked
    assert label("--overwrite", "--frames", "100:101").status == 0
    assert asked
    assert json.loads((tmp_path / "out" / "walk.report.json").read_text())["occlusion"] == "bvh"


def test_without_blender_rays_are_refused_and_the_closed_form_is_the_default(label, tmp_path, monkeypatch):
    monkeypatch.setattr(blendfile, "has_blender", lambda: False)
    monkeypatch.setattr("addon.jobs.job.inside_blender", lambda: False)
    reason = label("--occlusion", "bvh", "--frames", "100:101").refusal(2)
    assert "--occlusion bvh needs Blender or the bpy package" in reason
    assert not (tmp_path / "out" / "walk.labels.csv").exists()
    assert label("--frames", "100:101").status == 0
    assert json.loads((tmp_path / "out" / "walk.report.json").read_text())["occlusion"] == "capsules"


@pytest.mark.slow
def test_a_person_learned_from_the_first_half_is_named_in_the_second(shared_data, tmp_path):
    """Floors a little below what was measured (results/real_blobs.json): 99.76 % of 103,414 labels, recall 99.64 %."""
    if not real_blobs.available():
        pytest.skip("the recorded blobs (../shared/data/blobs) are not on this machine")
    outcome = next(iter(recorded(tmp_path))).label()
    right, wrong, there = (int(count.sum()) for count in (outcome.right, outcome.wrong, outcome.there))
    assert right + wrong > 102_500
    assert wrong < 0.004 * (right + wrong)
    assert right > 0.994 * there
