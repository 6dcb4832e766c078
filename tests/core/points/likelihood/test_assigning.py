# SPDX-License-Identifier: GPL-3.0-or-later
"""Points given to markers that want the same ones: against SciPy's."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from addon.core.data.takes import NO_POINT
from addon.core.points.likelihood.assigning import assigned
from addon.core.points.likelihood.naming import IMPOSSIBLE, one_to_one


def made_up(seed: int) -> np.ndarray:
    """Odds (M, P), some impossible, many below 0; of some seeds whole numbers, of which many are equal."""
    rng = np.random.default_rng(seed)
    odds = rng.normal(rng.normal(), 3, rng.integers(1, 9, 2))
    odds[rng.random(odds.shape) < rng.random()] = IMPOSSIBLE
    return np.round(odds) if seed % 3 == 0 else odds


def total(odds: np.ndarray, naming: np.ndarray) -> float:
    named = np.flatnonzero(naming != NO_POINT)
    return float(odds[named, naming[named]].sum())


@settings(deadline=None, max_examples=300)
@given(st.integers(0, 10**6))
def test_the_total_is_the_highest_that_there_is(seed):
    odds = made_up(seed)
    naming = assigned(odds)
    assert total(odds, one_to_one(odds[None])[0]) == pytest.approx(total(odds, naming), abs=1e-6)
    given_away = naming[naming != NO_POINT]
    assert len(set(given_away.tolist())) == len(given_away)
    assert (odds[naming != NO_POINT, given_away] > 0).all()
    worth = np.maximum(odds, 0)
    assert total(odds, naming) == pytest.approx(worth[linear_sum_assignment(worth, maximize=True)].sum(), abs=1e-6)


def test_frames_in_which_nobody_wants_the_same_point_need_no_more_than_their_likeliest():
    frames = np.array([[[3.0, 1.0], [0.5, 2.0]], [[3.0, 1.0], [2.5, 2.0]], [[3.0, -1.0], [2.5, -2.0]]])
    assert one_to_one(frames).tolist() == [[0, 1], [0, 1], [0, NO_POINT]]
    assert one_to_one(np.full((2, 3, 4), IMPOSSIBLE)).tolist() == [[NO_POINT] * 3] * 2


def test_a_chain_of_markers_moves_up_for_one_that_comes_late():
    odds = np.array([[5.0, 4.0, 0.0], [0.0, 5.0, 4.0], [5.0, 0.0, 0.0]])
    assert assigned(odds).tolist() == [1, 2, 0]
