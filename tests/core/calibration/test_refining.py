# SPDX-License-Identifier: GPL-3.0-or-later
"""The parts of a take that a room is refined by; `tests/cli/test_refine.py` refines one."""

from itertools import pairwise

import pytest

from addon.core.calibration.refining import REFINED_AT_ONCE, parts_of


@pytest.mark.parametrize("count", [1, 2, 3, 19, 20, 57, 480, 481, 20000])
def test_parts_are_spread_over_the_take(count):
    parts = parts_of(11, 10 + count)
    assert parts[0][0] == 11
    assert parts[-1][1] == 10 + count
    assert all(first <= last for first, last in parts)
    assert all(last < following for (_, last), (following, _) in pairwise(parts))
    assert all(last - first < REFINED_AT_ONCE for first, last in parts)
    assert len(parts) == min(12, count)
