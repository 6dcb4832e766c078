# SPDX-License-Identifier: GPL-3.0-or-later
"""Points given to the markers of a frame where several want the same one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from addon.core.data.takes import NO_POINT
from addon.core.points.likelihood.naming import IMPOSSIBLE, one_to_one


def made_up(seed: int) -> np.ndarray:
    """Odds (M, P), some impossible, many below 0; of some seeds whole numbers, of which many are equal."""
    rng = np.random.default_rng(seed)
    odds = rng.normal(rng.normal(), 3, rng.integers(1, 9, 2))
    odds[rng.random(odds.shape) < rng.random()] = IMPOSSIBLE
    return np.round(odds) if seed % 3 == 0 else odds


@settings(deadline=None, max_examples=300)
@given(st.integers(0, 10**6))
def test_the_total_is_the_highest_that_there_is(seed):
    odds = made_up(seed)
    naming = one_to_one(odds[None])[0]
    named = np.flatnonzero(naming != NO_POINT)
    assert len(set(naming[named].tolist())) == len(named)
    assert (odds[named, naming[named]] > 0).all()
    worth = np.maximum(odds, 0)
    best = worth[linear_sum_assignment(worth, maximize=True)].sum()
    assert odds[named, naming[named]].sum() == pytest.approx(best, abs=1e-6)
