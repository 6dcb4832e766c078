# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of the points of a take, once all of its frames were named on their own."""

from dataclasses import replace

import numpy as np

from addon.core.data.takes import BY_LIKELIHOOD, NO_MARKER, Labels
from addon.core.points.deciding import decide

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
