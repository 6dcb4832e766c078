# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that a whole take contradicts are found, and nothing else is."""

import numpy as np

from addon.core.data.takes import NO_MARKER
from addon.core.points.deciding import MarkerPlaces, stray_suspects, strays
from addon.core.points.likelihood.distances import DistanceConstraints

CONSTRAINTS = DistanceConstraints(np.array(np.triu_indices(4, 1)).T, np.full(6, 0.2), np.full(6, 0.004), 0.05)


def rigid_body(frames: int = 100) -> np.ndarray:
    """(T, 5, 3) four markers on a plate that wanders, and one that has no ties."""
    path = np.cumsum(np.random.default_rng(0).normal(0, 0.01, (frames, 1, 3)), axis=0)
    return path + np.random.default_rng(1).uniform(-0.1, 0.1, (5, 3))


def places(markers: np.ndarray) -> MarkerPlaces:
    """Those of markers (T, 5, 3), which stand in lanes in the other order."""
    there = np.isfinite(markers).all(axis=2)[:, ::-1]
    return MarkerPlaces(markers[:, ::-1], np.where(there, np.arange(5)[::-1], NO_MARKER), 5)


def test_a_marker_that_leaves_its_plate_is_found_and_its_mates_are_not():
    markers = rigid_body()
    markers[40:46, 2] += 0.06
    markers[:, 4] += np.random.default_rng(2).normal(0, 0.2, (100, 3))
    markers[10:20, 0] = np.nan
    stray = strays(places(markers), CONSTRAINTS)
    assert np.argwhere(stray).tolist() == [[frame, 2] for frame in range(40, 46)]


def test_nothing_is_said_of_too_few_mates_or_frames():
    markers = rigid_body()
    markers[40:46, 2] += 0.06
    markers[:, :1] = np.nan
    markers[30:60, 1] = np.nan
    assert not strays(places(markers), CONSTRAINTS).any()
    assert not strays(places(rigid_body(3) * np.nan), CONSTRAINTS).any()


def test_ranges_bridge_short_interruptions():
    stray = np.zeros((100, 5), bool)
    stray[[10, 12, 15, 40], 1] = True
    found = stray_suspects(stray, list("ABCDE"), 1000)
    assert [(one.first, one.last) for one in found] == [(1010, 1015), (1040, 1040)]
    assert found[0].reason.startswith("B was off")
