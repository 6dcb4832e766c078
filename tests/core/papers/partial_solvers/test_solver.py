# SPDX-License-Identifier: GPL-3.0-or-later
"""The tree search: equal to trying everything; and hit rates, of all subsets at once as one by one."""

from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.progress import finished
from addon.core.papers.partial_solvers import solver as solver_module
from addon.core.papers.partial_solvers.assess import Occlusions, assess, draw_occlusions
from addon.core.papers.partial_solvers.boosting import learn_intervals
from addon.core.papers.partial_solvers.features import all_features, tables
from addon.core.papers.partial_solvers.masks import Masks
from addon.core.papers.partial_solvers.model import FUNCTIONS, PAPER_FUNCTIONS, Classifiers, Record
from addon.core.papers.partial_solvers.search import members
from addon.core.papers.partial_solvers.solver import TreeSearch
from addon.core.papers.partial_solvers.survey import survey
from tests.core.papers.partial_solvers.plain import accepts, moving, pool_of


def by_trying(markers, classifiers, frame, clouds):
    """All injective labellings that are accepted, one by one."""
    present = np.flatnonzero(clouds.present[frame])
    size = int(max(classifiers.points.max(), *markers)) + 1
    found = []
    for points in permutations(present, len(markers)):
        labelling = np.full(size, -1)
        labelling[list(markers)] = points
        if accepts(classifiers, frame, labelling, clouds):
            found.append(tuple(int(point) for point in points))
    return sorted(found)


def side_by_side(markers, classifiers, clouds):
    cloud, chosen = TreeSearch(markers, classifiers)(Masks(clouds))
    return [sorted(tuple(row) for row in chosen[cloud == frame].tolist()) for frame in range(len(clouds.present))]


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 1000), st.integers(2, 6), st.sampled_from([PAPER_FUNCTIONS, FUNCTIONS]), st.booleans())
def test_equals_trying_everything(seed, size, functions, boosted):
    generator = np.random.default_rng(seed)
    points = moving(7, 30, sway=0.1, seed=seed)
    pool = pool_of(points, functions)
    markers = sorted(generator.choice(7, size, replace=False).tolist())
    mine = pool[pool.within(markers)]
    if boosted:
        mine = mine[generator.choice(len(mine), max(len(mine) // 3, 1), replace=False)]
    seen = points[:3].copy()
    seen[1, generator.integers(7)] = np.nan
    clouds = tables(seen)
    expected = [by_trying(markers, mine, frame, clouds) for frame in range(3)]
    assert side_by_side(markers, mine, clouds) == expected


def test_seven_of_seven_against_all_5040():
    points = moving(7, 40, sway=0.15)
    pool = pool_of(points)
    clouds = tables(points[:2])
    assert side_by_side(range(7), pool, clouds) == [by_trying(range(7), pool, frame, clouds) for frame in range(2)]


def test_none_one_and_several():
    square = np.array([[0, 0, 0], [1.0, 0, 0], [1, 1, 0], [0, 1, 0]])
    distances = learn_intervals(tables(square[None]), *all_features(4, ("distance",)))
    clouds = tables(np.stack([square, 2 * square]))
    found = side_by_side(range(4), distances, clouds)
    assert len(found[0]) == 8  # four turns of the square, and their mirror images
    assert found[1] == []
    lopsided = np.array([[0, 0, 0], [1.0, 0, 0], [1.5, 1, 0], [0, 1, 0]])
    own = learn_intervals(tables(lopsided[None]), *all_features(4, ("distance",)))
    assert side_by_side(range(4), own, tables(lopsided[None])) == [[(0, 1, 2, 3)]]


def test_all_or_none():
    points = moving(6, 40)
    pool = pool_of(points)
    seen = points.copy()
    seen[:, 2:] = np.nan
    assert side_by_side(range(6), pool, tables(seen)) == [[]] * 40


def test_more_points_than_a_word_has_bits():
    points = moving(5, 20)
    pool = pool_of(points)
    ghosts = np.random.default_rng(0).uniform(3, 9, (20, 120, 3))
    cloud, chosen = TreeSearch(range(5), pool)(Masks(tables(np.concatenate([ghosts, points], axis=1))))
    right = (chosen == np.arange(120, 125)).all(axis=1)
    assert sorted(cloud[right].tolist()) == list(range(20))


def test_parts_make_no_difference(monkeypatch):
    points = moving(6, 50, sway=0.2)
    pool = pool_of(points)
    whole = side_by_side(range(4), pool[pool.within(range(4))], tables(points))
    monkeypatch.setattr(solver_module, "MAX_ROWS", 7)
    assert side_by_side(range(4), pool[pool.within(range(4))], tables(points)) == whole


def test_within_keeps_to_the_subset():
    pool = pool_of(moving(6, 10))
    inside = pool[pool.within([0, 2, 5])]
    assert set(inside.points.ravel().tolist()) == {-1, 0, 2, 5}
    assert len(inside) == 3 + 3 + 3 + 3
    assert isinstance(inside, Classifiers)


def bits_to_flags(removed, points):
    return np.unpackbits(removed.view(np.uint8), axis=2, bitorder="little", count=points).astype(bool)


def slow_record(markers, pool, points, removed):
    """Takes the points away for real and searches anew."""
    search = TreeSearch(markers, pool)
    flags = bits_to_flags(removed, points.shape[1])
    hits, failures, answers = found = np.zeros((3, len(markers)), dtype=int)
    for frame, draw in np.ndindex(flags.shape[:2]):
        seen = np.where(flags[frame, draw][:, None], np.nan, points[frame])
        _, chosen = search(Masks(tables(seen[None])))
        for at, marker in enumerate(markers):
            told = set(chosen[:, at].tolist())
            answers[at] += bool(told)
            hits[at] += told == {marker}
            failures[at] += bool(told) and marker not in told
    return found.tolist()


def counts(record):
    return np.array([record.hits, record.failures, record.answers]).tolist()


@pytest.mark.parametrize("markers", [[0, 3], [1, 2, 4], [0, 1, 2, 3, 4, 5]])
def test_records_count_what_happens_when_points_are_away(markers):
    points = moving(6, 60, sway=0.12)
    pool = pool_of(points, PAPER_FUNCTIONS)
    mine = pool[pool.within(markers)]
    masks = Masks(tables(points[:25]))
    removed = draw_occlusions(masks, Occlusions(3, 6), np.random.default_rng(0))
    expected = slow_record(markers, mine, points[:25], removed)
    assert counts(assess(TreeSearch(markers, mine), masks, removed)) == expected


def test_the_survey_has_every_solver():
    points = moving(6, 60, sway=0.12)
    points[3, 2] = np.nan
    pool = pool_of(points)
    masks = Masks(tables(points[:30]))
    removed = draw_occlusions(masks, Occlusions(3, 5), np.random.default_rng(1))
    surveyed = finished(survey(pool, masks, removed))
    for subset in range(1, 1 << 6):
        markers = members(subset)
        one = assess(TreeSearch(markers, pool[pool.within(markers)]), masks, removed)
        assert counts(surveyed.record(markers)) == counts(one), markers


def test_occlusions_are_as_asked_and_targets_are_of_hits_over_answers():
    points = moving(8, 400)
    points[:, 5] = np.nan
    masks = Masks(tables(points))
    flags = bits_to_flags(draw_occlusions(masks, Occlusions(4, 10), np.random.default_rng(2)), 8)
    assert flags[:, :, 5].all()
    counts = np.bincount(flags.sum(axis=2).ravel() - 1, minlength=5)
    assert len(counts) == 5
    assert (np.abs(counts - 800) < 120).all()
    record = Record(np.array([99, 98, 0, 99]), np.array([1, 0, 0, 0]), np.array([100, 100, 0, 99]), 200)
    assert record.rates[:2].tolist() == [0.99, 0.98]
    assert np.isnan(record.rates[2])
    assert record.reaches(np.full(4, 0.99)).tolist() == [True, False, False, True]
    assert record.reaches(np.array([0.995, 0.9, 0.9, 1.0])).tolist() == [False, True, False, True]
