# SPDX-License-Identifier: GPL-3.0-or-later
"""Files that say a wrong axis is up or have no rate, behind every verb that reads them: mended, said, overruled."""

import json
import struct

import numpy as np
import pytest

from addon.core.data.errors import JobError
from addon.core.data.takes import Points
from addon.core.geometry.camera_up import turned
from addon.demo.take import MODEL
from addon.io.cameras import read_cameras
from addon.io.points import read_points, write_c3d
from addon.jobs.training_takes import read_takes
from tests.io.samples import qca

from .conftest import report_of

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
        report = tmp_path / "out" / f"{path.stem}.report.json"
        return answer, json.loads(report.read_text()) if answer.status == 0 else None

    return call


def test_label_says_which_axis_it_took_and_takes_the_one_that_is_given(label_points, room, upside_down, tmp_path):
    answer, report = label_points(upside_down)
    assert answer.status == 0
    assert SAID in answer.out
    assert report["up_axis"] == "+Z"
    assert report["notes"][0].startswith(SAID)
    assert report["unlabelled"] < 0.1 * report["points"]
    found, truth = read_points(tmp_path / "out" / "down.c3d"), read_points(room.c3d)
    column = [found.names.index(name) for name in truth.names]
    assert np.nanmedian(np.abs(found.xyz[:, column] - truth.xyz)) < 1e-4
    answer, report = label_points(upside_down, "--up", "z")
    assert SAID not in answer.out
    assert (report["up_axis"], report["notes"]) == ("+Z", [])
    for words in (["--up", "-z"], ["--up=-z"]):
        answer, report = label_points(upside_down, *words)
        assert answer.status == 1 or (report["up_axis"] == "-Z" and report["unlabelled"] > 0.9 * report["points"])


def test_label_takes_a_rate_where_there_is_none(label_points, without_rate):
    assert "has a rate of 0 frames a second; expected a rate above zero" in label_points(without_rate)[0].reason
    answer, report = label_points(without_rate, "--rate", "60")
    assert (report["rate"], report["notes"]) == (60, [NO_RATE])
    assert NO_RATE in answer.out


def test_simulate_takes_axis_and_rate(run, room, upside_down, without_rate, tmp_path):
    def blobs(take, *words):
        out = tmp_path / "blobs.csv"
        answer = run("simulate", take, "--cameras", room.cameras, "--out", out, "--overwrite", *words)
        return answer, out.read_text() if answer.status == 0 else ""

    plain = blobs(room.c3d)[1]
    answer, seen = blobs(upside_down)
    assert seen == plain
    assert SAID in answer.out
    answer, seen = blobs(upside_down, "--up", "z")
    assert seen == plain
    assert SAID not in answer.out
    assert blobs(upside_down, "--up", "-z")[1] != plain
    assert "rate of 0" in blobs(without_rate)[0].reason
    answer, seen = blobs(without_rate, "--rate", "60", "--json")
    assert seen == plain
    assert json.loads(answer.out)["notes"] == [NO_RATE]


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
        answer, report = label_points(path)
        assert answer.status == 0, answer.err
        assert report.get("c3d_first_frame") == written
        assert read_points(tmp_path / "out" / "late.c3d").first_frame == first
    # The last of 32 bits is passed within the take.
    content = path.read_bytes()
    for name, number in (("START", last - 2), ("END", (last - 3 + len(take.xyz)) % 2**32)):
        at = content.index(f"ACTUAL_{name}_FIELD".encode()) + len(f"ACTUAL_{name}_FIELD") + 5
        content = content[:at] + struct.pack("<I", number) + content[at + 4 :]
    path.write_bytes(content[:6] + b"\xff\xff\xff\xff" + content[10:])
    answer, _ = label_points(path)
    assert answer.status == 2
    assert f"goes on to frame {last - 3 + len(take.xyz)}; expected frame numbers up to {last}" in answer.err


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
        assert answer.status == 0, answer.err
        return read_points(tmp_path / name), json.loads(answer.out)

    plain, _ = points("plain.c3d", room.cameras)
    turned_back, said = points("turned.c3d", lying)
    assert said["calibration"] == [TURNED]
    np.testing.assert_allclose(turned_back.xyz, plain.xyz, atol=1e-4)
    _, told = points("told.c3d", lying, "--up", "y")
    assert "calibration" not in told
    overruled, _ = points("overruled.trc", lying, "--up", "z")
    np.testing.assert_allclose(overruled.xyz, plain.xyz @ Y_UP_FROM_Z_UP.T, atol=1e-4)
    words = run("reconstruct", room.blobs, "--cameras", lying, "--out", tmp_path / "words.c3d").out
    assert TURNED in words


def test_label_and_simulate(label, run, room, lying, tmp_path):
    assert TURNED in label("--frames", "100:103", cameras=lying).out
    report = report_of(tmp_path / "out" / "walk.c3d")
    assert report["calibration"] == [TURNED]
    assert report["unlabelled"] < 0.3 * report["blobs"]
    assert label("--frames", "100:103", "--up=-y", "--overwrite", cameras=lying).status == 0
    assert "calibration" not in report_of(tmp_path / "out" / "walk.c3d")
    words = "simulate", room.c3d, "--cameras", lying, "--out", tmp_path / "turned.csv", "--overwrite"
    assert TURNED in run(*words).out
    assert TURNED not in run(*words, "--cameras-up", "y").out


def test_no_other_axis_is_known(run, room, tmp_path):
    words = "reconstruct", room.blobs, "--cameras", room.cameras, "--out", tmp_path / "a.c3d", "--up", "w"
    assert run(*words).status == 2
