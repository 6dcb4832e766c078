# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels that follow edits group by group are those of all edits at once, whatever was asked before."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.takes import Labels, PointRows
from addon.core.edits import following
from addon.core.edits.applying import apply_to_points
from addon.core.edits.following import Following, changed_frames
from addon.core.edits.kinds import NO_EDITS, AssignPoint, Edits, Place, Swap
from addon.core.edits.replay import FREE

from .lists import COLUMNS, FIRST, FRAMES, NAMES, edit, edits, take

seeds = st.integers(0, 10_000)


@pytest.fixture(autouse=True, scope="module", params=[2, 2000])
def blocks(request):
    """Blocks of a part of the take, and one of all of it."""
    before, following.FOLLOWING = following.FOLLOWING, following.FollowingOptions(request.param)
    yield
    following.FOLLOWING = before


def rows_of(labels: Labels, cells) -> tuple[PointRows, Labels, tuple[np.ndarray, np.ndarray]]:
    """The points of a table one after the other, their labels, and where in the table each is."""
    at = np.nonzero(cells.present)
    xyz = np.random.default_rng(1).normal(size=(len(at[0]), 3))
    rows = PointRows(FIRST + np.arange(FRAMES), at[0], COLUMNS[at[1]], xyz, np.full(len(xyz), 0.001))
    return rows, labels[at], at


def same(one: Labels, other: Labels):
    for name in ("marker", "step", "confidence"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


@settings(max_examples=80, deadline=None)
@given(seeds, st.lists(edits, min_size=1, max_size=3))
def test_they_are_those_of_all_edits_at_once(seed, lists):
    labels, cells = take(seed)
    rows, program, at = rows_of(labels, cells)
    take_of = Following(rows, program, cells.names, cells.count)
    for said in lists:
        after, wanted = take_of.apply(said), apply_to_points(labels, said, cells)
        same(after.labels, wanted.labels[at])
        assert after.outcomes == wanted.outcomes
        np.testing.assert_array_equal(after.said, (wanted.edited.rule != FREE)[at])
        np.testing.assert_array_equal(after.right, wanted.edited.right)
        assert {key: tuple(xyz) for key, xyz in after.places.items()} == {
            key: tuple(xyz) for key, xyz in wanted.places.items()
        }


@settings(max_examples=40, deadline=None)
@given(seeds, edits)
def test_each_group_knows_where_its_markers_are(seed, said):
    labels, cells = take(seed)
    rows, program, _ = rows_of(labels, cells)
    after = Following(rows, program, cells.names, cells.count).apply(said)
    xyz = np.full((FRAMES, cells.count, 3), np.nan)
    named = after.labels.named
    xyz[rows.frame[named], after.labels.marker[named]] = rows.xyz[named]
    for key, place in after.places.items():
        xyz[key] = place
    for group in after.groups:
        np.testing.assert_array_equal(group.xyz, xyz[group.frames][:, group.markers])


@settings(max_examples=40, deadline=None)
@given(seeds, edits, edit)
def test_what_one_more_edit_changes_is_known_by_its_markers(seed, said, one):
    labels, cells = take(seed)
    rows, program, _ = rows_of(labels, cells)
    take_of = Following(rows, program, cells.names, cells.count)
    before = take_of.apply(said)
    after = take_of.apply(said.added(one))
    differs = before.labels.marker != after.labels.marker
    touched = {*before.labels.marker[differs].tolist(), *after.labels.marker[differs].tolist()} - {-1}
    spans = changed_frames(before.groups, after.groups)
    assert touched <= set(spans)
    for marker in (before.labels.marker[differs], after.labels.marker[differs]):
        for row, one_of in zip(np.flatnonzero(differs), marker, strict=True):
            assert one_of < 0 or rows.frame[row] in range(spans[one_of].start, spans[one_of].stop)
    same(take_of.apply(said).labels, before.labels)


def test_edits_that_share_nothing_are_worked_out_once():
    labels, cells = take(3)
    rows, program, _ = rows_of(labels, cells)
    take_of = Following(rows, program, cells.names, cells.count)
    one = AssignPoint(int(COLUMNS[0]), NAMES[0], frames=(FIRST, FIRST + 1))
    other = Swap((NAMES[2], NAMES[3]), frames=(FIRST + 3, FIRST + FRAMES - 1))
    [kept] = take_of.apply(Edits((one,))).groups
    both = take_of.apply(Edits((one, other))).groups
    assert [group is kept for group in both] == [True] + [False] * (len(both) - 1)
    assert take_of.apply(NO_EDITS).groups == ()


def test_a_take_in_which_nothing_was_seen_can_be_edited():
    _, cells = take(3)
    nothing = PointRows(FIRST + np.arange(FRAMES), np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), None)
    placed = Place(NAMES[0], FIRST + 1, (0.0, 0.0, 1.0))
    said = Edits((AssignPoint(int(COLUMNS[0]), NAMES[1]), Swap((NAMES[0], NAMES[1])), placed))
    after = Following(nothing, Labels.none(0), cells.names, cells.count).apply(said)
    assert [outcome.labels for outcome in after.outcomes] == [0, 0, 1]
    assert list(after.places) == [(1, cells.names[NAMES[0]])]
