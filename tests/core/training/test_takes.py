# SPDX-License-Identifier: GPL-3.0-or-later
"""Labelled takes to learn from: what in them is of nothing on the subject."""

import numpy as np

from addon.core.training.takes import LabelledTake, standing_apart


def test_what_stays_where_it_is_while_all_else_goes_away_is_no_marker():
    time = np.linspace(0, 1, 50)[:, None, None]
    body = np.random.default_rng(2).normal(size=(1, 6, 3)) * 0.3
    walking = body + time * [4.0, 0.0, 0.0]
    heights = np.full((50, 2, 3), [0.0, 0.0, 0.02])
    gone = np.full((50, 1, 3), np.nan)
    names = (*"ABCDEF", "height 1", "height 2", "unseen")
    take = LabelledTake("walk", "she", names, np.concatenate([walking, heights, gone], axis=1))
    assert standing_apart([take], names) == ("height 1", "height 2")
    # Feet that stay on the floor while somebody bends are markers, and so is what moves in another take.
    bending = body + np.where(np.arange(6)[:, None] < 2, 0.0, time * [0.0, 0.0, 0.5])
    still = LabelledTake("bend", "she", names[:8], np.concatenate([bending, heights], axis=1))
    assert standing_apart([still], names[:8]) == ()
    assert standing_apart([take, still], names) == ("height 1", "height 2")
    moved = LabelledTake("again", "she", names[:8], np.concatenate([walking, heights + time], axis=1))
    assert standing_apart([take, moved], names[:8]) == ()


def test_a_number_that_changes_along_one_axis_is_no_marker():
    rng = np.random.default_rng(3)
    names = (*"ABCDEF", "height")
    body = rng.normal(size=(1, 6, 3)) * 0.3 + rng.normal(size=(50, 6, 3)) * 0.01
    height = np.concatenate([np.zeros((50, 1, 2)), rng.normal(0.02, 0.01, (50, 1, 1))], axis=2)
    take = LabelledTake("sway", "she", names, np.concatenate([body, height], axis=1))
    assert standing_apart([take], names) == ("height",)
    # Whoever is made up may go straight ahead without a tremor.
    straight = LabelledTake(
        "slide", "she", names[:6], body[:1] + np.linspace(0, 1, 50)[:, None, None] * [1.0, 0.0, 0.0]
    )
    assert standing_apart([straight], names[:6]) == ()
