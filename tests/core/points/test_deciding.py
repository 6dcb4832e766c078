# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of the points of a take, once its frames were named alone, and names that the take contradicts."""

from dataclasses import replace

import numpy as np

from addon.core.data.takes import BY_LIKELIHOOD, NO_MARKER, Labels
from addon.core.points.deciding import MarkerPlaces, decide, stray_suspects, strays
from addon.core.points.likelihood.distances import DistanceConstraints

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


def test_a_trajectory_is_named_by_frames_none_of_which_is_sure(model):
    decided = decide(*votes(20, 0.95), model, TARGET, 0).labels
    assert decided.marker[:, :3].tolist() == [[0, 1, 2]] * FRAMES


def test_among_many_more_points_than_markers_frames_must_be_sure_too(model):
    """A point that is no marker may sit like one in every frame of a crowd: its frames are not so many witnesses."""
    decided = decide(*votes(30, 0.95), model, TARGET, 0).labels
    assert (decided.marker == NO_MARKER).all()


def test_in_a_crowd_sure_frames_carry_the_others_of_their_trajectory(model):
    sure = np.ones((FRAMES, 3))
    sure[::3, 0] = 0  # most frames of the first are sure
    sure[5:, 1] = 0  # few of the second are
    decided = decide(*votes(30, 0.95, sure), model, TARGET, 0).labels
    assert (decided.marker[:, 0] == 0).all()
    assert (decided.marker[:5, 1] == 1).all() and (decided.marker[5:, 1] == NO_MARKER).all()
    assert (decided.marker[:, 2] == 2).all()


def test_where_one_subject_is_all_that_the_model_has_seen_a_quarter_of_the_frames_must_be_sure(model):
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


CONSTRAINTS = DistanceConstraints(np.array(np.triu_indices(4, 1)).T, np.full(6, 0.2), np.full(6, 0.004), 0.05)


def rigid_body(frames: int = 100) -> np.ndarray:
    """(T, 5, 3) four markers on a plate that wanders, and one that has no ties."""
    path = np.cumsum(np.random.default_rng(0).normal(0, 0.01, (frames, 1, 3)), axis=0)
    return path + np.random.default_rng(1).uniform(-0.1, 0.1, (5, 3))


def places(markers: np.ndarray) -> MarkerPlaces:
    """Those of markers (T, 5, 3), which stand in lanes in the other order."""
    there = np.isfinite(markers).all(axis=2)[:, ::-1]
    return MarkerPlaces(markers[:, ::-1], np.where(there, np.arange(5)[::-1], NO_MARKER), 5)


def test_a_marker_that_leaves_its_plate_is_found_and_its_mates_are_not():
    markers = rigid_body()
    markers[40:46, 2] += 0.06
    markers[:, 4] += np.random.default_rng(2).normal(0, 0.2, (100, 3))
    markers[10:20, 0] = np.nan
    stray = strays(places(markers), CONSTRAINTS)
    assert np.argwhere(stray).tolist() == [[frame, 2] for frame in range(40, 46)]


def test_nothing_is_said_of_too_few_mates_or_frames():
    markers = rigid_body()
    markers[40:46, 2] += 0.06
    markers[:, :1] = np.nan
    markers[30:60, 1] = np.nan
    assert not strays(places(markers), CONSTRAINTS).any()
    assert not strays(places(rigid_body(3) * np.nan), CONSTRAINTS).any()


def test_ranges_bridge_short_interruptions():
    stray = np.zeros((100, 5), bool)
    stray[[10, 12, 15, 40], 1] = True
    found = stray_suspects(stray, list("ABCDE"), 1000)
    assert [(one.first, one.last) for one in found] == [(1010, 1015), (1040, 1040)]
    assert found[0].reason.startswith("B was off")
