# SPDX-License-Identifier: GPL-3.0-or-later
"""C3D files that say a wrong axis is up or have no rate, behind every verb that reads them: mended, said, overruled."""

import json
import struct

import numpy as np
import pytest

from addon.core.data.errors import JobError
from addon.core.data.takes import Points
from addon.demo.take import MODEL
from addon.io.points import read_points, write_c3d
from addon.jobs.training_takes import read_takes

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
def label(run, tmp_path):
    def call(path, *words):
        answer = run("label", path, "--model", MODEL, "--out", tmp_path / "out", "--overwrite", *words)
        report = tmp_path / "out" / f"{path.stem}.report.json"
        return answer, json.loads(report.read_text()) if answer.status == 0 else None

    return call


def test_label_says_which_axis_it_took(label, room, upside_down, tmp_path):
    answer, report = label(upside_down)
    assert answer.status == 0
    assert SAID in answer.out
    assert report["up_axis"] == "+Z"
    assert report["notes"][0].startswith(SAID)
    assert report["unlabelled"] < 0.1 * report["points"]
    found, truth = read_points(tmp_path / "out" / "down.c3d"), read_points(room.c3d)
    column = [found.names.index(name) for name in truth.names]
    assert np.nanmedian(np.abs(found.xyz[:, column] - truth.xyz)) < 1e-4


def test_label_takes_the_axis_that_is_given(label, upside_down):
    answer, report = label(upside_down, "--up", "z")
    assert SAID not in answer.out
    assert (report["up_axis"], report["notes"]) == ("+Z", [])
    for words in (["--up", "-z"], ["--up=-z"]):
        answer, report = label(upside_down, *words)
        assert answer.status == 1 or (report["up_axis"] == "-Z" and report["unlabelled"] > 0.9 * report["points"])


def test_label_takes_a_rate_where_there_is_none(label, without_rate):
    assert "has a rate of 0 frames a second; expected a rate above zero" in label(without_rate)[0].reason
    answer, report = label(without_rate, "--rate", "60")
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


def test_frames_are_numbered_up_to_the_last_of_32_bits(label, room, tmp_path):
    take = read_points(room.c3d)
    last = 2**32 - 1
    path = tmp_path / "late.c3d"
    for first, written in ((last - len(take.xyz) + 1, None), (0, None)):
        write_c3d(path, Points(take.names, take.xyz, take.residual, take.rate, first))
        answer, report = label(path)
        assert answer.status == 0, answer.err
        assert report.get("c3d_first_frame") == written
        assert read_points(tmp_path / "out" / "late.c3d").first_frame == first
    # The last of 32 bits is passed within the take.
    content = path.read_bytes()
    for name, number in (("START", last - 2), ("END", (last - 3 + len(take.xyz)) % 2**32)):
        at = content.index(f"ACTUAL_{name}_FIELD".encode()) + len(f"ACTUAL_{name}_FIELD") + 5
        content = content[:at] + struct.pack("<I", number) + content[at + 4 :]
    path.write_bytes(content[:6] + b"\xff\xff\xff\xff" + content[10:])
    answer, _ = label(path)
    assert answer.status == 2
    assert f"goes on to frame {last - 3 + len(take.xyz)}; expected frame numbers up to {last}" in answer.err
