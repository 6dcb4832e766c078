# SPDX-License-Identifier: GPL-3.0-or-later
"""`reconstruct`: the file of unnamed points, what is said of it, and what cannot be done."""

import json

import ezc3d
import numpy as np
import pytest

from addon.io.points import read_points

from .conftest import FRAMES


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
    near = np.nanmin(distance[np.isfinite(found.xyz[..., 0])], axis=1) < 0.01
    assert near.mean() > 0.98
    assert np.nanmax(found.residual) < 0.02
    said = json.loads(answer.out)
    assert said["trajectories"] == len(labels)
    assert said["frames"] == FRAMES[1] - FRAMES[0] + 1
    assert not said["rate_assumed"]


def test_trc_and_words_for_people_and_what_cannot_be_done(reconstruct, tmp_path, run, room):
    answer = reconstruct("--frames", "105:114", out="points.trc")
    assert answer.status == 0
    assert "10 frames" in answer.out
    assert "blobs explained" in answer.out
    assert read_points(tmp_path / "points.trc").xyz.shape[0] == 10
    assert "expected a name that ends in .c3d" in reconstruct(out="points.csv").reason
    assert reconstruct().status == 0
    assert "exists already" in reconstruct().reason
    lone = tmp_path / "lone.csv"
    lone.write_text("".join(line for line in room.blobs.open() if line.split(",")[1] in ("camera", "cam1")))
    answer = run("reconstruct", lone, "--cameras", room.cameras, "--out", tmp_path / "lone.c3d")
    assert answer.status == 1
    assert "no two cameras" in answer.reason
    assert not (tmp_path / "lone.c3d").exists()
