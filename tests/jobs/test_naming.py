# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of the points of a take, once all of its frames were named on their own."""

import numpy as np

from addon.core.takes import NO_MARKER
from addon.jobs.naming import NamedFrames, decide

MARKERS = ("A", "B", "C")
TARGET = 0.999
FRAMES = 50


def votes(points: int, confidence: float, sure: np.ndarray | None = None) -> tuple[NamedFrames, np.ndarray]:
    """Frames of `points` trajectories, the first three of which are named A, B, C; sure (F, 3) of it where asked."""
    marker = np.full((FRAMES, points), NO_MARKER)
    marker[:, : len(MARKERS)] = range(len(MARKERS))
    chance = np.where(marker == NO_MARKER, 0.0, confidence)
    rate = np.zeros(marker.shape)
    if sure is not None:
        rate[:, : len(MARKERS)] = sure
    return NamedFrames(marker, chance, rate), np.broadcast_to(np.arange(points), marker.shape)


def test_a_trajectory_is_named_by_frames_none_of_which_is_sure():
    decided = decide(*votes(4, 0.95), MARKERS, TARGET, 0)
    assert decided.marker[:, :3].tolist() == [[0, 1, 2]] * FRAMES


def test_among_many_more_points_than_markers_frames_must_be_sure_too():
    """A point that is no marker may sit like one in every frame of a crowd: its frames are not so many witnesses."""
    decided = decide(*votes(6, 0.95), MARKERS, TARGET, 0)
    assert (decided.marker == NO_MARKER).all()


def test_in_a_crowd_sure_frames_carry_the_others_of_their_trajectory():
    sure = np.ones((FRAMES, 3))
    sure[::3, 0] = 0  # most frames of A are sure
    sure[5:, 1] = 0  # few of B are
    decided = decide(*votes(6, 0.95, sure), MARKERS, TARGET, 0)
    assert (decided.marker[:, 0] == 0).all()
    assert (decided.marker[:5, 1] == 1).all() and (decided.marker[5:, 1] == NO_MARKER).all()
    assert (decided.marker[:, 2] == 2).all()
