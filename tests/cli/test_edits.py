# SPDX-License-Identifier: GPL-3.0-or-later
"""`label --edits`: corrections of blobs and of points hold in all that is written, and what is near them gains."""

import json
from collections import Counter
from dataclasses import replace

import ezc3d
import numpy as np
import pytest

from addon.demo.take import MODEL
from addon.io.points import read_points, write_c3d

from .conftest import FRAMES, report_of, rows_of


def positions(path, name: str) -> tuple[np.ndarray, np.ndarray]:
    """Where a marker is in a C3D file (T, 3) mm, and its residuals (T,)."""
    take = ezc3d.c3d(str(path))
    index = take["parameters"]["POINT"]["LABELS"]["value"].index(name)
    return take["data"]["points"][:3, index].T, take["data"]["meta_points"]["residuals"][0, index]


@pytest.fixture
def edited(tmp_path):
    """Writes edits beside nothing, and gives the file."""

    def write(*edits, name="mine.json"):
        path = tmp_path / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(json.dumps({"version": 1, "edits": edits}))
        return path

    return write


def once_an_image(rows: list[dict], keys) -> bool:
    return max(Counter((*(row[key] for key in keys), row["marker"]) for row in rows if row["marker"]).values()) == 1


def test_what_is_said_of_markers_holds_in_every_file_of_blobs(label, tmp_path, edited):
    said = (
        {"kind": "unlabel", "marker": "C7", "frames": [105, 110]},
        {"kind": "place", "marker": "C7", "frame": 107, "xyz": [0.1, 0.2, 1.5]},
        {"kind": "swap", "markers": ["LFHD", "RFHD"], "frames": [112, 119]},
        {"kind": "right", "marker": "RANK"},
        {"kind": "assign", "camera": "cam1", "frame": 104, "x": 2, "y": 3, "marker": "LASI"},
    )
    assert label().err == ""
    report = report_of(tmp_path / "out" / "walk.c3d")
    assert ("edits" in report, report["provenance"]["edits"]) == (False, [])
    assert not any(row["hand"] for row in report["provenance"]["markers"].values())
    was, at_first = positions(tmp_path / "out" / "walk.c3d", "LFHD")[0], rows_of(tmp_path / "out" / "walk.labels.csv")
    said = label("--overwrite", "--trc", "--edits", edited(*said)).done().out
    assert "edit 5 (assign) found nothing: cam1 has no blob within 2 px of 2, 3 in frame 104" in said
    rows, swapped = rows_of(tmp_path / "out" / "walk.labels.csv"), {"LFHD": "RFHD", "RFHD": "LFHD"}
    assert not [row for row in rows if row["marker"] == "C7" and 105 <= int(row["frame"]) <= 110]
    late = [(old["marker"], row) for old, row in zip(at_first, rows, strict=True) if int(row["frame"]) >= 112]
    heads = [(swapped[old], row["marker"], row["step"]) for old, row in late if old in swapped]
    assert heads and all((name, step) == (wanted, "edit") for wanted, name, step in heads)
    assert once_an_image(rows, ("frame", "camera"))
    places, residual = positions(tmp_path / "out" / "walk.c3d", "C7")
    assert np.isfinite(places[:, 0])[5:11].tolist() == [False, False, True, False, False, False]
    assert places[7] == pytest.approx([100, 200, 1500], abs=0.01)
    assert (residual[5:11] == [-1, -1, 0, -1, -1, -1]).all()
    assert np.nanmax(np.abs(positions(tmp_path / "out" / "walk.c3d", "RFHD")[0][12:] - was[12:])) < 1
    take = read_points(tmp_path / "out" / "walk.trc")
    lifted = take.xyz[7:9, take.names.index("C7")]
    np.testing.assert_allclose(lifted, [[0.1, 0.2, 1.5], [np.nan] * 3], atol=1e-5)
    report = report_of(tmp_path / "out" / "walk.c3d")
    assert report["edits"]["applied"] == {"assign": 0, "unlabel": 1, "swap": 1, "place": 1, "right": 1}
    assert [one["edit"] for one in report["edits"]["found_nothing"]] == [5]
    origins = report["provenance"]["markers"]
    assert (origins["C7"]["hand"], origins["C7"]["hand_frames"]) == (1, [[107, 107]])
    assert (origins["LFHD"]["hand_frames"], origins["LASI"]["hand"]) == ([[112, 119]], 0)
    assert not [row for row in report["suspect"] if row["reason"].startswith("RANK ")]


def test_one_blob_named_holds_and_hardly_costs_others_their_names(label, room, figures, tmp_path, edited):
    """A person names one blob of one camera, near where a foot's markers are easily taken for each other."""
    truth, labels = rows_of(room.truth), tmp_path / "out" / "walk.labels.csv"
    asked = ("101", "cam3", "RTOE")
    row = next(row for row in truth if (row["frame"], row["camera"], row["marker"]) == asked)
    label().done()
    before = figures(labels, room.truth)
    where = {"camera": "cam3", "frame": 101, "x": float(row["x"]) + 1, "y": float(row["y"])}
    label("--overwrite", "--edits", edited({"kind": "assign", "marker": "RTOE"} | where)).done()
    assert list(rows_of(labels)[truth.index(row)].values())[4:] == ["RTOE", "edit", "1"]
    assert report_of(labels)["edits"] == {"file": "mine.json", "applied": {"assign": 1}, "found_nothing": []}
    after = figures(labels, room.truth)
    assert after["false_assignments"] <= before["false_assignments"] + 1e-9
    assert after["recall"] >= 0.998 * before["recall"]


@pytest.fixture
def cloud(room, tmp_path):
    """The room's take without names, and the marker of each trajectory."""
    take = read_points(room.c3d)
    order = np.random.default_rng(2).permutation(len(take.names))
    path, shuffled = tmp_path / "cloud.c3d", take.picked(order)
    write_c3d(path, replace(shuffled, names=("",) * len(order), residual=np.full(take.xyz.shape[:2], 0.0005)))
    return path, list(shuffled.names)


def test_edits_beside_a_take_of_points_hold_in_every_file(run, cloud, tmp_path, edited):
    path, whose = cloud
    heel, toe, knee, wrist = (whose.index(name) for name in ("LHEE", "LTOE", "RKNE", "LWRA"))
    beside = edited(
        {"kind": "assign", "point": heel, "marker": "LTOE", "frames": [105, 109]},
        {"kind": "delete", "point": knee, "frames": [100, 104]},
        {"kind": "unlabel", "point": wrist},
        {"kind": "place", "marker": "LWRA", "frame": 103, "xyz": [0.1, 0.2, 0.9]},
        {"kind": "swap", "markers": ["LFHD", "RFHD"], "frames": [110, 119]},
        name="cloud.edits.json",
    )
    answer = run("label", path, "--model", MODEL, "--out", tmp_path / "out").done()
    assert "the edits of cloud.edits.json beside it are applied" in answer.err
    assert "5 edits applied" in answer.out
    rows = rows_of(tmp_path / "out" / "cloud.labels.csv")
    assert once_an_image(rows, ("frame",))
    label = {(int(row["frame"]), int(row["point"])): (row["marker"], row["step"], row["confidence"]) for row in rows}
    assert [label[frame, heel] for frame in range(105, 110)] == [("LTOE", "edit", "1")] * 5
    assert all(label[frame, toe][0] != "LTOE" for frame in range(105, 110))
    assert all(label[frame, knee] == ("", "", "0") for frame in range(100, 105))
    assert all(label[frame, wrist] == ("", "", "0") for frame in range(*FRAMES))
    assert label[115, whose.index("LFHD")] == ("RFHD", "edit", "1")
    toes, residual = positions(tmp_path / "out" / "cloud.c3d", "LTOE")
    assert toes[5:10] == pytest.approx(1000 * read_points(path).xyz[5:10, heel], abs=0.01)
    wrists, residual = positions(tmp_path / "out" / "cloud.c3d", "LWRA")
    assert np.flatnonzero(np.isfinite(wrists[:, 0])).tolist() == [3]
    assert [*wrists[3], residual[3]] == pytest.approx([100, 200, 900, 0], abs=0.01)
    report = report_of(tmp_path / "out" / "cloud.c3d")
    assert report["edits"]["file"] == beside.name and report["steps"]["edit"] == 25
    origins = report["provenance"]["markers"]
    told = {name: row.get("hand_frames") for name, row in origins.items() if row["hand"]}
    assert told == {"LTOE": [[105, 109]], "LWRA": [[103, 103]], "LFHD": [[110, 119]], "RFHD": [[110, 119]]}
    assert origins["LWRA"] | {"measured": 0, "missing": 19} == origins["LWRA"]


def test_results_of_other_edits_are_not_passed_over(run, cloud, tmp_path, edited):
    path, _ = cloud
    words = "label", path, "--model", MODEL, "--out", tmp_path / "out", "--resume"
    edited({"kind": "right", "marker": "C7"}, name="cloud.edits.json")
    assert run(*words).status == 0
    again = run(*words).out
    assert "done before" in again and ", 1 edit applied" in again
    edited({"kind": "delete", "point": 0}, name="cloud.edits.json")
    assert "differs in edits; expected the same as then" in run(*words).reason


@pytest.mark.parametrize(
    ("blobs", "row", "said"),
    [
        (False, {"kind": "right", "marker": "XYZ"}, "edit 1 names 'XYZ'"),
        (False, {"kind": "frown"}, "edit 1 is of the kind 'frown'"),
        (True, {"kind": "delete", "point": 1}, "edit 1 is of a point in a take of blobs"),
    ],
)
def test_edits_that_cannot_be_of_a_take_are_refused(run, label, cloud, tmp_path, edited, blobs, row, said):
    words = "--edits", edited(row)
    answer = label(*words) if blobs else run("label", cloud[0], "--model", MODEL, "--out", tmp_path / "out", *words)
    assert "mine.json: " in answer.refusal(2)
    assert said in answer.reason
    assert not list(tmp_path.glob("out/*.labels.csv"))


def test_edits_of_one_take_are_not_for_several(run, cloud, room, tmp_path, edited):
    words = "--model", MODEL, "--cameras", room.cameras, "--out", tmp_path / "out", "--edits", edited()
    assert "--edits is of one take, and there are 2" in run("label", cloud[0], room.blobs, *words).refusal(2)
    words = "--model", MODEL, "--out", tmp_path / "out", "--edits"
    assert "there is no such file" in run("label", cloud[0], *words, "nowhere.edits.json").reason
    beside = edited(name="out/cloud.labels.csv")
    assert "is read and would be written over" in run("label", cloud[0], *words, beside, "--overwrite").reason


def test_of_several_takes_each_has_its_own_edits(run, cloud, tmp_path, edited):
    path, whose = cloud
    other = path.with_name("other.c3d")
    other.write_bytes(path.read_bytes())
    edited({"kind": "delete", "point": whose.index("C7")}, name="cloud.edits.json")
    edited({"kind": "delete", "point": 99}, name="other.edits.json")
    answer = run("label", path, other, "--model", MODEL, "--out", tmp_path / "out")
    assert "other.edits.json: edit 1 is of trajectory 99" in answer.refusal(2)
    assert "cloud: 20 frames" in answer.out
    assert not [row for row in rows_of(tmp_path / "out" / "cloud.labels.csv") if row["marker"] == "C7"]
    assert not (tmp_path / "out" / "other.labels.csv").exists()
