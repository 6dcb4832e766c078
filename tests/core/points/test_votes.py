# SPDX-License-Identifier: GPL-3.0-or-later
"""The vote of trajectories: one name each, no name twice at a time, swaps found and said."""

import tracemalloc

import numpy as np

from addon.core.data.takes import Labels
from addon.core.points.tracklets import vote

NAMES = ("LTOE", "RTOE", "HEAD")


def said(rows, present: np.ndarray | None = None):
    """Frames' labels (T, P) with a confidence of 0.98, and the tracklet (T, P) of every point that is present."""
    marker = np.array(rows).T
    present = np.ones(marker.shape, dtype=bool) if present is None else present
    marker = np.where(present, marker, -1)
    labels = Labels(marker, np.zeros(marker.shape, np.int8), np.where(marker >= 0, 0.98, 0.0))
    return labels, np.where(present, np.arange(marker.shape[1]), -1)


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
    present = np.ones((100, 2), dtype=bool)
    present[:50, 1] = present[50:, 0] = False
    voted = vote(*said([np.full(100, 2), np.full(100, 2)], present), NAMES)
    assert (voted.labels.marker[present] == 2).all()
    assert (voted.labels.marker[~present] == -1).all()


def test_where_no_frame_says_anything_nothing_is_named():
    voted = vote(*said([np.full(30, -1), np.full(30, -1)]), NAMES)
    assert (voted.labels.marker == -1).all()
    assert voted.suspects == ()


def test_a_ghost_that_is_named_now_and_then_stays_unnamed():
    ghost = np.full(300, -1)
    ghost[::20] = 2
    voted = vote(*said([ghost]), NAMES)
    assert (voted.labels.marker == -1).all()


def test_ghosts_of_one_frame_each_change_no_vote_and_take_no_time_or_room():
    marker, ghosts = np.repeat([[0, 1]], 2000, axis=0), 20
    labels, tracklet = said(np.concatenate([marker, np.full((2000, ghosts), -1)], axis=1).T)
    tracklet[:, 2:] = 2 + np.arange(2000 * ghosts).reshape(2000, ghosts)
    tracemalloc.start()
    voted = vote(labels, tracklet, NAMES)
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert (voted.labels.marker[:, :2] == [0, 1]).all()
    assert (voted.labels.marker[:, 2:] == -1).all()
    assert most < 500 * tracklet.size  # a table of frames by tracklets has a byte for each of 80 million cells
