# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories in tracklets: where they are cut, and how tracklets vote."""

import numpy as np
import pytest

from addon.core.data.takes import BY_LIKELIHOOD, NO_MARKER, NO_STEP, Labels
from addon.core.points.deciding import Votes
from addon.core.points.tracklets import VOTE, cut, renamed

RATE = 100.0


def straight(frames: int, points: int) -> np.ndarray:
    """(T, P, 3) m points that walk side by side at 1 m/s."""
    along = np.arange(frames)[:, None, None] / RATE * [1.0, 0, 0]
    return along + np.arange(points)[:, None] * [0, 0.5, 0]


def labelled(marker: np.ndarray, confidence: float | np.ndarray) -> Labels:
    """What frames on their own may have said."""
    step = np.where(marker == NO_MARKER, NO_STEP, BY_LIKELIHOOD)
    return Labels(marker, step, np.broadcast_to(confidence, marker.shape))


def test_long_gaps_and_leaps_part_pieces_and_short_gaps_do_not():
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


def test_one_column_may_carry_two_markers_one_after_the_other():
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


def test_points_without_trajectories_keep_their_own_names():
    shuffled = np.random.default_rng(0).permuted(straight(40, 12) * [1, 4, 1], axis=1)
    tracklet = cut(shuffled, RATE)
    marker = np.random.default_rng(1).integers(0, 5, tracklet.shape)
    voted = Votes.of(labelled(marker, 1.0), tracklet, list("ABCDE"), 0)
    np.testing.assert_array_equal(voted.marker, marker)


def test_windows_do_not_change_a_long_trajectory():
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
