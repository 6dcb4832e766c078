# SPDX-License-Identifier: GPL-3.0-or-later
"""Which frames of a take are named on their own, and what is said of those between them."""

import numpy as np
import pytest

from addon.core.data.lanes import LaneOptions
from addon.core.data.takes import BY_LIKELIHOOD, BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels
from addon.core.points.whole_take.asking import asked_frames
from addon.core.points.whole_take.tracklets import said_between


@pytest.fixture
def tracklet():
    """(T, P): a whole trajectory, two short tracklets that no fourth frame shows, one that such a frame shows."""
    found = np.full((12, 3), -1)
    found[:, 0] = 0
    found[1:4, 1], found[2:3, 2], found[6:11, 1] = 1, 2, 3
    return found


@pytest.mark.parametrize(("rate", "step"), [(120.0, 8), (60.0, 4), (30.0, 2), (10.0, 1)])
def test_so_many_frames_a_second_are_asked_and_every_tracklet_is_in_one(tracklet, rate, step):
    frames = asked_frames(tracklet, rate)
    assert set(range(0, 12, step)) <= set(frames.tolist())
    assert set(np.unique(tracklet)) == set(np.unique(tracklet[frames])) | {-1}
    assert (np.diff(frames) > 0).all()


def test_what_no_frame_shows_needs_no_frame():
    assert asked_frames(np.full((19, 2), -1), 90.0).tolist() == [0, 6, 12, 18]


@pytest.mark.parametrize("cells", [0, 1000])
def test_frames_between_say_what_their_tracklets_do_in_the_nearest_one(tracklet, cells):
    frames = np.array([0, 2, 4, 8])
    marker = np.where(tracklet[frames] >= 0, tracklet[frames], NO_MARKER)
    marker[frames == 8, 0] = 7
    step = np.where(marker == NO_MARKER, NO_STEP, BY_LIKELIHOOD)
    chance = np.where(marker == NO_MARKER, 0.0, 0.9)
    given = said_between(Labels(marker, step, chance, chance), frames, tracklet, LaneOptions(whole_cells=cells))
    assert isinstance(given, Labels) == (tracklet.size <= cells)
    said = Labels.join(given[part] for part in (slice(0, 5), slice(5, 6), slice(6, 12)))
    assert (said.marker[:, 1:] == np.where(tracklet[:, 1:] >= 0, tracklet[:, 1:], NO_MARKER)).all()
    assert said.marker[:, 0].tolist() == [0] * 7 + [7] * 5
    there = tracklet >= 0
    own = np.isin(np.arange(12), frames)[:, None] & there
    assert (said.step[own] == BY_LIKELIHOOD).all()
    assert (said.step[there & ~own] == BY_TRAJECTORY).all()
    assert (said.step[~there] == NO_STEP).all()
    assert (said.rate[there] == 0.9).all()
