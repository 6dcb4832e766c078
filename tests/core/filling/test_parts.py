# SPDX-License-Identifier: GPL-3.0-or-later
"""Gaps are found, trials are cut where they say something, and what is learned goes down the slope that it says."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from addon.core.filling.gaps import Gap, KnownMarkers, find_gaps
from addon.core.filling.kernels import PRIOR_SCALES, Alikeness, LearnedScales
from addon.core.filling.trials import TRIALS, cut_gaps, own_in_trial, pace_of, paces

RATE = 100.0


@settings(max_examples=60, deadline=None)
@given(arrays(bool, st.tuples(st.integers(1, 12), st.integers(1, 4))))
def test_gaps_are_what_is_missing_of_markers_that_are_seen(present):
    gaps = find_gaps(present)
    missing = ~present & present.any(axis=0)
    covered = np.zeros(present.shape, int)
    for gap in gaps:
        covered[gap.start : gap.stop, gap.marker] += 1
        assert gap.start == 0 or present[gap.start - 1, gap.marker]
        assert gap.stop == len(present) or present[gap.stop, gap.marker]
    assert (covered == missing).all()
    assert [len(gap) for gap in gaps] == sorted(len(gap) for gap in gaps)


def walk(frames: int = 300, markers: int = 5, seed: int = 0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return np.cumsum(rng.normal(0, 0.005, (frames, 1, 3)), axis=0) + rng.uniform(0, 0.3, (1, markers, 3))


def test_filled_samples_help_only_with_gaps_that_are_much_longer():
    take = KnownMarkers(walk())
    take.put(Gap(100, 110, 1), take.xyz[100:110, 1].copy())
    assert 1 not in take.helping(Gap(95, 115, 0))
    assert 1 in take.helping(Gap(80, 140, 0))
    assert set(take.helping(Gap(200, 210, 0))) == {1, 2, 3, 4}


@pytest.mark.parametrize("gap", [Gap(100, 130, 0), Gap(0, 20, 0), Gap(280, 300, 0)])
def test_trials_are_cut_where_everything_is_known_and_neighbours_move_alike(gap):
    xyz = walk()
    xyz[:150] = xyz[0] + 0.05 * (xyz[:150] - xyz[0])  # a calm half
    xyz[60:64, 2] = np.nan
    own = np.ones(300, bool)
    own[gap.start : gap.stop] = False
    take, neighbours = KnownMarkers(xyz), np.array([1, 2, 3])
    summed = paces(take, neighbours, RATE)
    trials, alike = cut_gaps(take, gap, neighbours, own, summed)
    assert 0 < len(trials) <= TRIALS.gaps
    assert alike
    for trial in trials:
        around = slice(trial.start - 1, trial.stop + 1)
        assert own[around].all()
        assert np.isfinite(xyz[around][:, neighbours]).all()
        ratio = pace_of(summed, trial.start, trial.stop) / pace_of(summed, gap.start, gap.stop)
        assert 1 / TRIALS.grade <= ratio <= TRIALS.grade
        hidden = own_in_trial(own, trial, gap, RATE)
        assert not hidden[trial.start : trial.stop].any()
        assert hidden[trial.start - 1] == (gap.start > 0)
        assert trial.stop == 300 or hidden[trial.stop] == (gap.stop < 300)


def test_there_are_no_trials_where_there_is_no_room():
    take, own = KnownMarkers(walk(30)), np.ones(30, bool)
    own[4:28] = False
    assert cut_gaps(take, Gap(4, 28, 0), np.array([1, 2, 3]), own, paces(take, np.array([1, 2, 3]), RATE)) == (
        [],
        False,
    )


def test_the_slopes_are_those_of_the_likelihood():
    rng = np.random.default_rng(5)
    features, seconds = rng.normal(size=(40, 6)), np.sort(rng.uniform(0, 2, 40))
    alike = Alikeness.of((features, features), (seconds, seconds), 1e-4)
    learned = LearnedScales(alike, 0.01 * rng.normal(size=(40, 3)), steps=0)
    at = PRIOR_SCALES.medians + 0.3
    value, slope = learned._unlikely(at)
    for index in range(8):
        step = 1e-5 * np.eye(8)[index]
        measured = (learned._unlikely(at + step)[0] - learned._unlikely(at - step)[0]) / 2e-5
        assert slope[index] == pytest.approx(measured, rel=1e-3, abs=1e-3 * abs(value))
    assert (np.linalg.eigvalsh(alike.covariance(at) + 1e-9 * np.eye(40)) > 0).all()
