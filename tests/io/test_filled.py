# SPDX-License-Identifier: GPL-3.0-or-later
"""What was filled is told apart from what was measured, in C3D files and in the table of gaps."""

import csv

import ezc3d
import numpy as np

from addon.core.data.takes import Points
from addon.core.filling.filling import FilledGap
from addon.core.filling.gaps import Gap
from addon.io.filled import gap_rows, write_filled
from addon.io.points import read_points, write_c3d


def test_residuals_tell_filled_measured_and_missing_samples_unless_all_are_zero(tmp_path):
    xyz = np.random.default_rng(0).uniform(0.1, 1, (1, 6, 3))
    xyz[0, 5] = np.nan
    residual = np.array([[0.0, np.nan, 1e-6, 0.0005, 1.0, np.nan]])
    path = tmp_path / "a.c3d"
    write_c3d(path, Points(tuple("ABCDEF"), xyz, residual, 100.0, 1))
    found = ezc3d.c3d(str(path))["data"]["meta_points"]["residuals"][0, :, 0]
    np.testing.assert_allclose(found, [0, 0.1, 0.05, 0.5, 6.35, -1], atol=1e-6)
    np.testing.assert_allclose(read_points(path).residual[0, :5], [0, 1e-4, 5e-5, 5e-4, 0.01275], atol=1e-8)
    path = tmp_path / "a.c3d"
    write_c3d(path, Points(("A", "B"), np.ones((3, 2, 3)), np.zeros((3, 2)), 100.0, 1))
    take = read_points(path)
    assert np.isnan(take.residual).all()
    write_c3d(tmp_path / "b.c3d", take)
    np.testing.assert_allclose(read_points(tmp_path / "b.c3d").residual, 1e-4, atol=1e-9)


def test_the_table_has_a_row_a_gap_by_the_sources_frames(tmp_path):
    gaps = [FilledGap(Gap(4, 9, 1), "regression", 0.00213), FilledGap(Gap(0, 1, 0), "rigid", np.nan, (False, True))]
    write_filled(tmp_path / "a.filled.csv", gap_rows(gaps, ["=A", 'B,"x"'], 101))
    assert [row["rests_on"] for row in gap_rows(gaps, ["A", "B"], 101)] == ["both ends", "its end"]
    with (tmp_path / "a.filled.csv").open(newline="") as file:
        rows = list(csv.reader(file))
    assert rows == [
        ["marker", "first", "last", "method", "expected_mm"],
        ['B,"x"', "105", "109", "regression", "2.13"],
        ["'=A", "101", "101", "rigid", ""],
    ]
