# SPDX-License-Identifier: GPL-3.0-or-later
"""The likelihood of a naming against the textbook's dense formula, and every closed-form gain against trying it."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.geometry.upright import turned, upright_aligned
from addon.core.points.likelihood import swaps
from addon.core.points.likelihood.distances import ConstraintOptions, learn_constraints, size_and_fit
from addon.core.points.likelihood.latent import Latent
from addon.core.points.likelihood.naming import NO_POINT, name_worth, settle
from addon.core.points.likelihood.shape import learn_shape

MARKERS = 7
NAMING = [0, 1, 2, 3, 4, NO_POINT, NO_POINT]


@pytest.fixture
def scene(monkeypatch):
    """A model, its ties and one frame whose yaw and size stand still, so that gains are exact."""
    rng = np.random.default_rng(0)
    base = rng.normal(size=(MARKERS, 3))
    swing = 0.1 * rng.normal(size=(200, 1, 3)) * rng.normal(size=(MARKERS, 3))
    clouds = base + swing + 0.02 * rng.normal(size=(200, MARKERS, 3))
    shape = learn_shape([clouds])
    constraints = replace(learn_constraints([clouds], shape.radius), size_sd=1e-12)
    assert len(constraints) > 0
    monkeypatch.setattr("addon.core.points.likelihood.distances.CONSTRAINING", ConstraintOptions(max_cost=1e9))
    monkeypatch.setattr(swaps, "ALTERNATIVES", swaps.AlternativeOptions(max_distance_radii=20.0))
    points = upright_aligned(clouds[:1], shape.mean)
    points = np.concatenate([points, rng.normal(size=(1, 3, 3))], axis=1)
    model = Latent(shape)
    model.yaw_sd = 0.0

    def settled(named):
        return settle(model, constraints, points, np.ones((1, MARKERS + 3), dtype=bool), np.array([named]))

    return model, constraints, settled


def test_score_is_the_dense_gaussian(scene):
    model, constraints, settled = scene
    found = settled(NAMING)
    flat = model.columns.reshape(-1, model.size)
    covariance = flat @ flat.T + np.diag(np.repeat(model.noise, 3))
    known = slice(0, 15)
    offset = (found.points[0, :5] - model.mean[:5]).ravel()
    block = covariance[known, known]
    expected = -0.5 * offset @ np.linalg.solve(block, offset) - 0.5 * np.linalg.slogdet(block)[1]
    expected += 5 * name_worth(model, found.present)[0]
    expected += size_and_fit(constraints, found.points, found.naming)[1][0]
    assert found.score[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(("marker", "point"), [(2, NO_POINT), (2, 8), (5, 7), (6, 9)])
def test_dropping_replacing_and_adding_gain_what_trying_gains(scene, marker, point):
    model, constraints, settled = scene
    before = settled(NAMING)
    tried = list(NAMING)
    tried[marker] = point
    odds = swaps.alternatives(model, constraints, before).odds[0, marker]
    gain = (odds[point] if point >= 0 else 0) - (odds[NAMING[marker]] if NAMING[marker] >= 0 else 0)
    assert gain == pytest.approx(settled(tried).score[0] - before.score[0], abs=1e-4)


@pytest.mark.parametrize(("old", "new"), [(2, 5), (0, 6), (2, 1), (3, 4), (0, 3)])
def test_moving_gains_what_trying_gains(scene, old, new):
    model, constraints, settled = scene
    before = settled(NAMING)
    tried = list(NAMING)
    tried[new], tried[old] = tried[old], NO_POINT
    gain = swaps.alternatives(model, constraints, before).move[0, old, new]
    assert gain == pytest.approx(settled(tried).score[0] - before.score[0], abs=1e-4)


@pytest.mark.parametrize(("one", "other"), [(3, 1), (4, 3), (4, 0), (2, 0)])
def test_swapping_gains_what_trying_gains(scene, one, other):
    model, constraints, settled = scene
    before = settled(NAMING)
    tried = list(NAMING)
    tried[one], tried[other] = tried[other], tried[one]
    gain = swaps.alternatives(model, constraints, before).swap[0, one, other]
    assert gain == pytest.approx(settled(tried).score[0] - before.score[0], rel=1e-6)


def test_alignment_undoes_a_turn_and_a_step():
    rng = np.random.default_rng(5)
    template = rng.normal(size=(6, 3))
    moved = turned(template[None], np.array([2.1])) + np.array([3.0, -4.0, 0.5])
    moved[0, 2] = np.nan
    aligned = upright_aligned(moved, template)[0]
    assert np.isnan(aligned[2]).all()
    assert np.allclose(np.delete(aligned, 2, axis=0), np.delete(template, 2, axis=0))
