# SPDX-License-Identifier: GPL-3.0-or-later
"""Trained ensembles: what they promise of their solvers, what they do with points."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis.extra.numpy import array_shapes, arrays

from addon.core.data.takes import BY_PARTIAL_SOLVERS, NO_STEP, Labels
from addon.core.papers.partial_solvers import frames
from addon.core.papers.partial_solvers.assess import Occlusions, assess, draw_occlusions
from addon.core.papers.partial_solvers.features import tables
from addon.core.papers.partial_solvers.frames import SolversNamer, resolve
from addon.core.papers.partial_solvers.masks import Masks
from addon.core.papers.partial_solvers.model import FUNCTIONS, PAPER_FUNCTIONS
from addon.core.papers.partial_solvers.search import Genetics
from addon.core.papers.partial_solvers.solver import TreeSearch
from addon.core.papers.partial_solvers.training import SEARCHES, Training
from tests.accuracy.partial.clouds import Trouble, spoilt
from tests.core.papers.partial_solvers.plain import moving, named_by, trained
from tests.io.checks import refused

NAMES = tuple("ABCDEFG")
OPTIONS = Training(functions=FUNCTIONS, survey_frames=60, check_frames=200, genetics=Genetics(16, 10), wrong=400)


@pytest.fixture(scope="module")
def points():
    return moving(7, 500, sway=0.05, seed=3)


@pytest.fixture(scope="module")
def partial_solvers(points):
    return trained(points, NAMES, 0.99, OPTIONS)


def shuffled(points, seed=0, hide=0, ghosts=0):
    generator = np.random.default_rng(seed)
    points = points.copy()
    away = generator.random(points.shape[:2]).argsort(axis=1).argsort(axis=1) < hide
    points[away] = np.nan
    points = np.concatenate([points, generator.uniform(-3, 3, (len(points), ghosts, 3))], axis=1)
    order = generator.random(points.shape[:2]).argsort(axis=1)
    truth = np.where(np.take_along_axis(away, np.minimum(order, 6), axis=1) & (order < 7), -1, order)
    return np.take_along_axis(points, order[..., None], axis=1), np.where(truth < 7, truth, -1)


def right_part(named, truth):
    """The part of the names (T, P) that are right."""
    return (named == truth)[named >= 0].mean()


def test_it_covers_the_markers(partial_solvers):
    assert (partial_solvers.covered > 0).all()
    assert set(np.concatenate([solver.markers for solver in partial_solvers.solvers]).tolist()) == set(range(7))
    assert len({tuple(solver.markers) for solver in partial_solvers.solvers}) == len(partial_solvers)


def test_each_solver_reaches_a_target_and_its_record_holds_on_new_samples(partial_solvers, points):
    masks = Masks(tables(points))
    removed = draw_occlusions(masks, Occlusions(5, 8), np.random.default_rng(77))
    for solver in partial_solvers.solvers:
        assert solver.reached.any()
        assert (solver.record.rates[solver.reached] >= 0.99).all()
        again = assess(TreeSearch(solver.markers, partial_solvers.classifiers[solver.strong.chosen]), masks, removed)
        told, rate = np.maximum(solver.record.answers, 1), np.nan_to_num(solver.record.rates)
        # Both records are shares of samples of the same kind; frames repeat, so that they are fewer than they seem.
        room = 4 * np.sqrt(np.maximum(rate * (1 - rate), 0.002) / np.minimum(told, 60))
        assert (np.abs(np.nan_to_num(again.rates) - rate) <= room).all()


def test_a_hit_rate_outside_the_subset_is_undefined(partial_solvers):
    solver = next(solver for solver in partial_solvers.solvers if len(solver.markers) < 7)
    outside = next(marker for marker in range(7) if marker not in solver.markers)
    assert 0 <= solver.hit_rate(int(solver.markers[0])) <= 1
    with pytest.raises(KeyError):
        solver.hit_rate(outside)


def test_the_same_seed_gives_the_same_ensemble(partial_solvers, points):
    again = trained(points, NAMES, 0.99, OPTIONS)
    for mine, theirs in zip(again.solvers, partial_solvers.solvers, strict=True):
        assert np.array_equal(mine.markers, theirs.markers)
        assert np.array_equal(mine.strong.chosen, theirs.strong.chosen)
        assert np.array_equal(mine.strong.weights, theirs.strong.weights)
        assert np.array_equal(mine.record.hits, theirs.record.hits)


@pytest.mark.parametrize("search", SEARCHES)
def test_every_search_names_points(points, search):
    partial_solvers = trained(points, NAMES, 0.97, replace(OPTIONS, search=search, survey_frames=40))
    seen, truth = shuffled(points[:60], hide=1)
    assert right_part(named_by(partial_solvers, seen).marker, truth) > 0.97
    assert (partial_solvers.covered > 0).all()


def test_each_marker_has_its_own_target(points):
    targets = np.full(7, 0.9)
    targets[2] = 1.0
    partial_solvers = trained(points, NAMES, targets, OPTIONS)
    for solver in partial_solvers.solvers:
        asked = targets[solver.markers]
        assert (solver.record.rates[solver.reached] >= asked[solver.reached]).all()
        for marker, reached, rate in zip(solver.markers, solver.reached, solver.record.rates, strict=True):
            if marker == 2 and reached:
                assert rate == 1.0


@pytest.mark.parametrize(("hide", "ghosts"), [(0, 0), (2, 0), (2, 3), (4, 0)])
def test_named_points(partial_solvers, points, hide, ghosts):
    seen, truth = shuffled(points, seed=hide, hide=hide, ghosts=ghosts)
    labels = named_by(partial_solvers, seen)
    named, confidence = labels.marker, labels.confidence
    given = named >= 0
    assert named.shape == truth.shape
    assert right_part(named, truth) > 0.98
    assert ((confidence > 0) == given).all()
    assert (labels.step == np.where(given, BY_PARTIAL_SOLVERS, NO_STEP)).all()
    assert (labels.rate == given).all()
    assert confidence.max() <= 1
    assert (named[np.isnan(seen).any(axis=2)] == -1).all()
    if hide <= 2 and not ghosts:
        assert given.sum() > 0.7 * (truth >= 0).sum()


def test_frames_are_independent(partial_solvers, points):
    seen, _ = shuffled(points[:30], hide=1)
    named = named_by(partial_solvers, seen).marker
    broken = seen.copy()
    broken[10] = np.random.default_rng(0).uniform(-1, 1, broken[10].shape)
    again = named_by(partial_solvers, broken).marker
    others = np.arange(30) != 10
    assert (again[others] == named[others]).all()
    alone = named_by(partial_solvers, seen[17:18]).marker
    assert (alone[0] == named[17]).all()


def test_a_take_in_pieces_and_in_chunks(partial_solvers, points, monkeypatch):
    seen, _ = shuffled(points[:40], hide=1, ghosts=1)
    whole = named_by(partial_solvers, seen)
    sparse = np.full((40, 200, 3), np.nan)
    columns = np.sort(np.random.default_rng(1).choice(200, 8, replace=False))
    sparse[:, columns] = seen
    named = named_by(partial_solvers, sparse)
    assert (named.marker[:, columns] == whole.marker).all()
    assert named.named.sum() == whole.named.sum() > 0
    monkeypatch.setattr(frames, "TABLE_FRAMES", 7)
    parts = list(SolversNamer(partial_solvers).name(seen, 100.0))
    assert max(len(part.marker) for part in parts) <= 7
    joined = Labels.join(parts)
    for name in ("marker", "step", "confidence", "rate"):
        np.testing.assert_array_equal(getattr(joined, name), getattr(whole, name))


@pytest.mark.parametrize("shape", [(0, 5, 3), (4, 0, 3), (4, 5, 3)])
def test_nothing_to_name(partial_solvers, shape):
    named = named_by(partial_solvers, np.full(shape, np.nan))
    assert named.marker.shape == named.confidence.shape == named.rate.shape == shape[:2]
    assert not named.named.any()


def test_too_little_to_learn_from():
    refused("only 2 markers", trained, np.zeros((50, 2, 3)), ("A", "B"))
    refused("fewer than two frames", trained, np.full((50, 4, 3), np.nan), NAMES[:4])


def test_frames_with_gaps_can_be_learned_from(points):
    gappy = points.copy()
    gappy[np.random.default_rng(0).random(gappy.shape[:2]) < 0.05] = np.nan
    partial_solvers = trained(gappy, NAMES, 0.95, OPTIONS)
    named = named_by(partial_solvers, points[:80]).marker
    assert (named >= 0).mean() > 0.6
    assert right_part(named, np.arange(7)) > 0.97


# One row a point, one column a marker.
CASES = {
    "each alone": ([[1, 0, 0], [0, 0, 1], [0, 1, 0]], [0, 2, 1]),
    "an empty column is an occluded marker": ([[0, 1, 0], [0, 0, 0], [1, 0, 0]], [1, -1, 0]),
    "two points for one marker: neither": ([[1, 0, 0], [1, 0, 0], [0, 0, 1]], [-1, -1, 2]),
    "two markers for one point: neither": ([[1, 1, 0], [0, 0, 1], [0, 0, 0]], [-1, 2, -1]),
    "a chain of conflicts takes all with it": ([[1, 1, 0], [0, 1, 1], [0, 0, 0]], [-1, -1, -1]),
}


@pytest.mark.parametrize("name", CASES)
def test_by_hand(name):
    matrix, expected = CASES[name]
    assert resolve(np.array([matrix], dtype=bool))[0].tolist() == expected


@given(arrays(bool, array_shapes(min_dims=3, max_dims=3, max_side=5)))
def test_the_rules(suggested):
    named = resolve(suggested)
    for frame, row in enumerate(named):
        given_names = row[row >= 0]
        assert len(set(given_names.tolist())) == len(given_names)
        for point, marker in np.ndindex(suggested.shape[1:]):
            alone = suggested[frame, point].sum() == 1 and suggested[frame, :, marker].sum() == 1
            assert (row[point] == marker) == (suggested[frame, point, marker] and alone)


@pytest.mark.parametrize("hide", range(6))
def test_clouds_lack_as_many_markers_as_asked_in_any_order(hide):
    frames = moving(7, 200)
    clouds = spoilt(frames, Trouble(hide), np.random.default_rng(0))
    assert clouds.points.shape == (200, 7 - hide, 3)
    assert all(len(set(row)) == 7 - hide for row in clouds.truth.tolist())
    assert np.array_equal(clouds.points, np.take_along_axis(frames, clouds.truth[..., None], axis=1))
    # Every marker is hidden about equally often, and comes at every place.
    assert np.ptp(np.bincount(clouds.truth.ravel(), minlength=7)) < 60
    assert len(np.unique(clouds.truth[:, 0])) == 7


def test_clouds_repeat_themselves_for_a_seed_and_have_ghosts_and_noise():
    frames = moving(6, 50)
    clouds, again = (spoilt(frames, Trouble(2, 3, 0.01), np.random.default_rng(4)) for _ in range(2))
    assert np.array_equal(clouds.points, again.points)
    assert np.array_equal(clouds.truth, again.truth)
    assert not np.array_equal(clouds.truth, spoilt(frames, Trouble(2, 3, 0.01), np.random.default_rng(5)).truth)
    assert ((clouds.truth == -1).sum(axis=1) == 3).all()
    real = clouds.truth >= 0
    off = (clouds.points - np.take_along_axis(frames, np.maximum(clouds.truth, 0)[..., None], axis=1))[real]
    assert off.std() == pytest.approx(0.01, rel=0.15)


def test_a_mirror_changes_nothing_for_the_papers_functions_and_much_for_turn():
    points = moving(6, 260, sway=0.05, seed=3)
    for functions in (PAPER_FUNCTIONS, FUNCTIONS):
        options = Training(functions=functions, survey_frames=40, check_frames=120, wrong=300)
        partial_solvers = trained(points[:200], tuple("ABCDEF"), 0.95, options)
        plain, turned = (named_by(partial_solvers, some).marker for some in (points[200:], points[200:] * [1, -1, 1]))
        assert (plain >= 0).mean() > 0.5
        if functions == PAPER_FUNCTIONS:
            assert np.array_equal(plain, turned)
        else:
            assert (turned == plain)[plain >= 0].mean() < 0.5
