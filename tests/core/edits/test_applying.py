# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits applied to labels: what they say holds, later ones win, and no frame has a marker twice."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.errors import InputError
from addon.core.data.takes import BY_EDIT, BY_LIKELIHOOD, NO_MARKER, Blobs, Labels
from addon.core.edits.applying import apply_edits, cells_of_blobs, refuse_unknown, summary_of
from addon.core.edits.kinds import (
    AssignBlob,
    AssignPoint,
    Delete,
    Edits,
    Place,
    Right,
    Swap,
    UnlabelMarker,
    UnlabelPoint,
)
from addon.core.edits.replay import ANYBODY
from addon.io.markersets import open_markerset

from .lists import COLUMNS, FIRST, FRAMES, INDEX, POINTS, cells_of, edit, edits, named, take

A, B, C = range(3)
seeds = st.integers(0, 10_000)


def column(number: int) -> int:
    return COLUMNS.tolist().index(number)


def rows(one) -> slice:
    first, last = one.span or (FIRST, FIRST + FRAMES - 1)
    return slice(first - FIRST, last - FIRST + 1)


@settings(max_examples=50, deadline=None)
@given(seeds, edits)
def test_no_frame_has_a_marker_twice_and_only_points_have_names(seed, said):
    labels, present = take(seed)
    cells = cells_of(present)
    after = apply_edits(labels, said, cells)
    for row in range(FRAMES):
        own = after.labels.marker[row]
        assert len(set(own[own >= 0])) == (own >= 0).sum()
        placed = [marker for frame, marker in after.places if frame == row]
        assert not set(placed) & set(own)
    assert not (after.labels.named & ~present).any()
    assert ((after.labels.step == BY_EDIT) <= (after.labels.confidence == 1)).all()
    assert (after.labels.named == (after.labels.step > 0)).all()
    assert (after.labels.named == (after.labels.confidence > 0)).all()


@settings(max_examples=50, deadline=None)
@given(seeds, edits, edit)
def test_the_last_edit_holds_whatever_was_said_before(seed, said, last):
    labels, present = take(seed)
    cells = cells_of(present)
    before = apply_edits(labels, said, cells)
    done = apply_edits(labels, said.added(last), cells)
    after, part = done.labels, rows(last)
    if isinstance(last, AssignPoint):
        own = after[part, column(last.point)]
        there = present[part, column(last.point)]
        assert (own.marker[there] == INDEX[last.marker]).all()
        assert (own.step[there] == BY_EDIT).all()
        assert (own.confidence[there] == 1).all()
    elif isinstance(last, UnlabelPoint | Delete):
        assert not after.named[part, column(last.point)].any()
    elif isinstance(last, UnlabelMarker):
        assert not (after.marker[part] == INDEX[last.marker]).any()
    elif isinstance(last, Place):
        assert not (after.marker[part] == INDEX[last.marker]).any()
        assert done.places[part.start, INDEX[last.marker]].tolist() == list(last.xyz)
    elif isinstance(last, Right):
        was = before.labels.marker[part] == INDEX[last.marker]
        assert ((after.marker[part] == INDEX[last.marker]) == was).all()
        assert (after.step[part][was] == BY_EDIT).all()
        assert (done.edited.claim[part, INDEX[last.marker]] != ANYBODY).all()
    else:
        one, other = (INDEX[name] for name in last.markers)
        was = before.labels.marker[part]
        swapped = np.where(was == one, other, np.where(was == other, one, was))
        assert (after.marker[part] == swapped).all()


@settings(max_examples=50, deadline=None)
@given(seeds, edits, edit)
def test_what_an_edit_is_not_about_stays(seed, said, last):
    labels, present = take(seed)
    cells = cells_of(present)
    before, after = (apply_edits(labels, one, cells).labels.marker for one in (said, said.added(last)))
    outside = np.ones(FRAMES, bool)
    outside[rows(last)] = False
    assert (before[outside] == after[outside]).all()
    if isinstance(last, UnlabelMarker | Swap | Place | Right):
        own = np.isin(before, [INDEX[name] for name in last.names])
        assert (before[~own] == after[~own]).all()


@settings(max_examples=50, deadline=None)
@given(seeds, edits)
def test_nothing_that_is_given_is_changed_and_undo_is_a_shorter_list(seed, said):
    labels, present = take(seed)
    cells = cells_of(present)
    kept = [column.copy() for column in (labels.marker, labels.step, labels.confidence, present)]
    steps = [apply_edits(labels, Edits(said.items[:count]), cells).labels.marker for count in range(len(said) + 1)]
    assert all((one == other).all() for one, other in zip(kept, (*_columns(labels), present), strict=True))
    shorter = said
    for before in reversed(steps[:-1]):
        shorter = shorter.without(-1)
        assert (apply_edits(labels, shorter, cells).labels.marker == before).all()
    assert (steps[0] == labels.marker).all()


def _columns(labels: Labels):
    return labels.marker, labels.step, labels.confidence


@settings(max_examples=50, deadline=None)
@given(seeds, seeds, edits)
def test_labelled_again_the_same_edits_of_what_lies_below_say_the_same(seed, other, said):
    """`below` gives labels of which the edits make what they make of the old ones, and the new ones elsewhere."""
    labels, present = take(seed)
    cells = cells_of(present)
    first = apply_edits(labels, said, cells)
    again = named(np.where(present, take(other)[0].marker, NO_MARKER))
    below = first.edited.below(labels, again)
    for row in range(FRAMES):
        own = below.marker[row]
        assert len(set(own[own >= 0])) == (own >= 0).sum()
    after = apply_edits(below, said, cells)
    held = first.edited.named
    assert (after.labels.marker[held] == first.labels.marker[held]).all()
    assert not after.labels.named[first.edited.deleted].any()
    free = first.edited.rule < 0
    row, place = np.nonzero(free & again.named)
    open_ = first.edited.claim[row, again.marker[row, place]] == -1
    row, place = row[open_], place[open_]
    assert (after.labels.marker[row, place] == again.marker[row, place]).all()
    round_trip = apply_edits(first.edited.below(labels, first.labels), said, cells)
    assert (round_trip.labels.marker == first.labels.marker).all()


def test_what_a_later_edit_overrides_leaves_nothing_behind():
    """A name taken by mistake, and given up again, is its old owner's."""
    labels = named(np.array([[A, B, NO_MARKER, NO_MARKER, NO_MARKER]] * FRAMES))
    cells = cells_of(np.ones((FRAMES, POINTS), bool))
    wrong = Edits().added(AssignPoint(5, "A"))
    assert apply_edits(labels, wrong, cells).labels.marker[0].tolist() == [-1, B, A, -1, -1]
    right = wrong.added(AssignPoint(5, "C"))
    assert apply_edits(labels, right, cells).labels.marker[0].tolist() == [A, B, C, -1, -1]
    assert apply_edits(labels, right, cells).labels.step[0].tolist() == [BY_LIKELIHOOD, BY_LIKELIHOOD, BY_EDIT, 0, 0]


def test_edits_that_find_nothing_say_why():
    labels, cells = named(np.full((FRAMES, POINTS), NO_MARKER)), cells_of(np.zeros((FRAMES, POINTS), bool))
    said = Edits((AssignPoint(2, "A", frames=(11, 12)), UnlabelMarker("B"), Swap(("A", "B")), UnlabelPoint(3)))
    said = said.added(Delete(5, frames=(11, 11)), Right("A", frames=(400, 500)), Right("A"))
    outcomes = apply_edits(labels, said, cells).outcomes
    assert [one.reason for one in outcomes] == [
        "trajectory 2 is not seen in frames 11 to 12",
        "B is not named in the take",
        "neither of A and B is named in the take",
        "trajectory 3 has no name in the take",
        "trajectory 5 is not seen in frame 11",
        "frames 400 to 500 are not among what is labelled",
        "",
    ]
    said = summary_of(outcomes)
    assert said["applied"] == {"assign": 0, "unlabel": 0, "swap": 0, "delete": 0, "right": 1}
    assert [one["edit"] for one in said["found_nothing"]] == [1, 2, 3, 4, 5, 6]


@pytest.mark.parametrize(
    ("one", "said"),
    [
        (AssignPoint(2, "X"), "edit 2 names 'X'"),
        (AssignPoint(4, "A"), "edit 2 is of trajectory 4, which the take does not have"),
        (Delete(99), "edit 2 is of trajectory 99"),
        (Swap(("A", "a")), "edit 2 swaps a marker with itself"),
        (Right("A", frames=(9, 12)), "edit 2 is about frame 9"),
        (Right("A", frames=(10, 16)), "edit 2 is about frame 16"),
        (Place("A", 99, (0.0, 0.0, 0.0)), "edit 2 is about frame 99"),
        (AssignBlob("cam1", 10, 1.0, 2.0, "A"), "edit 2 is of a blob in a take of points"),
    ],
)
def test_words_that_are_not_of_this_take_are_refused(one, said):
    names, frames = {**INDEX, "a": A}, (FIRST, FIRST + FRAMES - 1)
    fine = Edits((Right("B"),))
    refuse_unknown(fine, names, frames, COLUMNS.tolist())
    with pytest.raises(InputError, match=said) as caught:
        refuse_unknown(fine.added(one), names, frames, COLUMNS.tolist())
    assert "; expected " in caught.value.message


# Blobs: two cameras, two frames from 20 on.
@pytest.fixture(scope="module")
def markerset():
    return open_markerset("gait15")


@pytest.fixture
def cells(markerset):
    xy = np.array([[10, 10], [20, 20], [10, 10], [30, 30], [11, 10], [21, 20]], float)
    blobs = Blobs(
        np.array([20, 21]), np.array([0, 0, 0, 0, 1, 1]), np.array([0, 0, 1, 1, 0, 0]), xy, np.full(6, np.nan)
    )
    return cells_of_blobs(blobs, ("cam1", "cam2"), markerset.by_name, len(markerset))


def test_a_blob_is_found_again_within_two_pixels_and_markers_are_of_all_images_of_their_frames(cells, markerset):
    sacrum, hip = markerset.markers[:2]
    labels = named(np.array([0, 1, 0, 1, 0, 1]))
    said = Edits((AssignBlob("cam1", 20, 18.5, 20.0, sacrum), AssignBlob("cam2", 20, 13.0, 10.0, hip)))
    done = apply_edits(labels, said.added(AssignBlob("cam2", 21, 0, 0, hip)), cells)
    assert done.labels.marker.tolist() == [-1, 0, 0, 1, 0, 1]
    assert done.labels.step.tolist() == [0, BY_EDIT, *[BY_LIKELIHOOD] * 4]
    assert [one.reason for one in done.outcomes] == [
        "",
        "cam2 has no blob within 2 px of 13, 10 in frame 20, the nearest is 3 px off",
        "cam2 has no blob within 2 px of 0, 0 in frame 21",
    ]
    one, other = markerset.markers[:2]
    labels = named(np.array([0, 1, 0, 1, 0, 1]))
    done = apply_edits(labels, Edits((Swap((one, other), frames=(20, 20)),)), cells)
    assert done.labels.marker.tolist() == [1, 0, 1, 0, 0, 1]
    done = apply_edits(labels, Edits((UnlabelMarker(one, frames=(21, 21)),)), cells)
    assert done.labels.marker.tolist() == [0, 1, 0, 1, -1, 1]
    done = apply_edits(labels, Edits((Place(one, 21, (1.0, 2.0, 3.0)),)), cells)
    assert (done.labels.marker == labels.marker).all()
    assert {key: place.tolist() for key, place in done.places.items()} == {(1, 0): [1.0, 2.0, 3.0]}
    moved = apply_edits(labels, Edits((Place(one, 21, (1.0, 2.0, 3.0)), Swap((one, other)))), cells)
    assert list(moved.places) == [(1, 1)]
