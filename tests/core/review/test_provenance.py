# SPDX-License-Identifier: GPL-3.0-or-later
"""Where samples are from, every one counted once; and what labelling again changed, by marker and range."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from addon.core.data.takes import BY_EDIT, BY_LIKELIHOOD, LabelledChunk, Labels, PointRows
from addon.core.edits.kinds import Edits, Place
from addon.core.review.changes import GAINED, LOST, OTHER, changes, summary_of_changes
from addon.core.review.provenance import SampleOrigins
from tests.core.scenes import motion_of

FIRST, FRAMES, NAMES = 101, 20, ("LHEE", "RHEE", "LTOE")
EDITS = Edits((Place("heel", 118, (0.0, 0.0, 0.1)),))
WORDS = {"LHEE": 0, "heel": 0, "RHEE": 1, "LTOE": 2}


@pytest.fixture
def part():
    """A part of a take of points: LHEE named by hand in frames 105 to 109, placed in 118 and missing from 111 on.

    RHEE was filled before, in frames 101 and 102; LTOE is never there.
    """
    markers = np.tile(np.arange(9.0).reshape(3, 3), (FRAMES, 1, 1))
    markers[10:17, 0] = markers[18:, 0] = markers[:, 2] = np.nan
    motion = motion_of(markers, np.nan_to_num(markers), FIRST)
    motion.residual[:2, 1] = motion.residual[17, 0] = 0.0

    def cut(start: int, stop: int) -> tuple[PointRows, LabelledChunk]:
        own = replace(motion, **{name: getattr(motion, name)[start:stop] for name in ("frames", "markers", "residual")})
        there = np.isfinite(own.markers[..., 0])
        if start <= 17 < stop:
            there[17 - start, 0] = False  # it is no point
        frame, marker = np.nonzero(there)
        hand = (marker == 0) & (frame + start >= 4) & (frame + start < 9)
        confidence = np.where(marker == 0, np.where(frame + start == 0, 0.9, 1.0), 0.98)
        labels = Labels(marker, np.where(hand, BY_EDIT, BY_LIKELIHOOD), confidence)
        return PointRows(own.frames, frame, marker, own.markers[frame, marker], None), LabelledChunk(labels, own)

    return cut


@pytest.mark.parametrize("cuts", [(0, 20), (0, 6, 20), (0, 1, 8, 17, 18, 20)])
def test_every_sample_is_counted_once(part, cuts):
    origins = SampleOrigins(NAMES, EDITS, WORDS)
    for start, stop in pairwise(cuts):
        origins.add(*part(start, stop))
    fills = [{"marker": "LHEE", "first": 111, "last": 113, "method": "spline"}]
    fills += [fills[0] | {"first": 114, "last": 114}]
    told = origins.of_markers(fills, [20, 0, 0])
    assert told["LHEE"] == {
        "measured": 5, "hand": 6, "filled": {"spline": 4}, "missing": 5, "smoothed": 20,
        "confidence": {"names": 5, "lowest": 0.9, "mean": 0.98, "sure": 0.8},
        "hand_frames": [[105, 109], [118, 118]],
    }  # fmt: skip
    assert told["RHEE"] == {
        "measured": 18, "hand": 0, "filled": {"input": 2}, "missing": 0, "smoothed": 0,
        "confidence": {"names": 20, "lowest": 0.98, "mean": 0.98, "sure": 0.0},
        "filled_in_input": [[101, 102]],
    }  # fmt: skip
    nothing = {"measured": 0, "hand": 0, "filled": {}, "missing": 20, "smoothed": 0, "confidence": None}
    assert told["LTOE"] == nothing


PAIR, NUMBERS = ("A", "B"), 10 + np.arange(20)


def changed(edit):
    """Two points in every frame, the markers A and B, then as `edit` makes of a table (20, 2)."""
    before = np.tile([0, 1], (20, 1))
    after = before.copy()
    edit(before, after)
    return changes(np.repeat(np.arange(20), 2), before.ravel(), after.ravel(), PAIR, NUMBERS)


def said(found):
    return [(one.marker, one.what, one.first, one.last, one.frames) for one in found]


def test_nothing_changed_gained_lost_and_exchanged_over_a_short_break():
    assert changed(lambda before, after: None) == ()
    assert summary_of_changes(()) == ""

    def edit(before, after):
        before[:5, 0] = -1
        after[8:10, 1] = -1

    found = changed(edit)
    assert said(found) == [("A", GAINED, 10, 14, 5), ("B", LOST, 18, 19, 2)]
    assert summary_of_changes(found) == "5 labels more, 2 fewer"
    assert found[0].words == "A is named now in frames 10–14"

    def edit(before, after):
        after[4:12] = [1, 0]
        after[7] = [0, 1]

    found = changed(edit)
    assert said(found) == [("A", OTHER, 14, 21, 7), ("B", OTHER, 14, 21, 7)]
