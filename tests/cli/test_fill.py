# SPDX-License-Identifier: GPL-3.0-or-later
"""`fill` and `label --fill`: gaps are closed and told, what was measured stays, what is wrong is one sentence."""

import json
import shutil
from dataclasses import replace
from unittest.mock import Mock

import ezc3d
import numpy as np
import pytest

from addon.core.data.takes import Points
from addon.core.points.models import Model
from addon.demo.take import MODEL
from addon.io import markersets
from addon.io.c3d.writing import names_in_c3d
from addon.io.models import open_model, write_model
from addon.io.points import columns_of_set, read_points, write_c3d, write_trc

from .conftest import report_of, rows_of

FIRST = 100  # the room's first frame
GAPS = {"LKNE": (5, 9), "RELB": (11, 13)}


@pytest.fixture(scope="module")
def whole(room):
    return read_points(room.c3d)


@pytest.fixture(scope="module")
def holed(room, whole, tmp_path_factory):
    """The room's take with two gaps and a trajectory without a name, as C3D and TRC."""
    folder = tmp_path_factory.mktemp("holed")
    xyz = whole.xyz.copy()
    for name, (start, stop) in GAPS.items():
        xyz[start:stop, whole.names.index(name)] = np.nan
    ghost = np.tile([1.0, 1.0, 1.0], (len(xyz), 1, 1))
    ghost[3:6] = np.nan
    xyz, names = np.concatenate([xyz, ghost], axis=1), (*whole.names, "")
    take = Points(names, xyz, np.full(xyz.shape[:2], 0.0005), whole.rate, whole.first_frame)
    write_c3d(folder / "walk.c3d", take)
    write_trc(folder / "walk.trc", take)
    return folder


@pytest.mark.parametrize(("name", "measured"), [("walk.c3d", 0.5), ("walk.trc", 0.1)])
def test_gaps_are_closed_and_told(run, holed, whole, tmp_path, name, measured):
    said = run("fill", holed / name, "--out", tmp_path / "full.c3d", "--json").quiet().json
    rows = rows_of(tmp_path / "full.filled.csv")
    assert list(rows[0]) == ["marker", "first", "last", "method", "expected_mm"]
    assert {row["marker"]: (int(row["first"]) - FIRST, int(row["last"]) + 1 - FIRST) for row in rows} == GAPS
    assert [float(row["expected_mm"]) for row in rows] == [row["expected_mm"] for row in said["filled"]]
    assert (said["samples_filled"], said["samples_missing"], said["left"]) == (6, 6, [])
    given, found = read_points(holed / name), read_points(tmp_path / "full.c3d")
    assert (found.names, found.first_frame) == (given.names, FIRST)
    present = given.present
    assert np.abs(found.xyz[present] - given.xyz[present]).max() < 1e-6
    residual = ezc3d.c3d(str(tmp_path / "full.c3d"))["data"]["meta_points"]["residuals"][0].T
    np.testing.assert_allclose(residual[present], measured, atol=1e-6)
    for marker, (start, stop) in GAPS.items():
        index = whole.names.index(marker)
        assert (residual[start:stop, index] == 0).all()
        assert np.linalg.norm(found.xyz[start:stop, index] - whole.xyz[start:stop, index], axis=1).max() < 0.02
    assert (residual[3:6, -1] == -1).all()  # what has no name is not filled


def test_what_was_filled_before_stays_marked_and_longer_gaps_are_left_and_told(run, holed, tmp_path):
    assert run("fill", holed / "walk.c3d", "--out", tmp_path / "a.c3d", "--markers", "LKNE").status == 0
    said = run("fill", tmp_path / "a.c3d", "--out", tmp_path / "b.c3d", "--method", "spline", "--json").json
    assert [row["marker"] for row in said["filled"]] == ["RELB"]
    take = read_points(tmp_path / "b.c3d")
    assert {take.names[column] for column in np.nonzero(take.residual == 0)[1]} == set(GAPS)
    said = run("fill", holed / "walk.c3d", "--out", tmp_path / "c.c3d", "--max-gap", 2, "--model", MODEL).out
    assert "1 of 2 gaps filled" in said
    assert "left: LKNE, frames 105–108: the gap is longer than 2 frames" in said


def test_a_model_is_read_once(run, holed, tmp_path, monkeypatch):
    model = shutil.copy(markersets.markerset_file(MODEL), tmp_path)
    reading = Mock(wraps=markersets.read_json)
    monkeypatch.setattr(markersets, "read_json", reading)
    run("fill", holed / "walk.c3d", "--out", tmp_path / "full.c3d", "--model", model).done()
    assert reading.call_count == 1


def test_one_is_said_as_one(run, holed, room, tmp_path):
    """Of a gap of a frame, and of a frame of one marker."""
    one = read_points(room.c3d).picked([0])
    xyz = one.xyz.copy()
    xyz[5] = np.nan
    write_c3d(tmp_path / "one.c3d", replace(one, xyz=xyz))
    said = run("fill", tmp_path / "one.c3d", "--out", tmp_path / "full.c3d").done().out
    assert "1 of 1 gap filled, 1 of 1 missing sample, " in said
    words = "fill", holed / "walk.c3d", "--out", tmp_path / "left.c3d", "--max-gap", 1
    assert "the gap is longer than 1 frame\n" in run(*words).done().out
    write_c3d(tmp_path / "frame.c3d", replace(one, xyz=xyz[:1], residual=one.residual[:1]))
    assert "1 frame, 0 of 0 gaps filled" in run("fill", tmp_path / "frame.c3d", "--out", tmp_path / "b.c3d").done().out
    model = tmp_path / "me.markerset.json"
    assert "has 1 named marker; expected 4" in run("train", tmp_path / "one.c3d", "--out", model).refusal(2)
    words = "simulate", room.c3d, "--cameras", room.cameras, "--out", tmp_path / "one.csv", "--frames", "105:105"
    assert " in 1 frame, 8 cameras, the body" in run(*words).done().out


def test_bad_inputs(run, holed, tmp_path):
    out, source, take = tmp_path / "out" / "a.c3d", holed / "walk.c3d", read_points(holed / "walk.c3d")

    def refused(path, *words) -> str:
        return run("fill", path, "--out", out, *words).reason

    assert "there is no such file" in refused(tmp_path / "none.c3d")
    (tmp_path / "bad.c3d").write_bytes(b"nothing")
    assert "expected a C3D file" in refused(tmp_path / "bad.c3d")
    assert "over" in run("fill", source, "--out", source, "--overwrite").reason
    write_c3d(tmp_path / "few.c3d", replace(take.picked([0, 1, 2]), names=("A", "B", "C")))
    few = refused(tmp_path / "few.c3d", "--model", MODEL)
    assert "has 0 of the markers of body26; expected 4 or more" in few
    assert not out.exists()
    out.parent.mkdir(exist_ok=True)
    out.write_text("mine")
    assert "exists already" in refused(source)
    assert out.read_text() == "mine"


def test_a_report_says_where_all_is_from_and_verify_whether_it_is_still_so(run, holed, tmp_path):
    edits = {"version": 1, "edits": [{"kind": "assign", "point": 0, "marker": "LFHD", "frames": [100, 102]}]}
    (tmp_path / "hand.json").write_text(json.dumps(edits))
    words = ("--model", MODEL, "--edits", tmp_path / "hand.json", "--out", tmp_path)
    assert run("label", holed / "walk.c3d", *words).status == 0
    source, full = tmp_path / "walk.c3d", tmp_path / "out" / "full.c3d"
    (tmp_path / "walk.edits.json").write_text(json.dumps(edits))  # of no concern to what is filled
    before, said = report_of(source), run("fill", source, "--out", full, "--model", MODEL, "--json").json
    report = report_of(full)
    assert said.keys() - report.keys() == {"out", "seconds"}
    assert report["doubtful"] == before["doubtful"]
    rows, take = report["provenance"]["markers"], read_points(full)
    was = before["provenance"]["markers"]
    assert rows["LFHD"]["hand_frames"] == was["LFHD"]["hand_frames"] == [[100, 102]]
    for name, row in rows.items():
        own = [gap for gap in report["filled"] if gap["marker"] == name]
        assert sum(row["filled"].values()) == sum(gap["last"] + 1 - gap["first"] for gap in own)
        assert [row[kind] for kind in ("measured", "hand")] == [was[name][kind] for kind in ("measured", "hand")]
        assert row["missing"] == (~take.present[:, take.names.index(name)]).sum()
    for one in (full, full.parent, full.with_suffix(".report.json"), full.with_suffix(".filled.csv")):
        said = run("verify", one).out
        assert said.startswith("full: 2 results are as version ") and said.endswith(f"made them of walk.c3d, {MODEL}\n")
    again = tmp_path / "out" / "again.c3d"
    assert run("fill", full, "--out", again).status == 0
    later = report_of(again)["provenance"]["markers"]
    assert later["LKNE"]["filled"] == {"input": rows["LKNE"]["filled"]["regression"]}
    assert later["LFHD"]["hand"] == 3
    before["provenance"]["markers"] = {"LFHD": {"hand_frames": 5}}
    (tmp_path / "walk.report.json").write_text(json.dumps(before))
    assert "walk.report.json: is damaged in what is by hand" in run("fill", source, "--out", tmp_path / "x.c3d").reason
    source.write_bytes(source.read_bytes() + bytes(512))
    reason = run("verify", full).refusal(1)
    assert "the input ../walk.c3d was changed; expected all as it was when this take was filled" in reason


def test_what_is_by_hand_is_so_in_the_frames_that_a_c3d_can_say(run, holed, tmp_path):
    take = replace(read_points(holed / "walk.c3d"), first_frame=-10)
    write_trc(tmp_path / "walk.trc", take)
    edits = {"version": 1, "edits": [{"kind": "assign", "point": 0, "marker": "LFHD", "frames": [-8, -6]}]}
    (tmp_path / "walk.edits.json").write_text(json.dumps(edits))
    assert run("label", tmp_path / "walk.trc", "--model", MODEL, "--out", tmp_path / "out").status == 0
    assert run("fill", tmp_path / "out" / "walk.c3d", "--out", tmp_path / "full.c3d").status == 0
    assert "no .c3d can say these" in run("fill", tmp_path / "walk.trc", "--out", tmp_path / "raw.c3d").done().out
    before, after = report_of(tmp_path / "out" / "walk.c3d"), report_of(tmp_path / "full.c3d")
    assert (before["first_frame"], before["c3d_first_frame"], after["first_frame"]) == (-10, 0, 0)
    spans = [one["provenance"]["markers"]["LFHD"]["hand_frames"] for one in (before, after)]
    assert spans == [[[-8, -6]], [[2, 4]]]
    del before["first_frame"]  # as in reports of earlier versions, whose frames nobody can tell
    (tmp_path / "out" / "walk.report.json").write_text(json.dumps(before))
    assert run("fill", tmp_path / "out" / "walk.c3d", "--out", tmp_path / "old.c3d").status == 0
    assert "hand_frames" not in report_of(tmp_path / "old.c3d")["provenance"]["markers"]["LFHD"]


def test_a_name_that_is_there_twice_is_told_apart(run, holed, tmp_path):
    take = read_points(holed / "walk.c3d")
    first, second = sorted(GAPS, key=take.names.index)
    names = tuple(first if name == second else name for name in take.names)
    write_c3d(tmp_path / "twice.c3d", replace(take, names=names))
    assert run("fill", tmp_path / "twice.c3d", "--out", tmp_path / "full.c3d").status == 0
    report, told = report_of(tmp_path / "full.c3d"), {first, f"{first} ({take.names.index(second)})"}
    rows = report["provenance"]["markers"]
    assert {name for name in rows if first in name} == told
    assert all(row["missing"] >= 0 for row in rows.values())
    assert {row["marker"] for row in report["filled"]} == told
    assert {row["marker"] for row in rows_of(tmp_path / "full.filled.csv")} == told
    third = next(name for name in reversed(names) if name not in ("", first))
    own = f"{first} ({take.names.index(second)})"  # the file's own name for another
    write_c3d(tmp_path / "twice.c3d", replace(take, names=tuple(own if name == third else name for name in names)))
    assert run("fill", tmp_path / "twice.c3d", "--out", tmp_path / "full.c3d", "--overwrite").status == 0
    report = report_of(tmp_path / "full.c3d")
    assert len(report["provenance"]["markers"]) == report["markers"] == len(names) - 1
    assert {row["marker"] for row in report["filled"]} == {first, own.replace(")", f") ({take.names.index(second)})")}


def test_a_name_that_no_c3d_can_hold_is_told(run, holed, tmp_path):
    take = read_points(holed / "walk.trc")
    names = (take.names[0] + 300 * "x", *take.names[1:])
    write_trc(tmp_path / "long.trc", replace(take, names=names))
    said = run("fill", tmp_path / "long.trc", "--out", tmp_path / "full.c3d").done().out
    assert "no .c3d can hold 1 name: c3d_names of the report has others" in said
    assert report_of(tmp_path / "full.c3d")["c3d_names"] == {names[0]: names[0][:255]}


@pytest.mark.parametrize("owner", ["", "ann:"])
def test_a_model_s_markers_are_found_by_what_a_c3d_has_of_their_names(run, holed, tmp_path, owner):
    worn = open_model(MODEL).markerset
    called = {name: f"{name} {'x' * 260}" for name in worn.markers[:-2]} | {name: name for name in worn.markers[-2:]}
    own = replace(worn, markers=tuple(called.values()), aliases={})
    write_model(tmp_path / "long.markerset.json", Model(own))
    take = read_points(holed / "walk.trc")
    names = tuple(owner + called[name] if name in called else "" for name in take.names)
    write_c3d(tmp_path / "long.c3d", replace(take, names=names))
    words = "--model", tmp_path / "long.markerset.json", "--method", "body"
    said = run("fill", tmp_path / "long.c3d", "--out", tmp_path / "full.c3d", *words, "--json").done().json
    assert {row["method"] for row in said["filled"]} == {"body"}
    alike = [f"{'x' * 260}{name}" for name in worn.markers]
    columns = columns_of_set(names_in_c3d(alike), replace(worn, markers=tuple(alike), aliases={}))
    assert (columns == -1).all(), "in another order another's beginning would be the same"


def test_label_fills_in_the_same_job_and_labels_stay_what_was_seen(run, holed, tmp_path):
    words = ("label", holed / "walk.c3d", "--model", MODEL, "--trc", "--json")
    [plain] = run(*words, "--out", tmp_path / "a").done().json["takes"]
    [report] = run(*words, "--out", tmp_path / "b", "--fill").done().json["takes"]
    labels = [(tmp_path / name / "walk.labels.csv").read_text() for name in "ab"]
    assert labels[0] == labels[1]
    before, after = (read_points(tmp_path / name / "walk.c3d") for name in "ab")
    assert report == report_of(tmp_path / "b" / "walk.c3d")
    assert {row["marker"] for row in report["filled"]} >= set(GAPS)
    assert ("filled" in plain, report["markers"]) == (False, plain["markers"])
    told = np.zeros(after.present.shape, bool)
    for row in report["filled"]:
        told[row["first"] - FIRST : row["last"] + 1 - FIRST, after.names.index(row["marker"])] = True
    assert ((after.residual == 0) == told).all()
    for column, (name, row) in enumerate(report["provenance"]["markers"].items()):
        assert sum(row["filled"].values()) == told[:, column].sum(), name
        assert (row["measured"], row["hand"]) == (before.present[:, column].sum(), 0)
        assert row["missing"] == (~after.present[:, column]).sum()
    assert (after.present == (before.present | told)).all()
    assert np.array_equal(after.xyz[before.present], before.xyz[before.present])
    assert read_points(tmp_path / "b" / "walk.trc").present[told].all()


def test_the_ray_of_the_camera_that_still_sees_a_marker_holds_its_fill(label, room, tmp_path):
    head, *lines = room.blobs.read_text().splitlines()
    kept, left = {}, [head]
    for line, row in zip(lines, rows_of(room.truth), strict=True):
        gap = row["marker"] == "LKNE" and 105 <= int(row["frame"]) < 109
        if not gap or kept.setdefault(row["frame"], row["camera"]) == row["camera"]:
            left.append(line)
    (tmp_path / "one.csv").write_text("\n".join([*left, ""]))
    assert label("--fill", blobs=[tmp_path / "one.csv"]).status == 0
    filled = report_of(tmp_path / "out" / "one.c3d")["filled"]
    assert any(row["marker"] == "LKNE" and row["method"].endswith("+ray") for row in filled)
