# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills that are kept: put in again exactly, and left out where what was measured around them is another."""

from types import SimpleNamespace

import numpy as np
import pytest

from addon.core.filling.filling import FilledGap, FilledTake, kept_fills_of
from addon.core.filling.gaps import Gap
from addon.core.filling.kept import KeptFill, put_fills, replaced_fills
from tests.core.scenes import motion_of

NAMES = ("A", "B")
FRAMES = 50 + np.arange(12)
GAPS = (Gap(4, 7, 0), Gap(9, 12, 1))


@pytest.fixture
def take() -> SimpleNamespace:
    """Markers with two gaps, the second at the end, and what they were filled with."""
    whole = np.random.default_rng(1).normal(size=(12, 2, 3))
    markers = whole.copy()
    for gap in GAPS:
        markers[gap.start : gap.stop, gap.marker] = np.nan
    flags = np.isnan(markers[..., 0])
    filled = FilledTake(whole, flags, (FilledGap(GAPS[0], "pca", 0.002), FilledGap(GAPS[1], "spline", np.nan)), ())
    return SimpleNamespace(markers=markers, whole=whole, flags=flags, fills=kept_fills_of(filled, NAMES, FRAMES))


@pytest.mark.parametrize(
    ("frame", "marker", "value", "which", "reason"),
    [
        (5, 0, 1.0, 0, "is named in some of its frames"),
        (3, 0, 1.0, 0, "right before or after"),
        (7, 0, np.nan, 0, "right before or after"),
        (8, 1, np.nan, 1, "right before or after"),
    ],
)
def test_a_fill_is_left_out_where_the_take_is_another_around_it(take, frame, marker, value, which, reason):
    take.markers[frame, marker] = value
    motion, unfit = put_fills(motion_of(take.markers, take.whole, FRAMES[0]), NAMES, take.fills)
    assert reason in unfit[which]
    assert unfit[1 - which] == ""
    filled = motion.residual == 0
    assert filled[:, 1 - marker].any()
    assert not filled[:, marker].any()


def test_fills_of_other_markers_or_frames_are_left_out_and_new_ones_take_the_place_of_those_they_meet(take):
    one = take.fills[0]
    for other, reason in (
        (KeptFill("C", one.first, one.last, "pca", 0.0, one.path), "no such marker"),
        (KeptFill("A", 60, 70, "pca", 0.0, np.zeros((13, 3))), "not all of its frames"),
    ):
        motion, unfit = put_fills(motion_of(take.markers, take.whole, FRAMES[0]), NAMES, [other])
        assert reason in unfit[0]
        np.testing.assert_array_equal(motion.markers, take.markers)
    new = KeptFill("A", 56, 58, "rigid", 0.0, np.zeros((5, 3)))
    assert replaced_fills(take.fills, [new]) == (new, take.fills[1])
    assert replaced_fills(take.fills, []) == take.fills
