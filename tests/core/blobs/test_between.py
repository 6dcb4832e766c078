# SPDX-License-Identifier: GPL-3.0-or-later
"""A few frames between sure ones: names go where the markers must have been."""

import numpy as np
import pytest

from addon.core.blobs.between import passages_of, put_between
from tests.core.blobs.followed import exchange, followed, take_name, wrong_names
from tests.core.scenes import RATE


def named(results):
    return sum(int((result.naming.slot >= 0).sum()) for result in results)


def test_an_exchange_over_two_frames_is_undone():
    scene, _, views, results = followed()
    exchange(scene, results, (10, 11), "LANK", "LHEE")
    assert wrong_names(scene, views, results).any()
    changed = put_between(results, RATE)
    assert {10, 11} <= set(changed)
    assert not wrong_names(scene, views, results).any()


def test_a_name_that_was_missing_for_two_frames_is_given():
    scene, _, views, results = followed()
    before = named(results)
    for frame in (9, 10):
        take_name(results[frame].naming, scene.markerset.index("LHEE"))
    assert named(results) < before
    put_between(results, RATE)
    assert named(results) >= before
    assert not wrong_names(scene, views, results).any()


def test_what_goes_on_smoothly_keeps_its_names():
    scene, _, views, results = followed()
    before = [result.naming.slot.copy() for result in results]
    put_between(results, RATE)
    assert all(
        (slot[slot >= 0] == result.naming.slot[slot >= 0]).all() for slot, result in zip(before, results, strict=True)
    )
    assert not wrong_names(scene, views, results).any()


def test_a_long_gap_is_left_alone():
    _, _, _, results = followed()
    points = np.array([result.naming.meeting.points for result in results])
    marker = int(np.isfinite(points[:, :, 0]).all(axis=0).argmax())
    points[10:25, marker] = np.nan
    assert all(one.marker != marker for found in passages_of(points, RATE).values() for one in found)


def test_a_passage_is_on_the_path():
    time = np.arange(40)[:, None] / RATE
    path = np.concatenate([time, np.sin(3 * time), 1 + 0 * time], axis=1)[:, None]
    gone = path.copy()
    gone[20:22] = np.nan
    found = passages_of(gone, RATE)
    assert sorted(found) == [20, 21]
    for frame, (passage,) in found.items():
        assert passage.place == pytest.approx(path[frame, 0], abs=passage.sd / 2)


def test_frames_without_anybody():
    assert put_between([None, None], RATE) == {}
    _, _, _, results = followed()
    put_between([*results[:20], None, *results[21:]], RATE)
