# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames in no order teach their subject: strangers whose markers sit elsewhere are named nearly completely."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from addon.core.data.progress import finished
from addon.core.data.takes import Labels
from addon.core.points import unordered
from addon.core.points.likelihood.frames import label_frames
from addon.core.points.likelihood.trials import Trial, make_trial
from addon.core.points.tracklets import cut
from addon.core.points.unordered import is_unordered, learn_subject
from addon.core.points.whole_take.pipeline import PointOptions, label_points
from addon.core.simulation.virtual import Act
from tests.core.scenes import anonymous, walker

RATE, TARGET, FRAMES, HIDDEN = 100.0, 0.999, 120, 4
RTHI = 3


@pytest.fixture(scope="module")
def walk() -> np.ndarray:
    """(T, 15, 3) m of a virtual person who walks and wears the right thigh's marker 12 cm higher and farther out."""
    markers = walker("gait15", 5, [Act(1.2, 0.4), Act(1.2, 0.9)], RATE, noise=0.001)[:: 240 // FRAMES][:FRAMES]
    outward = markers[:, 1] - markers[:, 2]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    markers[:, RTHI] += 0.06 * outward + [0, 0, 0.1]
    return markers


@pytest.fixture(scope="module")
def clouds(walk) -> Trial:
    """Its frames in random order, points without names."""
    generator = np.random.default_rng(1)
    return make_trial(walk[generator.permutation(len(walk))], (HIDDEN, HIDDEN), (0, 0), generator)


@pytest.fixture(scope="module")
def alone(model, clouds) -> Labels:
    """What frames say on their own."""
    return Labels.join(label_frames(model.likelihood, clouds.points))


@pytest.fixture(scope="module")
def learned(model, clouds, alone):
    """The likelihood of the subject."""
    return finished(learn_subject(model.likelihood, clouds.points, alone))


def right(labels: Labels, clouds: Trial) -> float:
    """The part of the points that have their own name, sure enough; none may have another's."""
    marker = labels.sure(TARGET)
    assert (marker == clouds.truth)[marker >= 0].mean() > 0.997
    return float((marker == clouds.truth)[clouds.truth >= 0].mean())


def test_what_is_sure_names_the_rest_and_finds_the_marker_worn_elsewhere(clouds, alone, learned):
    assert (alone.sure(TARGET) == RTHI).sum() < 0.2 * (clouds.truth == RTHI).sum()
    named = Labels.join(label_frames(learned, clouds.points))
    assert right(named, clouds) > 0.98 > 0.95 > right(alone, clouds)
    assert (named.sure(TARGET) == RTHI).sum() > 0.9 * (clouds.truth == RTHI).sum()


def test_the_pipeline_learns_where_nothing_connects_frames(model, clouds):
    points = clouds.points
    assert is_unordered(model, cut(points, RATE))
    work = label_points(anonymous(points, RATE), model, PointOptions("likelihood"))
    shares = []
    chunk = finished(work, lambda progress: shares.append(progress.fraction))
    assert shares == sorted(shares)
    marker = chunk.labels.marker
    assert (marker == clouds.truth)[clouds.truth >= 0].mean() > 0.98
    assert not any("behind a gap" in suspect.words for suspect in chunk.suspects)


@settings(max_examples=25)
@given(length=st.integers(1, 9), rate=st.integers(10, 240), in_order=st.booleans())
@example(length=2, rate=120, in_order=False)
@example(length=2, rate=120, in_order=True)
@example(length=4, rate=60, in_order=True)
def test_trajectories_of_few_frames_have_the_names_of_their_own_frames(model, walk, length, rate, in_order):
    # Each trajectory is so many frames long and has a column of its own; they follow on each other, or in no order.
    generator = np.random.default_rng(length)
    starts = np.arange(0, 60, length)
    order = starts if in_order else generator.permutation(starts)
    pieces = [walk[start : min(start + length, 60)] for start in order]
    points = np.full((60, 15 * len(pieces), 3), np.nan)
    truth, first = np.full(points.shape[:2], -1), 0
    for number, piece in enumerate(pieces):
        frames, columns = slice(first, first + len(piece)), slice(15 * number, 15 * (number + 1))
        marker = generator.permutation(15)
        points[frames, columns], truth[frames, columns] = piece[:, marker], marker
        first += len(piece)
    marker = finished(label_points(anonymous(points, float(rate)), model, PointOptions("likelihood"))).labels.marker
    assert (marker == truth)[marker >= 0].mean() > 0.999
    assert (marker == truth)[truth >= 0].mean() > 0.99


def test_too_little_that_is_sure_leaves_the_training(model, clouds, alone):
    none = alone.kept(np.zeros(alone.marker.shape, dtype=bool))
    assert finished(learn_subject(model.likelihood, clouds.points, none)) is model.likelihood


def test_ghosts_are_no_marker_that_nobody_wears(model, walk, monkeypatch):
    generator = np.random.default_rng(2)
    without = walk.copy()
    without[:, RTHI] = np.nan
    clouds = make_trial(without, (2, 2), (3, 3), generator)
    alone = Labels.join(label_frames(model.likelihood, clouds.points))
    monkeypatch.setattr(unordered, "KEEPING_TRIALS", 1)
    learned = finished(learn_subject(model.likelihood, clouds.points, alone))
    marker = Labels.join(label_frames(learned, clouds.points)).sure(TARGET)
    assert (marker == RTHI).mean() < 0.005
