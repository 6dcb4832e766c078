# SPDX-License-Identifier: GPL-3.0-or-later
"""Keys in bulk: what is moved is as if it had been keyed anew, and many keys go into several actions."""

import bpy
import numpy as np
import pytest

from addon.scene import animation
from addon.scene.animation import KeyOptions

FRAMES = np.arange(11, 71)


@pytest.fixture
def bag(empty):
    """The channels of an object."""
    item = bpy.data.objects.new("LKNE", None)
    empty.scene.collection.objects.link(item)
    return animation.bind(item, bpy.data.actions.new("walk"))


def keys_of(bag) -> list[list[tuple]]:
    """What is known of each key of each channel."""
    return [[(*key.co, key.interpolation, key.type) for key in curve.keyframe_points] for curve in bag.fcurves]


def path(seed: int, gaps=()) -> np.ndarray:
    """A path with gaps, from and up to so many frames."""
    xyz = np.random.default_rng(seed).normal(size=(len(FRAMES), 3)).astype(np.float32)
    for start, stop in gaps:
        xyz[start:stop] = np.nan
    return xyz


def with_rows(xyz: np.ndarray, rows: slice, other: np.ndarray) -> np.ndarray:
    """A path with some rows of another."""
    xyz = xyz.copy()
    xyz[rows] = other[rows]
    return xyz


BEFORE = path(1, [(5, 9), (40, 44)])


@pytest.mark.parametrize(
    "after",
    [
        with_rows(BEFORE, slice(20, 22), path(2)),
        with_rows(BEFORE, slice(10, 40), path(2)),
        with_rows(BEFORE, slice(5, 9), path(2)),
        with_rows(BEFORE, slice(50, 60), path(2, [(52, 60)])),
        path(3, [(0, 4), (20, 21)]),
        BEFORE,
    ],
)
@pytest.mark.parametrize("most_single", [300, 1])
@pytest.mark.parametrize("filled", [(None, None), ((22, 30), (22, 30)), ((22, 30), None), (None, (44, 55))])
def test_moved_keys_are_those_that_keying_anew_makes(bag, after, most_single, filled, monkeypatch):
    monkeypatch.setattr(animation, "KEYING", KeyOptions(most_single=most_single, most_removed=most_single))
    was, made = (None if span is None else (span[0] <= FRAMES) & (span[1] > FRAMES) for span in filled)
    animation.key(bag, "location", FRAMES, BEFORE, "LKNE", was)
    moved = animation.move(bag, "location", FRAMES, (BEFORE, was), (after, made))
    fewer = np.isfinite(BEFORE[:, 0]).sum() - np.isfinite(after[:, 0]).sum()
    assert moved == (fewer <= most_single)
    if not moved:
        return
    found = keys_of(bag)
    animation.clear(bag, "location")
    animation.key(bag, "location", FRAMES, after, "LKNE", made)
    assert found == keys_of(bag)
    values = [[curve.evaluate(frame) for frame in FRAMES] for curve in bag.fcurves]
    there = np.isfinite(after[:, 0])
    np.testing.assert_allclose(np.array(values).T[there], after[there], atol=1e-6)


def test_keys_that_a_hand_took_away_or_that_all_go_are_not_moved(bag):
    animation.key(bag, "location", FRAMES, BEFORE, "LKNE")
    assert not animation.move(bag, "location", FRAMES, (BEFORE, None), (BEFORE * np.nan, None))
    points = bag.fcurves[1].keyframe_points
    points.remove(points[3])
    before = keys_of(bag)
    assert not animation.move(bag, "location", FRAMES, (BEFORE, None), (path(2), None))
    assert keys_of(bag) == before
