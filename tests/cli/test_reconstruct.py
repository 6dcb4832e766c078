# SPDX-License-Identifier: GPL-3.0-or-later
"""`reconstruct`: the file of unnamed points and what is said of it; `simulate`: blobs and truth of a labelled take."""

import json

import ezc3d
import numpy as np
import pytest

from addon.core.data.takes import Points
from addon.demo.take import MODEL
from addon.io.markersets import open_markerset
from addon.io.points import read_points, write_c3d, write_trc

from .conftest import FRAMES, rows_of


@pytest.fixture
def reconstruct(run, room, tmp_path):
    def call(*words, out="points.c3d"):
        return run("reconstruct", room.blobs, "--cameras", room.cameras, "--out", tmp_path / out, *words)

    return call


def test_the_points_are_the_markers_without_names(reconstruct, room, tmp_path):
    answer = reconstruct("--rate", "60", "--json")
    assert (answer.status, answer.err) == (0, "")
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
    said = json.loads(answer.out)
    assert said["trajectories"] == len(labels)
    assert said["frames"] == FRAMES[1] - FRAMES[0] + 1
    assert not said["rate_assumed"]


def test_trc_and_words_for_people_and_what_cannot_be_done(reconstruct, tmp_path, run, room):
    answer = reconstruct("--frames", "105:114", out="points.trc").done()
    assert "10 frames" in answer.out
    assert "blobs explained" in answer.out
    assert read_points(tmp_path / "points.trc").xyz.shape[0] == 10
    assert "expected a name that ends in .c3d" in reconstruct(out="points.csv").reason
    assert reconstruct().status == 0
    assert "exists already" in reconstruct().reason
    lone = tmp_path / "lone.csv"
    lone.write_text("".join(line for line in room.blobs.open() if line.split(",")[1] in ("camera", "cam1")))
    reason = run("reconstruct", lone, "--cameras", room.cameras, "--out", tmp_path / "lone.c3d").refusal(1)
    assert "no two cameras" in reason
    assert not (tmp_path / "lone.c3d").exists()


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
    assert {name for row in truth for name in row["marker"].split("|")} == {"", *open_markerset(MODEL).markers}
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
    write_trc(tmp_path / "anna.trc", Points(names, xyz, np.zeros(xyz.shape[:2]), there.rate, there.first_frame))
    chosen = json.loads(simulate("--json", take=tmp_path / "anna.trc").out)
    assert chosen["markers"] == list(open_markerset(MODEL).markers)


def test_a_take_of_another_kind(simulate, room, tmp_path):
    assert simulate(take=room.cameras).status == 2
    broken = tmp_path / "broken.c3d"
    broken.write_bytes(room.c3d.read_bytes()[:3000])
    assert "broken.c3d" in simulate(take=broken).reason
