# SPDX-License-Identifier: GPL-3.0-or-later
"""Doubts that a person has answered leave the list."""

import pytest

from addon.core.data.takes import Suspect
from addon.core.edits.kinds import Accepted, AssignPoint, Delete, Edits, Right, Swap, UnlabelMarker, UnlabelPoint
from addon.core.review.answering import settled_in, unanswered, without_accepted

from ..edits.lists import INDEX

JUMPS = Suspect(12, 20, "A jumps", markers=("A",))
NAMELESS = Suspect(12, 20, "may be D and stays unnamed", 7, ("D",))
CHANGE = Suspect(14, 15, "goes over from A to B", 2, ("A", "B"))
MANY = Suspect(12, 20, "A B C: jumps", markers=("A", "B", "C"))
LOST = Suspect(12, 20, "the subject was lost")
ALL = [(12, 20)]


@pytest.mark.parametrize(
    ("suspect", "edits", "left"),
    [
        (JUMPS, [Right("A", frames=(14, 15))], [(12, 13), (16, 20)]),
        (JUMPS, [Right("A", frames=(1, 12)), Right("B")], [(13, 20)]),
        (JUMPS, [Right("A")], []),
        (JUMPS, [Right("A"), UnlabelMarker("A", frames=(12, 14))], [(12, 14)]),
        (JUMPS, [Right("B")], ALL),
        (JUMPS, [AssignPoint(2, "A")], ALL),
        (NAMELESS, [AssignPoint(7, "D", frames=(10, 15))], [(16, 20)]),
        (NAMELESS, [UnlabelPoint(7)], []),
        (NAMELESS, [AssignPoint(11, "D")], ALL),
        (CHANGE, [AssignPoint(2, "A", frames=(10, 14))], []),
        (CHANGE, [Swap(("B", "A"), frames=(15, 40))], []),
        (CHANGE, [Right("B", frames=(15, 15))], []),
        (CHANGE, [Swap(("C", "D")), AssignPoint(3, "C")], [(14, 15)]),
        (MANY, [Right("A"), Right("B")], ALL),
        (MANY, [Right("A"), Right("B"), Right("C")], []),
        (LOST, [Right("A"), Delete(2)], ALL),
    ],
)
def test_a_doubt_is_left_in_the_frames_that_no_edit_answers(suspect, edits, left):
    found = unanswered([suspect], Edits(tuple(edits)), INDEX)
    assert [(one.first, one.last) for one in found] == left
    assert {one.reason for one in found} <= {suspect.reason}


def test_what_was_accepted_does_not_come_back_with_other_figures():
    moved = Suspect(12, 20, "camera B seems to have moved: its blobs are 1.7 px off")
    accepted = Accepted("camera B seems to have moved: its blobs are 1.62 px off", frames=(12, 17))
    assert without_accepted([moved], Edits((accepted,))) == (Suspect(18, 20, moved.words),)
    other = Accepted("camera C seems to have moved: its blobs are 1.7 px off")
    assert without_accepted([moved], Edits((other,))) == (moved,)


def test_a_trajectory_is_settled_where_all_of_its_frames_are_no_marker():
    parts = Delete(7, frames=(10, 14)), Delete(7, frames=(15, 30))
    assert settled_in(Edits(parts), 7, 12, 20)
    assert not settled_in(Edits(parts[:1]), 7, 12, 20)
    assert not settled_in(Edits((Delete(8), UnlabelPoint(7))), 7, 12, 20)
    assert settled_in(Edits((Delete(7),)), 7, 12, 20)
