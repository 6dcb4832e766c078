# SPDX-License-Identifier: GPL-3.0-or-later
"""How sure a label is: never outside 0 to 1, lower where another marker could have made the blob."""

import numpy as np
import pytest

from addon.core.blobs.confidence import CONFIDENCE, named_confidences, swap_doubts
from addon.core.blobs.swaps import Swaps
from addon.core.data.takes import EXCLUSIVE
from addon.core.geometry.views import Sight, split_views
from addon.core.papers.virtual_occlusions.labelling import Expectation, Frame, Naming, Rules, name_markers
from addon.core.simulation.rigs import paper_rig
from tests.core.scenes import blobs_at

RIG = paper_rig()
SIGHT = Sight(RIG)


def expect_at(points, deviation, visible=True):
    shown = np.broadcast_to(visible, (4, len(points)))
    return Expectation(points, np.tile(deviation**2 * np.eye(3), (len(points), 1, 1)), shown)


def one_blob(rival_at, visible=True, taken=False):
    """Confidence of the one blob of marker 0 in camera 0; a second marker is expected `rival_at` m beside it."""
    points = np.array([[0, 0, 1.0], [0, 0, 1.0 + rival_at]])
    pixels = [RIG.project(points)[0, :2] if taken else RIG.project(points)[0, :1]] + [np.zeros((0, 2))] * 3
    view = split_views(blobs_at(pixels), RIG)[0]
    shown = np.array([True, visible])
    naming = Naming.empty(Frame(view, SIGHT, expect_at(points, 0.02, shown), Rules()))
    naming.give(np.array([0]), np.array([0]), np.array([0]), EXCLUSIVE)
    if taken:
        naming.give(np.array([0]), np.array([1]), np.array([1]), EXCLUSIVE)
    return named_confidences(naming, CONFIDENCE)[0, 0]


def test_doubts_of_twins_strangers_and_exchanges():
    assert one_blob(0.0) == pytest.approx(0.5)
    assert one_blob(0.5) == pytest.approx(1)
    assert one_blob(0.02, visible=False) > one_blob(0.02)
    assert one_blob(0.02, taken=True) == pytest.approx(1)
    swaps = Swaps(np.array([[1, 0, 2, 3], [0, 2, 1, 3]]), np.array([0.0, 20.0]))
    assert swap_doubts(swaps, 4) == pytest.approx([0.5, 0.5, 1 / (1 + np.exp(-10)), 1])
    assert (swap_doubts(Swaps(np.zeros((0, 3), int), np.zeros(0)), 3) == 1).all()
    assert swap_doubts(Swaps(np.array([[1, 0]]), np.array([-1e9])), 2) == pytest.approx([0, 0])


def test_wrong_labels_are_less_sure_than_right_ones():
    """The confidence ranks: over scenes with close markers and a model a little off, wrong names come last."""
    right, wrong = [], []
    for seed in range(60):
        generator = np.random.default_rng(seed)
        points = generator.uniform([-0.15, -0.15, 0.9], [0.15, 0.15, 1.2], (10, 3))
        rows = [np.flatnonzero(generator.random(10) < 0.7) for _ in range(4)]
        pixels = [image[kept] for image, kept in zip(RIG.project(points), rows, strict=True)]
        expected = expect_at(points + generator.normal(0, 0.01, points.shape), 0.01)
        naming = name_markers(split_views(blobs_at(pixels), RIG)[0], SIGHT, expected, Rules())
        camera, marker = np.nonzero(naming.slot >= 0)
        sure = named_confidences(naming, CONFIDENCE)[camera, marker]
        for c, m, chance in zip(camera, marker, sure, strict=True):
            (right if rows[c][naming.slot[c, m]] == m else wrong).append(chance)
    assert len(wrong) < 0.05 * len(right)
    assert np.mean(right) > np.mean(wrong)
