# SPDX-License-Identifier: GPL-3.0-or-later
"""A review that tells the truth: what is missing, left over or off the body is said, worst first."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.data.takes import BY_FIT, NO_MARKER, NO_STEP, Labels, Motion, PointRows, Suspect
from addon.core.edits.kinds import Accepted, Delete, Edits, Right, Swap
from addon.core.points.whole_take.deciding import words_of_pair
from addon.core.review.take_trouble import TakeTrouble
from addon.core.review.trouble import IN_DOUBT, LEFT_OVER, MISSING, OF_CAMERA, OFF_BODY, summary_of_trouble
from tests.core.scenes import motion_of

RATE, FIRST, FRAMES = 100.0, 11, 200
NAMES = ("HEAD", "LHEE", "RHEE")
PLACES = np.array([[0.0, 0, 1.7], [0, 0.1, 0.05], [0, -0.1, 0.05]])


BESIDE = np.tile(PLACES[1] + [0.1, 0, 0], (FRAMES, 1))
ROOM = Suspect(FIRST, FIRST + FRAMES - 1, "the room seems to be about 1000 times too large: its cameras see")
ALIKE = Suspect(20, 29, "LHEE and RHEE may be either way round: each stays unnamed", markers=("LHEE", "RHEE"))


def take(markers: np.ndarray, others: dict[int, np.ndarray] | None = None):
    """Rows, labels and motion: a trajectory for each of the markers (F, M, 3), then others by number (F, 3)."""
    count = len(markers)
    xyz = np.concatenate([markers, *(one[:, None] for one in (others or {}).values())], axis=1)
    numbers = np.array([*range(len(NAMES)), *(others or {})])
    frame, column = np.nonzero(np.isfinite(xyz[..., 0]))
    marker = np.where(column < len(NAMES), column, NO_MARKER)
    named = marker != NO_MARKER
    labels = Labels(marker, np.where(named, BY_FIT, NO_STEP), named * 1.0)
    rows = PointRows(FIRST + np.arange(count), frame, numbers[column], xyz[frame, column], None)
    return rows, labels, motion_of(markers, np.tile(PLACES, (count, 1, 1)), FIRST)


def trouble(markers, others=None, edits=(), suspects=(), answered=()):
    looking = TakeTrouble(NAMES, RATE, Edits(tuple(edits)))
    looking.add(*take(markers, others))
    return looking.found(suspects, answered)


def even() -> np.ndarray:
    return np.tile(PLACES, (FRAMES, 1, 1))


def without(*names: str, frames: slice = slice(None)) -> np.ndarray:
    markers = even()
    for name in names:
        markers[frames, NAMES.index(name)] = np.nan
    return markers


def test_a_take_without_trouble_has_none():
    assert trouble(even()) == ()
    assert summary_of_trouble(()) == ""


def test_a_heel_that_was_never_found_is_said_with_the_point_beside_it():
    [alone] = trouble(without("LHEE"))
    assert (alone.kind, alone.markers, alone.first, alone.last) == (MISSING, ("LHEE",), FIRST, FIRST + FRAMES - 1)
    assert alone.stake == FRAMES
    assert alone.reason == "LHEE is never found"
    [missing] = trouble(without("LHEE"), {7: BESIDE})
    assert (missing.kind, missing.trajectories, missing.action) == (MISSING, (7,), "name")
    assert "trajectory 7, which has no name, is 100 mm from where it should be" in missing.reason
    left, answered = trouble(without("LHEE"), {7: BESIDE}, edits=missing.answers())
    assert answered.answered and (left.kind, left.markers, left.trajectories) == (LEFT_OVER, (), (7,))


def test_a_point_beside_a_marker_that_lacks_for_a_moment_is_left_over_by_itself():
    """So short a gap is no trouble of its own."""
    beside = np.full((FRAMES, 3), np.nan)
    beside[20:46] = BESIDE[20:46]
    markers = without("LHEE", frames=slice(20, 46))
    looking = TakeTrouble(NAMES, RATE)
    looking.add(*take(markers, {7: beside}))
    looking.fill("LHEE", FIRST + 20, FIRST + 45)
    [left] = looking.found()
    assert (left.kind, left.markers, left.action) == (LEFT_OVER, ("LHEE",), "name")


def test_markers_that_were_never_found_are_one_line_which_one_answer_closes():
    [both] = trouble(without("LHEE", "RHEE"))
    assert both.reason == "LHEE, RHEE are never found" and both.stake == 2 * FRAMES
    assert both.answer == "Not Worn" and [edit.names for edit in both.answers()] == [("LHEE",), ("RHEE",)]
    over = trouble(without("LHEE", "RHEE"), edits=both.answers())
    assert over and all(one.answered for one in over)


def test_a_marker_that_was_answered_is_not_asked_again_beside_one_that_was_not():
    [both] = trouble(without("LHEE", "RHEE"))
    said = [Accepted("LHEE has gaps", frames=(both.first, both.last))]
    rest = [one for one in trouble(without("LHEE", "RHEE"), edits=said) if not one.answered]
    assert [one.markers for one in rest] == [("RHEE",)]


def test_a_point_is_to_be_named_where_it_is_and_a_gap_that_was_filled_is_no_trouble():
    beside = BESIDE.copy()
    beside[60:] = np.nan
    markers = without("LHEE", frames=slice(0, 60))
    markers[100:180, 1] = np.nan
    missing = next(one for one in trouble(markers, {7: beside}) if one.kind == MISSING)
    assert (missing.trajectories, missing.named_in) == ((7,), ((FIRST, FIRST + 59),))
    assert missing.ranges == ((FIRST, FIRST + 59), (FIRST + 100, FIRST + 179))
    looking = TakeTrouble(NAMES, RATE)
    looking.add(*take(without("LHEE", frames=slice(20, 80))))
    assert [one.markers for one in looking.found()] == [("LHEE",)]
    looking.fill("LHEE", FIRST + 20, FIRST + 79)
    assert looking.found() == ()


def test_a_doubted_point_is_offered_a_name_on_the_body_only():
    asked = Suspect(FIRST, FIRST + 99, "may be LHEE, stays unnamed", 7, ("LHEE",))
    for away, action in ((0.0, "name"), (2.7, "")):
        found = trouble(without("LHEE"), {7: BESIDE + away}, suspects=[asked])
        doubt = next(one for one in found if one.kind == IN_DOUBT)
        assert (doubt.trajectories, doubt.action) == ((7,), action)
        assert ("off the body" in doubt.advice) == (away > 0)


def test_gaps_count_by_their_frames_the_worst_first_and_what_is_right_counts_nothing():
    markers = without("LHEE", frames=slice(20, 40))
    markers[50:150, 2] = np.nan
    found = trouble(markers)
    assert [(one.markers, one.stake, one.action) for one in found] == [
        (("RHEE",), 100.0, "fill"),
        (("LHEE",), 20.0, "fill"),
    ]
    assert found[0].reason == "RHEE is found in 50 % of the frames; not in frames 61–160"
    assert trouble(without("LHEE", frames=slice(20, 21))) == ()
    assert summary_of_trouble(found) == f"2 to look at, worst: {found[0].reason}"
    [answered] = trouble(without("LHEE"), edits=[Right("LHEE")])
    assert answered.answered and answered.stake == 0
    assert summary_of_trouble([answered]) == ""
    half = trouble(without("LHEE"), edits=[Right("LHEE", frames=(FIRST, FIRST + 99))])
    assert [(one.answered, one.stake, one.first) for one in half] == [(False, 100.0, FIRST + 100), (True, 0.0, FIRST)]
    again = trouble(without("LHEE"), edits=[Right("LHEE"), Swap(("LHEE", "RHEE"))])
    assert [one.answered for one in again] == [False]


def test_a_point_far_from_the_body_is_none_of_its_own_and_one_on_it_is():
    far, brief = np.tile([3.0, 3, 1], (FRAMES, 1)), np.full((FRAMES, 3), np.nan)
    brief[10:14] = PLACES[0]
    assert all(7 not in one.trajectories for one in trouble(even(), {7: far, 8: brief}))
    on = np.tile(PLACES[0] + [0.05, 0, 0], (FRAMES, 1))
    [left] = trouble(even(), {9: on})
    assert (left.kind, left.trajectories, left.markers) == (LEFT_OVER, (9,), ())
    assert left.stake == 0
    [gone] = trouble(even(), {9: on}, edits=[Delete(9)])
    assert gone.answered
    halves = [Delete(9, frames=(FIRST, 100)), Delete(9, frames=(101, FIRST + FRAMES - 1))]
    assert trouble(even(), {9: on}, edits=halves)[0].answered
    assert not trouble(even(), {9: on}, edits=halves[:1])[0].answered


def test_how_far_the_body_is_off_is_said_in_mm_and_doubts_once_with_what_to_do():
    markers = even()
    markers[30:40, 2, 0] += 0.285
    markers[35, 2, 0] -= 0.1
    [off] = trouble(markers)
    assert (off.kind, off.markers, off.first, off.last, off.stake) == (OFF_BODY, ("RHEE",), 41, 50, 10.0)
    assert "up to 285 mm apart in frames 41–50" in off.reason
    assert trouble(markers, edits=[Right("RHEE", frames=(41, 50))])[0].answered
    far = Suspect(20, 29, "LHEE is far from where the body has it", markers=("LHEE",))
    [doubt] = trouble(even(), suspects=[ALIKE, far])
    assert (doubt.kind, doubt.stake, doubt.action) == (IN_DOUBT, 20.0, "")
    [answered] = trouble(even(), answered=[ALIKE])
    assert answered.answered and answered.stake == 0


def test_what_answers_a_trouble_fits_it():
    ghost = np.tile(PLACES[1] + [0.05, 0, 0.02], (FRAMES, 1))
    away = even()
    away[30:40, 2, 0] += 0.285
    unnamed = Suspect(20, 29, "may be LHEE and stays unnamed", 7, ("LHEE",))
    several = Suspect(20, 29, f"trajectories 7 8: as {unnamed.reason}", markers=("LHEE", "RHEE"))
    for found, answer in (
        (trouble(without("LHEE")), "Not Worn"),
        (trouble(without("LHEE", frames=slice(20, 160))), "Not Seen"),
        (trouble(even(), {7: ghost}), "No Marker"),
        (trouble(away), "It Is Right"),
        (trouble(even(), suspects=[ALIKE]), "Leave Unnamed"),
        (trouble(even(), suspects=[unnamed]), "Leave Unnamed"),
        (trouble(even(), suspects=[several]), "Leave Unnamed"),
        (trouble(even(), suspects=[ROOM]), "Calibration Is Right"),
    ):
        assert found[0].answer == answer, found[0].reason
        assert "say" not in found[0].advice or answer in found[0].advice, found[0].advice
        assert ("which is which" in found[0].advice) == ("either way" in found[0].reason)
    [edit] = trouble(even(), suspects=[ALIKE])[0].answers()
    assert edit == Accepted(ALIKE.words, frames=(20, 29)), "markers without a name are not right as they are"


def test_two_that_may_be_each_other_are_not_said_to_be_missing_too():
    alone = without("LHEE", "RHEE")
    [row] = trouble(alone, suspects=[ALIKE])
    assert (row.kind, set(row.markers)) == (IN_DOUBT, {"LHEE", "RHEE"})
    assert trouble(alone, edits=row.answers()) == (), "left unnamed, and labelled again"
    told = replace(ALIKE, words=words_of_pair(ALIKE.markers, named=True))
    [row] = trouble(alone, suspects=[told])
    assert ("which is which" in row.advice, row.answer) == (True, "Leave Unnamed")


def test_another_room_is_the_worst_as_no_name_is_to_be_trusted():
    first, second = trouble(without("LHEE"), suspects=[ROOM])
    assert (first.kind, first.cameras, first.stake) == (OF_CAMERA, (), 1.0 * FRAMES * len(NAMES))
    assert "Import the calibration" in first.advice
    assert second.markers == ("LHEE",)
    [answered] = trouble(even(), suspects=[ROOM], edits=first.answers())
    assert answered.answered


@pytest.mark.parametrize("parts", [1, 2, 7])
def test_a_take_in_chunks_has_the_same_trouble(parts):
    markers = without("LHEE", frames=slice(20, 160))
    markers[60:90, 2, 0] += 0.2
    whole = trouble(markers)
    rows, labels, motion = take(markers)
    looking = TakeTrouble(NAMES, RATE)
    for some in np.array_split(np.arange(FRAMES), parts):
        own = (rows.frame >= some[0]) & (rows.frame <= some[-1])
        piece = Motion(*(column[some] for column in vars(motion).values()))
        part = PointRows(rows.frames[some], rows.frame[own] - some[0], rows.trajectory[own], rows.xyz[own], None)
        looking.add(part, labels[own], piece)
    found, wanted = ([(one.kind, one.first, one.last, one.stake) for one in some] for some in (looking.found(), whole))
    assert found == wanted


def test_many_gaps_are_answered_by_one_edit_that_locks_nothing_between_them():
    markers = even()
    markers[::10, 1] = np.nan
    [gaps] = trouble(markers)
    assert gaps.stake == 20
    [answer] = gaps.answers()
    assert (answer, answer.frames) == (Accepted("LHEE has gaps", frames=(11, 201)), (11, 201))
    assert [one.answered for one in trouble(markers, edits=[answer])] == [True]
    markers[5:8, 1] = np.nan
    assert [one.answered for one in trouble(markers, edits=[answer])] == [True]
    markers[195:, 1] = np.nan
    assert [one.answered for one in trouble(markers, edits=[answer])] == [False]
