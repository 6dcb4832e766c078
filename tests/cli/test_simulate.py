# SPDX-License-Identifier: GPL-3.0-or-later
"""`simulate`: blobs and truth of a labelled take."""

import json

import numpy as np
import pytest

from addon.core.data.takes import Points
from addon.demo.take import MODEL
from addon.io.markersets import open_markerset
from addon.io.points import read_points, write_c3d, write_trc

from .conftest import FRAMES, rows_of


@pytest.fixture
def simulate(run, room, tmp_path):
    def call(*words, take=None):
        return run("simulate", take or room.c3d, "--cameras", room.cameras, "--out", tmp_path / "sim.csv", *words)

    return call


def test_truth_lies_beside_the_blobs_row_for_row(simulate, tmp_path):
    answer = simulate("--frames", "103:119")
    assert (answer.status, answer.err) == (0, "")
    assert f"the body of {MODEL} in the way" in answer.out
    blobs, truth = rows_of(tmp_path / "sim.csv"), rows_of(tmp_path / "sim.csv.truth.csv")
    keys = ("frame", "camera", "x", "y")
    assert [[row[key] for key in keys] for row in blobs] == [[row[key] for key in keys] for row in truth]
    names = {name for row in truth for name in row["marker"].split("|")}
    assert names == {"", *open_markerset(MODEL).markers}
    assert {int(row["frame"]) for row in blobs} == set(range(103, FRAMES[1] + 1))
    assert all(float(row["area"]) > 0 for row in blobs)


def test_a_take_outside_the_room_is_moved_on_request(simulate, room, tmp_path):
    there = read_points(room.c3d)
    away = Points(there.names, there.xyz + np.array([50.0, 20.0, 0.0]), there.residual, there.rate, there.first_frame)
    write_c3d(tmp_path / "away.c3d", away)
    words = ("--ghosts", "0", "--flicker", "0")
    assert "--centre" in simulate(*words, take=tmp_path / "away.c3d").refusal(1)
    assert not (tmp_path / "sim.csv").exists()
    assert simulate(*words, "--centre", take=tmp_path / "away.c3d").status == 0


def test_markers_that_no_model_has_and_subjects_names(simulate, room, tmp_path):
    there = read_points(room.c3d)
    names = (*(f"Anna:{name}" for name in there.names), "EXTRA", "")
    xyz = np.concatenate([there.xyz, there.xyz[:, :1] + 0.05, there.xyz[:, :1] + 0.1], axis=1)
    residual = np.zeros(xyz.shape[:2])
    write_trc(tmp_path / "anna.trc", Points(names, xyz, residual, there.rate, there.first_frame))
    chosen = json.loads(simulate("--json", take=tmp_path / "anna.trc").out)
    assert chosen["markers"] == list(open_markerset(MODEL).markers)


@pytest.mark.parametrize(
    ("words", "status", "reason"),
    [
        (("--frames", "900:"), 2, "of its own 100 to 119"),
        (("--noise", "loud"), 2, "--noise"),
        (("--model", "nobody"), 2, "nobody"),
    ],
)
def test_what_cannot_be(simulate, words, status, reason):
    answer = simulate(*words)
    assert answer.status == status
    assert reason in answer.reason


def test_a_take_of_another_kind(simulate, room, tmp_path):
    assert simulate(take=room.cameras).status == 2
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(room.c3d.read_bytes()[:3000])
    assert "broken.c3d" in simulate(take=broken).reason
