# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames worth a look, once each, as a table of samples; where samples are from, and what labelling again changed."""

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest

from addon.core.data.takes import BY_EDIT, BY_LIKELIHOOD, LabelledChunk, Labels, PointRows, Suspect
from addon.core.edits.kinds import Accepted, AssignPoint, Delete, Edits, Place, Right, Swap, UnlabelMarker, UnlabelPoint
from addon.core.review.answering import WHOLE_FRAME, doubtful_samples, settled_in, unanswered, without_accepted
from addon.core.review.changes import GAINED, LOST, OTHER, changes, summary_of_changes
from addon.core.review.summary import SampleOrigins
from addon.core.review.suspects import MAX_ENTRIES, Ranges, find_suspects, summarised
from tests.core.scenes import motion_of

RATE = 100.0


def even() -> np.ndarray:
    """Two markers that walk along at 1 m/s."""
    along = np.arange(40)[:, None, None] / RATE * np.array([1.0, 0, 0])
    return along + np.array([[0.0, 0, 1], [0, 0.5, 1]])


def test_a_marker_away_from_the_body_and_a_jump_are_found_and_a_gap_and_a_steady_walk_are_none():
    assert find_suspects(motion_of(even(), even(), 10), ("A", "B"), RATE) == ()
    markers = even()
    markers[5:9, 1, 2] += 0.2
    markers[11:13, 1, 2] += 0.2
    found = find_suspects(motion_of(markers, even(), 10), ("A", "B"), 1.0)
    assert [(s.first, s.last, s.reason) for s in found] == [(15, 22, "B is far from where the body has it")]
    markers = even()
    markers[20, 0, 1] += 0.1
    markers[30:33, 1] = np.nan
    found = find_suspects(motion_of(markers, markers, 10), ("A", "B"), RATE)
    assert {s.reason for s in found} == {"A jumps"}
    assert found[0].first <= 30 <= found[0].last


def test_findings_with_one_reason_are_one_and_trajectories_are_listed_by_number():
    found = summarised([Suspect(30, 31, "A jumps"), Suspect(10, 12, "A jumps"), Suspect(40, 40, "B jumps")], RATE)
    assert found == (Suspect(10, 31, "A jumps"), Suspect(40, 40, "B jumps"))
    [twice] = summarised([Suspect(10, 19, "names are new"), Suspect(12, 19, "names are new")], RATE)
    assert (twice.first, twice.last, twice.frames) == (10, 19, 10)
    found = summarised([Suspect(first, first + 1, "A jumps") for first in range(0, 1000, 100)], RATE)
    assert found == (Suspect(0, 901, "A jumps, in 10 places"),)
    many = [Suspect(index, index + 900, f"trajectory {index} goes over from A to M{index}") for index in range(100)]
    (found,) = summarised(many, RATE)
    assert found.reason.startswith("trajectories 0 1 2 3 4 5 6 7 and 92 more: as trajectory 0 goes over from A to M0")
    assert (found.first, found.last) == (0, 999)


def test_a_list_stays_short_and_names_those_it_is_about_and_what_is_of_the_whole_take_is_first():
    many = [Suspect(index, index, f"M{index:03} jumps") for index in range(200)]
    few = [Suspect(5, 9, "trajectory 3 goes over from A to B"), Suspect(0, 999, "10 trajectories stand still")]
    found = summarised(many + few, RATE)
    assert len(found) == 3 <= MAX_ENTRIES
    assert found[0].reason == "10 trajectories stand still"
    assert found[1] == Suspect(0, 199, "M000 M001 M002 M003 M004 M005 M006 M007 and 192 more: jumps")
    assert found[2] in few


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
    ranges = Ranges(len(NAMES))
    for part in (slice(0, 22), slice(22, None)):
        ranges.add(motion.frames[part], found[part].T)
    return {name: spans for index, name in enumerate(NAMES) if (spans := ranges.spans(index))}


def test_doubts_are_told_frame_by_frame_of_their_markers_until_a_person_gives_the_name(take):
    summed_up = Suspect(101, 150, "RHEE is far from where the body has it, in 3 places", markers=("RHEE",), doubtful=5)
    assert asked(take, [summed_up]) == {"RHEE": [[121, 125]]}
    named = Suspect(130, 140, "may have each other's names", markers=("LHEE", "LTOE"))
    whole = Suspect(110, 111, f"{WHOLE_FRAME} 60 % sure")
    about_things = Suspect(101, 150, "2 trajectories stand still while the subject moves")
    assert asked(take, [named, whole, about_things]) == {
        "LHEE": [[110, 111], [130, 140]],
        "RHEE": [[110, 111], [121, 125]],
        "LTOE": [[110, 111], [130, 140]],
    }
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


JUMPS = Suspect(12, 20, "A jumps", markers=("A",))
NAMELESS = Suspect(12, 20, "may be D and stays unnamed", 7, ("D",))
CHANGE = Suspect(14, 15, "goes over from A to B", 2, ("A", "B"))
TWO = Suspect(12, 20, "A B: jumps", markers=("A", "B"))
MANY = Suspect(12, 20, "A B C: jumps", markers=("A", "B", "C"))
WHICH = Suspect(12, 20, "A and B may be either way round in the whole take: each stays unnamed", markers=("A", "B"))
NOBODY = Suspect(12, 20, "the subject was lost")
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
        (TWO, [AssignPoint(2, "A")], ALL),
        (TWO, [Right("A", frames=(12, 14))], [(15, 20)]),
        (MANY, [Right("A"), Right("B")], ALL),
        (MANY, [Right("A"), Right("B"), Right("C")], []),
        (WHICH, [AssignPoint(7, "A", frames=(12, 14))], []),
        (WHICH, [AssignPoint(7, "C")], ALL),
        (NOBODY, [Right("A"), Delete(2)], ALL),
    ],
)
def test_a_doubt_is_left_in_the_frames_that_no_edit_answers(suspect, edits, left):
    found = unanswered([suspect], Edits(tuple(edits)), dict(zip("ABCD", range(4), strict=True)))
    assert [(one.first, one.last) for one in found] == left
    assert {one.reason for one in found} <= {suspect.reason}


def test_what_was_accepted_or_is_no_marker_in_all_of_its_frames_does_not_come_back():
    moved = Suspect(12, 20, "camera B seems to have moved: its blobs are 1.7 px off")
    accepted = Accepted("camera B seems to have moved: its blobs are 1.62 px off", frames=(12, 17))
    assert without_accepted([moved], Edits((accepted,))) == (Suspect(18, 20, moved.words),)
    other = Accepted("camera C seems to have moved: its blobs are 1.7 px off")
    assert without_accepted([moved], Edits((other,))) == (moved,)
    parts = Delete(7, frames=(10, 14)), Delete(7, frames=(15, 30))
    assert settled_in(Edits(parts), 7, 12, 20)
    assert not settled_in(Edits(parts[:1]), 7, 12, 20)
    assert not settled_in(Edits((Delete(8), UnlabelPoint(7))), 7, 12, 20)
    assert settled_in(Edits((Delete(7),)), 7, 12, 20)


FIRST, COUNT, NAMES = 101, 20, ("LHEE", "RHEE", "LTOE")
EDITS = Edits((Place("heel", 118, (0.0, 0.0, 0.1)),))
WORDS = {"LHEE": 0, "heel": 0, "RHEE": 1, "LTOE": 2}


@pytest.fixture
def part():
    """A part of a take of points: LHEE named by hand in frames 105 to 109, placed in 118 and missing from 111 on.

    RHEE was filled before, in frames 101 and 102; LTOE is never there.
    """
    markers = np.tile(np.arange(9.0).reshape(3, 3), (COUNT, 1, 1))
    markers[10:17, 0] = markers[18:, 0] = markers[:, 2] = np.nan
    motion = motion_of(markers, np.nan_to_num(markers), FIRST)
    motion.residual[:2, 1] = motion.residual[17, 0] = 0.0

    def cut(start: int, stop: int) -> tuple[PointRows, LabelledChunk]:
        own = replace(motion, **{name: getattr(motion, name)[start:stop] for name in ("frames", "markers", "residual")})
        there = np.isfinite(own.markers[..., 0])
        if start <= 17 < stop:
            there[17 - start, 0] = False  # it is no point
        frame, marker = np.nonzero(there)
        hand = (marker == 0) & (frame + start >= 4) & (frame + start < 9)
        confidence = np.where(marker == 0, np.where(frame + start == 0, 0.9, 1.0), 0.98)
        labels = Labels(marker, np.where(hand, BY_EDIT, BY_LIKELIHOOD), confidence)
        return PointRows(own.frames, frame, marker, own.markers[frame, marker], None), LabelledChunk(labels, own)

    return cut


@pytest.mark.parametrize("cuts", [(0, 20), (0, 6, 20), (0, 1, 8, 17, 18, 20)])
def test_every_sample_is_counted_once(part, cuts):
    origins = SampleOrigins(NAMES, EDITS, WORDS)
    for start, stop in pairwise(cuts):
        origins.add(*part(start, stop))
    fills = [{"marker": "LHEE", "first": 111, "last": 113, "method": "spline"}]
    fills += [fills[0] | {"first": 114, "last": 114}]
    told = origins.of_markers(fills, [20, 0, 0])
    assert told["LHEE"] == {
        "measured": 5, "hand": 6, "filled": {"spline": 4}, "missing": 5, "smoothed": 20,
        "confidence": {"names": 5, "lowest": 0.9, "mean": 0.98, "sure": 0.8},
        "hand_frames": [[105, 109], [118, 118]],
    }  # fmt: skip
    assert told["RHEE"] == {
        "measured": 18, "hand": 0, "filled": {"input": 2}, "missing": 0, "smoothed": 0,
        "confidence": {"names": 20, "lowest": 0.98, "mean": 0.98, "sure": 0.0},
        "filled_in_input": [[101, 102]],
    }  # fmt: skip
    nothing = {"measured": 0, "hand": 0, "filled": {}, "missing": 20, "smoothed": 0, "confidence": None}
    assert told["LTOE"] == nothing


PAIR, NUMBERS = ("A", "B"), 10 + np.arange(20)


def changed(before, after):
    """Of two points in every frame, the markers A and B but in some frames (first, after, A's, B's) of each table."""
    tables = np.tile([[[0, 1]]], (2, 20, 1))
    for table, rows in zip(tables, (before, after), strict=True):
        for first, end, *markers in rows:
            table[first:end] = markers
    found = changes(np.repeat(np.arange(20), 2), *tables.reshape(2, -1), PAIR, NUMBERS)
    return found, [(one.marker, one.what, one.first, one.last, one.frames) for one in found]


def test_nothing_changed_gained_lost_and_exchanged_over_a_short_break():
    assert changed([], []) == ((), [])
    assert summary_of_changes(()) == ""
    found, said = changed([(0, 5, -1, 1)], [(8, 10, 0, -1)])
    assert said == [("A", GAINED, 10, 14, 5), ("B", LOST, 18, 19, 2)]
    assert summary_of_changes(found) == "5 labels more, 2 fewer"
    assert summary_of_changes(changed([(0, 1, -1, 1)], [(4, 7, 1, 0)])[0]) == "1 label more, 6 changed"
    assert found[0].words == "A is named now in frames 10–14"
    _, said = changed([], [(4, 7, 1, 0), (8, 12, 1, 0)])
    assert said == [("A", OTHER, 14, 21, 7), ("B", OTHER, 14, 21, 7)]
