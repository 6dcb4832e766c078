# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels that follow edits one by one are those of all edits at once, whatever was asked before."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.takes import BY_EDIT, Labels, PointRows
from addon.core.edits.applying import apply_edits, cells_of_points
from addon.core.edits.following import Following, changed_frames
from addon.core.edits.kinds import NO_EDITS, AssignPoint, Edits, Place, Swap

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
    spans, moved = changed_frames(before.held, after.held), changed_frames(before.held, after.held, said=False)
    placed = {key[1] for key in {**before.held.places, **after.held.places}}
    assert set(moved) <= set(spans) and set(moved) - placed <= touched
    assert changed_frames(None, before.held) == changed_frames(before.held, None)
    assert touched <= set(spans)
    for marker in (before.labels.marker[differs], after.labels.marker[differs]):
        for row, one_of in zip(np.flatnonzero(differs), marker, strict=True):
            assert one_of < 0 or rows.frame[row] in range(spans[one_of].start, spans[one_of].stop)
    same(take_of.apply(said).labels, before.labels)


def test_a_place_that_is_moved_is_a_marker_that_moved():
    take_of, _, _ = followed(*take(3))
    one, other = (take_of.apply(Edits((Place(NAMES[1], FIRST + 2, (0.0, 0.0, z)),))) for z in (1.0, 2.0))
    assert changed_frames(one.held, other.held, said=False) == {1: slice(2, 3)}
    assert changed_frames(one.held, one.held) == changed_frames(None, None) == {}
    assert not changed_frames(None, take_of.apply(NO_EDITS).held)


def test_a_take_in_which_nothing_was_seen_can_be_edited():
    nothing = PointRows(FIRST + np.arange(FRAMES), np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), None)
    placed = Place(NAMES[0], FIRST + 1, (0.0, 0.0, 1.0))
    said = Edits((AssignPoint(int(COLUMNS[0]), NAMES[1]), Swap((NAMES[0], NAMES[1])), placed))
    after = Following(Labels.none(0), cells_of_points(nothing, INDEX, len(NAMES))).apply(said)
    assert [outcome.labels for outcome in after.outcomes] == [0, 0, 1]
    assert list(after.held.places) == [(1, 0)]
