# SPDX-License-Identifier: GPL-3.0-or-later
"""The labelling matrix's rules."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays

from addon.core.papers.partial_solvers.frames import resolve

# One row a point, one column a marker.
CASES = {
    "each alone": ([[1, 0, 0], [0, 0, 1], [0, 1, 0]], [0, 2, 1]),
    "an empty column is an occluded marker": ([[0, 1, 0], [0, 0, 0], [1, 0, 0]], [1, -1, 0]),
    "two points for one marker: neither": ([[1, 0, 0], [1, 0, 0], [0, 0, 1]], [-1, -1, 2]),
    "two markers for one point: neither": ([[1, 1, 0], [0, 0, 1], [0, 0, 0]], [-1, 2, -1]),
    "a chain of conflicts takes all with it": ([[1, 1, 0], [0, 1, 1], [0, 0, 0]], [-1, -1, -1]),
}


@pytest.mark.parametrize("name", CASES)
def test_by_hand(name):
    matrix, expected = CASES[name]
    assert resolve(np.array([matrix], dtype=bool))[0].tolist() == expected


@given(arrays(bool, array_shapes(min_dims=3, max_dims=3, max_side=5)))
def test_the_rules(suggested):
    named = resolve(suggested)
    for frame, row in enumerate(named):
        given_names = row[row >= 0]
        assert len(set(given_names.tolist())) == len(given_names)
        for point, marker in np.ndindex(suggested.shape[1:]):
            alone = suggested[frame, point].sum() == 1 and suggested[frame, :, marker].sum() == 1
            assert (row[point] == marker) == (suggested[frame, point, marker] and alone)


def test_no_points():
    assert resolve(np.zeros((3, 0, 4), dtype=bool)).shape == (3, 0)
