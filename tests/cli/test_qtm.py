# SPDX-License-Identifier: GPL-3.0-or-later
"""A user's own capture, `.qtm`, in every verb that reads takes: no --cameras, and it is clear what was taken."""

import csv
import json
from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.takes import Blobs
from addon.demo.take import MODEL
from addon.io.blobs import read_blobs
from addon.io.cameras import read_cameras, write_cameras
from addon.io.points import read_points

from ..io.qtm_file import FILLED, MEASURED, Recording, Trajectory, write_qtm
from .conftest import FRAMES


@pytest.fixture(scope="module")
def capture(room, tmp_path_factory):
    """The short take as a capture: cameras by serial number, one of them not calibrated and one of video."""
    folder = tmp_path_factory.mktemp("capture")
    cameras = read_cameras(room.cameras)
    names = tuple(str(11 + index) for index in range(len(cameras)))
    blobs = Blobs.join(part.blobs for part in read_blobs(room.blobs, cameras))
    lens = cameras.distortion.copy()
    lens[:, 4] = 0
    shown = replace(cameras, names=names, distortion=lens)
    take = read_points(room.c3d)
    tracks = []
    for index, name in enumerate(take.names):
        kinds = [FILLED if index == 0 and frame < 5 else MEASURED for frame in range(len(take.xyz))]
        rows = zip(1000 * take.xyz[:, index], kinds, strict=True)
        tracks.append(Trajectory(name, [FRAMES], [(*xyz.tolist(), 0.4, kind) for xyz, kind in rows]))
    return write_qtm(folder / "walk.qtm", Recording(shown, blobs, tracks, rate=100.0))


def marker_rows(path) -> list[list[str]]:
    with path.open(newline="") as file:
        return list(csv.reader(file))[1:]


def test_a_capture_is_labelled_without_cameras_as_its_blobs_would_be(run, capture, tmp_path):
    answer = run("label", capture, "--model", MODEL, "--out", tmp_path / "out")
    assert (answer.status, answer.err) == (0, "")
    assert "its blobs (" in answer.out and "are taken, not its 3D points (" in answer.out and "--use" in answer.out
    report = json.loads((tmp_path / "out" / "walk.report.json").read_text())
    assert (report["rate"], report["rate_assumed"]) == (100.0, False)
    assert report["capture"][0].startswith("of walk.qtm, its blobs")
    labels = marker_rows(tmp_path / "out" / "walk.labels.csv")
    # The same blobs as text, with the same calibration beside them.
    with (tmp_path / "walk.csv").open("w") as file:
        file.write("frame,camera,x,y\n" + "".join(",".join(row[:4]) + "\n" for row in labels))
    write_cameras(tmp_path / "room.toml", read_cameras(capture))
    same = run("label", tmp_path / "walk.csv", "--cameras", tmp_path / "room.toml", "--model", MODEL, "--out", tmp_path)
    assert same.status == 0
    theirs = marker_rows(tmp_path / "walk.labels.csv")
    assert [row[:4] for row in labels] == [row[:4] for row in theirs]
    assert np.mean([one[4] == other[4] for one, other in zip(labels, theirs, strict=True)]) > 0.99
    assert np.mean([row[4] != "" for row in labels]) > 0.5


def test_its_points_are_labelled_where_they_are_asked_for(run, capture, tmp_path):
    answer = run("label", capture, "--use", "points", "--model", MODEL, "--out", tmp_path)
    assert answer.status == 0
    assert "its 3D points (" in answer.out and "are taken, not its blobs" in answer.out
    report = json.loads((tmp_path / "walk.report.json").read_text())
    assert report["points"] > 0 and report["provenance"]["cameras"] == []
    again = run("label", capture, "--use", "points", "--model", MODEL, "--out", tmp_path, "--resume")
    assert "done before" in again.out


def test_other_cameras_overrule_its_own_and_those_that_are_not_there_are_named(run, capture, tmp_path):
    own = read_cameras(capture)
    write_cameras(tmp_path / "fewer.toml", own.select(list(range(len(own) - 1))))
    words = ("--model", MODEL, "--out", tmp_path, "--frames", f"{FRAMES[0]}:{FRAMES[0] + 3}")
    answer = run("label", capture, "--cameras", tmp_path / "fewer.toml", *words)
    assert answer.status == 0
    assert f"cameras that the calibration does not have are left out: {own.names[-1]}" in answer.out
    assert own.names[-1] not in {row[1] for row in marker_rows(tmp_path / "walk.labels.csv")}
    write_cameras(tmp_path / "others.toml", replace(own, names=tuple(f"c{name}" for name in own.names)))
    answer = run("label", capture, "--cameras", tmp_path / "others.toml", *words, "--overwrite")
    assert "expected some of the calibration's, c11" in answer.reason


def test_what_is_asked_for_and_not_there_is_refused(run, capture, room, tmp_path):
    for words, said in (
        ((room.c3d, "--use", "blobs"), "holds 3D points; expected a take of blobs, or no --use"),
        ((room.blobs, "--cameras", room.cameras, "--use", "points"), "holds blobs; expected a take of points, or no"),
    ):
        assert said in run("label", *words, "--model", MODEL, "--out", tmp_path).reason
    (tmp_path / "cut.qtm").write_bytes(capture.read_bytes()[:3000])
    (tmp_path / "text.qtm").write_text("frame,camera,x,y\n")
    for name, said in (("cut", "is a damaged compound file"), ("text", "is no OLE compound file; expected a capture")):
        answer = run("label", tmp_path / f"{name}.qtm", "--model", MODEL, "--out", tmp_path)
        assert f"{name}.qtm: {said}" in answer.reason


def test_reconstruct_and_refine_need_no_cameras_either(run, capture, room, tmp_path):
    answer = run("reconstruct", capture, "--out", tmp_path / "points.c3d", "--json")
    result = json.loads(answer.out)
    assert (answer.status, result["rate"], result["rate_assumed"]) == (0, 100.0, False)
    assert result["first_frame"] == FRAMES[0] and result["capture"]
    answer = run("reconstruct", room.blobs, "--out", tmp_path / "none.c3d")
    assert "holds blobs, and there is no calibration of their cameras; expected --cameras" in answer.reason
    answer = run("refine", capture, "--model", MODEL, "--out", tmp_path / "room.toml")
    assert answer.status == 0
    assert read_cameras(tmp_path / "room.toml").names == read_cameras(capture).names


def test_gaps_are_filled_and_cameras_taken_for_a_virtual_capture(run, capture, room, tmp_path):
    assert run("fill", capture, "--out", tmp_path / "filled.c3d").status == 0
    takes = read_points(capture), read_points(tmp_path / "filled.c3d")
    assert len({(take.rate, take.first_frame, len(take.xyz)) for take in takes}) == 1
    answer = run("simulate", room.c3d, "--cameras", capture, "--out", tmp_path / "blobs.csv")
    assert answer.status == 0
    assert {row[1] for row in marker_rows(tmp_path / "blobs.csv")} <= set(read_cameras(capture).names)
