# SPDX-License-Identifier: GPL-3.0-or-later
"""Spots in pictures that are drawn here, where their places are known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.pictures.spots import SpotOptions, brightness_of, find_spots

OPTIONS = SpotOptions()
SIZE = (90, 120)  # rows and columns


def drawn(discs, size=SIZE, noise=0.0, background=0.0, seed=0) -> np.ndarray:
    """A picture with bright discs (x, y, radius); pixels at the rim are as bright as they are covered."""
    fine = (np.arange(8) + 0.5) / 8 - 0.5
    y = (np.arange(size[0])[:, None] + fine).ravel()[:, None]
    x = (np.arange(size[1])[:, None] + fine).ravel()
    lit = np.zeros((len(y), x.size), bool)
    for cx, cy, radius in discs:
        lit |= (x - cx) ** 2 + (y - cy) ** 2 < radius**2
    covered = lit.reshape(size[0], 8, size[1], 8).mean(axis=(1, 3))
    picture = background + (1 - background) * covered
    picture = picture + noise * np.random.default_rng(seed).standard_normal(size)
    return (np.clip(picture, 0, 1) * 255).round() / 255


def spots_of(picture, options=OPTIONS):
    return find_spots(picture, brightness_of([picture], options), options)


@settings(max_examples=30, deadline=None)
@given(x=st.floats(10, 105), y=st.floats(10, 75), radius=st.floats(1, 8), background=st.sampled_from([0.0, 0.1, 0.3]))
def test_a_disc_is_found_where_it_is(x, y, radius, background):
    found = spots_of(drawn([(x, y, radius)], background=background))
    assert len(found) == 1
    assert found.xy[0] == pytest.approx([x, y], abs=0.06)
    assert found.area[0] == pytest.approx(np.pi * radius**2, rel=0.15 if radius > 1.5 else 0.5)
    assert found.roundness[0] > 0.75


def test_the_middle_of_the_first_pixel_is_nought_and_noise_is_no_spot_and_hides_none():
    picture = np.zeros(SIZE)
    picture[20:23, 30:33] = 1.0
    assert spots_of(picture).xy.tolist() == [[31.0, 21.0]]
    discs = [(20.3, 15.8, 2.0), (60.6, 40.1, 2.5), (100.2, 70.4, 3.0)]
    found = spots_of(drawn(discs, noise=0.04, background=0.2))
    assert found.xy == pytest.approx(np.array(discs)[:, :2], abs=0.2)
    dark = np.clip(0.02 * np.random.default_rng(1).standard_normal(SIZE) + 0.1, 0, 1)
    assert len(spots_of(dark)) == 0


@pytest.mark.parametrize("angle", [0.0, 0.4, 0.8, 1.3])
@pytest.mark.parametrize("radius", [2.0, 4.0])
def test_two_that_touch_are_two(angle, radius):
    apart = 2.1 * radius * np.array([np.cos(angle), np.sin(angle)])
    places = np.array([[40.2, 40.7], np.array([40.2, 40.7]) + apart])
    discs = [(*place, radius) for place in places]
    found = spots_of(drawn([*discs, (80, 20, radius), (90, 70, radius)]))
    assert len(found) == 4
    near = np.linalg.norm(found.xy[:, None] - places, axis=2).min(axis=0)
    assert near.max() < 0.3


def test_what_is_long_large_small_or_cut_is_none():
    picture = drawn([(0.5, 40, 3), (60, 45, 3), (60, 89, 3)])
    picture[10:12, 20:60] = 1.0  # a lamp's tube
    picture[70, 100] = 1.0  # a hot pixel
    assert spots_of(picture).xy == pytest.approx(np.array([[60, 45]]), abs=0.05)
    assert len(spots_of(picture, SpotOptions(max_area=10.0))) == 0
    assert len(spots_of(picture, SpotOptions(min_area=0.5))) == 2


def test_a_threshold_that_is_given_holds_and_a_dark_picture_takes_that_of_others():
    dim = 0.5 * drawn([(60, 45, 3)])
    assert len(spots_of(dim)) == 1
    assert len(spots_of(dim, SpotOptions(threshold=0.6))) == 0
    assert len(spots_of(dim, SpotOptions(threshold=0.3))) == 1
    lit, dark = drawn([(60, 45, 3)], noise=0.01), drawn([], noise=0.01)
    brightness = brightness_of([lit, lit, dark], OPTIONS)
    assert len(find_spots(dark, brightness, OPTIONS)) == 0
    assert len(find_spots(lit, brightness, OPTIONS)) == 1
