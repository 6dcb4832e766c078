# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames that are worth a look are pointed out, once each, with the marker's name."""

import numpy as np

from addon.core.data.takes import Suspect
from addon.core.review.suspects import MAX_ENTRIES, find_suspects, summarised
from tests.core.scenes import motion_of

RATE = 100.0


def even(count: int = 40) -> np.ndarray:
    """Two markers that walk along at 1 m/s."""
    along = np.arange(count)[:, None, None] / RATE * np.array([1.0, 0, 0])
    return along + np.array([[0.0, 0, 1], [0, 0.5, 1]])


def test_a_steady_walk_is_not_suspect():
    assert find_suspects(motion_of(even(), even(), 10), ("A", "B"), RATE) == ()


def test_a_marker_away_from_the_body_is_one_range_over_short_interruptions():
    markers = even()
    markers[5:9, 1, 2] += 0.2
    markers[11:13, 1, 2] += 0.2
    found = find_suspects(motion_of(markers, even(), 10), ("A", "B"), 1.0)
    assert [(s.first, s.last, s.reason) for s in found] == [(15, 22, "B is far from where the body has it")]


def test_a_jump_is_found_where_it_happens_and_a_gap_is_none():
    markers = even()
    markers[20, 0, 1] += 0.1
    markers[30:33, 1] = np.nan
    found = find_suspects(motion_of(markers, markers, 10), ("A", "B"), RATE)
    assert {s.reason for s in found} == {"A jumps"}
    assert found[0].first <= 30 <= found[0].last


def test_findings_with_one_reason_that_are_close_are_one():
    found = summarised([Suspect(30, 31, "A jumps"), Suspect(10, 12, "A jumps"), Suspect(40, 40, "B jumps")], RATE)
    assert found == (Suspect(10, 31, "A jumps"), Suspect(40, 40, "B jumps"))


def test_many_findings_with_one_reason_are_one_that_counts_them():
    found = summarised([Suspect(first, first + 1, "A jumps") for first in range(0, 1000, 100)], RATE)
    assert found == (Suspect(0, 901, "A jumps, in 10 places"),)


def test_a_list_stays_short_and_names_those_it_is_about_and_what_is_of_the_whole_take_is_first():
    many = [Suspect(index, index, f"M{index:03} jumps") for index in range(200)]
    few = [Suspect(5, 9, "trajectory 3 goes over from A to B"), Suspect(0, 999, "10 trajectories stand still")]
    found = summarised(many + few, RATE)
    assert len(found) == 3 <= MAX_ENTRIES
    assert found[0].reason == "10 trajectories stand still"
    assert found[1] == Suspect(0, 199, "M000 M001 M002 M003 M004 M005 M006 M007 and 192 more: jumps")
    assert found[2] in few


def test_trajectories_of_one_kind_are_listed_by_number():
    many = [Suspect(index, index + 900, f"trajectory {index} goes over from A to M{index}") for index in range(100)]
    (found,) = summarised(many, RATE)
    assert found.reason.startswith("trajectories 0 1 2 3 4 5 6 7 and 92 more: as trajectory 0 goes over from A to M0")
    assert (found.first, found.last) == (0, 999)
