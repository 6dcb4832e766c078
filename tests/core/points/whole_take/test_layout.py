# SPDX-License-Identifier: GPL-3.0-or-later
"""Which exchanges of names are worth weighing, and where a marker is next seen: what is quick against what is plain."""

from itertools import combinations

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.points.likelihood.naming import settle
from addon.core.points.whole_take.layout import LAYOUT_NAMING, _gains, _may_gain
from addon.core.points.whole_take.likeness import _next_seen
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
    _, _, usual = _gains(known, now, place, tried, np.zeros(markers, bool))
    assert (~worth).sum() > len(one) / 10
    assert usual[~worth].max() < -LAYOUT_NAMING.max_question
    assert worth[(one == exchanged[0]) & (other == exchanged[1])].all()


@given(SEEDS, st.integers(1, 30), st.integers(1, 5), st.sampled_from([0.0, 0.3, 1.0]))
def test_the_frames_in_which_markers_are_next_seen(seed, frames, markers, share):
    rng = np.random.default_rng(seed)
    seen = rng.random((frames, markers)) < share
    first = rng.integers(0, frames, 4)
    last = np.minimum(first + rng.integers(0, frames, 4), frames - 1)
    before, after = _next_seen(seen, first, last)
    for row, marker in np.ndindex(4, markers):
        there = np.flatnonzero(seen[:, marker])
        assert before[row, marker] == there[there < first[row]].max(initial=-1)
        assert after[row, marker] == next(iter(there[there > last[row]].tolist()), -1)
