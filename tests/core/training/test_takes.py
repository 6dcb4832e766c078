# SPDX-License-Identifier: GPL-3.0-or-later
"""Labelled takes to learn from: what in them is of nothing on the subject."""

import numpy as np

from addon.core.training.takes import LabelledTake, standing_apart


def test_a_number_beside_two_zeros_is_no_marker():
    rng = np.random.default_rng(3)
    names = (*"ABCDEF", "height", "floor", "unseen")
    body = rng.normal(size=(1, 6, 3)) * 0.3 + rng.normal(size=(50, 6, 3)) * 0.01
    height = np.concatenate([np.zeros((50, 1, 2)), rng.normal(0.02, 0.01, (50, 1, 1))], axis=2)
    floor, gone = np.zeros((50, 1, 3)), np.full((50, 1, 3), np.nan)
    take = LabelledTake("sway", "she", names, np.concatenate([body, height, floor, gone], axis=1))
    assert standing_apart([take], names) == ("height", "floor")
    # Feet that stand as still as a file can say are markers, and so is what moves in another take.
    still = LabelledTake("still", "she", names[:8], np.concatenate([body[:1].repeat(50, 0), height, floor], axis=1))
    assert standing_apart([still], names[:8]) == ("height", "floor")
    moved = LabelledTake("again", "she", names[:8], take.xyz[:, :8] + 0.1)
    assert standing_apart([take, moved], names[:8]) == ()
