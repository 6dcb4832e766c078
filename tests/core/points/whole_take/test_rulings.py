# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person says of a take that is solved: it holds through all rounds, and the rest follows from it."""

import numpy as np
import pytest

from addon.core.data.takes import NO_MARKER, Labels, Points
from addon.core.edits.applying import apply_edits, cells_of_take
from addon.core.edits.kinds import AssignPoint, Delete, Edits, UnlabelMarker
from addon.core.points.tracklets import cut
from addon.core.points.whole_take.deciding import labels_of
from addon.core.points.whole_take.rulings import Rulings
from addon.core.points.whole_take.solving import solve_take
from addon.core.points.whole_take.tracklets import tracklets_of

from .test_solving import FRAMES, RATE, said

PAIR = "LWRA", "LWRB"


@pytest.fixture(scope="module")
def everything(model, markers):
    """Labels by which both wrists' markers have each other's names in all of the take."""
    one, other = (model.markerset.index(name) for name in PAIR)
    whose = np.arange(len(model.markerset))
    whose[[one, other]] = other, one
    return said(markers, whose, np.ones(markers.shape[:2], bool))


def rulings_of(model, markers, labels: Labels, *edits) -> Rulings:
    take = Points(("",) * markers.shape[1], markers, markers[..., 0], RATE, 1)
    cells = cells_of_take(take, model.markerset.by_name, len(model.markerset))
    return Rulings(apply_edits(labels, Edits(edits), cells).edited, labels, cut(markers, RATE), None)


def solved(model, markers, labels: Labels, rulings: Rulings) -> np.ndarray:
    """(T, P) the markers of the take once it is solved with the rulings."""
    pieces = rulings.parted()
    heard = rulings.applied_to(labels)
    solution = solve_take(markers, pieces, heard, model, RATE, rulings=rulings)
    return labels_of(solution, heard, 0.999, model.markerset.markers).labels.marker


def test_one_frame_of_one_marker_puts_the_whole_take_right(model, markers, everything):
    """The other marker too, before that frame and after it, though every frame says otherwise."""
    one, other = (model.markerset.index(name) for name in PAIR)
    rulings = rulings_of(model, markers, everything, AssignPoint(one, PAIR[0], frames=(100, 100)))
    marker = solved(model, markers, everything, rulings)
    present = np.isfinite(markers[..., 0])
    assert (marker[:, one] == one)[present[:, one]].all()
    assert (marker[:, other] == other)[present[:, other]].all()
    rest = np.setdiff1d(np.arange(len(model.markerset)), [one, other])
    assert (marker[:, rest] == np.where(present, np.arange(len(model.markerset)), NO_MARKER)[:, rest]).all()


def test_a_held_name_is_believed_against_everything_and_is_nobody_elses(model, markers, everything):
    knee, toe = (model.markerset.index(name) for name in ("RKNE", "LTOE"))
    rulings = rulings_of(model, markers, everything, AssignPoint(knee, "LTOE", frames=(50, 150)))
    marker = solved(model, markers, everything, rulings)
    assert (marker[49:150, knee] == toe).all()
    assert not (marker[49:150, toe] == toe).any()
    # So odd a word may cost the toe its name elsewhere, and gives it to nobody else.
    assert np.isin(marker[:, toe], (toe, NO_MARKER)).all()
    assert (np.isin(marker, toe).sum(axis=1) <= 1).all()


def test_tracklets_end_where_what_is_said_of_them_does(model, markers, everything):
    knee, toe, back = (model.markerset.index(name) for name in ("RKNE", "LTOE", "C7"))
    edits = AssignPoint(knee, "LTOE", frames=(11, 20)), Delete(back, frames=(1, 30))
    rulings = rulings_of(model, markers, everything, *edits)
    tracklet = rulings.parted()
    ends = [np.flatnonzero(np.diff(tracklet[:, column])).tolist() for column in (knee, toe, back)]
    assert ends == [[9, 19], [9, 19], [29]]
    assert (tracklet[:30, back] == -1).all()
    pieces = rulings.of(tracklets_of(markers, tracklet, everything, len(model.markerset)))
    (held,) = np.flatnonzero(pieces.held != NO_MARKER)
    assert (pieces.held[held], pieces.first[held], pieces.last[held]) == (toe, 10, 19)
    assert pieces.votes[held].argmax() == toe


def test_a_tracklet_is_cut_at_a_gap_in_which_another_has_its_name(model, markers, everything):
    toe = model.markerset.index("LTOE")
    broken = np.concatenate([markers, np.full((FRAMES, 1, 3), np.nan)], axis=1)
    broken[100:120, -1] = broken[100:120, toe]
    broken[98:122, toe] = np.nan
    labels = Labels(
        *(np.pad(column, ((0, 0), (0, 1))) for column in (everything.marker, everything.step)),
        *[np.pad(column, ((0, 0), (0, 1))) for column in (everything.confidence, everything.rate)],
    )
    labels.marker[:, -1] = NO_MARKER
    whole = cut(broken, RATE)
    assert whole[0, toe] == whole[-1, toe]
    parted = rulings_of(model, broken, labels, AssignPoint(broken.shape[1] - 1, "LTOE")).parted()
    assert parted[0, toe] != parted[-1, toe]
    without = rulings_of(model, broken, labels, UnlabelMarker("C7")).parted()
    assert without[0, toe] == without[-1, toe]


def test_what_is_nobodys_is_not_named_and_what_has_no_name_goes_on_as_a_person_called_it(model, markers, everything):
    rulings = rulings_of(model, markers, everything, UnlabelMarker("LTOE", frames=(1, 200)))
    marker = solved(model, markers, everything, rulings)
    toe = model.markerset.index("LTOE")
    assert not (marker[:200] == toe).any()
    assert (marker[202:, toe] == toe).all()
    toe, back, knee = (model.markerset.index(name) for name in ("LTOE", "C7", "RKNE"))
    labels = everything.kept(~np.isin(np.arange(markers.shape[1]), [toe, back]) & everything.named)
    edits = AssignPoint(toe, "LTOE", frames=(100, 100)), UnlabelMarker("LTOE", frames=(200, 210))
    rulings = rulings_of(model, markers, labels, *edits, AssignPoint(knee, "LKNE", frames=(5, 6)))
    present = np.isfinite(markers[:, toe, 0])
    carried = np.flatnonzero(rulings.carried[:, toe] == toe)
    expected = np.setdiff1d(np.flatnonzero(present), [99, *range(199, 210)])
    assert carried.tolist() == expected.tolist()
    assert (np.delete(rulings.carried, toe, axis=1) == NO_MARKER).all()
    assert (rulings.applied_to(labels).marker[expected, toe] == toe).all()
    assert (rulings.start[99, toe], rulings.start[98, toe]) == (toe, toe)
