# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels taken apart and put together, ranges merged, trajectories in lanes, copies; and the progress of long work."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.errors import ForceableError, InputError, of_file
from addon.core.data.lanes import Lanes
from addon.core.data.made import Copies
from addon.core.data.merging import LabelledRange, merged
from addon.core.data.progress import Stage, finished, in_stages
from addon.core.data.takes import (
    BY_FIT,
    BY_LIKELIHOOD,
    BY_TRAJECTORY,
    NO_MARKER,
    NO_STEP,
    Blobs,
    Labels,
    Motion,
    PointRows,
    Points,
    Suspect,
)


@pytest.fixture
def labels() -> Labels:
    """Two frames of three points, the last of which has no name."""
    return Labels(
        np.array([[4, 2, NO_MARKER], [2, 4, NO_MARKER]]),
        np.array([[BY_LIKELIHOOD, BY_TRAJECTORY, NO_STEP], [BY_LIKELIHOOD, BY_LIKELIHOOD, NO_STEP]]),
        np.array([[0.9, 0.8, 0.0], [0.7, 0.6, 0.0]]),
        np.array([[0.999, 0.99, 0.0], [1.0, 0.9, 0.0]]),
    )


def test_parts_come_one_after_the_other_are_kept_or_left_out_and_give_place_to_others(labels):
    whole = Labels.join([labels, labels[:1]])
    for name in ("marker", "step", "confidence", "rate"):
        column = getattr(labels, name)
        np.testing.assert_array_equal(getattr(whole, name), np.concatenate([column, column[:1]]))
    assert Labels.join(part for part in (labels, replace(labels, rate=None))).rate is None, (
        "not all of them were measured"
    )
    before = labels.marker.copy()
    kept = labels.kept(np.array([[True, False, True], [False, True, True]]))
    assert kept.marker.tolist() == [[4, NO_MARKER, NO_MARKER], [NO_MARKER, 4, NO_MARKER]]
    assert kept.step.tolist() == [[BY_LIKELIHOOD, NO_STEP, NO_STEP], [NO_STEP, BY_LIKELIHOOD, NO_STEP]]
    assert kept.confidence.tolist() == [[0.9, 0, 0], [0, 0.6, 0]]
    assert kept.rate.tolist() == [[0.999, 0, 0], [0, 0.9, 0]]
    np.testing.assert_array_equal(labels.marker, before)
    assert replace(labels, rate=None).kept(labels.named).rate is None
    other = Labels(np.full((2, 3), 7), np.full((2, 3), BY_FIT), np.full((2, 3), 0.5))
    where = np.array([[False, True, True], [False, False, False]])
    made = labels.replaced(where, other)
    assert made.marker.tolist() == [[4, 7, 7], [2, 4, NO_MARKER]]
    assert made.step.tolist() == [[BY_LIKELIHOOD, BY_FIT, BY_FIT], [BY_LIKELIHOOD, BY_LIKELIHOOD, NO_STEP]]
    assert made.confidence.tolist() == [[0.9, 0.5, 0.5], [0.7, 0.6, 0.0]]
    assert made.rate is None, "the rates were not those of both"


def test_sure_are_those_that_are_right_often_enough(labels):
    assert labels.sure(0.99).tolist() == [[4, 2, NO_MARKER], [2, NO_MARKER, NO_MARKER]]
    assert labels.sure(0.999).tolist() == [[4, NO_MARKER, NO_MARKER], [2, NO_MARKER, NO_MARKER]]


def test_points_become_rows_that_call_trajectories_as_their_file_does():
    xyz = np.arange(18.0).reshape(2, 3, 3)
    xyz[0, 1, 2] = np.nan
    residual = np.arange(6.0).reshape(2, 3)
    rows = PointRows.of(Points(("",) * 3, xyz, residual, 100.0, 41, np.array([0, 5, 9])))
    assert rows.frames.tolist() == [41, 42]
    assert rows.frame.tolist() == [0, 0, 1, 1, 1]
    assert rows.trajectory.tolist() == [0, 9, 0, 5, 9]
    np.testing.assert_array_equal(rows.xyz, xyz[[0, 0, 1, 1, 1], [0, 2, 0, 1, 2]])
    assert rows.residual.tolist() == [0, 2, 3, 4, 5]
    assert len(rows) == 5
    assert PointRows.of(Points(("",) * 3, xyz, residual, 100.0, 41)).trajectory.tolist() == [0, 2, 0, 1, 2]


MARKERS, POINTS = 3, 4


def labelled(first: int, last: int, value: int, blobs: bool = False, joints: int = 2, suspects=()) -> LabelledRange:
    """Frames `first` to `last` in which every point is the marker `value`, and every number of the motion too."""
    frames = np.arange(first, last + 1)
    count = len(frames)
    frame = np.repeat(np.arange(count), POINTS)
    other = np.tile(np.arange(POINTS), count)
    marker = np.where(other == 0, value, NO_MARKER)
    labels = Labels(marker, np.where(other == 0, BY_FIT, NO_STEP), (other == 0) * 1.0)
    place = np.column_stack([frames[frame], other, other]).astype(float)
    rows = PointRows(frames, frame, other, place, None)
    if blobs:
        rows = Blobs(frames, frame, other, place[:, :2], np.full(len(frame), np.nan))

    def filled(*shape):
        return np.full((count, *shape), float(value))

    body = filled(MARKERS, 3), filled(joints, 3), filled(joints, 3, 3), filled(3), filled()
    motion = Motion(frames, filled(MARKERS, 3), *(filled(MARKERS) for _ in range(3)), *body)
    return LabelledRange(rows, labels, motion, tuple(suspects))


@given(*(st.integers(0, 30) for _ in range(4)), st.booleans())
def test_in_its_frames_the_new_holds_and_elsewhere_the_old(a, b, c, d, blobs):
    old, new = labelled(min(a, b), max(a, b), 1, blobs), labelled(min(c, d), max(c, d), 2, blobs)
    whole = merged(old, new)
    frames = whole.motion.frames
    assert frames.tolist() == list(range(min(a, b, c, d), max(a, b, c, d) + 1))
    fresh, known = np.isin(frames, new.motion.frames), np.isin(frames, old.motion.frames)
    wanted = np.where(fresh, 2.0, np.where(known, 1.0, np.nan))
    np.testing.assert_array_equal(whole.motion.markers[:, 0, 0], wanted)
    named = whole.labels.named
    np.testing.assert_array_equal(whole.labels.marker[named], wanted[whole.rows.frame[named]])
    assert named.sum() == (fresh | known).sum()
    assert (np.diff(whole.rows.frame) >= 0).all()
    place = whole.rows.xy if blobs else whole.rows.xyz
    np.testing.assert_array_equal(frames[whole.rows.frame], place[:, 0])
    assert whole.unedited is None


def test_of_a_part_doubts_are_the_new_ones_and_what_the_program_said_is_kept():
    old = labelled(1, 30, 1, suspects=[Suspect(5, 25, "A jumps", markers=("A",)), Suspect(12, 13, "of old")])
    whole = merged(old, labelled(10, 20, 2, suspects=[Suspect(11, 12, "new")]))
    assert [(one.first, one.last, one.reason) for one in whole.suspects] == [
        (5, 9, "A jumps"),
        (11, 12, "new"),
        (21, 25, "A jumps"),
    ]
    assert whole.suspects[0].markers == ("A",)
    old, new = labelled(1, 10, 1), labelled(4, 6, 2)
    edited = LabelledRange(new.rows, labelled(4, 6, 0).labels, new.motion, (), new.labels)
    whole = merged(old, edited)
    own = whole.labels.marker[whole.labels.named].tolist()
    assert own == [1] * 3 + [0] * 3 + [1] * 4
    assert whole.unedited.marker[whole.unedited.named].tolist() == [1] * 3 + [2] * 3 + [1] * 4
    with pytest.raises(InputError, match="expected ranges of one take"):
        merged(labelled(1, 5, 1), labelled(1, 5, 1, joints=3))


FRAMES = 30


@st.composite
def takes(draw) -> tuple[np.ndarray, Points]:
    """Trajectories with gaps, some without a point, as a column each (T, P, 3), and the same packed."""
    spans = st.tuples(st.integers(0, FRAMES - 1), st.integers(0, 12), st.lists(st.integers(1, 10), max_size=3))
    xyz = np.full((FRAMES, draw(st.integers(1, 14)), 3), np.nan)
    for column, (first, length, gone) in zip(range(xyz.shape[1]), iter(lambda: draw(spans), None), strict=False):
        frames = [frame for frame in range(first, min(first + length, FRAMES)) if frame - first not in gone]
        xyz[frames, column] = np.array(frames)[:, None] + [0, column, 0.5]
    return xyz, packed(xyz)


def packed(xyz: np.ndarray) -> Points:
    """A take of trajectories (T, P, 3) in lanes, whose indices in the file are odd."""
    there = np.isfinite(xyz[..., 0])
    first, last = there.argmax(axis=0), len(xyz) - 1 - there[::-1].argmax(axis=0)
    lanes = Lanes.packed(first, np.where(there.any(axis=0), last, -1))
    places = np.full((len(xyz), max(lanes.count, 1), 3), np.nan)
    for number, span, lane in lanes.each_alone():
        own = there[span, number]
        places[span, lane][own] = xyz[span, number][own]
    residual = np.where(np.isfinite(places[..., 0]), places[..., 1], np.nan)
    return Points(("",) * xyz.shape[1], places, residual, 100.0, 7, 2 * np.arange(xyz.shape[1]) + 1, lanes)


@given(takes())
def test_a_lane_holds_one_trajectory_at_a_time_and_there_are_no_more_than_needed(made):
    xyz, take = made
    lanes, there = take.lanes, np.isfinite(xyz[..., 0])
    covered = np.zeros((FRAMES, lanes.count), int)
    for _, span, lane in lanes.each_alone():
        covered[span, lane] += 1
    assert covered.max(initial=0) <= 1
    spanned = np.maximum.accumulate(there) & np.maximum.accumulate(there[::-1])[::-1]
    at_once = max(int(spanned.sum(axis=1).max()), 1)
    assert lanes.count == (at_once if 2 * at_once <= xyz.shape[1] else xyz.shape[1])
    table = lanes.table(slice(0, FRAMES))
    frame, lane = np.nonzero(table >= 0)
    np.testing.assert_array_equal(lanes.at(frame, lane), table[frame, lane])


@given(takes(), st.integers(0, FRAMES - 1), st.integers(1, FRAMES))
def test_every_point_is_found_again_by_its_trajectory(made, start, length):
    xyz, take = made
    np.testing.assert_array_equal(take.picked(range(xyz.shape[1])).xyz, xyz)
    whole = Points(take.names, xyz, np.where(np.isfinite(xyz[..., 0]), xyz[..., 1], np.nan), 100.0, 7, take.columns)
    for part in (None, slice(start, min(start + length, FRAMES))):
        ours, theirs = PointRows.of(take, part), PointRows.of(whole, part)
        for name in ("frames", "frame", "trajectory", "xyz", "residual"):
            np.testing.assert_array_equal(getattr(ours, name), getattr(theirs, name), name)
    few = take.lanes.between(start, FRAMES)
    np.testing.assert_array_equal(few.table(slice(0, FRAMES - start)), take.lanes.table(slice(start, FRAMES)))


@given(takes())
def test_what_a_frame_shows_is_in_the_order_of_the_file_and_labels_find_their_way_back(made):
    xyz, take = made
    frames = np.arange(0, FRAMES, 2)
    ordered = take.in_order(frames)
    for row, shown in zip(xyz[frames], ordered.xyz, strict=True):
        there = np.isfinite(row[:, 0])
        np.testing.assert_array_equal(shown[: there.sum()], row[there])
        assert np.isnan(shown[there.sum() :]).all()
    number = np.where(np.isfinite(ordered.xyz[..., 0]), np.nan_to_num(ordered.xyz[..., 1]), -1).astype(int)
    given_labels = Labels(number, np.zeros(number.shape, int), np.ones(number.shape), np.ones(number.shape))
    back = ordered.labels(given_labels)
    there = take.present[frames]
    np.testing.assert_array_equal(back.marker, np.where(there, np.nan_to_num(take.xyz[frames, :, 1]), -1))
    np.testing.assert_array_equal(back.rate, there)
    np.testing.assert_array_equal(ordered.of(there) & np.isfinite(ordered.xyz[..., 0]), number >= 0)


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 4), st.integers(0, 3)), max_size=30))
def test_a_copy_is_what_the_arrays_were_as_long_as_it_is_held(steps):
    copies, held = Copies(np.zeros(5), np.zeros(5, int)), {}
    for number, (which, index, keep) in enumerate(steps):
        copies.arrays[which][index] = number
        copies.note(which, index)
        given_out = copies.copy()
        for one, now in zip(given_out, copies.arrays, strict=True):
            np.testing.assert_array_equal(one, now)
        # Some are held whole, some by a view alone, others not at all.
        held[keep] = (given_out, [one.copy() for one in given_out]) if keep else None
        if keep == 2:
            held[keep] = ([one[:3] for one in given_out], [one[:3].copy() for one in given_out])
        del given_out
        for views, was in (pair for pair in held.values() if pair):
            for one, other in zip(views, was, strict=True):
                np.testing.assert_array_equal(one, other)


BEGINS = {"read": 0.0, "skip": 0.25, "solve": 0.25, "write": 0.75}


def work():
    yield Stage("read", "read it")
    yield 0.5
    yield 1.0
    yield Stage("skip", "nothing to do")
    yield 0.5
    yield Stage("solve", "solve it")
    yield 0.5, "frame 7"
    yield Stage("write", "write it")
    return "done"


def test_stages_are_told_as_parts_of_the_whole():
    told = [(progress.fraction, progress.note) for progress in in_stages(work(), BEGINS)]
    skipped = [(0.25, "nothing to do")] * 2
    read, rest = [(0.0, "read it"), (0.125, "read it"), (0.25, "read it")], [(0.5, "frame 7"), (0.75, "write it")]
    assert told == [*read, *skipped, (0.25, "solve it"), *rest]
    assert finished(in_stages(work(), BEGINS)) == "done"


def test_all_that_work_yields_is_told_and_who_is_told_can_end_it():
    ended, told = [], []

    def long():
        try:
            yield "a"
            yield "b"
        finally:
            ended.append(True)
        return 3

    assert finished(long(), told.append) == 3
    assert told == ["a", "b"]

    def refuse(word):
        raise RuntimeError(word)

    with pytest.raises(RuntimeError, match="a"):
        finished(going := long(), refuse)
    assert len(ended) == 2
    assert going.gi_frame is None, "it would go on when nobody waits any more"


@pytest.mark.parametrize(
    ("trouble", "file"),
    [(InputError("bad"), "own.json"), (InputError("bad", "b.csv"), "b.csv"), (ForceableError("bad"), "")],
)
def test_trouble_of_the_kind_gets_the_file_it_lacks(trouble, file):
    with pytest.raises(type(trouble), match="bad") as caught, of_file("own.json", InputError):
        raise trouble
    assert caught.value.file == file
