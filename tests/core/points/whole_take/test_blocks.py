# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers side by side, named anew: what is quickly known of it against the exact likelihood."""

from types import SimpleNamespace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.points.likelihood.distances import DistanceConstraints
from addon.core.points.likelihood.latent import Latent
from addon.core.points.likelihood.naming import score_of, settle
from addon.core.points.likelihood.shape import Shape
from addon.core.points.whole_take.blocks import _held_together, _row, block_exchanges, middle_of_known

SEEDS = st.integers(0, 2**16)
UNHELD = DistanceConstraints(np.zeros((0, 2), int), np.zeros(0), np.zeros(0), 0.05)


def settled(seed: int, slipped: tuple[int, ...] = ()):
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
    known, now = settled(seed)
    row = np.array([*order, *range(3, 7)])
    score = score_of(known.fine, UNHELD, now.points, now.worth, np.where(now.present[:, row], row, -1))
    precision, pull = _held_together(known, now, np.array([[0, 1, 2]]))
    moved = (now.points[:, order] - now.points[:, :3]).reshape(9, 9)
    square = np.einsum("fi,fij,fj->f", moved, precision[0], moved) + 2 * (moved * pull[0]).sum(axis=1)
    whole = now.present[:, :3].all(axis=1)
    # But for the yaw, which another order takes up anew.
    np.testing.assert_allclose((score - now.score)[whole], -square[whole] / 2, rtol=0.1, atol=0.5)


def test_names_that_moved_up_are_put_right_at_once():
    known, now = settled(3, slipped=(0, 1, 2))
    assert [2, 0, 1, 3, 4, 5, 6] in block_exchanges(known, now, np.arange(7)).tolist()


def test_where_no_block_is_seen_for_long_nothing_is_tried():
    known, now = settled(3)
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
