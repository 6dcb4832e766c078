# SPDX-License-Identifier: GPL-3.0-or-later
"""The vote of trajectories: one name each, no name twice at a time, swaps found and said."""

import numpy as np

from addon.core.points.tracklets import vote

NAMES = ("LTOE", "RTOE", "HEAD")


def said(rows):
    """Frames' markers (T, P) with a confidence of 0.98 and every point present."""
    marker = np.array(rows).T
    return marker, np.where(marker >= 0, 0.98, 0.0), np.ones(marker.shape, dtype=bool)


def test_a_few_wrong_frames_are_outvoted():
    left = np.zeros(200, dtype=int)
    left[50:60] = 1
    right = np.ones(200, dtype=int)
    right[50:60] = 0
    voted = vote(*said([left, right]), NAMES)
    assert (voted.labels.marker == [0, 1]).all()
    assert voted.suspects == ()
    assert (voted.labels.confidence > 0.99).all()


def test_a_swap_is_followed_and_reported():
    left, right = np.repeat([0, 1], [120, 80]), np.repeat([1, 0], [120, 80])
    voted = vote(*said([left, right]), NAMES, first_frame=1000)
    assert (voted.labels.marker == np.array([left, right]).T).all()
    assert len(voted.suspects) == 2
    assert voted.suspects[0].first == 1119
    assert voted.suspects[0].reason == "trajectory 0 goes over from LTOE to RTOE"


def test_who_says_more_keeps_a_name_that_two_claim():
    voted = vote(*said([np.full(100, 2), np.repeat([2, -1], [60, 40])]), NAMES)
    assert (voted.labels.marker[:, 0] == 2).all()
    assert (voted.labels.marker[:, 1] == -1).all()
    assert "trajectory 1 may be HEAD" in voted.suspects[0].reason


def test_pieces_of_one_marker_that_follow_each_other_all_get_its_name():
    marker, confidence, present = said([np.full(100, 2), np.full(100, 2)])
    present[:50, 1] = present[50:, 0] = False
    voted = vote(np.where(present, marker, -1), np.where(present, confidence, 0), present, NAMES)
    assert (voted.labels.marker[present] == 2).all()
    assert (voted.labels.marker[~present] == -1).all()


def test_a_ghost_that_is_named_now_and_then_stays_unnamed():
    ghost = np.full(300, -1)
    ghost[::20] = 2
    voted = vote(*said([ghost]), NAMES)
    assert (voted.labels.marker == -1).all()
