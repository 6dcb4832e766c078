# SPDX-License-Identifier: GPL-3.0-or-later
"""A take in lanes is labelled as with a column for each trajectory: labels, suspects, edits, what is left over."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.progress import finished
from addon.core.data.takes import NO_MARKER, PointRows, Points
from addon.core.edits.kinds import AssignPoint, Delete, Edits, Right, Swap, UnlabelPoint
from addon.core.points.motion import labelled_points
from addon.core.points.tracklets import cut, renamed
from addon.core.points.whole_take.pipeline import PointOptions, label_take
from addon.core.review.suspects import find_suspects
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from tests.core.data.test_takes import packed

from .whole_take.test_solving import RATE, pieces

FRAMES = 120


@pytest.fixture(scope="module")
def points():
    """(T, P, 3) m somebody's markers as shuffled pieces, with ghosts that come and go."""
    markers = make_performance(open_markerset("gait15")).take.xyz[:FRAMES]
    found, _ = pieces(markers)
    rng, ghosts = np.random.default_rng(2), np.full((FRAMES, 60, 3), np.nan)
    for ghost in range(ghosts.shape[1]):
        first = int(rng.integers(0, FRAMES - 30))
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
    names = model.markerset.markers
    point = [int(take.columns[number]) for number in there[:6]]
    return Edits(
        (
            AssignPoint(point[0], names[0]),
            UnlabelPoint(point[1], frames=(10, 100)),
            Delete(point[2]),
            Swap(("LKNE", "RKNE"), frames=(40, 70)),
            Right("SACR", frames=(20, 90)),
            AssignPoint(point[3], names[3], frames=(7, 60)),
        )
    )


@pytest.mark.parametrize("edited", [False, True])
def test_lanes_change_nothing_of_what_is_said(model, points, edited):
    told = []
    for take in both(points):
        edits = edits_of(both(points)[1], model) if edited else Edits()
        labelled = finished(label_take(take, model, PointOptions("likelihood", edits=edits)))
        rows, chunk = labelled.part(take, slice(0, FRAMES))
        written = labelled_points(take, labelled, model.markerset)
        told.append((rows, chunk, written))
    (rows, chunk, written), (rows_too, chunk_too, written_too) = told
    assert both(points)[1].lanes.count < points.shape[1] / 2
    least = 0.4 if edited else 0.7  # these edits contradict what is seen
    assert (chunk.labels.marker != NO_MARKER).sum() > least * FRAMES * 15
    for name in ("frame", "trajectory", "xyz", "residual"):
        np.testing.assert_array_equal(getattr(rows, name), getattr(rows_too, name))
    for name in ("marker", "step", "confidence"):
        np.testing.assert_array_equal(getattr(chunk.labels, name), getattr(chunk_too.labels, name))
    for name in vars(chunk.motion):  # a mean over lanes differs in the last digit
        np.testing.assert_allclose(getattr(chunk.motion, name), getattr(chunk_too.motion, name), rtol=0, atol=1e-12)
    assert chunk.suspects == chunk_too.suspects
    assert chunk.outcomes == chunk_too.outcomes
    assert written.names == written_too.names
    np.testing.assert_array_equal(written.xyz[0:FRAMES], written_too.xyz[0:FRAMES])
    np.testing.assert_array_equal(written.residual[3], written_too.residual[3])
    if edited:
        np.testing.assert_array_equal(chunk.unedited.marker, chunk_too.unedited.marker)
        assert all(one.labels for one in chunk.outcomes)


def test_a_change_of_trajectory_parts_tracklets_however_near_the_next_one_begins():
    along = np.arange(60)[:, None] / RATE * [1.0, 0, 0]
    xyz = np.full((60, 4, 3), np.nan)
    xyz[:30, 0], xyz[30:, 1], xyz[:30, 2], xyz[30:, 3] = along[:30], along[30:], along[:30] + 1, along[30:] + 1
    take = packed(xyz)
    assert take.lanes.count == 2
    tracklet = cut(take.xyz, RATE, lanes=take.lanes)
    numbers = cut(xyz, RATE)
    for number, span, lane in take.lanes.each_alone():
        np.testing.assert_array_equal(tracklet[span, lane], numbers[span, number])
    marker = np.where(np.arange(60)[:, None] < 30, 0, 1) * np.ones((1, 2), int)
    assert renamed(marker, tracklet, ["A", "B"], lanes=take.lanes) == ()
    assert len(renamed(marker, tracklet, ["A", "B"])) == 2, "of one trajectory each it would be said"


def test_rows_of_parts_make_the_rows_of_the_take(model, points):
    _, take = both(points)
    labelled = finished(label_take(take, model, PointOptions("likelihood")))
    whole, motion = PointRows.of(take), labelled.whole().motion
    parts = [labelled.part(take, slice(first, first + 50)) for first in range(0, FRAMES - 20, 50)]
    count = sum(len(rows) for rows, _ in parts)
    np.testing.assert_array_equal(np.concatenate([rows.trajectory for rows, _ in parts]), whole.trajectory[:count])
    for name in ("markers", "expected", "confidence"):
        found = np.concatenate([getattr(chunk.motion, name) for _, chunk in parts])
        np.testing.assert_array_equal(found, getattr(motion, name)[: len(found)])
    assert labelled.motion.suspects(model.markerset.markers, RATE) == find_suspects(
        motion, model.markerset.markers, RATE
    )
