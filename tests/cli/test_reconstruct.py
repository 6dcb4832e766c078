# SPDX-License-Identifier: GPL-3.0-or-later
"""`reconstruct`, `simulate`, `refine` and `quality`: what is written and said, and what cannot be done."""

import json
from dataclasses import replace

import ezc3d
import numpy as np
import pytest

from addon.core.data.takes import Points
from addon.demo.take import MODEL
from addon.io.cameras import read_cameras, write_cameras
from addon.io.markersets import open_markerset
from addon.io.points import read_points, write_c3d, write_trc
from tests.core.calibration.test_adjusting import image_error, moved

from .conftest import FRAMES, rows_of


@pytest.fixture
def reconstruct(run, room, tmp_path):
    def call(*words, out="points.c3d"):
        return run("reconstruct", room.blobs, "--cameras", room.cameras, "--out", tmp_path / out, *words)

    return call


def test_the_points_are_the_markers_without_names(reconstruct, room, tmp_path):
    answer = reconstruct("--rate", "60", "--json").quiet()
    take = ezc3d.c3d(str(tmp_path / "points.c3d"))
    labels = take["parameters"]["POINT"]["LABELS"]["value"]
    assert labels == [f"*{number}" for number in range(1, len(labels) + 1)]
    assert take["header"]["points"]["first_frame"] + 1 == FRAMES[0]
    found, truth = read_points(tmp_path / "points.c3d"), read_points(room.c3d)
    assert found.rate == 60
    distance = np.linalg.norm(found.xyz[:, :, None] - truth.xyz[:, None], axis=3)
    assert (np.nanmin(distance, axis=1) < 0.01).mean() > 0.95
    assert (np.nanmin(distance[np.isfinite(found.xyz[..., 0])], axis=1) < 0.01).mean() > 0.98
    assert np.nanmax(found.residual) < 0.02
    said = answer.json
    assert (said["trajectories"], said["frames"], said["rate_assumed"]) == (len(labels), 20, False)
    there = np.isfinite(found.residual)
    assert said["points"] == there.sum(), "and not what is left out"
    assert said["residual_mm"] == pytest.approx(1000 * np.sqrt((found.residual[there] ** 2).mean()), rel=0.05)


def test_trc_and_words_for_people_and_what_cannot_be_done(reconstruct, tmp_path, run, room):
    said = reconstruct("--frames", "105:114", out="points.trc").done().out
    assert "10 frames" in said and "blobs explained" in said
    assert read_points(tmp_path / "points.trc").xyz.shape[0] == 10
    assert "expected a name that ends in .c3d" in reconstruct(out="points.csv").reason
    assert "exists already" in reconstruct(out="points.trc").reason
    lone = tmp_path / "lone.csv"
    lone.write_text("".join(line for line in room.blobs.open() if line.split(",")[1] in ("camera", "cam1")))
    answer = run("reconstruct", lone, "--cameras", room.cameras, "--out", tmp_path / "lone.c3d")
    assert "no two cameras" in answer.refusal(1)
    for points in (room.c3d, tmp_path / "points.trc"):  # which are no other input of this verb
        reason = run("reconstruct", points, "--cameras", room.cameras, "--out", tmp_path / "lone.c3d").refusal(2)
        assert reason.endswith("; expected a blob file with the header frame,camera,x,y and optionally area")
        assert "3D points" not in reason
    assert not (tmp_path / "lone.c3d").exists()


@pytest.fixture
def simulate(run, room, tmp_path):
    def call(*words, take=None):
        return run("simulate", take or room.c3d, "--cameras", room.cameras, "--out", tmp_path / "sim.csv", *words)

    return call


def test_truth_lies_beside_the_blobs_row_for_row(simulate, tmp_path):
    answer = simulate("--frames", "103:119").quiet()
    assert f"the body of {MODEL} in the way" in answer.out
    blobs, truth = rows_of(tmp_path / "sim.csv"), rows_of(tmp_path / "sim.csv.truth.csv")
    keys = ("frame", "camera", "x", "y")
    assert [[row[key] for key in keys] for row in blobs] == [[row[key] for key in keys] for row in truth]
    assert {name for row in truth for name in row["marker"].split("|")} == {"", *open_markerset(MODEL).markers}
    assert {int(row["frame"]) for row in blobs} == set(range(103, FRAMES[1] + 1))
    assert all(float(row["area"]) > 0 for row in blobs)


def test_a_take_outside_the_room_is_moved_on_request(simulate, room, tmp_path):
    there = read_points(room.c3d)
    write_c3d(tmp_path / "away.c3d", replace(there, xyz=there.xyz + np.array([50.0, 20.0, 0.0])))
    assert "--centre" in simulate(take=tmp_path / "away.c3d").refusal(1), "there are ghosts alone"
    assert not (tmp_path / "sim.csv").exists()
    assert simulate("--centre", take=tmp_path / "away.c3d").status == 0
    reason = simulate("--dropout", "1", "--overwrite").refusal(1)
    assert "no marker gives a blob by these options" in reason and "room" not in reason.rpartition(": ")[2]


def test_markers_that_no_model_has_subjects_names_and_a_take_of_another_kind(simulate, room, tmp_path):
    there = read_points(room.c3d)
    names = (*(f"Anna:{name}" for name in there.names), "EXTRA", "")
    xyz = np.concatenate([there.xyz, there.xyz[:, :1] + 0.05, there.xyz[:, :1] + 0.1], axis=1)
    write_trc(tmp_path / "anna.trc", Points(names, xyz, np.zeros(xyz.shape[:2]), there.rate, there.first_frame))
    assert simulate("--json", take=tmp_path / "anna.trc").json["markers"] == list(open_markerset(MODEL).markers)
    assert simulate("--overwrite", take=room.cameras).status == 2
    assert simulate("--overwrite", "--model", "nobody").reason.startswith("there is no marker set nobody; expected ")
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(room.c3d.read_bytes()[:3000])
    assert "broken.c3d" in simulate("--overwrite", take=broken).reason


@pytest.fixture
def refine(run, room, tmp_path):
    def call(*words, cameras=room.cameras, blobs=room.blobs, out="refined.toml"):
        files = "--cameras", cameras, "--model", MODEL, "--out", tmp_path / out
        return run("refine", blobs, *files, "--rate", "60", *words)

    return call


@pytest.mark.parametrize("which", [[2], [2, 5]])
def test_cameras_that_were_moved_are_put_where_they_stand(refine, room, tmp_path, which):
    true, off = read_cameras(room.cameras), tmp_path / "off.toml"
    write_cameras(off, moved(true, which, 0.3, 10))
    said = refine("--json", cameras=off).quiet().json
    assert said["refined"]
    assert set(said["cameras"]) == set(true.names)
    assert len(said["camera_doubts"]) == len(which)
    for name in map(true.names.__getitem__, which):
        row = said["cameras"][name]
        assert {"before_px", "after_px", "blobs", "shifted_mm", "turned_deg"} == set(row)
        assert row["after_px"] < 0.5 < row["before_px"] and row["shifted_mm"] == pytest.approx(10, abs=6)
        assert row["turned_deg"] == pytest.approx(0.3, abs=0.1)
        assert any(f"camera {name} seems to have moved" in words for words in said["camera_doubts"])
    found = read_cameras(tmp_path / "refined.toml")
    assert image_error(found, true).max() < 0.6 < image_error(read_cameras(off), true)[which].min() / 2
    assert found.names == true.names
    for field in ("size", "matrix", "distortion", "inverse"):
        assert np.array_equal(getattr(found, field), getattr(true, field))


def test_a_good_room_is_written_as_it_was_and_told_so(refine, room, tmp_path, monkeypatch):
    # Whose names two markers have is nothing to cameras; it is asked only of takes that are labelled.
    monkeypatch.delattr("addon.core.pipelines.blobs.asked_in_space")
    answer = refine().quiet()
    lines, true = answer.out.splitlines(), read_cameras(room.cameras)
    assert lines[-1].startswith(f"{tmp_path / 'refined.toml'}: nothing to refine, the cameras are written as they were")
    assert len(lines) == len(true) + 1
    for name, line in zip(true.names, lines, strict=False):
        assert line.split()[0] == name
        assert " px before, " in line
        assert line.endswith(" px after")
    found = read_cameras(tmp_path / "refined.toml")
    for field in ("rotation", "translation", "matrix", "distortion", "size"):
        assert np.allclose(getattr(found, field), getattr(true, field), rtol=0, atol=1e-12)


def test_what_cannot_be_done(refine, room, tmp_path):
    assert "expected a name that ends in .toml" in refine(out="refined.csv").reason
    (tmp_path / "refined.toml").write_text("mine")
    assert "exists already" in refine().reason
    assert (tmp_path / "refined.toml").read_text() == "mine"
    none = f"{room.blobs}: has no blobs in frames 500:600; expected some of its own, 100 to "
    assert refine("--frames", "500:600", out="a.toml").reason.startswith(none)
    early = "has no blobs in frames :7; expected some of its own, 100 and later"
    assert refine("--frames", ":7", out="a.toml").reason.endswith(early)
    few = f"{room.blobs}: three cameras see 26 named markers at a time; expected 100 or more, so a longer take"
    assert refine("--frames", "100:101", out="a.toml").reason.startswith(few)
    true, other, some = read_cameras(room.cameras), tmp_path / "other.toml", tmp_path / "some.csv"
    exchanged = replace(true.select([0, 3, 2, 1, *range(4, len(true))]), names=true.names)
    for cameras, words in (
        (exchanged, "cam2 and cam4 seem to have each other's names"),
        (replace(true, translation=1000 * true.translation), "about 1000 times too large"),
        (replace(true, matrix=true.matrix * [[2], [2], [1]]), "the room seems not to be this take's"),
    ):
        write_cameras(other, cameras)
        assert words in refine(cameras=other, out="a.toml").refusal(1)
    head, *rows = room.blobs.read_text().splitlines()
    some.write_text("\n".join([head, *rows[::15], ""]))
    assert "nobody was recognised" in refine(blobs=some, out="a.toml").refusal(1)
    write_cameras(other, true.select([0, 1]))
    some.write_text("\n".join([head, *(row for row in rows if row.split(",")[1] in ("cam1", "cam2")), ""]))
    reason = refine(cameras=other, blobs=some, out="a.toml").refusal(1)
    assert reason.startswith(f"{some}: ") and "2 cameras cannot tell which of them was moved" in reason
    assert not (tmp_path / "a.toml").exists()


def test_a_built_in_model_is_judged(run):
    report = run("quality", "gait15", "--advice", 1, "--json").quiet().json
    assert set(report["markers"]) == set(open_markerset("gait15").markers)
    separations = [pair["separation"] for pair in report["pairs"]]
    assert separations == sorted(separations)
    assert all(pair["all_seen"] >= pair["separation"] for pair in report["pairs"]) and report["subjects"] > 1
    [advice] = report["advice"]
    assert advice["after"] > advice["before"]
    assert set(advice["for"]) <= set(report["markers"])
    assert max(map(abs, advice["shift_mm"])) < 65


def test_a_model_without_evidence_is_judged_by_its_spread_and_keeps_the_markers_it_is_to_keep(run, bare, tmp_path):
    path = tmp_path / "quality.json"
    said = run("quality", bare, "--advice", 0, "--report", path).done().out
    assert said.startswith("bare: 15 markers, drawn from its spread")
    assert "ambiguous" in said and "advice" not in said
    assert json.loads(path.read_text())["model"] == "bare"
    before = path.read_bytes()
    words = "quality", bare, "--advice", 2, "--goal", 8, "--keep", "LANK,RANK", "--json"
    assert "exists already" in run(*words, "--report", path).reason
    assert path.read_bytes() == before
    report = run(*words, "--report", path, "--overwrite").done().json
    assert report == json.loads(path.read_text()) and report["advice"]
    assert not {row["marker"] for row in report["advice"]} & {"LANK", "RANK"}
