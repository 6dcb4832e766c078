# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories in lanes, of which nothing is lost, and copies of arrays that stay as they are for who holds them."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.copies import Copies
from addon.core.data.lanes import PACKING, Lanes, blocks
from addon.core.data.takes import Labels, PointRows, Points

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
    at_once = max(int(_spanned(there).sum(axis=1).max()), 1)
    assert lanes.count == (at_once if 2 * at_once <= xyz.shape[1] else xyz.shape[1])
    table = lanes.table(slice(0, FRAMES))
    frame, lane = np.nonzero(table >= 0)
    np.testing.assert_array_equal(lanes.at(frame, lane), table[frame, lane])


def _spanned(there: np.ndarray) -> np.ndarray:
    """(T, P) True from the first to the last point of each trajectory (T, P)."""
    return np.maximum.accumulate(there, axis=0) & np.maximum.accumulate(there[::-1], axis=0)[::-1]


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


def test_blocks_are_all_frames_one_after_the_other():
    for frames, width in ((0, 5), (7, 0), (1000, PACKING.block_cells), (5000, 500)):
        parts = list(blocks(frames, width))
        assert [frame for part in parts for frame in range(part.start, part.stop)] == list(range(frames))
        assert all((part.stop - part.start) * width <= max(PACKING.block_cells, width) for part in parts)


def written(copies: Copies, which: int, index, value):
    copies.arrays[which][index] = value
    copies.note(which, index)


@given(st.lists(st.tuples(st.integers(0, 1), st.integers(0, 4), st.integers(0, 3)), max_size=30))
def test_a_copy_is_what_the_arrays_were_as_long_as_it_is_held(steps):
    copies, held = Copies(np.zeros(5), np.zeros(5, int)), {}
    for number, (which, index, keep) in enumerate(steps):
        written(copies, which, index, number)
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


def test_memory_that_nobody_holds_is_used_again():
    copies = Copies(np.zeros(100))
    [first], [second] = copies.copy(), copies.copy()
    place = first.__array_interface__["data"][0]
    assert second.__array_interface__["data"][0] != place
    del first
    written(copies, 0, slice(3, 5), 7.0)
    [again] = copies.copy()
    assert again.__array_interface__["data"][0] == place
    np.testing.assert_array_equal(again, copies.arrays[0])
    assert not second.any()
