# SPDX-License-Identifier: GPL-3.0-or-later
"""Doubts that a person has answered leave the list."""

import numpy as np

from addon.core.data.takes import Suspect
from addon.core.edits.applying import PointCells, apply_to_points, unless_heard
from addon.core.edits.kinds import Accepted, AssignPoint, Edits, Right
from addon.core.review.answering import heard_in, unanswered, unanswered_of_blobs, without_accepted

from ..edits.lists import COLUMNS, FIRST, INDEX, NAMES, named

FRAMES = 20


LABELS = named(np.tile([0, 1, 2, -1, -1], (FRAMES, 1)))
CELLS = PointCells(INDEX, len(NAMES), FIRST, np.ones((FRAMES, 5), bool), COLUMNS)


def left(suspects, *edits):
    edited = apply_to_points(LABELS, Edits(tuple(edits)), CELLS).edited
    return [(one.first, one.last, one.reason) for one in unanswered(suspects, edited, INDEX, FIRST)]


def test_what_is_right_is_not_doubtful_in_its_frames():
    jumps = Suspect(12, 20, "A jumps", markers=("A",))
    assert left([jumps], Right("A", frames=(14, 15))) == [(12, 13, "A jumps"), (16, 20, "A jumps")]
    assert left([jumps], Right("A")) == []
    assert left([jumps], Right("B")) == [(12, 20, "A jumps")]
    assert left([jumps], AssignPoint(2, "A")) == [(12, 20, "A jumps")]


def test_a_question_about_a_trajectory_is_answered_by_its_name():
    nameless = Suspect(12, 20, "may be D and stays unnamed", 3, ("D",))
    assert left([nameless], AssignPoint(7, "D", frames=(10, 15))) == [(16, 20, nameless.reason)]
    assert left([nameless], AssignPoint(11, "D")) == [(12, 20, nameless.reason)]
    change = Suspect(14, 15, "goes over from A to B", 0, ("A", "B"))
    assert left([change], AssignPoint(2, "A", frames=(10, 14))) == []


def test_of_blobs_only_what_is_right_answers():
    jumps = Suspect(12, 20, "A jumps", markers=("A",))
    edits = Edits((Right("A", frames=(1, 12)), Right("B")))
    assert [(one.first, one.last) for one in unanswered_of_blobs([jumps], edits, INDEX)] == [(13, 20)]
    lost = Suspect(12, 20, "the subject was lost")
    assert unanswered_of_blobs([lost], edits, INDEX) == (lost,)


def test_what_was_accepted_does_not_come_back_with_other_figures():
    moved = Suspect(12, 20, "camera B seems to have moved: its blobs are 1.7 px off")
    accepted = Accepted("camera B seems to have moved: its blobs are 1.62 px off", frames=(12, 17))
    assert without_accepted([moved], Edits((accepted,))) == (Suspect(18, 20, moved.words),)
    assert without_accepted([moved], Edits((Accepted("camera C seems to have moved: its blobs are 1.7 px off"),)))
    assert apply_to_points(LABELS, Edits((accepted,)), CELLS).outcomes[0].labels == 6


def test_an_edit_is_heard_where_a_doubt_says_the_same_in_a_frame_of_it():
    moved = Suspect(12, 20, "camera B seems to have moved: its blobs are 1.7 px off")
    words = "camera B seems to have moved: its blobs are 1.62 px off"
    heard = Accepted(words), Accepted(words, frames=(20, 30))
    deaf = Accepted(words, frames=(21, 30)), Accepted("no such doubt at all")
    assert heard_in(Edits((*heard, *deaf, Right("A"))), [moved]) == set(heard)
    outcomes = apply_to_points(LABELS, Edits((*heard, *deaf)), CELLS).outcomes
    told = unless_heard(outcomes, Edits((*heard, *deaf)), heard)
    assert told[:2] == outcomes[:2]
    assert [one.labels for one in told[2:]] == [0, 0]
    assert told[3].reason == "nothing to look at says 'no such doubt at all'"


def test_of_more_than_two_markers_all_have_to_be_right():
    many = Suspect(12, 20, "A B C: jumps", markers=("A", "B", "C"))
    assert left([many], Right("A"), Right("B")) == [(12, 20, "A B C: jumps")]
    assert left([many], Right("A"), Right("B"), Right("C")) == []


def test_of_a_trajectory_only_points_are_asked():
    nameless = Suspect(12, 20, "may be D and stays unnamed", 3, ("D",))
    cells = PointCells(INDEX, len(NAMES), FIRST, np.ones((FRAMES, 5), bool), COLUMNS)
    cells.present[15 - FIRST :, 3] = False
    edited = apply_to_points(LABELS, Edits((AssignPoint(7, "D"),)), cells).edited
    assert unanswered([nameless], edited, INDEX, FIRST, cells.present) == ()
    assert unanswered([nameless], edited, INDEX, FIRST) == (Suspect(15, 20, nameless.words, 3),)
