# SPDX-License-Identifier: GPL-3.0-or-later
"""Intervals, wrong labellings and the tailored boosting."""

from itertools import pairwise

import numpy as np
import pytest

from addon.core.papers.partial_solvers.boosting import Boosting, boost, learn_intervals, rejections, wrong_labellings
from addon.core.papers.partial_solvers.features import all_features, tables
from addon.core.papers.partial_solvers.model import FUNCTIONS, Strong
from tests.core.papers.partial_solvers.plain import moving, pool_of


def test_weak_classifiers_accept_all_they_learned_from():
    points = moving()
    labelling = np.tile(np.arange(points.shape[1]), (len(points), 1))
    assert not rejections(pool_of(points), np.arange(len(points)), labelling, tables(points)).any()


def test_intervals_end_at_values_that_were_seen():
    points = moving(4, 50)
    pool = pool_of(points)
    pair = np.flatnonzero(
        (pool.kind == FUNCTIONS.index("distance")) & (pool.points[:, 0] == 1) & (pool.points[:, 1] == 3)
    )
    seen = np.linalg.norm(points[:, 1] - points[:, 3], axis=1)
    assert pool.low[pair[0]] == pytest.approx(seen.min())
    assert pool.high[pair[0]] == pytest.approx(seen.max())


def test_gaps_leave_out_frames_and_markers_never_seen_together_have_no_classifier():
    points = moving(5, 60)
    points[:30, 0] = np.nan
    points[30:, 1] = np.nan
    pool = learn_intervals(tables(points), *all_features(5))
    assert not ((pool.points == 0).any(axis=1) & (pool.points == 1).any(axis=1)).any()
    assert np.isfinite(pool.low).all()
    assert (pool.low <= pool.high).all()


def test_wrong_labellings_have_the_severity_they_were_drawn_with():
    wrong = wrong_labellings(np.arange(9), 7, 3000, np.random.default_rng(0))
    severity = wrong.moved.sum(axis=1)
    assert (np.sort(wrong.labelling, axis=1) == np.arange(7)).all()
    counts = np.bincount(severity, minlength=8)
    assert counts[:2].tolist() == [0, 0]
    assert (np.abs(counts[2:] - 500) < 100).all()


def test_a_toy_log_by_hand():
    # Labellings 0 1 2 3 of severity 2 3 2 5; three weak classifiers reject: a 0 and 1, b 1 2 3, c 3.
    rejected = np.array([[1, 1, 0, 0], [0, 1, 1, 1], [0, 0, 0, 1]], dtype=bool)
    severity = np.array([2, 3, 2, 5])
    strong = boost(rejected, severity, Boosting(accuracy=1.0, period=2))
    # First two: a gains 2 + 3, b 3; a joins. Next two: b gains 2 + 5 more, c 5; b joins, and all are rejected.
    assert strong.chosen.tolist() == [0, 1]
    assert strong.weights.tolist() == [5.0, 10.0]


def test_a_rejected_labelling_is_passed_over():
    rejected = np.array([[1, 1, 0], [0, 1, 0], [0, 0, 1]], dtype=bool)
    strong = boost(rejected, np.array([2, 2, 2]), Boosting(accuracy=1.0, period=1))
    # Once classifier 0 rejects labelling 1, classifier 1 gains nothing from it and never joins.
    assert strong.chosen.tolist() == [0, 2]


def test_boosting_reaches_its_accuracy_and_false_positives_fall():
    points = moving()
    pool, clouds = pool_of(points), tables(points)
    wrong = wrong_labellings(np.arange(len(points)), 6, 1500, np.random.default_rng(1))
    rejected = rejections(pool, wrong.frame, wrong.labelling, clouds)
    strong = boost(rejected, wrong.moved.sum(axis=1), Boosting(accuracy=0.999))
    through = [(~rejected[strong.chosen[:count]].any(axis=0)).mean() for count in range(len(strong) + 1)]
    assert all(after < before for before, after in pairwise(through))
    assert through[-1] <= 0.001
    assert len(set(strong.chosen.tolist())) == len(strong)


def test_going_on_keeps_what_was_chosen():
    rejected = np.array([[1, 0], [0, 1]], dtype=bool)
    start = Strong(np.array([1]), np.array([7.0]))
    strong = boost(rejected, np.array([2, 2]), Boosting(accuracy=1.0), start)
    assert strong.chosen.tolist() == [1, 0]
    assert strong.weights[0] == 7.0


def test_votes_are_equation_two():
    strong = Strong(np.array([4, 2, 9]), np.array([1.0, 2.0, 5.0]))
    accepted = np.array([[1, 1, 1], [1, 0, 1], [0, 0, 0]], dtype=bool)
    assert strong.votes(accepted).tolist() == [1.0, 6 / 8, 0.0]
    evaluated = np.array([[1, 1, 1], [1, 0, 1], [0, 0, 0]], dtype=bool)
    assert strong.votes(accepted, evaluated).tolist() == [1.0, 1.0, 1.0]
