# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames that are worth a look are pointed out, once each, with the marker's name."""

import numpy as np

from addon.core.suspects import find_suspects
from addon.core.takes import Motion

RATE = 100.0


def motion_of(markers: np.ndarray, expected: np.ndarray) -> Motion:
    """A motion of F frames in which nothing but the markers matters; frames count from 10."""
    count = len(markers)
    nothing = np.zeros(markers.shape[:2])
    pose = np.zeros((count, 1, 3)), np.tile(np.eye(3), (count, 1, 1, 1)), np.ones((count, 3)), np.ones(count)
    return Motion(np.arange(10, 10 + count), markers, nothing, nothing, nothing, expected, *pose)


def steady(count: int = 40) -> np.ndarray:
    """Two markers that walk along at 1 m/s."""
    along = np.arange(count)[:, None, None] / RATE * np.array([1.0, 0, 0])
    return along + np.array([[0.0, 0, 1], [0, 0.5, 1]])


def test_a_steady_walk_is_not_suspect():
    assert find_suspects(motion_of(steady(), steady()), ("A", "B"), RATE) == ()


def test_a_marker_away_from_the_body_is_one_range_over_short_interruptions():
    markers = steady()
    markers[5:9, 1, 2] += 0.2
    markers[11:13, 1, 2] += 0.2
    found = find_suspects(motion_of(markers, steady()), ("A", "B"), 1.0)
    assert [(s.first, s.last, s.reason) for s in found] == [(15, 22, "B is far from where the body has it")]


def test_a_jump_is_found_where_it_happens_and_a_gap_is_none():
    markers = steady()
    markers[20, 0, 1] += 0.1
    markers[30:33, 1] = np.nan
    found = find_suspects(motion_of(markers, markers), ("A", "B"), RATE)
    assert {s.reason for s in found} == {"A jumps"}
    assert found[0].first <= 30 <= found[0].last
