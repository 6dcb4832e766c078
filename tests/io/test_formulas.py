# SPDX-License-Identifier: GPL-3.0-or-later
"""Names of markers and cameras that a table takes for a formula: harmless in our files, and read as they are."""

import numpy as np
import pytest

from addon.core.data.takes import Blobs, Labels, PointRows
from addon.core.geometry.cameras import Cameras
from addon.io.blobs import read_blobs, write_blobs
from addon.io.filled import write_filled
from addon.io.labels import LabelFile, TruthWriter, write_point_labels

NAMES = ("=1+1", "@SUM", "+A", "-A", "'=A", "LASI")
WRITTEN = ("'=1+1", "'@SUM", "'+A", "'-A", "''=A", "LASI")


def test_markers_in_labels(tmp_path):
    count = len(NAMES)
    rows = PointRows(np.array([7]), np.zeros(count, int), np.arange(count), np.zeros((count, 3)), np.zeros(count))
    write_point_labels(tmp_path / "a.csv", rows, Labels(np.arange(count), np.ones(count, int), np.ones(count)), NAMES)
    lines = (tmp_path / "a.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert [line.split(",")[2] for line in lines] == list(WRITTEN)
    with LabelFile(tmp_path / "a.csv") as file:
        assert [row.marker for row in file.rows()] == list(NAMES)


def test_markers_in_truth_and_in_the_list_of_gaps(tmp_path):
    with TruthWriter(tmp_path / "a.csv") as writer:
        writer.write([f"1,cam,{place},2" for place in range(len(NAMES))], NAMES)
    with LabelFile(tmp_path / "a.csv") as file:
        assert [row.marker for row in file.rows()] == list(NAMES)
    gap = {"first": 1, "last": 2, "method": "spline", "expected_mm": None}
    write_filled(tmp_path / "b.csv", [gap | {"marker": name} for name in NAMES])
    lines = (tmp_path / "b.csv").read_text(encoding="utf-8").splitlines()[1:]
    assert [line.split(",")[0] for line in lines] == list(WRITTEN)


@pytest.mark.parametrize("name", NAMES)
def test_cameras_in_blobs(tmp_path, name):
    turn = np.eye(3)[None]
    cameras = Cameras((name,), np.full((1, 2), 640), turn, np.zeros((1, 5)), turn, np.zeros((1, 3)))
    blobs = Blobs(np.array([1]), np.zeros(1, int), np.zeros(1, int), np.ones((1, 2)), np.full(1, np.nan))
    keys = write_blobs(tmp_path / "a.csv", blobs, cameras)
    assert keys == [f"1,{WRITTEN[NAMES.index(name)]},1.000,1.000"]
    [chunk] = read_blobs(tmp_path / "a.csv", cameras)
    assert (chunk.blobs.camera.tolist(), chunk.keys) == ([0], keys)
