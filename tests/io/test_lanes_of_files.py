# SPDX-License-Identifier: GPL-3.0-or-later
"""Files of thousands of short trajectories: read and written in little memory, and the same as column by column."""

import tracemalloc

import numpy as np
import pytest

from addon.core.data.columns import Columns, beside_of
from addon.core.data.lanes import Lanes
from addon.core.data.progress import finished
from addon.core.data.takes import Points
from addon.io.points import read_points, write_c3d, write_trc
from addon.io.textpoints import read_trc
from addon.jobs.fill import FillJob, fill_file
from tests.io.whole_columns import dense, read_c3d

FRAMES, AT_ONCE, LENGTH = 1000, 20, 8
LANES = AT_ONCE + 1  # of which one is named, and there all of the time
COUNT = 1 + AT_ONCE * FRAMES // LENGTH


@pytest.fixture(scope="module")
def take() -> Points:
    """Somebody's many short trajectories in no order, and a marker, LASI, with a gap."""
    rng = np.random.default_rng(0)
    first = np.concatenate([[0], np.repeat(np.arange(0, FRAMES, LENGTH), AT_ONCE)])
    last = np.concatenate([[FRAMES - 1], first[1:] + LENGTH - 1])
    order = rng.permutation(COUNT)
    lanes = Lanes.packed(first[order], last[order])
    assert lanes.count == LANES
    xyz = 1 + 0.05 * np.arange(LANES)[:, None] + np.cumsum(rng.normal(0, 0.001, (FRAMES, LANES, 3)), axis=0)
    named = int(np.flatnonzero(order == 0)[0])
    xyz[400:405, lanes.lane[named]] = np.nan
    names = tuple("LASI" if index == named else "" for index in range(COUNT))
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan)
    return Points(names, xyz, residual, 100.0, 11, None, lanes)


def in_columns(take: Points) -> Points:
    """The take with a column for each trajectory, as files have it."""
    nobody, every = np.zeros(0, int), np.arange(COUNT)
    xyz, residual = (
        Columns(np.zeros((FRAMES, 0, *values.shape[2:])), nobody, COUNT, beside_of(take, values, every))
        for values in (take.xyz, take.residual)
    )
    return Points(take.names, xyz, residual, take.rate, take.first_frame)


@pytest.fixture(scope="module")
def path(take, tmp_path_factory):
    """The take as a C3D file."""
    path = tmp_path_factory.mktemp("lanes") / "raw.c3d"
    write_c3d(path, in_columns(take))
    return path


def test_a_file_of_thousands_of_trajectories_fills_no_memory(path):
    table = FRAMES * COUNT * 24
    tracemalloc.start()
    try:
        found = read_points(path, up="z")
        assert tracemalloc.get_traced_memory()[1] < table / 3
        tracemalloc.reset_peak()
        before = tracemalloc.get_traced_memory()[0]
        write_c3d(path.with_name("again.c3d"), in_columns(found))
        assert tracemalloc.get_traced_memory()[1] - before < table / 3
    finally:
        tracemalloc.stop()
    assert path.with_name("again.c3d").read_bytes() == path.read_bytes()


def test_lanes_hold_what_the_columns_of_a_file_hold_and_texts_are_packed_too(take, path, tmp_path):
    found, columns = read_points(path, up="z"), read_c3d(path)
    assert found.xyz.shape == (FRAMES, LANES, 3)
    assert found.names == take.names
    np.testing.assert_array_equal(found.lanes.lane, take.lanes.lane)
    shown = found.picked(range(COUNT))
    np.testing.assert_array_equal(shown.xyz, columns.xyz * 0.001)
    np.testing.assert_array_equal(shown.residual, columns.residual * 0.001)
    part = read_points(path, up="z", frames=(211, 310))
    np.testing.assert_array_equal(part.picked(range(COUNT)).xyz, columns.xyz[200:300] * 0.001)
    few = take.lanes.between(0, 40)
    part = Points(take.names, take.xyz[:40], take.residual[:40], 100.0, 11, None, few)
    shown = part.picked(range(COUNT))
    write_trc(tmp_path / "raw.trc", shown)
    found = read_points(tmp_path / "raw.trc")
    assert found.xyz.shape[1] == LANES
    text = read_trc(tmp_path / "raw.trc")
    trc, _ = dense(text.frames, COUNT, text.parts())
    np.testing.assert_array_equal(found.picked(range(COUNT)).xyz, trc * 0.001)


def test_gaps_of_a_marker_among_thousands_of_trajectories_are_filled(take, path, tmp_path):
    said = finished(fill_file(FillJob(path, tmp_path / "whole.c3d", up="z")))
    assert said["samples_filled"] == said["samples_missing"] == 5
    before, after = read_points(path, up="z"), read_points(tmp_path / "whole.c3d", up="z")
    assert after.names == before.names
    named = before.names.index("LASI")
    was, now = before.picked([named]), after.picked([named])
    assert np.isnan(was.xyz[400:405]).all()
    assert np.isfinite(now.xyz).all()
    assert (now.residual[400:405] == 0).all()
    others = [index for index in range(COUNT) if index != named]
    np.testing.assert_array_equal(after.picked(others).xyz, before.picked(others).xyz)
