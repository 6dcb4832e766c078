# SPDX-License-Identifier: GPL-3.0-or-later
"""`refine` and `quality`: what is written and said of each camera or marker, and what cannot be done or judged."""

import json
from dataclasses import replace

import numpy as np
import pytest

from addon.core.points.models import Model
from addon.demo.take import MODEL
from addon.io.cameras import read_cameras, write_cameras
from addon.io.markersets import open_markerset
from addon.io.models import write_model
from tests.core.calibration.test_adjusting import image_error, moved


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
    answer = refine("--json", cameras=off)
    assert (answer.status, answer.err) == (0, "")
    said = json.loads(answer.out)
    assert said["refined"]
    assert set(said["cameras"]) == set(true.names)
    assert len(said["camera_doubts"]) == len(which)
    for name in map(true.names.__getitem__, which):
        row = said["cameras"][name]
        assert {"before_px", "after_px", "blobs", "shifted_mm", "turned_deg"} == set(row)
        assert row["after_px"] < 0.5 < row["before_px"]
        assert row["shifted_mm"] == pytest.approx(10, abs=6)
        assert row["turned_deg"] == pytest.approx(0.3, abs=0.1)
        assert any(f"camera {name} seems to have moved" in words for words in said["camera_doubts"])
    found = read_cameras(tmp_path / "refined.toml")
    assert image_error(found, true).max() < 0.6 < image_error(read_cameras(off), true)[which].min() / 2
    assert found.names == true.names
    for field in ("size", "matrix", "distortion", "inverse"):
        assert np.array_equal(getattr(found, field), getattr(true, field))


def test_a_good_room_is_written_as_it_was_and_told_so(refine, room, tmp_path):
    answer = refine()
    assert (answer.status, answer.err) == (0, "")
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


def test_what_cannot_be_done(refine, run, room, tmp_path):
    assert "expected a name that ends in .toml" in refine(out="refined.csv").reason
    (tmp_path / "refined.toml").write_text("mine")
    assert "exists already" in refine().reason
    assert (tmp_path / "refined.toml").read_text() == "mine"
    before = room.cameras.read_bytes()
    over = run("refine", room.blobs, "--cameras", room.cameras, "--model", MODEL, "--out", room.cameras, "--overwrite")
    assert "is read and would be written over" in over.reason
    assert room.cameras.read_bytes() == before
    none = f"{room.blobs}: has no blobs in frames 500:600; expected some of its own, 100 to "
    assert refine("--frames", "500:600", out="late.toml").reason.startswith(none)
    early = "has no blobs in frames :7; expected some of its own, 100 and later"
    assert refine("--frames", ":7", out="late.toml").reason.endswith(early)
    few = refine("--frames", "100:101", out="few.toml").reason
    assert "named markers are seen by three cameras at a time; expected 100 or more, so a longer take" in few
    true, other = read_cameras(room.cameras), tmp_path / "other.toml"
    exchanged = replace(true.select([0, 3, 2, 1, *range(4, len(true))]), names=true.names)
    for cameras, words in (
        (exchanged, "cam2 and cam4 seem to have each other's names"),
        (replace(true, translation=1000 * true.translation), "about 1000 times too large"),
        (replace(true, matrix=true.matrix * [[2], [2], [1]]), "the room seems not to be this take's"),
    ):
        write_cameras(other, cameras)
        answer = refine(cameras=other, out="other-refined.toml")
        assert words in answer.refusal(1), answer.reason
    other.unlink()
    head, *rows = room.blobs.read_text().splitlines()
    nobody = tmp_path / "two.csv"
    nobody.write_text("\n".join([head, *rows[::15], ""]))
    assert "nobody was recognised" in refine(blobs=nobody, out="other-refined.toml").refusal(1)
    two = tmp_path / "two.toml"
    write_cameras(two, read_cameras(room.cameras).select([0, 1]))
    blobs = tmp_path / "two.csv"
    blobs.write_text("".join(line for line in room.blobs.open() if line.split(",")[1] in ("camera", "cam1", "cam2")))
    reason = refine(cameras=two, blobs=blobs, out="of-two.toml").refusal(1)
    assert reason.startswith(f"{blobs}: ")
    assert "2 cameras cannot tell which of them was moved" in reason
    assert sorted(path.name for path in tmp_path.iterdir()) == ["refined.toml", "two.csv", "two.toml"]


@pytest.fixture(scope="module")
def bare(tmp_path_factory):
    """gait15 as a file that has learned nothing of points."""
    path = tmp_path_factory.mktemp("bare") / "bare.markerset.json"
    write_model(path, Model(replace(open_markerset("gait15"), name="bare")))
    return path


def test_a_built_in_model_is_judged(run, tmp_path):
    path = tmp_path / "quality.json"
    answer = run("quality", "gait15", "--advice", 1, "--report", path, "--json")
    assert (answer.status, answer.err) == (0, "")
    report = json.loads(answer.out)
    assert report == json.loads(path.read_text())
    assert set(report["markers"]) == set(open_markerset("gait15").markers)
    separations = [pair["separation"] for pair in report["pairs"]]
    assert separations == sorted(separations)
    assert all(pair["all_seen"] >= pair["separation"] for pair in report["pairs"])
    assert report["subjects"] > 1
    [advice] = report["advice"]
    assert advice["after"] > advice["before"]
    assert set(advice["for"]) <= set(report["markers"])
    assert max(map(abs, advice["shift_mm"])) < 65


def test_a_model_without_evidence_is_judged_by_its_spread_and_keeps_the_markers_it_is_to_keep(run, bare):
    answer = run("quality", bare, "--advice", 0).done()
    assert answer.out.startswith("bare: 15 markers, drawn from its spread")
    assert "ambiguous" in answer.out
    assert "advice" not in answer.out
    report = json.loads(run("quality", bare, "--advice", 2, "--goal", 8, "--keep", "LANK,RANK", "--json").out)
    assert report["advice"]
    assert not {row["marker"] for row in report["advice"]} & {"LANK", "RANK"}


def test_a_report_is_not_overwritten_unasked(run, bare, tmp_path):
    path = tmp_path / "quality.json"
    path.write_text("mine")
    assert "exists already" in run("quality", bare, "--advice", 0, "--report", path).reason
    assert path.read_text() == "mine"
    assert run("quality", bare, "--advice", 0, "--report", path, "--overwrite").status == 0
    assert json.loads(path.read_text())["model"] == "bare"
