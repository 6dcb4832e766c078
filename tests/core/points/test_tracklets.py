# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories in tracklets: where they are cut, how they vote; and takes in lanes, labelled as in columns."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.progress import finished
from addon.core.data.takes import BY_LIKELIHOOD, NO_MARKER, NO_STEP, Labels, Points
from addon.core.edits.kinds import AssignPoint, Delete, Edits, Right, Swap, UnlabelPoint
from addon.core.points.motion import labelled_points
from addon.core.points.tracklets import VOTE, cut, renamed, vote
from addon.core.points.whole_take.deciding import Votes, decide
from addon.core.points.whole_take.pipeline import PointOptions, label_take
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from tests.core.data.test_takes import packed
from tests.io.checks import memory_within

from .whole_take.test_solving import pieces

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
    with memory_within(500 * tracklet.size):  # a table of frames by tracklets has a byte for each of 80 million cells
        voted = vote(labels, tracklet, NAMES)
    assert (voted.labels.marker[:, :2] == [0, 1]).all()
    assert (voted.labels.marker[:, 2:] == -1).all()


def test_frames_none_of_which_is_sure_name_a_trajectory_together(model):
    tracklet = np.broadcast_to(np.arange(3), (50, 3))
    given = replace(labelled(tracklet, 0.95), rate=np.zeros(tracklet.shape))
    assert (decide(given, tracklet, model, 0.999, 0).labels.marker == tracklet).all()


LENGTH = 120


@pytest.fixture(scope="module")
def points():
    """(T, P, 3) m somebody's markers as shuffled pieces, with ghosts that come and go."""
    markers = make_performance(open_markerset("gait15")).take.xyz[:LENGTH]
    found, _ = pieces(markers)
    rng, ghosts = np.random.default_rng(2), np.full((LENGTH, 60, 3), np.nan)
    for ghost in range(ghosts.shape[1]):
        first = int(rng.integers(0, LENGTH - 30))
        place = np.nanmean(found[first], axis=0) + rng.normal(0, 0.4, 3)
        ghosts[first : first + 12, ghost] = place + np.cumsum(rng.normal(0, 0.002, (12, 3)), axis=0)
    every = np.concatenate([found, ghosts], axis=1)
    return every[:, rng.permutation(every.shape[1])]


def both(points: np.ndarray) -> tuple[Points, Points]:
    """A take with a column for each trajectory, and in lanes."""
    take = packed(points)
    residual = np.where(np.isfinite(points[..., 0]), 0.0004, np.nan)
    own = replace(take, residual=np.where(take.present, 0.0004, np.nan))
    return Points(take.names, points, residual, RATE, 7, take.columns), replace(own, rate=RATE)


def edits_of(take: Points, model) -> Edits:
    """What a person may have said of a take, of which the trajectories are of its file."""
    there = [number for number, span, _ in take.standing.each_alone() if span.stop - span.start > 15]
    names, point = model.markerset.markers, [int(take.columns[number]) for number in there[:6]]
    gone = UnlabelPoint(point[1], frames=(10, 100)), Delete(point[2])
    right = Swap(("LKNE", "RKNE"), frames=(40, 70)), Right("SACR", frames=(20, 90))
    named = AssignPoint(point[0], names[0]), AssignPoint(point[3], names[3], frames=(7, 60))
    return Edits((*gone, *right, *named))


@pytest.mark.parametrize("edited", [False, True])
def test_lanes_change_nothing_of_what_is_said(model, points, edited):
    told = []
    for take in both(points):
        edits = edits_of(both(points)[1], model) if edited else Edits()
        labelled = finished(label_take(take, model, PointOptions("likelihood", edits=edits)))
        rows, chunk = labelled.part(take, slice(0, LENGTH))
        written = labelled_points(take, labelled, model.markerset)
        told.append((rows, chunk, written))
    (rows, chunk, written), (rows_too, chunk_too, written_too) = told
    assert both(points)[1].lanes.count < points.shape[1] / 2
    least = 0.4 if edited else 0.7  # these edits contradict what is seen
    assert (chunk.labels.marker != NO_MARKER).sum() > least * LENGTH * 15
    for one, other in ((rows, rows_too), (chunk.labels, chunk_too.labels)):
        for name in vars(one):
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name))
    for name in vars(chunk.motion):  # a mean over lanes differs in the last digit
        np.testing.assert_allclose(getattr(chunk.motion, name), getattr(chunk_too.motion, name), rtol=0, atol=1e-12)
    assert (chunk.suspects, chunk.outcomes) == (chunk_too.suspects, chunk_too.outcomes)
    assert written.names == written_too.names
    np.testing.assert_array_equal(written.xyz[0:LENGTH], written_too.xyz[0:LENGTH])
    np.testing.assert_array_equal(written.residual[3], written_too.residual[3])
    if edited:
        np.testing.assert_array_equal(chunk.unedited.marker, chunk_too.unedited.marker)
        assert all(one.labels for one in chunk.outcomes)
