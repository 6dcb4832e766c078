# SPDX-License-Identifier: GPL-3.0-or-later
"""Features, the intervals that are learned of them, wrong labellings and the tailored boosting."""

from itertools import pairwise
from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from addon.core.papers.partial_solvers import features
from addon.core.papers.partial_solvers.boosting import Boosting, boost, learn_intervals, rejections, wrong_labellings
from addon.core.papers.partial_solvers.features import all_features, tables
from addon.core.papers.partial_solvers.model import DOMAIN, FUNCTIONS, NO_POINT, Strong
from tests.core.papers.partial_solvers import plain
from tests.core.papers.partial_solvers.plain import moving, pool_of

PLAIN = [getattr(plain, name) for name in FUNCTIONS]
ANGLE, DISTANCE, RATIO, HEIGHT, TURN = range(5)
A, B, C, D = np.array([[0.0, 0, 0], [3, 0, 4], [0, 2, 0], [0, 2, 1]])
clouds = arrays.arrays(float, (4, 3), elements=st.floats(-2, 2).map(lambda value: round(value, 3))).filter(
    lambda points: min(np.linalg.norm(points[i] - points[j]) for i in range(4) for j in range(i)) > 0.05
)


def test_closed_forms():
    assert plain.angle(A, B, C) == pytest.approx(np.pi / 2)
    assert plain.angle(A, B, 2 * B) == pytest.approx(0.0)
    assert plain.angle(A, B, -B) == pytest.approx(np.pi)
    assert plain.distance(A, B) == pytest.approx(5.0)
    assert plain.ratio(A, B, C, D) == pytest.approx(2 * (5 - 1) / (5 + 1))
    assert plain.height(B, A) == pytest.approx(4.0)
    assert plain.turn(A, B, C) == pytest.approx(3 * 2 / (5 * 2))


@given(clouds, st.floats(-3, 3), st.floats(0.2, 3))
def test_invariances(points, yaw, size):
    turned = points @ np.array([[np.cos(yaw), np.sin(yaw), 0], [-np.sin(yaw), np.cos(yaw), 0], [0, 0, 1]]) + [1, -2, 3]
    tilted = points @ np.array([[1, 0, 0], [0, np.cos(yaw), np.sin(yaw)], [0, -np.sin(yaw), np.cos(yaw)]])
    mirrored = points * [1, -1, 1]
    value = [function(*points[: DOMAIN[kind]]) for kind, function in enumerate(PLAIN)]

    def same(moved, *kinds):
        for kind in kinds:
            assert PLAIN[kind](*moved[: DOMAIN[kind]]) == pytest.approx(value[kind], abs=1e-5)

    same(turned, ANGLE, DISTANCE, RATIO, HEIGHT, TURN)
    same(tilted, ANGLE, DISTANCE, RATIO)
    same(size * points, ANGLE, RATIO, TURN)
    same(mirrored, ANGLE, DISTANCE, RATIO, HEIGHT)
    assert plain.turn(*mirrored[:3]) == pytest.approx(-value[TURN], abs=1e-9)


@pytest.mark.parametrize("markers", [3, 4, 7, 15])
def test_every_combination_once(markers):
    kind, points = features.all_features(markers, FUNCTIONS)
    counted = plain.count_features(markers)
    assert {name: int((kind == index).sum()) for index, name in enumerate(FUNCTIONS)} == counted
    assert counted["ratio"] == 3 * comb(markers, 4)
    for index, domain in enumerate(DOMAIN):
        mine = points[kind == index]
        assert (mine[:, domain:] == NO_POINT).all()
        assert all(len(set(row)) == domain for row in mine[:, :domain].tolist())
        assert len({tuple(row) for row in mine.tolist()}) == len(mine)
    halves = [frozenset((frozenset(row[:2]), frozenset(row[2:]))) for row in points[kind == RATIO].tolist()]
    assert len(set(halves)) == len(halves)


@pytest.mark.parametrize(("markers", "counts"), [(15, (1365, 105, 4095, 105)), (26, (7800, 325, 44850, 325))])
def test_the_pool_of_the_paper(markers, counts):
    kind, points = features.all_features(markers)
    assert len(kind) == sum(counts)
    assert kind.nbytes + points.nbytes < 4e6


def test_a_large_set_draws_its_ratios_and_tables_give_what_the_functions_give():
    kind, points = features.all_features(20, most=5000, seed=3)
    again = features.all_features(20, most=5000, seed=3)[1]
    assert len(kind) == 5000
    assert (kind == ANGLE).sum() == plain.count_features(20)["angle"]
    assert (points == again).all()
    assert (points != features.all_features(20, most=5000, seed=4)[1]).any()
    points = np.random.default_rng(0).normal(size=(3, 6, 3))
    within = features.tables(points)
    kind, which = features.all_features(6, FUNCTIONS)
    for index, function in enumerate(PLAIN):
        rows = which[kind == index][:, : DOMAIN[index]]
        expected = function(*points[1, rows].transpose(1, 0, 2))
        assert features.values(index, np.array(1), rows, within) == pytest.approx(expected, abs=1e-7)


def test_a_missing_point_has_no_features():
    points = np.random.default_rng(0).normal(size=(1, 4, 3))
    points[0, 2] = np.nan
    within = features.tables(points)
    kind, which = features.all_features(4, FUNCTIONS)
    for index in range(len(FUNCTIONS)):
        seen = features.values(index, np.array(0), which[kind == index], within)
        assert (np.isnan(seen) == (which[kind == index] == 2).any(axis=1)).all()
    assert within.present.tolist() == [[True, True, False, True]]


def test_weak_classifiers_accept_all_they_learned_from():
    points = moving()
    labelling = np.tile(np.arange(points.shape[1]), (len(points), 1))
    assert not rejections(pool_of(points), np.arange(len(points)), labelling, tables(points)).any()


def test_intervals_end_at_values_that_were_seen():
    points = moving(4, 50)
    pool = pool_of(points)
    of_pair = (pool.points[:, :2] == [1, 3]).all(axis=1)
    pair = np.flatnonzero((pool.kind == FUNCTIONS.index("distance")) & of_pair)
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
