# SPDX-License-Identifier: GPL-3.0-or-later
"""Which exchanges of names are worth weighing, and where a marker is next seen."""

from itertools import combinations
from types import SimpleNamespace

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.points.likelihood.naming import settle
from addon.core.points.tracklets import VOTE
from addon.core.points.whole_take.layout import LAYOUT_NAMING, _gains, _may_gain
from addon.core.points.whole_take.likeness import _next_named
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
