# SPDX-License-Identifier: GPL-3.0-or-later
"""Edits applied to labels, all at once and one by one: what they say holds, later ones win; and edits in words."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from addon.core.data.errors import InputError
from addon.core.data.takes import BY_EDIT, BY_LIKELIHOOD, NO_MARKER, NO_STEP, Blobs, Labels, PointRows, Points
from addon.core.edits import applying, kinds
from addon.core.edits.applying import Cells, apply_edits, cells_of_points
from addon.core.edits.following import Following, changed_frames
from addon.core.edits.kinds import AssignPoint, Delete, Edits, Place, Right, Swap, UnlabelMarker, UnlabelPoint
from addon.core.edits.replay import ANYBODY
from addon.io.markersets import open_markerset

# Of a small take, made up at random: M markers A, B, … on P trajectories over T frames.
FRAMES, POINTS, FIRST = 6, 5, 10
NAMES = ("A", "B", "C", "D")
INDEX = {name: index for index, name in enumerate(NAMES)}
COLUMNS = np.array([2, 3, 5, 7, 11])  # of the file, some of which are no markers'

frame = st.integers(FIRST, FIRST + FRAMES - 1)
frames = st.none() | st.tuples(frame, frame).map(lambda two: (min(two), max(two)))
marker = st.sampled_from(NAMES)
point = st.sampled_from(COLUMNS.tolist())
xyz = st.tuples(*[st.floats(-5, 5)] * 3)

edit = st.one_of(
    st.builds(AssignPoint, point, marker, frames=frames),
    st.builds(UnlabelMarker, marker, frames=frames),
    st.builds(UnlabelPoint, point, frames=frames),
    st.builds(Swap, st.permutations(NAMES).map(lambda names: (names[0], names[1])), frames=frames),
    st.builds(Delete, point, frames=frames),
    st.builds(Place, marker, frame, xyz),
    st.builds(Right, marker, frames=frames),
)
edits = st.lists(edit, max_size=6).map(lambda items: Edits(tuple(items)))


def take(seed: int) -> tuple[Labels, np.ndarray]:
    """Labels that have each marker once a frame at most, of points (T, P) that are there four times in five."""
    rng = np.random.default_rng(seed)
    present = rng.random((FRAMES, POINTS)) < 0.8
    names = [*range(len(NAMES)), NO_MARKER, NO_MARKER]
    given = np.array([rng.permutation(names)[:POINTS] for _ in range(FRAMES)])
    return named(np.where(present, given, NO_MARKER)), present


def cells_of(present: np.ndarray) -> Cells:
    """What edits of these points (T, P) go by."""
    xyz = np.where(present[..., None], np.zeros(3), np.nan)
    points = Points(("",) * POINTS, xyz, xyz[..., 0], 100.0, FIRST, columns=COLUMNS)
    return applying.cells_of_take(points, INDEX, len(NAMES))


def named(marker: np.ndarray) -> Labels:
    """Labels (T, P) of these markers, all from frames on their own."""
    some = marker != NO_MARKER
    return Labels(marker, np.where(some, BY_LIKELIHOOD, NO_STEP), np.where(some, 0.9, 0.0))


A, B, C = range(3)
seeds = st.integers(0, 10_000)
takes = seeds.map(lambda seed: (*(made := take(seed)), cells_of(made[1])))  # labels, which points are there, and cells


def column(number: int) -> int:
    return COLUMNS.tolist().index(number)


def rows(one) -> slice:
    first, last = one.span or (FIRST, FIRST + FRAMES - 1)
    return slice(first - FIRST, last - FIRST + 1)


@given(takes, edits)
def test_no_frame_has_a_marker_twice_and_only_points_have_names(made, said):
    labels, present, cells = made
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


@given(takes, edits, edit)
def test_the_last_edit_holds_whatever_was_said_before(made, said, last):
    labels, present, cells = made
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


@given(takes, edits, edit)
def test_what_an_edit_is_not_about_stays(made, said, last):
    labels, _, cells = made
    before, after = (apply_edits(labels, one, cells).labels.marker for one in (said, said.added(last)))
    outside = np.ones(FRAMES, bool)
    outside[rows(last)] = False
    assert (before[outside] == after[outside]).all()
    if isinstance(last, UnlabelMarker | Swap | Place | Right):
        own = np.isin(before, [INDEX[name] for name in last.names])
        assert (before[~own] == after[~own]).all()


@given(takes, edits)
def test_nothing_that_is_given_is_changed_and_undo_is_a_shorter_list(made, said):
    labels, present, cells = made
    kept = [column.copy() for column in (labels.marker, labels.step, labels.confidence, present)]
    steps = [apply_edits(labels, Edits(said.items[:count]), cells).labels.marker for count in range(len(said) + 1)]
    now = labels.marker, labels.step, labels.confidence, present
    assert all((one == other).all() for one, other in zip(kept, now, strict=True))
    shorter = said
    for before in reversed(steps[:-1]):
        shorter = shorter.without(-1)
        assert (apply_edits(labels, shorter, cells).labels.marker == before).all()
    assert (steps[0] == labels.marker).all()


@given(takes, seeds, edits)
def test_labelled_again_the_same_edits_of_what_lies_below_say_the_same(made, other, said):
    """`below` gives labels of which the edits make what they make of the old ones, and the new ones elsewhere."""
    labels, present, cells = made
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
        "trajectory 2 is not seen in frames 11–12",
        "B is not named in the take",
        "neither of A and B is named in the take",
        "trajectory 3 has no name in the take",
        "trajectory 5 is not seen in frame 11",
        "frames 400–500 are not among what is labelled",
        "",
    ]
    said = applying.summary_of(outcomes)
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
        (kinds.AssignBlob("cam1", 10, 1.0, 2.0, "A"), "edit 2 is of a blob in a take of points"),
    ],
)
def test_words_that_are_not_of_this_take_are_refused(one, said):
    names, frames = {**INDEX, "a": A}, (FIRST, FIRST + FRAMES - 1)
    fine = Edits((Right("B"),))
    applying.refuse_unknown(fine, names, frames, COLUMNS.tolist())
    with pytest.raises(InputError, match=said) as caught:
        applying.refuse_unknown(fine.added(one), names, frames, COLUMNS.tolist())
    assert "; expected " in caught.value.message


# Blobs: two cameras, two frames from 20 on.
WORN = open_markerset("gait15")


@pytest.fixture
def cells():
    xy = np.array([[10, 10], [20, 20], [10, 10], [30, 30], [11, 10], [21, 20]], float)
    frame, camera = np.array([0, 0, 0, 0, 1, 1]), np.array([0, 0, 1, 1, 0, 0])
    blobs = Blobs(np.array([20, 21]), frame, camera, xy, np.full(6, np.nan))
    return applying.cells_of_blobs(blobs, ("cam1", "cam2"), WORN.by_name, len(WORN))


def test_a_blob_is_found_again_within_two_pixels_and_markers_are_of_all_images_of_their_frames(cells):
    sacrum, hip = WORN.markers[:2]
    labels = named(np.array([0, 1, 0, 1, 0, 1]))
    said = Edits((kinds.AssignBlob("cam1", 20, 18.5, 20.0, sacrum), kinds.AssignBlob("cam2", 20, 13.0, 10.0, hip)))
    done = apply_edits(labels, said.added(kinds.AssignBlob("cam2", 21, 0, 0, hip)), cells)
    assert done.labels.marker.tolist() == [-1, 0, 0, 1, 0, 1]
    assert done.labels.step.tolist() == [0, BY_EDIT, *[BY_LIKELIHOOD] * 4]
    assert [one.reason for one in done.outcomes] == [
        "",
        "cam2 has no blob within 2 px of 13, 10 in frame 20, the nearest is 3 px off",
        "cam2 has no blob within 2 px of 0, 0 in frame 21",
    ]
    done = apply_edits(labels, Edits((Swap((sacrum, hip), frames=(20, 20)),)), cells)
    assert done.labels.marker.tolist() == [1, 0, 1, 0, 0, 1]
    done = apply_edits(labels, Edits((UnlabelMarker(sacrum, frames=(21, 21)),)), cells)
    assert done.labels.marker.tolist() == [0, 1, 0, 1, -1, 1]
    done = apply_edits(labels, Edits((Place(sacrum, 21, (1.0, 2.0, 3.0)),)), cells)
    assert (done.labels.marker == labels.marker).all()
    assert {key: place.tolist() for key, place in done.places.items()} == {(1, 0): [1.0, 2.0, 3.0]}
    moved = apply_edits(labels, Edits((Place(sacrum, 21, (1.0, 2.0, 3.0)), Swap((sacrum, hip)))), cells)
    assert list(moved.places) == [(1, 1)]


def followed(labels: Labels, present: np.ndarray) -> tuple[Following, PointRows, tuple[np.ndarray, np.ndarray]]:
    """What follows the points of a table, one after the other, these points, and where in the table each is."""
    at = np.nonzero(present)
    xyz = np.random.default_rng(1).normal(size=(len(at[0]), 3))
    rows = PointRows(FIRST + np.arange(FRAMES), at[0], COLUMNS[at[1]], xyz, np.full(len(xyz), 0.001))
    return Following(labels[at], cells_of_points(rows, INDEX, len(NAMES))), rows, at


def same(one: Labels, other: Labels):
    for name in ("marker", "step", "confidence"):
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name))


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
    assert not changed_frames(None, take_of.apply(kinds.NO_EDITS).held)
    nothing = PointRows(FIRST + np.arange(FRAMES), np.zeros(0, int), np.zeros(0, int), np.zeros((0, 3)), None)
    placed = Place(NAMES[0], FIRST + 1, (0.0, 0.0, 1.0))
    said = Edits((AssignPoint(int(COLUMNS[0]), NAMES[1]), Swap((NAMES[0], NAMES[1])), placed))
    after = Following(Labels.none(0), cells_of_points(nothing, INDEX, len(NAMES))).apply(said)
    assert [outcome.labels for outcome in after.outcomes] == [0, 0, 1]
    assert list(after.held.places) == [(1, 0)]


WORDS = {
    AssignPoint(12, "LKNE", frames=(100, 250)): "LKNE is trajectory 12, frames 100–250",
    AssignPoint(12, "LKNE", frames=(100, 100)): "LKNE is trajectory 12, frame 100",
    kinds.AssignBlob("cam1", 100, 512.3, 88.1, "LKNE"): "LKNE is the blob at 512 88 of cam1, frame 100",
    kinds.AssignBlob("cam1", 100, 1, 2, "LKNE", frames=(90, 100)): "LKNE is the blob at 1 2 of cam1, frames 90–100",
    kinds.UnlabelBlob("cam1", 100, 512.3, 88.1): "The blob at 512 88 of cam1 has no name, frame 100",
    kinds.DeleteBlob("cam1", 100, 512.3, 88.1): "The blob at 512 88 of cam1 is no marker, frame 100",
    UnlabelMarker("LKNE"): "Nothing is LKNE, all frames",
    UnlabelPoint(12): "Trajectory 12 has no name, all frames",
    Swap(("LKNE", "RKNE"), frames=(1, 2)): "LKNE and RKNE swapped, frames 1–2",
    Delete(7): "Trajectory 7 is no marker, all frames",
    Place("LKNE", 120, (0.1, 0.2, 0.5)): "LKNE is placed by hand, frame 120",
    Right("LKNE"): "LKNE is right, all frames",
    kinds.Accepted("camera B is off", frames=(1, 2)): "It is right that camera B is off, frames 1–2",
}


def test_every_kind_has_words():
    assert {type(edit) for edit in WORDS} == set(kinds.EDIT_KINDS)
    assert {edit: kinds.words_of(edit) for edit in WORDS} == WORDS


@pytest.mark.parametrize(
    ("words", "shifted"),
    [
        ("LKNE jumps in frame -7, by 30 mm", "LKNE jumps in frame 3, by 30 mm"),
        ("not in frames -9–-2; 3 of 40 frames", "not in frames 1–8; 3 of 40 frames"),
        ("trajectory 12 has no name", "trajectory 12 has no name"),
    ],
)
def test_a_sentence_names_frames_as_they_are_counted_elsewhere(words, shifted):
    assert kinds.counted_on(words, lambda frame: frame + 10) == shifted
    assert kinds.counted_on(words, int) == words
