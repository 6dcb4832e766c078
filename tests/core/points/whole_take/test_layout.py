# SPDX-License-Identifier: GPL-3.0-or-later
"""Which exchanges of names are worth weighing, against the exact likelihood; and crowds of more points than markers."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.data.takes import BY_LIKELIHOOD, NO_MARKER, NO_STEP, Labels
from addon.core.points.likelihood.distances import DistanceConstraints
from addon.core.points.likelihood.latent import Latent
from addon.core.points.likelihood.naming import score_of, settle
from addon.core.points.likelihood.shape import Shape
from addon.core.points.naming import namer_of
from addon.core.points.refusals import REFUSAL, refuse_unlike
from addon.core.points.tracklets import VOTE, cut
from addon.core.points.whole_take.blocks import _held_together, _row, block_exchanges, middle_of_known
from addon.core.points.whole_take.deciding import labels_of
from addon.core.points.whole_take.layout import LAYOUT_NAMING, _gains, _may_gain, named_by_layout
from addon.core.points.whole_take.likeness import _next_named
from addon.core.points.whole_take.objective import settled_frames, usual_fit
from addon.core.points.whole_take.solving import solve_take
from addon.io.models import open_model

SEEDS = st.integers(0, 2**16)


def settled(seed: int, exchanged: tuple[int, int]):
    """Some frames of people in `gait15`, in which two markers have each other's names and some are hidden."""
    known, rng = open_model("gait15").likelihood.known, np.random.default_rng(seed)
    model = known.fine
    latent = rng.normal(size=(9, model.size)) * np.where(np.arange(model.size) < 4, 0.02, 1)
    points = model.positions(latent) + np.sqrt(model.noise)[:, None] * rng.normal(size=(9, len(model), 3))
    present = rng.random(points.shape[:2]) < 0.98
    place = np.arange(len(model))
    place[list(exchanged)] = exchanged[::-1]
    naming = np.where(present[:, place], place, -1)
    now = settle(model, known.constraints, np.where(present[..., None], points, 0), present, naming)
    return known, now, place


@settings(deadline=None, max_examples=10)
@given(SEEDS, st.sampled_from([(0, 1), (3, 4), (9, 10)]))
def test_exchanges_that_are_left_out_are_no_question(seed, exchanged):
    known, now, place = settled(seed, exchanged)
    markers = len(known.fine)
    one, other = np.array(list(combinations(range(markers), 2))).T
    worth = _may_gain(known, now, one, other)
    tried = np.tile(np.arange(markers), (len(one), 1))
    rows = np.arange(len(one))
    tried[rows, one], tried[rows, other] = other, one
    _, _, usual = _gains(known, now, place, tried)
    assert (~worth).sum() > len(one) / 10
    assert usual[~worth].max() < -LAYOUT_NAMING.max_question
    assert worth[(one == exchanged[0]) & (other == exchanged[1])].all()


@given(SEEDS, st.integers(1, 12), st.integers(1, 3))
def test_the_tracklets_in_which_markers_are_next(seed, count, markers):
    rng = np.random.default_rng(seed)
    first = rng.integers(0, 60, count)
    last, marker = first + rng.integers(0, 30, count), rng.integers(-1, markers, count)
    found = _next_named(SimpleNamespace(first=first, last=last), marker, np.arange(count), markers)
    for one, name in np.ndindex(count, markers):
        others = (marker == name) & (np.arange(count) != one)
        before = others & (last <= first[one] + VOTE.max_overlap_frames)
        after = others & (first >= last[one] - VOTE.max_overlap_frames)
        own = found[:, one, name]
        assert (own[0] >= 0) == before.any()
        assert own[0] < 0 or (before[own[0]] and last[own[0]] == last[before].max())
        assert (own[1] >= 0) == after.any()
        assert own[1] < 0 or (after[own[1]] and first[own[1]] == first[after].min())


UNHELD = DistanceConstraints(np.zeros((0, 2), int), np.zeros(0), np.zeros(0), 0.05)


def side_by_side(seed: int, slipped: tuple[int, ...] = ()):
    """Some frames of a shape of seven markers, three of which sit side by side, those `slipped` one place off."""
    rng = np.random.default_rng(seed)
    mean = rng.normal(0, 2, (7, 3))
    mean[1:3] = mean[0] + np.array([[0.3, 0, 0], [0, 0.2, 0.2]])
    model = Latent(Shape(mean, rng.normal(0, 0.03, (7, 3, 2)), np.full(7, 4e-4)))
    latent = rng.normal(size=(9, model.size)) * np.where(np.arange(model.size) < 4, 0.01, 1)
    points = model.positions(latent) + rng.normal(0, 0.02, (9, 7, 3))
    points[:, np.roll(slipped, 1).astype(int)] = points[:, list(slipped)]
    present = rng.random((9, 7)) < 0.95
    naming = np.where(present, np.arange(7), -1)
    return SimpleNamespace(fine=model), settle(model, UNHELD, np.where(present[..., None], points, 0), present, naming)


@settings(deadline=None, max_examples=25)
@given(SEEDS, st.permutations(range(3)))
def test_what_another_order_wins_is_what_the_likelihood_says(seed, order):
    known, now = side_by_side(seed)
    row = np.array([*order, *range(3, 7)])
    score = score_of(known.fine, UNHELD, now.points, now.worth, np.where(now.present[:, row], row, -1))
    precision, pull = _held_together(known, now, np.array([[0, 1, 2]]))
    moved = (now.points[:, order] - now.points[:, :3]).reshape(9, 9)
    square = np.einsum("fi,fij,fj->f", moved, precision[0], moved) + 2 * (moved * pull[0]).sum(axis=1)
    whole = now.present[:, :3].all(axis=1)
    # But for the yaw, which another order takes up anew.
    np.testing.assert_allclose((score - now.score)[whole], -square[whole] / 2, rtol=0.1, atol=0.5)


def test_names_that_moved_up_are_put_right_at_once_where_a_block_is_seen_for_long():
    known, now = side_by_side(3, slipped=(0, 1, 2))
    assert [2, 0, 1, 3, 4, 5, 6] in block_exchanges(known, now, np.arange(7)).tolist()
    known, now = side_by_side(3)
    now.present[::2, 0] = False
    now.present[1::3, 0] = False
    assert block_exchanges(known, now, np.arange(7)).shape == (0, 7)


@given(SEEDS, st.integers(1, 6))
def test_the_middle_of_what_is_known(seed, count):
    rng = np.random.default_rng(seed)
    values = rng.normal(size=(3, count))
    values[rng.random(values.shape) < 0.4] = np.nan
    found = middle_of_known(values)
    for row, middle in zip(values, found, strict=True):
        own = row[np.isfinite(row)]
        assert middle == (np.median(own) if len(own) else np.inf)


def test_who_gives_a_point_away_takes_what_is_left():
    assert _row(np.array([0, 1]), np.array([1, 4]), 6).tolist() == [1, 4, 2, 3, 0, 5]


RATE = 100.0
FRAMES = 200
FOOT = "LANK", "LHEE", "LTOE"


def beside(markers: np.ndarray) -> np.ndarray:
    """(T, M, 3) m, a point on the way from each marker to the one that is usually next to it."""
    between = np.nanmean(np.linalg.norm(markers[::10, :, None] - markers[::10, None], axis=3), axis=0)
    np.fill_diagonal(between, np.inf)
    near = between.argmin(axis=1)
    return markers + 0.4 * (markers[:, near] - markers)


def shuffled(tracks: np.ndarray, markers: int, seed: int = 3) -> tuple[np.ndarray, np.ndarray]:
    """The same points (T, P, 3) in another order, and which of the markers each is, or none."""
    order = np.random.default_rng(seed).permutation(tracks.shape[1])
    return tracks[:, order], np.where(order < markers, order, NO_MARKER)


def said(points: np.ndarray, marker: np.ndarray) -> Labels:
    """What frames say on their own: these names (T, P)."""
    known = (marker != NO_MARKER) & np.isfinite(points[..., 0])
    chance = np.where(known, 0.97, 0.0)
    return Labels(np.where(known, marker, NO_MARKER), np.where(known, BY_LIKELIHOOD, NO_STEP), chance, chance)


def test_a_crowd_is_told_from_the_set_where_frames_know_the_trunk_only(model, markers):
    points, whose = shuffled(np.concatenate([markers, beside(markers)], axis=1), markers.shape[1])
    trunk = [model.markerset.markers.index(name) for name in ("LASI", "RASI", "SACR", "LSHO", "RSHO", "LELB", "RELB")]
    named = said(points, np.broadcast_to(np.where(np.isin(whose, trunk), whose, NO_MARKER), points.shape[:2]))
    solution = finished(solve_take(points, cut(points, RATE), named, model, RATE))
    given = labels_of(solution, named, 0.999, model.markerset.markers).labels.marker
    truth = np.where(np.isfinite(points[..., 0]), whose, NO_MARKER)
    assert solution.crowd
    assert (given[given != NO_MARKER] == truth[given != NO_MARKER]).all()
    assert (given == truth)[truth != NO_MARKER].mean() > 0.9
    assert solution.fit.residual < REFUSAL.max_residual


@pytest.mark.parametrize("turned", [(1, 2, 0), (2, 0, 1)])
def test_three_that_are_each_in_the_place_of_the_next_are_put_right(model, markers, turned):
    foot = [model.markerset.markers.index(name) for name in FOOT]
    placed = markers.copy()
    placed[:, foot] = markers[:, [foot[index] for index in turned]]
    name, _ = named_by_layout(model.likelihood, placed[::20], np.zeros(0, int), False)
    assert (name[foot] == [foot[index] for index in turned]).all()
    assert (np.delete(name, foot) == np.delete(np.arange(len(name)), foot)).all()


def test_every_choice_of_a_block_gives_each_point_one_taker(model, markers):
    placed = np.concatenate([markers, beside(markers)[:, :20]], axis=1)
    now = settled_frames(model.likelihood, placed[::20])
    tried = block_exchanges(model.likelihood.known, now, np.arange(placed.shape[1]))
    assert len(tried)
    assert (np.sort(tried, axis=1) == np.arange(placed.shape[1])).all()


def test_another_set_sits_elsewhere_and_is_refused(model, markers):
    own = usual_fit(model.likelihood, markers)
    rng = np.random.default_rng(4)
    elsewhere = markers + rng.normal(0, 0.08, (1, markers.shape[1], 3))
    other = usual_fit(model.likelihood, elsewhere)
    assert own.residual < REFUSAL.max_residual < other.residual
    namer = namer_of(model, "likelihood")
    refuse_unlike(model, namer, markers, own)
    with pytest.raises(JobError, match="does not look like a take of model body26"):
        refuse_unlike(model, namer, markers, other)
