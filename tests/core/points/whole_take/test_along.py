# SPDX-License-Identifier: GPL-3.0-or-later
"""Where what is lost goes along with those around it."""

import numpy as np
import pytest

from addon.core.geometry.rotations import turn_of
from addon.core.points.whole_take.along import carried_along, going_on_odds
from addon.core.points.whole_take.matching import leading

BODY = np.random.default_rng(3).uniform(-0.3, 0.3, (7, 3))


def test_what_is_lost_is_carried_by_what_moves_as_one_rigid_body():
    now = BODY @ turn_of(np.array([0.4, -1.0, 0.8])).T + [1, 2, 0.5]
    then = np.array([BODY[1:], np.where((np.arange(1, 7) < 3)[:, None], BODY[1:], np.nan)])
    found = carried_along(np.repeat(BODY[:1], 2, axis=0), then, now[1:])
    np.testing.assert_allclose(found[0], now[0], atol=1e-9)
    assert np.isnan(found[1]).all(), "two know no turn"


def test_what_is_near_counts_for_more_than_what_bends_away():
    near = np.array([[0.05, 0, 0], [0, 0.05, 0], [0, 0, 0.05]])
    far = near + np.array([0.4, 0, 0])
    found = carried_along(np.zeros((1, 3)), np.concatenate([near, far])[None], np.concatenate([near, far + 0.1]))
    assert np.abs(found).max() < 0.001


@pytest.mark.parametrize(("seconds", "off", "likely"), [(0.01, 0.01, True), (0.01, 0.05, False), (0.3, 0.05, True)])
def test_what_is_lost_for_longer_may_be_farther_from_where_it_is_expected(seconds, off, likely):
    odds = going_on_odds(np.array([[0, 0, 0], [np.nan] * 3]), np.full(2, seconds), np.array([[off, 0, 0]]))
    assert (odds[0, 0] > 0) == likely and odds[1, 0] == -np.inf


def test_the_best_of_a_row_is_compared_with_all_others_of_its_row_and_column():
    odds = np.random.default_rng(0).normal(size=(4, 6))
    odds[3] = -np.inf
    best, own, rival = leading(odds)
    for row, column in enumerate(best.tolist()):
        others = np.append(np.delete(odds[row], column), np.delete(odds[:, column], row))
        assert own[row] == odds[row].max() and rival[row] == others.max()
