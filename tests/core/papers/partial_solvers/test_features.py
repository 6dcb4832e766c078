# SPDX-License-Identifier: GPL-3.0-or-later
"""The geometric functions: closed forms, what leaves them unchanged, how many there are."""

from math import comb

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from addon.core.papers.partial_solvers import features
from addon.core.papers.partial_solvers.model import (
    DOMAIN,
    FUNCTIONS,
    KIND_ANGLE,
    KIND_DISTANCE,
    KIND_HEIGHT,
    KIND_RATIO,
    KIND_TURN,
    NO_POINT,
)
from tests.core.papers.partial_solvers import plain

ONE = {KIND_ANGLE: plain.angle, KIND_DISTANCE: plain.distance, KIND_RATIO: plain.ratio, KIND_HEIGHT: plain.height}
ONE[KIND_TURN] = plain.turn
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
    value = {kind: function(*points[: DOMAIN[kind]]) for kind, function in ONE.items()}
    for kind, function in ONE.items():
        assert function(*turned[: DOMAIN[kind]]) == pytest.approx(value[kind], abs=1e-5)
    for kind in (KIND_ANGLE, KIND_DISTANCE, KIND_RATIO):
        assert ONE[kind](*tilted[: DOMAIN[kind]]) == pytest.approx(value[kind], abs=1e-5)
    for kind in (KIND_ANGLE, KIND_RATIO, KIND_TURN):
        assert ONE[kind](*(size * points)[: DOMAIN[kind]]) == pytest.approx(value[kind], abs=1e-5)
    for kind in (KIND_ANGLE, KIND_DISTANCE, KIND_RATIO, KIND_HEIGHT):
        assert ONE[kind](*mirrored[: DOMAIN[kind]]) == pytest.approx(value[kind], abs=1e-9)
    assert plain.turn(*mirrored[:3]) == pytest.approx(-value[KIND_TURN], abs=1e-9)


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
    halves = [frozenset((frozenset(row[:2]), frozenset(row[2:]))) for row in points[kind == KIND_RATIO].tolist()]
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
    assert (kind == KIND_ANGLE).sum() == plain.count_features(20)["angle"]
    assert (points == again).all()
    assert (points != features.all_features(20, most=5000, seed=4)[1]).any()
    points = np.random.default_rng(0).normal(size=(3, 6, 3))
    within = features.tables(points)
    kind, which = features.all_features(6, FUNCTIONS)
    for index, function in ONE.items():
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
