# SPDX-License-Identifier: GPL-3.0-or-later
"""Groups of points that stand apart."""

import numpy as np

from addon.core.points.refusals import far_groups


def test_groups_are_told_by_the_gap_between_them_and_the_largest_comes_first():
    chance = np.random.default_rng(0)
    small, large = chance.uniform(0, 0.4, (12, 3)), chance.uniform([2.0, 0, 0], [2.4, 0.4, 0.4], (20, 3))
    points = np.concatenate([small, [[9.0, 9.0, 9.0], [np.nan] * 3], large])
    first, second = far_groups(points, 0.8, 10)
    assert np.flatnonzero(first).tolist() == list(range(14, 34))
    assert np.flatnonzero(second).tolist() == list(range(12))
    assert len(far_groups(points, 0.8, 1)) == 3
    assert len(far_groups(points, 3.0, 10)) == 1
    assert far_groups(points[12:14], 0.8, 1) == []
