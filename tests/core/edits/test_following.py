# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels that follow edits one by one are those of all at once; and edits in words."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.takes import BY_EDIT, Labels, PointRows
from addon.core.edits.applying import apply_edits, cells_of_points
from addon.core.edits.following import Following, changed_frames
from addon.core.edits.kinds import (
    EDIT_KINDS,
    NO_EDITS,
    Accepted,
    AssignBlob,
    AssignPoint,
    Delete,
    DeleteBlob,
    Edits,
    Place,
    Right,
    Swap,
    UnlabelBlob,
    UnlabelMarker,
    UnlabelPoint,
    counted_on,
    words_of,
)

from .lists import COLUMNS, FIRST, FRAMES, INDEX, NAMES, cells_of, edit, edits, take

seeds = st.integers(0, 10_000)


def followed(labels: Labels, present: np.ndarray) -> tuple[Following, PointRows, tuple[np.ndarray, np.ndarray]]:
    """What follows the points of a table, one after the other, these points, and where in the table each is."""
    at = np.nonzero(present)
    xyz = np.random.default_rng(1).normal(size=(len(at[0]), 3))
    rows = PointRows(FIRST + np.arange(FRAMES), at[0], COLUMNS[at[1]], xyz, np.full(len(xyz), 0.001))
    return Following(labels[at], cells_of_points(rows, INDEX, len(NAMES))), rows, at


def same(one: Labels, other: Labels):
    for name in ("marker", "step", "confidence"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@settings(max_examples=80, deadline=None)
@given(seeds, st.lists(edits, min_size=1, max_size=3))
def test_they_are_those_of_all_edits_at_once(seed, lists):
    labels, present = take(seed)
    take_of, _, at = followed(labels, present)
    cells = cells_of(present)
    for said in lists:
        after, wanted = take_of.apply(said), apply_edits(labels, said, cells)
        same(after.labels, wanted.labels[at])
        assert after.outcomes == wanted.outcomes
        assert {key: tuple(xyz) for key, xyz in after.held.places.items()} == {
            key: tuple(xyz) for key, xyz in wanted.places.items()
        }


@settings(max_examples=40, deadline=None)
@given(seeds, edits)
def test_it_knows_which_row_each_marker_is(seed, said):
    take_of, rows, _ = followed(*take(seed))
    after = take_of.apply(said)
    held = np.full((len(NAMES), FRAMES), -1)
    named = np.flatnonzero(after.labels.named)
    held[after.labels.marker[named], rows.frame[named]] = named
    np.testing.assert_array_equal(after.held.cells, held)
    by_edit = np.zeros(held.shape, bool)
    named = named[after.labels.step[named] == BY_EDIT]
    by_edit[after.labels.marker[named], rows.frame[named]] = True
    np.testing.assert_array_equal(after.held.by_edit, by_edit)


@settings(max_examples=40, deadline=None)
@given(seeds, edits, edit)
def test_what_one_more_edit_changes_is_known_by_its_markers(seed, said, one):
    take_of, rows, _ = followed(*take(seed))
    before = take_of.apply(said)
    after = take_of.apply(said.added(one))
    differs = before.labels.marker != after.labels.marker
    touched = {*before.labels.marker[differs].tolist(), *after.labels.marker[differs].tolist()} - {-1}
    spans, moved = changed_frames(before.held, after.held), changed_frames(before.held, after.held, by_hand=False)
    placed = {key[1] for key in {**before.held.places, **after.held.places}}
    assert set(moved) <= set(spans) and set(moved) - placed <= touched
    assert changed_frames(None, before.held) == changed_frames(before.held, None)
    assert touched <= set(spans)
    for marker in (before.labels.marker[differs], after.labels.marker[differs]):
        for row, one_of in zip(np.flatnonzero(differs), marker, strict=True):
            assert one_of < 0 or rows.frame[row] in range(spans[one_of].start, spans[one_of].stop)
    same(take_of.apply(said).labels, before.labels)


def test_a_place_that_is_moved_is_a_marker_that_moved_and_where_nothing_was_seen_it_is_one_too():
    take_of, _, _ = followed(*take(3))
    one, other = (take_of.apply(Edits((Place(NAMES[1], FIRST + 2, (0.0, 0.0, z)),))) for z in (1.0, 2.0))
    assert changed_frames(one.held, other.held, by_hand=False) == {1: slice(2, 3)}
    assert changed_frames(one.held, one.held) == changed_frames(None, None) == {}
    assert not changed_frames(None, take_of.apply(NO_EDITS).held)
    nothing = PointRows(FIRST + np.arange(FRAMES), np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), None)
    placed = Place(NAMES[0], FIRST + 1, (0.0, 0.0, 1.0))
    said = Edits((AssignPoint(int(COLUMNS[0]), NAMES[1]), Swap((NAMES[0], NAMES[1])), placed))
    after = Following(Labels.none(0), cells_of_points(nothing, INDEX, len(NAMES))).apply(said)
    assert [outcome.labels for outcome in after.outcomes] == [0, 0, 1]
    assert list(after.held.places) == [(1, 0)]


WORDS = {
    AssignPoint(12, "LKNE", frames=(100, 250)): "LKNE is trajectory 12, frames 100–250",
    AssignPoint(12, "LKNE", frames=(100, 100)): "LKNE is trajectory 12, frame 100",
    AssignBlob("cam1", 100, 512.3, 88.1, "LKNE"): "LKNE is the blob at 512 88 of cam1, frame 100",
    AssignBlob("cam1", 100, 1, 2, "LKNE", frames=(90, 100)): "LKNE is the blob at 1 2 of cam1, frames 90–100",
    UnlabelBlob("cam1", 100, 512.3, 88.1): "The blob at 512 88 of cam1 has no name, frame 100",
    DeleteBlob("cam1", 100, 512.3, 88.1): "The blob at 512 88 of cam1 is no marker, frame 100",
    UnlabelMarker("LKNE"): "Nothing is LKNE, all frames",
    UnlabelPoint(12): "Trajectory 12 has no name, all frames",
    Swap(("LKNE", "RKNE"), frames=(1, 2)): "LKNE and RKNE swapped, frames 1–2",
    Delete(7): "Trajectory 7 is no marker, all frames",
    Place("LKNE", 120, (0.1, 0.2, 0.5)): "LKNE is placed by hand, frame 120",
    Right("LKNE"): "LKNE is right, all frames",
    Accepted("camera B is off", frames=(1, 2)): "It is right that camera B is off, frames 1–2",
}


def test_every_kind_has_words():
    assert {type(edit) for edit in WORDS} == set(EDIT_KINDS)
    assert {edit: words_of(edit) for edit in WORDS} == WORDS


@pytest.mark.parametrize(
    ("words", "shifted"),
    [
        ("LKNE jumps in frame -7, by 30 mm", "LKNE jumps in frame 3, by 30 mm"),
        ("not in frames -9–-2; 3 of 40 frames", "not in frames 1–8; 3 of 40 frames"),
        ("edit 2 is about frames 5 to 12", "edit 2 is about frames 15 to 22"),
        ("trajectory 12 has no name", "trajectory 12 has no name"),
    ],
)
def test_a_sentence_names_frames_as_they_are_counted_elsewhere(words, shifted):
    assert counted_on(words, 10) == shifted
    assert counted_on(words, 0) == words
