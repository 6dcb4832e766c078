# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracklets and markers matched at once: against all namings tried one by one."""

from itertools import product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.takes import NO_MARKER
from addon.core.points.tracklets import VOTE
from addon.core.points.whole_take.matching import cliques, margins, matched


def allowed(marker, first, last) -> bool:
    """Whether no two tracklets that meet have one name."""
    end = np.maximum(last - VOTE.max_overlap_frames, first)
    for one in range(len(marker)):
        for other in range(one):
            meet = first[one] <= end[other] and first[other] <= end[one]
            if meet and marker[one] == marker[other] != NO_MARKER:
                return False
    return True


def total(odds, marker) -> float:
    named = np.flatnonzero(np.array(marker) != NO_MARKER)
    return float(odds[named, np.array(marker)[named]].sum())


def best_by_trying(odds, first, last) -> float:
    names = [*range(odds.shape[1]), NO_MARKER]
    every = product(names, repeat=len(odds))
    return max(total(odds, marker) for marker in every if allowed(marker, first, last))


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10**6))
def test_the_matching_is_the_best_of_all(seed):
    rng = np.random.default_rng(seed)
    odds = rng.normal(1, 4, (5, 3))
    first = rng.integers(0, 60, 5)
    last = first + rng.integers(0, 40, 5)
    marker = matched(odds, first, last)
    assert allowed(marker, first, last)
    assert total(odds, marker) == pytest.approx(best_by_trying(odds, first, last), abs=1e-6)


def test_of_equals_the_first_tracklet_has_the_first_marker():
    odds = np.array([[3.0, 3.0, 5.0], [3.0, 3.0 + 1e-12, 5.0], [3.0 + 1e-12, 3.0, 5.0]])
    assert matched(odds, np.zeros(3, int), np.full(3, 9)).tolist() == [0, 1, 2]


@given(st.integers(0, 10**6))
def test_cliques_hold_all_that_meet_and_nothing_else(seed):
    rng = np.random.default_rng(seed)
    first = rng.integers(0, 60, 7)
    end = first + rng.integers(0, 40, 7)
    meet = (first[:, None] <= end) & (first <= end[:, None])
    np.fill_diagonal(meet, False)
    held = np.zeros(meet.shape, bool)
    for clique in cliques(first, end):
        held[np.ix_(clique, clique)] = True
    np.fill_diagonal(held, False)
    assert (held == meet).all()


def test_a_margin_is_what_the_next_best_naming_lacks_and_what_nothing_speaks_for_has_no_name():
    first, last = np.array([0, 0]), np.array([50, 50])
    odds = np.array([[10.0, 4.0], [7.0, 6.0]])
    marker = matched(odds, first, last)
    assert marker.tolist() == [0, 1]
    # Exchanged they are worth 4 + 7 against 10 + 6.
    assert margins(odds, marker, first, last) == pytest.approx([5.0, 5.0])
    assert matched(np.full((2, 3), -1.0), np.zeros(2, int), np.full(2, 9)).tolist() == [NO_MARKER] * 2


@given(st.integers(0, 10**6))
def test_how_unlikely_a_ghost_is_changes_no_name_and_no_margin(seed):
    """`solving` does not ask how unlikely what is no marker in any case is."""
    rng = np.random.default_rng(seed)
    odds = rng.normal(0, 4, (30, 4))
    first = rng.integers(0, 60, 30)
    last = first + rng.integers(0, 40, 30)
    ghost = rng.random(30) < 0.6
    odds[ghost] = -np.abs(odds[ghost])
    other = np.where(ghost[:, None], -np.abs(rng.normal(0, 9, odds.shape)), odds)
    marker = matched(odds, first, last)
    assert (marker == matched(other, first, last)).all()
    np.testing.assert_array_equal(margins(odds, marker, first, last), margins(other, marker, first, last))
