# SPDX-License-Identifier: GPL-3.0-or-later
"""A calibration with y up behind every verb that takes one: it is turned, that is said, and `--up` overrules it."""

import json

import numpy as np
import pytest

from addon.core.geometry.camera_up import turned
from addon.io.cameras import read_cameras
from addon.io.points import read_points
from tests.io.samples import qca

from .conftest import report_of

Y_UP_FROM_Z_UP = np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]])
SAID = "the cameras stand with y up in the calibration, which does not say: turned to z up"


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
    assert said["calibration"] == [SAID]
    np.testing.assert_allclose(turned_back.xyz, plain.xyz, atol=1e-4)
    _, told = points("told.c3d", lying, "--up", "y")
    assert "calibration" not in told
    overruled, _ = points("overruled.trc", lying, "--up", "z")
    np.testing.assert_allclose(overruled.xyz, plain.xyz @ Y_UP_FROM_Z_UP.T, atol=1e-4)
    words = run("reconstruct", room.blobs, "--cameras", lying, "--out", tmp_path / "words.c3d").out
    assert SAID in words


def test_label_and_simulate(label, run, room, lying, tmp_path):
    assert SAID in label("--frames", "100:103", cameras=lying).out
    report = report_of(tmp_path / "out" / "walk.c3d")
    assert report["calibration"] == [SAID]
    assert report["unlabelled"] < 0.3 * report["blobs"]
    assert label("--frames", "100:103", "--up=-y", "--overwrite", cameras=lying).status == 0
    assert "calibration" not in report_of(tmp_path / "out" / "walk.c3d")
    words = "simulate", room.c3d, "--cameras", lying, "--out", tmp_path / "turned.csv", "--overwrite"
    assert SAID in run(*words).out
    assert SAID not in run(*words, "--cameras-up", "y").out


def test_no_other_axis_is_known(run, room, tmp_path):
    words = "reconstruct", room.blobs, "--cameras", room.cameras, "--out", tmp_path / "a.c3d", "--up", "w"
    assert run(*words).status == 2
