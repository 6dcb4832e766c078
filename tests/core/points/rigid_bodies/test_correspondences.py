# SPDX-License-Identifier: GPL-3.0-or-later
"""Which points of a group may be which markers of its plate."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from addon.core.data.takes import NO_POINT
from addon.core.points.rigid_bodies.correspondences import MAX_ALL, correspondences


@pytest.mark.parametrize(("markers", "points", "ways"), [(3, 3, 6), (3, 5, 60), (4, 3, 24), (3, 12, 210)])
def test_of_a_small_plate_all_ways_are_tried(markers, points, ways):
    rng = np.random.default_rng(0)
    tried = correspondences(rng.normal(size=(markers, 3)), rng.normal(size=(points, 3)))
    assert len(np.unique(tried, axis=0)) == ways
    assert ((tried != NO_POINT).sum(axis=1) == min(markers, points)).all()


@pytest.mark.parametrize("markers", [8, 13, 20])
@pytest.mark.parametrize("gone", [0, 2])
def test_of_a_large_plate_the_likely_ways_have_the_right_one_and_are_few(markers, gone):
    rng = np.random.default_rng(markers)
    form = rng.normal(0, 0.1, (markers, 3))
    order = rng.permutation(markers)[gone:]
    turn = Rotation.random(random_state=markers).as_matrix()
    tried = correspondences(form, form[order] @ turn.T + rng.normal(0, 0.001, (len(order), 3)))
    right = np.full(markers, NO_POINT)
    right[order] = np.arange(len(order))
    assert (tried == right).all(axis=1).any()
    assert markers > MAX_ALL and len(tried) < 10_000
    for way in tried:
        used = way[way != NO_POINT]
        assert len(np.unique(used)) == len(used)


def test_a_large_plate_that_fits_nowhere_is_given_no_point():
    rng = np.random.default_rng(3)
    tried = correspondences(rng.normal(0, 0.1, (9, 3)), rng.normal(0, 3.0, (4, 3)))
    assert (tried == NO_POINT).all()
