# SPDX-License-Identifier: GPL-3.0-or-later
"""What labelling again changed is listed by marker and range of frames."""

import numpy as np

from addon.core.review.changes import GAINED, LOST, OTHER, changes, summary_of_changes

NAMES, FRAMES = ("A", "B"), 10 + np.arange(20)


def changed(edit):
    """Two points in every frame, the markers A and B, then as `edit` makes of a table (20, 2)."""
    before = np.tile([0, 1], (20, 1))
    after = before.copy()
    edit(before, after)
    return changes(np.repeat(np.arange(20), 2), before.ravel(), after.ravel(), NAMES, FRAMES)


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
