# SPDX-License-Identifier: GPL-3.0-or-later
"""Hit rates: against a slow count, and of all subsets at once against one by one."""

import numpy as np
import pytest

from addon.core.data.progress import finished
from addon.core.papers.partial_solvers.assess import Occlusions, assess, draw_occlusions
from addon.core.papers.partial_solvers.features import tables
from addon.core.papers.partial_solvers.masks import Masks
from addon.core.papers.partial_solvers.model import PAPER_FUNCTIONS, Record
from addon.core.papers.partial_solvers.search import members
from addon.core.papers.partial_solvers.solver import TreeSearch
from addon.core.papers.partial_solvers.survey import survey
from tests.core.papers.partial_solvers.plain import moving, pool_of


def bits_to_flags(removed, points):
    return np.unpackbits(removed.view(np.uint8), axis=2, bitorder="little", count=points).astype(bool)


def slow_record(markers, pool, points, removed):
    """Takes the points away for real and searches anew."""
    search = TreeSearch(markers, pool)
    flags = bits_to_flags(removed, points.shape[1])
    hits, failures, answers = np.zeros((3, len(markers)), dtype=int)
    for frame, draw in np.ndindex(flags.shape[:2]):
        seen = np.where(flags[frame, draw][:, None], np.nan, points[frame])
        _, chosen = search(Masks(tables(seen[None])))
        for at, marker in enumerate(markers):
            told = set(chosen[:, at].tolist())
            answers[at] += bool(told)
            hits[at] += told == {marker}
            failures[at] += bool(told) and marker not in told
    return hits, failures, answers


def same(record, expected):
    return all(
        np.array_equal(mine, theirs)
        for mine, theirs in zip((record.hits, record.failures, record.answers), expected, strict=True)
    )


@pytest.mark.parametrize("markers", [[0, 3], [1, 2, 4], [0, 1, 2, 3, 4, 5]])
def test_records_count_what_happens_when_points_are_away(markers):
    points = moving(6, 60, sway=0.12)
    pool = pool_of(points, PAPER_FUNCTIONS)
    mine = pool[pool.within(markers)]
    masks = Masks(tables(points[:25]))
    removed = draw_occlusions(masks, Occlusions(3, 6), np.random.default_rng(0))
    assert same(assess(TreeSearch(markers, mine), masks, removed), slow_record(markers, mine, points[:25], removed))


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
        assert same(surveyed.record(markers), (one.hits, one.failures, one.answers)), markers


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
