# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories in tracklets: where they are cut, how they vote, and what is said of points once frames are named."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.takes import BY_LIKELIHOOD, NO_MARKER, NO_STEP, Labels
from addon.core.points.deciding import Votes, decide
from addon.core.points.tracklets import VOTE, cut, renamed, vote

RATE = 100.0


def straight(frames: int, points: int) -> np.ndarray:
    """(T, P, 3) m points that walk side by side at 1 m/s."""
    along = np.arange(frames)[:, None, None] / RATE * [1.0, 0, 0]
    return along + np.arange(points)[:, None] * [0, 0.5, 0]


def labelled(marker: np.ndarray, confidence: float | np.ndarray) -> Labels:
    """What frames on their own may have said."""
    step = np.where(marker == NO_MARKER, NO_STEP, BY_LIKELIHOOD)
    return Labels(marker, step, np.broadcast_to(confidence, marker.shape))


def test_long_gaps_and_leaps_part_pieces_and_a_column_may_carry_two_markers():
    points = straight(300, 2)
    points[20:40, 0] = np.nan
    points[100:180, 0] = np.nan
    points[200:, 1] += 1.0
    tracklet = cut(points, RATE)
    assert (tracklet[20:40, 0] == -1).all()
    assert set(tracklet[:100, 0].tolist()) == {-1, 0}
    assert set(tracklet[180:, 0].tolist()) == {1}
    assert set(tracklet[:200, 1].tolist()) == {2}
    assert set(tracklet[200:, 1].tolist()) == {3}
    tracklet = cut(np.concatenate([straight(50, 1), np.full((60, 1, 3), np.nan), straight(50, 1)]), RATE)
    marker, confidence = np.zeros(tracklet.shape, int), np.full(tracklet.shape, 0.9)
    marker[110:] = 1
    marker[3:6], marker[120:123] = 1, 0
    voted = Votes.of(labelled(np.where(tracklet >= 0, marker, NO_MARKER), confidence), tracklet, ["A", "B"], 0)
    assert (voted.marker[:50] == 0).all()
    assert (voted.marker[110:] == 1).all()
    assert (voted.marker[50:110] == NO_MARKER).all()
    [change] = renamed(voted.marker, tracklet, ["A", "B"], first_frame=100)
    assert (change.first, change.last) == (149, 210)
    assert change.reason == "trajectory 0 is A and, behind a gap or a leap, B"


def test_points_without_trajectories_keep_their_own_names_and_windows_change_no_long_trajectory():
    shuffled = np.random.default_rng(0).permuted(straight(40, 12) * [1, 4, 1], axis=1)
    tracklet = cut(shuffled, RATE)
    marker = np.random.default_rng(1).integers(0, 5, tracklet.shape)
    voted = Votes.of(labelled(marker, 1.0), tracklet, list("ABCDE"), 0)
    np.testing.assert_array_equal(voted.marker, marker)
    tracklet = cut(straight(VOTE.window_frames * 2 + 300, 2), RATE)
    marker = np.tile([1, 0], (len(tracklet), 1))
    marker[::7] = NO_MARKER
    voted = Votes.of(labelled(marker, 0.95), tracklet, ["A", "B"], 10)
    np.testing.assert_array_equal(voted.marker, np.tile([1, 0], (len(tracklet), 1)))
    assert voted.suspects == ()


def test_doubts_name_the_column_of_the_file():
    points = straight(120, 3)
    points[:, 0] = np.nan
    tracklet = cut(points, RATE)
    marker = np.full(tracklet.shape, NO_MARKER)
    marker[:, 1] = 0
    marker[:60, 2], marker[60:, 2] = 1, 2
    voted = Votes.of(labelled(marker, 0.99), tracklet, ["A", "B", "C"], 5)
    [swap] = voted.suspects
    assert (swap.trajectory, swap.reason) == (2, "trajectory 2 goes over from B to C")
    assert abs(swap.first - 64) <= 2


@pytest.mark.parametrize("frame", [VOTE.window_frames, VOTE.window_frames - 100, VOTE.window_frames * 2 + 300 - 90])
def test_a_swap_at_a_window_s_border_or_late_in_it_is_followed_and_said(frame):
    tracklet = cut(straight(VOTE.window_frames * 2 + 300, 2), RATE)
    marker = np.tile([1, 0], (len(tracklet), 1))
    marker[frame:] = [0, 1]
    voted = Votes.of(labelled(marker, 0.99), tracklet, ["A", "B"], 0)
    np.testing.assert_array_equal(voted.marker, marker)
    reasons = {(suspect.last, suspect.reason) for suspect in voted.suspects}
    assert reasons == {
        (frame, f"trajectory {at} goes over from {old} to {new}") for at, old, new in ((0, "B", "A"), (1, "A", "B"))
    }


NAMES = ("LTOE", "RTOE", "HEAD")


def said(rows, present: np.ndarray | None = None):
    """Frames' labels (T, P) with a confidence of 0.98, and the tracklet (T, P) of every point that is present."""
    marker = np.array(rows).T
    present = np.ones(marker.shape, dtype=bool) if present is None else present
    marker = np.where(present, marker, NO_MARKER)
    return labelled(marker, np.where(marker >= 0, 0.98, 0.0)), np.where(present, np.arange(marker.shape[1]), -1)


def test_a_few_wrong_frames_are_outvoted():
    left = np.zeros(200, dtype=int)
    left[50:60] = 1
    right = np.ones(200, dtype=int)
    right[50:60] = 0
    voted = vote(*said([left, right]), NAMES)
    assert (voted.labels.marker == [0, 1]).all()
    assert voted.suspects == ()
    assert (voted.labels.confidence > 0.99).all()


def test_a_name_goes_to_who_says_more_to_all_pieces_that_follow_each_other_and_to_no_ghost():
    voted = vote(*said([np.full(100, 2), np.repeat([2, -1], [60, 40])]), NAMES)
    assert (voted.labels.marker[:, 0] == 2).all()
    assert (voted.labels.marker[:, 1] == -1).all()
    assert "trajectory 1 may be HEAD" in voted.suspects[0].reason
    present = np.ones((100, 2), dtype=bool)
    present[:50, 1] = present[50:, 0] = False
    voted = vote(*said([np.full(100, 2), np.full(100, 2)], present), NAMES)
    assert (voted.labels.marker[present] == 2).all()
    assert (voted.labels.marker[~present] == -1).all()
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


NAMED = 3
TARGET = 0.999
FRAMES = 50


def votes(points: int, confidence: float, sure: np.ndarray | None = None) -> tuple[Labels, np.ndarray]:
    """Frames of `points` trajectories, the first three of which are named; sure (F, 3) of it where asked."""
    marker = np.full((FRAMES, points), NO_MARKER)
    marker[:, :NAMED] = range(NAMED)
    chance = np.where(marker == NO_MARKER, 0.0, confidence)
    rate = np.zeros(marker.shape)
    if sure is not None:
        rate[:, :NAMED] = sure
    step = np.where(marker == NO_MARKER, 0, BY_LIKELIHOOD)
    return Labels(marker, step, chance, rate), np.broadcast_to(np.arange(points), marker.shape)


def test_frames_none_of_which_is_sure_name_a_trajectory_but_not_among_many_more_points_than_markers(model):
    decided = decide(*votes(20, 0.95), model, TARGET, 0).labels
    assert decided.marker[:, :3].tolist() == [[0, 1, 2]] * FRAMES
    # A point that is no marker may sit like one in every frame of a crowd: its frames are not so many witnesses.
    decided = decide(*votes(30, 0.95), model, TARGET, 0).labels
    assert (decided.marker == NO_MARKER).all()


def test_in_a_crowd_sure_frames_carry_the_others_of_one_subject_where_they_are_a_quarter(model):
    sure = np.ones((FRAMES, 3))
    sure[::3, 0] = 0  # most frames of the first are sure
    sure[5:, 1] = 0  # few of the second are
    decided = decide(*votes(30, 0.95, sure), model, TARGET, 0).labels
    assert (decided.marker[:, 0] == 0).all()
    assert (decided.marker[:5, 1] == 1).all() and (decided.marker[5:, 1] == NO_MARKER).all()
    assert (decided.marker[:, 2] == 2).all()
    likelihood = replace(model.likelihood, subjects=1)
    alone = replace(model, likelihood=likelihood)
    sure = np.zeros((FRAMES, 3))
    sure[: FRAMES // 2, 0] = 1
    sure[: FRAMES // 10, 1] = 1
    decided = decide(*votes(20, 0.95, sure), alone, TARGET, 0).labels
    assert (decided.marker[:, 0] == 0).all()
    assert (decided.marker[: FRAMES // 10, 1] == 1).all() and (decided.marker[FRAMES // 10 :, 1] == NO_MARKER).all()
    assert (decided.marker[:, 2] == NO_MARKER).all()
    assert (decide(*votes(20, 0.95, sure), model, TARGET, 0).labels.marker[:, :3] == [0, 1, 2]).all()
