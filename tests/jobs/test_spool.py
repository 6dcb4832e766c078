# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories on disk: back in their columns, in flat memory."""

import tracemalloc

import numpy as np

from addon.core.reconstruction.trajectories import Reconstructed
from addon.io.points import read_points, write_c3d
from addon.jobs import rebuild
from addon.jobs.rebuild import TrajectoryFile


def part(first: int, frames: int, spans: dict[int, range]) -> Reconstructed:
    """Frames of trajectories: each point is at (its frame, its trajectory, 1) m."""
    pairs = [(f, t) for f in range(frames) for t, span in spans.items() if first + f in span]
    frame, trajectory = np.array(pairs, int).reshape(-1, 2).T
    points = np.column_stack([first + frame, trajectory, np.ones(len(frame))]) / 100
    rows = np.zeros((len(frame), 3), int)
    return Reconstructed(np.arange(first, first + frames), frame, trajectory, points, 0.001 * frame, rows, 0.3)


def test_trajectories_come_back_in_columns_without_the_shortest(tmp_path):
    spans = {0: range(10, 30), 1: range(12, 14), 2: range(20, 40)}
    with TrajectoryFile(tmp_path, 50.0) as file:
        file.add(part(10, 10, spans))
        file.add(part(20, 20, spans))
        points = file.points()
        assert (points.first_frame, points.rate, points.names) == (10, 50.0, ("", ""))
        assert points.xyz.shape == (30, 2, 3)
        whole = points.xyz[:]
        np.testing.assert_allclose(whole[:20, 0, 0], np.arange(10, 30) / 100, atol=1e-6)
        assert np.isnan(whole[20:, 0]).all()
        assert np.isnan(whole[:10, 1]).all()
        np.testing.assert_allclose(whole[10:, 1, 1], 0.02, atol=1e-6)
        np.testing.assert_array_equal(points.xyz[15], whole[15])
        np.testing.assert_allclose(points.residual[3:6][:, 0], [0.003, 0.004, 0.005], atol=1e-6)
        write_c3d(tmp_path / "a.c3d", points)
    np.testing.assert_allclose(read_points(tmp_path / "a.c3d").xyz, whole, atol=1e-6)


def test_many_trajectories_share_columns_when_they_are_far_apart_in_time(tmp_path, monkeypatch):
    monkeypatch.setattr(rebuild, "MAX_COLUMNS", 3)
    spans = {number: range(40 * number, 40 * number + 30) for number in range(5)}
    with TrajectoryFile(tmp_path, 5.0) as file:
        file.add(part(0, 200, spans))
        points = file.points()
        assert points.xyz.shape[1] == 1
        np.testing.assert_allclose(points.xyz[:][[0, 45, 170], 0, 1], [0, 0.01, 0.04], atol=1e-6)


def test_memory_stays_flat(tmp_path):
    peaks = []
    for chunks in (45, 120):
        (tmp_path / str(chunks)).mkdir()
        with TrajectoryFile(tmp_path / str(chunks), 100.0) as file:
            tracemalloc.start()
            for number in range(chunks):
                file.add(part(100 * number, 100, {t: range(100_000) for t in range(10)}))
            write_c3d(tmp_path / "a.c3d", file.points())
            peaks.append(tracemalloc.get_traced_memory()[1])
            tracemalloc.stop()
    assert peaks[1] < 1.2 * peaks[0] + 200_000
