# SPDX-License-Identifier: GPL-3.0-or-later
"""Volumes of four things that move: each is the median over the frames that show all four, whoever asks how."""

from itertools import permutations

import numpy as np
import pytest

from addon.core.points.rigid_bodies.volumes import MedianVolumes, signed_volumes

QUAD = np.array([4, 1, 3, 0])


@pytest.fixture
def place():
    """(F, G, 3) of six things, of which each is missing now and then and the last two are never seen together."""
    rng = np.random.default_rng(3)
    place = rng.normal(size=(40, 6, 3))
    place[rng.random((40, 6)) < 0.2] = np.nan
    place[:20, 4], place[20:, 5] = np.nan, np.nan
    return place


def test_a_volume_is_the_median_of_those_frames_that_show_all_four(place):
    each = signed_volumes(*(place[:, corner] for corner in QUAD))
    assert MedianVolumes(place).of(*QUAD) == pytest.approx(np.nanmedian(each))


def test_two_things_exchanged_turn_the_sign_over(place):
    volumes = MedianVolumes(place)
    asked = np.array(list(permutations(QUAD)))
    even = [np.linalg.det(np.eye(4)[list(order)]) for order in permutations(range(4))]
    assert np.allclose(volumes.of(*asked.T), np.multiply(even, volumes.of(*QUAD)))


def test_what_was_never_seen_together_or_is_there_twice_has_no_volume(place):
    assert (MedianVolumes(place).of(np.array([0, 0]), np.array([1, 1]), np.array([4, 2]), np.array([5, 2])) == 0).all()


def test_volumes_are_the_same_in_blocks_and_asked_for_again(place, monkeypatch):
    rng = np.random.default_rng(4)
    asked = rng.integers(0, 6, (4, 5, 7))
    volumes = MedianVolumes(place)
    first = volumes.of(*asked)
    monkeypatch.setattr("addon.core.points.rigid_bodies.volumes.VOLUMES_AT_ONCE", 50)
    assert first.shape == (5, 7)
    assert (volumes.of(*asked) == first).all()
    assert (MedianVolumes(place).of(*asked) == first).all()
