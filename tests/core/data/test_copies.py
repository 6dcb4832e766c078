# SPDX-License-Identifier: GPL-3.0-or-later
"""Copies of arrays stay as they are for whoever holds them, and take the memory of those that nobody holds."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.copies import Copies


def written(copies: Copies, which: int, index, value):
    copies.arrays[which][index] = value
    copies.note(which, index)


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 4), st.integers(0, 3)), max_size=30))
def test_a_copy_is_what_the_arrays_were_as_long_as_it_is_held(steps):
    copies, held = Copies(np.zeros(5), np.zeros(5, int)), {}
    for number, (which, index, keep) in enumerate(steps):
        written(copies, which, index, number)
        given_out = copies.copy()
        for one, now in zip(given_out, copies.arrays, strict=True):
            np.testing.assert_array_equal(one, now)
        # Some are held whole, some by a view alone, others not at all.
        held[keep] = (given_out, [one.copy() for one in given_out]) if keep else None
        if keep == 2:
            held[keep] = ([one[:3] for one in given_out], [one[:3].copy() for one in given_out])
        del given_out
        for views, was in (pair for pair in held.values() if pair):
            for one, other in zip(views, was, strict=True):
                np.testing.assert_array_equal(one, other)


def test_memory_that_nobody_holds_is_used_again():
    copies = Copies(np.zeros(100))
    [first], [second] = copies.copy(), copies.copy()
    place = first.__array_interface__["data"][0]
    assert second.__array_interface__["data"][0] != place
    del first
    written(copies, 0, slice(3, 5), 7.0)
    [again] = copies.copy()
    assert again.__array_interface__["data"][0] == place
    np.testing.assert_array_equal(again, copies.arrays[0])
    assert not second.any()
