# SPDX-License-Identifier: GPL-3.0-or-later
"""What is asked in words as a table: exact where the motion tells it, and without what a person answered."""

import numpy as np
import pytest

from addon.core.data.takes import BY_EDIT, BY_LIKELIHOOD, Labels, PointRows, Suspect
from addon.core.edits.kinds import Accepted, Edits, Right
from addon.core.review.doubtful import WHOLE_FRAME, add_ranges, doubtful_samples
from addon.core.review.suspects import find_suspects
from tests.core.scenes import motion_of

FRAMES, NAMES = 50, ("LHEE", "RHEE", "LTOE")


@pytest.fixture
def take():
    """A steady take of points, a trajectory a marker, whose RHEE is off the body in five frames."""
    markers = np.tile(np.arange(9.0).reshape(3, 3), (FRAMES, 1, 1))
    expected = markers.copy()
    expected[20:25, 1] += 0.2
    motion = motion_of(markers, expected, 101)
    frame, trajectory = np.divmod(np.arange(3 * FRAMES), 3)
    rows = PointRows(motion.frames, frame, trajectory, markers[frame, trajectory], None)
    return rows, Labels(trajectory, np.full(len(frame), BY_LIKELIHOOD), np.ones(len(frame))), motion


def asked(take, suspects=(), edits=()) -> dict[str, list[list[int]]]:
    rows, labels, motion = take
    exact = find_suspects(motion, NAMES, 100.0)
    found = doubtful_samples(rows, labels, motion.frames, exact, suspects, NAMES, Edits(tuple(edits)))
    ranges: dict[str, list[list[int]]] = {name: [] for name in NAMES}
    for part in (slice(0, 22), slice(22, None)):
        add_ranges(ranges, found[part], motion.frames[part])
    return {name: spans for name, spans in ranges.items() if spans}


def test_what_a_list_sums_up_is_told_frame_by_frame(take):
    summed_up = Suspect(101, 150, "RHEE is far from where the body has it, in 3 places", markers=("RHEE",), doubtful=5)
    assert asked(take, [summed_up]) == {"RHEE": [[121, 125]]}


def test_doubts_are_about_their_markers_or_about_all_of_their_frames(take):
    named = Suspect(130, 140, "may have each other's names", markers=("LHEE", "LTOE"))
    whole = Suspect(110, 111, f"{WHOLE_FRAME} 60 % sure")
    about_things = Suspect(101, 150, "2 trajectories stand still while the subject moves")
    assert asked(take, [named, whole, about_things]) == {
        "LHEE": [[110, 111], [130, 140]],
        "RHEE": [[110, 111], [121, 125]],
        "LTOE": [[110, 111], [130, 140]],
    }


def test_a_name_that_is_not_sure_is_doubtful_until_a_person_gives_it(take):
    _, labels, _ = take
    labels.confidence[[3, 6]] = 0.5
    assert asked(take)["LHEE"] == [[102, 103]]
    labels.step[6] = BY_EDIT
    assert asked(take)["LHEE"] == [[102, 102]]


@pytest.mark.parametrize(
    "edit",
    [
        Right("RHEE", frames=(121, 125)),
        Accepted("RHEE is off the body at times"),
        Accepted("RHEE is far from where the body has it", frames=(101, 150)),
    ],
)
def test_what_was_answered_is_no_doubt(take, edit):
    assert asked(take, edits=[edit]) == {}
