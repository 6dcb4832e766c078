# SPDX-License-Identifier: GPL-3.0-or-later
"""`label`: the files, the options, and several takes."""

import csv
import json
import shutil

import ezc3d
import numpy as np
import pytest

from addon.blendfile import has_blender
from addon.demo.take import MODEL
from addon.io.markersets import open_markerset
from addon.io.models import open_model

from .conftest import FRAMES


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.reader(file))


def test_labels_have_every_row_of_the_input_in_its_order_and_its_own_text(label, room, tmp_path):
    answer = label()
    assert (answer.status, answer.err) == (0, "")
    labels, blobs = rows_of(tmp_path / "out" / "walk.labels.csv"), rows_of(room.blobs)
    assert labels[0] == ["frame", "camera", "x", "y", "marker", "step", "confidence"]
    assert [row[:4] for row in labels[1:]] == [row[:4] for row in blobs[1:]]
    assert {row[5] for row in labels[1:]} <= {"", "exclusive", "conflict", "remaining"}
    assert all((row[4] == "") == (row[5] == "") for row in labels[1:])
    assert all(0 <= float(row[6]) <= 1 for row in labels[1:])


def test_the_virtual_person_is_labelled_right(label, run, room, tmp_path):
    label()
    figures = json.loads(run("evaluate", tmp_path / "out" / "walk.labels.csv", room.truth, "--json").out)
    assert figures["precision"] > 0.995
    assert figures["recall"] > 0.97
    assert figures["rows_without_truth"] == 0


def test_c3d_has_the_models_markers_in_their_order_and_the_takes_frames(label, tmp_path):
    label("--rate", "60", "--trc")
    take = ezc3d.c3d(str(tmp_path / "out" / "walk.c3d"))
    markers = open_markerset(MODEL).markers
    assert tuple(take["parameters"]["POINT"]["LABELS"]["value"][: len(markers)]) == markers
    assert take["header"]["points"]["first_frame"] + 1 == FRAMES[0]
    assert take["header"]["points"]["frame_rate"] == 60
    assert take["data"]["points"].shape[2] == FRAMES[1] - FRAMES[0] + 1
    assert np.nanmax(take["data"]["points"][2]) > 1000
    assert (tmp_path / "out" / "walk.trc").read_text().startswith("PathFileType\t4\t(X/Y/Z)")


def test_report_says_what_the_contract_asks(label, tmp_path):
    answer = label("--json", "--rate", "60")
    report = json.loads((tmp_path / "out" / "walk.report.json").read_text())
    assert {"take", "model", "frames", "rate", "markers", "unlabelled", "suspect", "timing", "version"} <= set(report)
    assert {"load", "place", "fit", "label", "write", "frames_per_second"} <= set(report["timing"])
    assert (report["take"], report["model"], report["frames"], report["rate"]) == ("walk", MODEL, 20, 60)
    assert (report["model_version"], report["model_fingerprint"]) == (1, open_model(MODEL).fingerprint)
    assert not report["rate_assumed"]
    assert set(report["steps"]) == {"exclusive", "conflict", "remaining"}
    assert json.loads(answer.out) == {"takes": [report], "failed": []}


def test_a_rate_that_nobody_gave_is_said_to_be_assumed(label):
    [report] = json.loads(label("--json").out)["takes"]
    assert (report["rate"], report["rate_assumed"]) == (100, True)


def test_only_the_frames_asked_for(label, tmp_path):
    label("--frames", "105:109")
    frames = {row[0] for row in rows_of(tmp_path / "out" / "walk.labels.csv")[1:]}
    assert frames == {"105", "106", "107", "108", "109"}


def test_hints_are_taken(label):
    assert label("--height", "1.7", "--facing", "-30", "--method", "fit").status == 0


def test_an_existing_file_is_replaced_only_on_request(label, tmp_path):
    label()
    old = (tmp_path / "out" / "walk.report.json").read_bytes()
    assert "exists already" in label().reason
    assert (tmp_path / "out" / "walk.report.json").read_bytes() == old
    assert label("--overwrite", "--rate", "50").status == 0
    assert (tmp_path / "out" / "walk.report.json").read_bytes() != old


def test_a_take_that_fails_does_not_stop_the_others(label, room, tmp_path):
    broken = tmp_path / "broken.csv"
    broken.write_text("frame,camera,x,y\n1,nowhere,3,4\n")
    answer = label("--json", blobs=[broken, room.blobs])
    assert answer.status == 2
    assert "broken.csv:2: camera 'nowhere'" in answer.reason
    said = json.loads(answer.out)
    assert [take["take"] for take in said["takes"]] == ["walk"]
    assert [(take["take"], take["status"]) for take in said["failed"]] == [("broken", 2)]
    assert sorted(path.name for path in (tmp_path / "out").iterdir()) == [
        "walk.c3d",
        "walk.labels.csv",
        "walk.report.json",
    ]


def test_takes_side_by_side_are_the_same_as_one_after_the_other(label, room, tmp_path):
    other = tmp_path / "other.csv"
    shutil.copy(room.blobs, other)
    broken = tmp_path / "broken.csv"
    broken.write_text("")
    answer = label("--jobs", "2", "--json", blobs=[other, broken, room.blobs])
    assert answer.status == 2
    assert "broken.csv: is empty" in answer.reason
    said = json.loads(answer.out)
    assert [take["take"] for take in said["takes"]] == ["other", "walk"]
    together = (tmp_path / "out" / "walk.labels.csv").read_bytes()
    assert label("--overwrite").status == 0
    assert (tmp_path / "out" / "walk.labels.csv").read_bytes() == together


def test_inputs_that_would_have_the_same_results_are_refused_before_any_work(label, room, tmp_path):
    (tmp_path / "copy").mkdir()
    twin = tmp_path / "copy" / "Walk.csv"
    shutil.copy(room.blobs, twin)
    assert "same results" in label(blobs=[room.blobs, twin]).reason
    assert not (tmp_path / "out").exists()


def test_progress_only_on_request_where_nobody_watches(label):
    assert label("--progress").err.startswith("walk: ")


@pytest.mark.blender
@pytest.mark.skipif(not has_blender(), reason="needs bpy")
def test_blend_holds_the_take(label, tmp_path):
    assert label("--blend", "--rate", "60").status == 0
    import bpy

    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "out" / "walk.blend"))
    markers = open_markerset(MODEL).markers
    assert set(markers) <= {thing.name for thing in bpy.data.objects}
    assert any(thing.type == "ARMATURE" for thing in bpy.data.objects)
    assert (bpy.context.scene.frame_start, bpy.context.scene.frame_end) == FRAMES
    bpy.ops.wm.read_homefile(use_empty=True, use_factory_startup=True)
    again = label("--overwrite", "--rate", "60", cameras=shutil.copy(tmp_path / "out" / "walk.blend", tmp_path))
    assert (again.status, again.err) == (0, "")
    assert "20 frames" in again.out


def test_without_blender_no_blend(label, monkeypatch):
    monkeypatch.setattr("addon.cli.label.checks.has_blender", lambda: False)
    assert "--blend needs Blender" in label("--blend").reason


def test_cameras_with_each_others_names_are_named(label, room, tmp_path):
    mixed = tmp_path / "mixed.csv"
    other = {"cam2": "cam5", "cam5": "cam2"}
    rows = [line.split(",") for line in room.blobs.read_text().splitlines()]
    mixed.write_text("".join(",".join([row[0], other.get(row[1], row[1]), *row[2:]]) + "\n" for row in rows))
    words = "cameras cam2 and cam5 seem to have each other's names: exchanged, their blobs fit"
    answer = label("--rate", "60", blobs=[mixed])
    assert answer.status == 0
    assert f"mixed: {words}" in answer.out.splitlines()
    report = json.loads((tmp_path / "out" / "mixed.report.json").read_text())
    assert report["camera_doubts"] == [words]
    assert {"first": 100, "last": 119, "reason": words} in report["suspect"]
    assert report["cameras"]["cam2"]["named"] < 0.1 * report["cameras"]["cam2"]["in_image"]
    assert label("--rate", "60").status == 0
    report = json.loads((tmp_path / "out" / "walk.report.json").read_text())
    assert report["camera_doubts"] == []
    assert report["cameras"]["cam2"]["named"] > 0.4 * report["cameras"]["cam2"]["in_image"]
    assert all(one["offset_px"] is None or one["offset_px"] < 0.5 for one in report["cameras"].values())
