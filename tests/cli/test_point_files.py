# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of another axis, without a rate, with frame numbers beyond 32 bits, or a .qtm, behind every verb that reads."""

import struct
from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.errors import JobError
from addon.core.data.takes import Blobs, Points
from addon.core.geometry.camera_up import turned
from addon.demo.take import MODEL
from addon.io.blobs import read_blobs
from addon.io.cameras import read_cameras, write_cameras
from addon.io.points import read_points, write_c3d, write_trc
from addon.jobs.training_takes import read_takes
from tests.io.samples import qca

from ..io.qtm_file import FILLED, MEASURED, Recording, Trajectory, write_qtm
from .conftest import FRAMES, report_of, rows_of

SAID = "the file says that -Z is up, but +Z was taken by "
NO_RATE = "the file has a rate of 0 frames a second, so the 60 that are given were taken"
REAL = struct.Struct("<f")


@pytest.fixture
def upside_down(room, tmp_path):
    """The room's take, which now says that -Z is up."""
    path = tmp_path / "down.c3d"
    path.write_bytes(room.c3d.read_bytes().replace(b"+Z", b"-Z"))
    return path


@pytest.fixture
def without_rate(room, tmp_path):
    """The room's take with a rate of 0 in all places."""
    path, rate = tmp_path / "slow.c3d", REAL.pack(read_points(room.c3d).rate)
    assert room.c3d.read_bytes().count(rate) == 2
    path.write_bytes(room.c3d.read_bytes().replace(rate, REAL.pack(0)))
    return path


@pytest.fixture
def label_points(run, tmp_path):
    def call(path, *words):
        answer = run("label", path, "--model", MODEL, "--out", tmp_path / "out", "--overwrite", *words)
        return answer, report_of(tmp_path / "out" / path.name) if answer.status == 0 else None

    return call


def test_label_says_which_axis_and_rate_it_took_and_takes_those_given(
    label_points, room, upside_down, without_rate, tmp_path
):
    answer, report = label_points(upside_down)
    assert SAID in answer.done().out
    assert report["up_axis"] == "+Z" and report["notes"][0].startswith(SAID)
    assert report["unlabelled"] < 0.1 * report["points"]
    found, truth = read_points(tmp_path / "out" / "down.c3d"), read_points(room.c3d)
    assert np.nanmedian(np.abs(found.xyz[:, [found.names.index(name) for name in truth.names]] - truth.xyz)) < 1e-4
    answer, report = label_points(upside_down, "--up", "z")
    assert SAID not in answer.out
    assert (report["up_axis"], report["notes"]) == ("+Z", [])
    for words in (["--up", "-z"], ["--up=-z"]):
        answer, report = label_points(upside_down, *words)
        assert answer.status == 1 or (report["up_axis"] == "-Z" and report["unlabelled"] > 0.9 * report["points"])
    assert "has a rate of 0 frames a second; expected a rate above zero" in label_points(without_rate)[0].reason
    answer, report = label_points(without_rate, "--rate", "60")
    assert (report["rate"], report["notes"], NO_RATE in answer.out) == (60, [NO_RATE], True)


def test_label_says_which_unit_it_took_where_the_file_names_none_that_is_known(label_points, room, tmp_path):
    write_trc(tmp_path / "odd.trc", read_points(room.c3d, frames=(100, 110)))
    head, millimetres, rows = (tmp_path / "odd.trc").read_text().partition("\tmm\t")
    (tmp_path / "odd.trc").write_text(f"{head}\tfurlong\t{rows}")
    answer, report = label_points(tmp_path / "odd.trc")
    assert ", no known unit in the file, taken for mm" in answer.out
    assert millimetres and report["unit_assumed"] == "mm"


def test_simulate_takes_axis_and_rate(run, room, upside_down, without_rate, tmp_path):
    def blobs(take, *words):
        out = tmp_path / "blobs.csv"
        said = run("simulate", take, "--cameras", room.cameras, "--out", out, "--overwrite", *words).done().out
        return said, out.read_text()

    plain = blobs(room.c3d)[1]
    for words, told in (([], True), (["--up", "z"], False)):
        said, seen = blobs(upside_down, *words)
        assert (seen == plain, SAID in said) == (True, told)
    assert blobs(upside_down, "--up", "-z")[1] != plain
    said, seen = blobs(without_rate, "--rate", "60")
    assert (seen == plain, NO_RATE in said) == (True, True)


def test_train_takes_axis_and_rate(run, upside_down, without_rate, tmp_path, monkeypatch):
    """The training, which takes its time, is left out."""
    jobs = []

    def train_file(job, *_):
        jobs.append(job)
        raise JobError("stops here; expected no more")

    monkeypatch.setattr("addon.cli.train.train_file", train_file)
    for take, *words in ((upside_down,), (upside_down, "--up", "-z"), (without_rate, "--rate", "60")):
        assert run("train", take, "--out", tmp_path / "ours.markerset.json", *words).status == 1
    as_it_stands, turned, timed = (read_takes(job.takes, job.subjects, job.known)[0] for job in jobs)
    assert as_it_stands.doubts[0].startswith(f"down.c3d: {SAID}")
    np.testing.assert_allclose(turned.xyz[..., 2], -as_it_stands.xyz[..., 2], atol=1e-9)
    assert (turned.doubts, timed.doubts) == ((), (f"slow.c3d: {NO_RATE}",))


def test_frames_are_numbered_up_to_the_last_of_32_bits(label_points, room, tmp_path):
    take = read_points(room.c3d)
    last = 2**32 - 1
    path = tmp_path / "late.c3d"
    for first, written in ((last - len(take.xyz) + 1, None), (0, None)):
        write_c3d(path, Points(take.names, take.xyz, take.residual, take.rate, first))
        assert label_points(path)[1].get("c3d_first_frame") == written
        assert read_points(tmp_path / "out" / "late.c3d").first_frame == first
    # The last of 32 bits is passed within the take.
    content = path.read_bytes()
    for name, number in (("START", last - 2), ("END", (last - 3 + len(take.xyz)) % 2**32)):
        at = content.index(f"ACTUAL_{name}_FIELD".encode()) + len(f"ACTUAL_{name}_FIELD") + 5
        content = content[:at] + struct.pack("<I", number) + content[at + 4 :]
    path.write_bytes(content[:6] + b"\xff\xff\xff\xff" + content[10:])
    words = f"goes on to frame {last - 3 + len(take.xyz)}; expected frame numbers up to {last}"
    assert words in label_points(path)[0].refusal(2)


Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
TURNED = "the cameras stand with y up in the calibration, which does not say: turned to z up"


@pytest.fixture
def lying(room, tmp_path):
    path = tmp_path / "lying.qca.txt"
    path.write_text(qca(turned(read_cameras(room.cameras), Y_UP_FROM_Z_UP)))
    return path


def test_reconstruct(run, room, lying, tmp_path):
    def points(name, cameras, *words):
        answer = run("reconstruct", room.blobs, "--cameras", cameras, "--out", tmp_path / name, "--json", *words)
        return read_points(tmp_path / name), answer.done().json

    plain, _ = points("plain.c3d", room.cameras)
    turned_back, said = points("turned.c3d", lying)
    assert said["calibration"] == [TURNED]
    np.testing.assert_allclose(turned_back.xyz, plain.xyz, atol=1e-4)
    _, told = points("told.c3d", lying, "--up", "y")
    assert "calibration" not in told
    overruled, _ = points("overruled.trc", lying, "--up", "z")
    np.testing.assert_allclose(overruled.xyz, plain.xyz @ Y_UP_FROM_Z_UP.T, atol=1e-4)
    assert TURNED in run("reconstruct", room.blobs, "--cameras", lying, "--out", tmp_path / "words.c3d").out


def test_label_and_simulate(label, run, room, lying, tmp_path):
    assert TURNED in label("--frames", "100:103", cameras=lying).out
    report = report_of(tmp_path / "out" / "walk.c3d")
    assert report["calibration"] == [TURNED] and report["unlabelled"] < 0.3 * report["blobs"]
    assert label("--frames", "100:103", "--up=-y", "--overwrite", cameras=lying).status == 0
    assert "calibration" not in report_of(tmp_path / "out" / "walk.c3d")
    words = "simulate", room.c3d, "--cameras", lying, "--out", tmp_path / "turned.csv", "--overwrite"
    assert [TURNED in run(*words, *more).out for more in ((), ("--cameras-up", "y"))] == [True, False]


PAUSE = 5 * 60 * 240  # frames: five minutes at 240 Hz


def moved(room, folder, shift: int, again: int = 0):
    """The room's blobs with other frame numbers, and where `again` is given once more so many frames later."""
    head, *rows = room.blobs.read_text().splitlines(keepends=True)
    fields = [row.split(",", 1) for row in rows]
    shifts = (shift, shift + again) if again else (shift,)
    path = folder / "moved.csv"
    path.write_text(head + "".join(f"{int(frame) + more},{rest}" for more in shifts for frame, rest in fields))
    return path


def test_minutes_without_anybody_keep_the_numbers_of_all_files(label, run, room, tmp_path):
    label("--trc", blobs=[moved(room, tmp_path, 0, PAUSE)]).done()
    report = report_of(tmp_path / "out" / "moved.csv")
    assert report["frames"] == PAUSE + 20
    assert {marker["longest_gap"] >= PAUSE - 20 for marker in report["markers"].values()} == {True}
    for ending in (".c3d", ".trc"):
        take = read_points(tmp_path / "out" / f"moved{ending}")
        seen = np.flatnonzero(np.isfinite(take.xyz).any(axis=(1, 2)))
        assert take.first_frame == 100
        assert np.isin([0, 19, PAUSE, PAUSE + 19], seen).all()
        assert not ((seen > 19) & (seen < PAUSE)).any()
    points = tmp_path / "points.c3d"
    assert run("reconstruct", moved(room, tmp_path, 0, 2000), "--cameras", room.cameras, "--out", points).status == 0
    assert len(read_points(points).xyz) == 2020


@pytest.mark.blender
def test_a_take_longer_than_blender_counts_is_refused_before_it_is_worked_on(label, room, tmp_path, monkeypatch):
    monkeypatch.setattr("addon.scene.clock.LAST_FRAME", 50)
    reason = label("--blend", blobs=[moved(room, tmp_path, 0, 60)]).refusal(1)
    assert "from frame 100 to 179; expected at most 50 frames" in reason
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("first", [5_000_000_000, 2**32 - 10])
def test_points_beyond_what_a_c3d_counts_are_told_with_file_and_line(run, room, tmp_path, first):
    path, out = tmp_path / "far.trc", tmp_path / "out"
    write_trc(path, read_points(room.c3d))
    lines = path.read_text().splitlines()
    rows = ["\t".join([str(first + at), *line.split("\t")[1:]]) for at, line in enumerate(lines[6:])]
    path.write_text("\n".join([*lines[:6], *rows, ""]))
    reason = run("label", path, "--model", MODEL, "--out", out, "--trc").refusal(2)
    assert "far.trc:" in reason and "up to 4294967295" in reason
    assert not out.exists()


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


def test_a_capture_is_labelled_without_cameras_as_its_blobs_would_be(run, capture, tmp_path):
    said = run("label", capture, "--model", MODEL, "--out", tmp_path / "out").quiet().out
    assert "its blobs (" in said and "are taken, not its 3D points (" in said and "--use" in said
    report = report_of(tmp_path / "out" / "walk.c3d")
    assert (report["rate"], report["rate_assumed"]) == (100.0, False)
    assert report["capture"][0].startswith("of walk.qtm, its blobs")
    # The same blobs as text, with the same calibration beside them.
    labels = [list(row.values()) for row in rows_of(tmp_path / "out" / "walk.labels.csv")]
    (tmp_path / "walk.csv").write_text("\n".join(["frame,camera,x,y", *(",".join(row[:4]) for row in labels), ""]))
    write_cameras(tmp_path / "room.toml", read_cameras(capture))
    run("label", tmp_path / "walk.csv", "--cameras", tmp_path / "room.toml", "--model", MODEL, "--out", tmp_path).done()
    theirs = [list(row.values()) for row in rows_of(tmp_path / "walk.labels.csv")]
    assert [row[:4] for row in labels] == [row[:4] for row in theirs]
    assert np.mean([one[4] == other[4] for one, other in zip(labels, theirs, strict=True)]) > 0.99
    assert np.mean([row[4] != "" for row in labels]) > 0.5


def test_its_points_are_labelled_where_they_are_asked_for(run, capture, tmp_path):
    answer = run("label", capture, "--use", "points", "--model", MODEL, "--out", tmp_path).done()
    assert "its 3D points (" in answer.out and "are taken, not its blobs" in answer.out
    report = report_of(tmp_path / "walk.c3d")
    assert report["points"] > 0 and report["provenance"]["cameras"] == []
    again = run("label", capture, "--use", "points", "--model", MODEL, "--out", tmp_path, "--resume")
    assert "done before" in again.out


def test_other_cameras_overrule_its_own_and_those_that_are_not_there_are_named(run, capture, tmp_path):
    own = read_cameras(capture)
    write_cameras(tmp_path / "fewer.toml", own.select(list(range(len(own) - 1))))
    words = ("--model", MODEL, "--out", tmp_path, "--frames", f"{FRAMES[0]}:{FRAMES[0] + 3}")
    said = run("label", capture, "--cameras", tmp_path / "fewer.toml", *words).done().out
    assert f"the blobs of 1 camera that the calibration does not have are left out: {own.names[-1]}" in said
    assert own.names[-1] not in {row["camera"] for row in rows_of(tmp_path / "walk.labels.csv")}
    write_cameras(tmp_path / "others.toml", replace(own, names=tuple(f"c{name}" for name in own.names)))
    answer = run("label", capture, "--cameras", tmp_path / "others.toml", *words, "--overwrite")
    assert "expected some of the calibration's, c11" in answer.reason


def test_reconstruct_and_refine_need_no_cameras_either(run, capture, room, tmp_path):
    answer = run("reconstruct", capture, "--out", tmp_path / "points.c3d", "--json")
    result = answer.json
    assert (answer.status, result["rate"], result["rate_assumed"]) == (0, 100.0, False)
    assert result["first_frame"] == FRAMES[0] and result["capture"]
    answer = run("reconstruct", room.blobs, "--out", tmp_path / "none.c3d")
    assert "holds blobs, and there is no calibration of their cameras; expected --cameras" in answer.reason
    run("refine", capture, "--model", MODEL, "--out", tmp_path / "room.toml").done()
    assert read_cameras(tmp_path / "room.toml").names == read_cameras(capture).names


def test_gaps_are_filled_and_cameras_taken_for_a_virtual_capture(run, capture, room, tmp_path):
    assert run("fill", capture, "--out", tmp_path / "filled.c3d").status == 0
    takes = read_points(capture), read_points(tmp_path / "filled.c3d")
    assert len({(take.rate, take.first_frame, len(take.xyz)) for take in takes}) == 1
    run("simulate", room.c3d, "--cameras", capture, "--out", tmp_path / "blobs.csv").done()
    assert {row["camera"] for row in rows_of(tmp_path / "blobs.csv")} <= set(read_cameras(capture).names)
