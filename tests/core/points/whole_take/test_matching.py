# SPDX-License-Identifier: GPL-3.0-or-later
"""Tracklets and markers matched at once, against all namings tried one by one; and ties, which are left open."""

from itertools import combinations, product

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.progress import finished
from addon.core.data.takes import NO_MARKER, Points
from addon.core.edits.kinds import AssignPoint, Edits
from addon.core.points.tracklets import VOTE
from addon.core.points.whole_take.matching import leads, margins, matched
from addon.core.points.whole_take.pipeline import PointOptions, label_take
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.models import open_model


def allowed(marker, first, last) -> bool:
    """Whether no two tracklets that meet have one name."""
    end = np.maximum(last - VOTE.max_overlap_frames, first)
    meeting = ((a, b) for a, b in combinations(range(len(marker)), 2) if first[a] <= end[b] and first[b] <= end[a])
    return not any(marker[a] == marker[b] != NO_MARKER for a, b in meeting)


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


def test_whoever_gives_up_a_name_must_take_the_other_in_exchange():
    first, last, marker = np.zeros(2, int), np.full(2, 99), np.array([0, 1])
    odds = np.array([[5.0, 4.0], [3.0, 4.0]])
    np.testing.assert_allclose(leads(odds, marker, first, last), [2.0, 2.0])
    odds = np.array([[5.0, -20.0], [-20.0, -9.0]])  # a name that hardly fits is better than the other
    np.testing.assert_allclose(leads(odds, marker, first, last), [36.0, 36.0])


def test_an_exchange_counts_for_the_part_of_the_time_that_the_other_is_there():
    first, last, marker = np.array([0, 0]), np.array([99, 49]) + VOTE.max_overlap_frames, np.array([0, 1])
    odds = np.array([[5.0, 1.0], [6.0, 4.0]])
    np.testing.assert_allclose(leads(odds, marker, first, last), [3.0, 2.0])


FRAMES, RATE = 240, 120.0
MARKER, APART_M, CUT = "RTHI", 0.02, 150
WORDS = f"another marker sits where {MARKER} may be: look which of the two it is"


@pytest.fixture(scope="module")
def model():
    return open_model("body39")


@pytest.fixture(scope="module")
def take(model):
    """The virtual person with a marker beside one of the set's, each as far from its place; that is in two pieces."""
    markers = make_performance(open_markerset("body39")).take.xyz[:FRAMES].astype(float)
    own = model.markerset.index(MARKER)
    beside = markers[:, [own]] - [0.0, 0.0, APART_M]
    markers[:, own] += [0.0, 0.0, APART_M]
    late = np.where(np.arange(FRAMES)[:, None, None] >= CUT + 6, markers[:, [own]], np.nan)
    markers[CUT:, own] = np.nan
    xyz = np.concatenate([markers, late, beside], axis=1)
    return Points(("",) * xyz.shape[1], xyz, np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan), RATE, 1)


def labelled(take, model, *edits):
    return finished(label_take(take, model, PointOptions("likelihood", edits=Edits(edits)))).whole()


def test_a_tie_is_one_question_which_its_own_answer_alone_settles(take, model):
    own, found = model.markerset.index(MARKER), labelled(take, model)
    assert not (found.labels.marker == own).any()
    assert [one.words for one in found.suspects].count(WORDS) == 1
    answered = labelled(take, model, AssignPoint(own, MARKER))
    there = np.isfinite(take.xyz[..., 0])
    assert (answered.labels.marker[there[:, own], own] == own).all()
    assert (answered.labels.marker[there[:, -2], -2] == own).all()
    assert (answered.labels.marker[:, -1] != own).all()
    assert WORDS not in [one.words for one in answered.suspects]
    head = model.markerset.index("LFHD")
    found = labelled(take, model, AssignPoint(head, "LFHD"))
    assert not (found.labels.marker == model.markerset.index(MARKER)).any()
    assert [one.words for one in found.suspects].count(WORDS) == 1
