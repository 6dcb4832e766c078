# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames in no order teach their subject: strangers whose markers sit elsewhere are named nearly completely."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from addon.core.body.bodies import BodyModel
from addon.core.data.progress import finished
from addon.core.data.takes import Labels, Points
from addon.core.points import unordered
from addon.core.points.likelihood.calibration import raised
from addon.core.points.likelihood.frames import label_frames
from addon.core.points.likelihood.subject import loosened, of_subject, off_expected
from addon.core.points.likelihood.trials import Trial, make_trial
from addon.core.points.tracklets import cut
from addon.core.points.unordered import is_unordered, learn_subject
from addon.core.points.whole_take.pipeline import PointOptions, label_points
from addon.core.simulation.virtual import Act, draw_person, perform
from addon.io.models import open_model

RATE, TARGET, FRAMES, HIDDEN = 100.0, 0.999, 120, 4
RTHI, RKNE = 3, 5


@pytest.fixture(scope="module")
def model():
    return open_model("gait15")


@pytest.fixture(scope="module")
def walk(model) -> np.ndarray:
    """(T, 15, 3) m of a virtual person who walks and wears the right thigh's marker 12 cm higher and farther out."""
    generator = np.random.default_rng(5)
    body = BodyModel(model.markerset)
    bodies = perform(body, draw_person(model.markerset, generator), [Act(1.2, 0.4), Act(1.2, 0.9)], rate=RATE)
    markers = body.pose(bodies).markers[:: 240 // FRAMES][:FRAMES]
    markers = markers + generator.normal(0, 0.001, markers.shape)
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
    residual = np.where(np.isfinite(points[..., 0]), 0.0005, np.nan)
    work = label_points(Points(("",) * points.shape[1], points, residual, RATE, 1), model, PointOptions("likelihood"))
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
    residual = np.where(np.isfinite(points[..., 0]), 0.0005, np.nan)
    take = Points(("",) * points.shape[1], points, residual, float(rate), 1)
    marker = finished(label_points(take, model, PointOptions("likelihood"))).labels.marker
    assert (marker == truth)[marker >= 0].mean() > 0.999
    assert (marker == truth)[truth >= 0].mean() > 0.99


@pytest.mark.parametrize("rate", [5.0, RATE])
def test_points_in_any_order_are_no_trajectories_at_any_rate(model, clouds, walk, rate):
    assert is_unordered(model, cut(clouds.points, rate))
    assert not is_unordered(model, cut(walk[:: round(RATE / rate) // 4 or 1], rate))


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


def test_a_subject_is_nearer_to_its_frames_than_the_training(model, walk):
    trained = model.likelihood
    seen = walk.copy()
    seen[np.random.default_rng(3).random(seen.shape[:2]) < 0.3] = np.nan
    own = of_subject(trained, seen)
    away = [np.linalg.norm(off_expected(shape, walk, RTHI), axis=1).mean() for shape in (trained.shape, own.shape)]
    assert away[1] < 0.3 * away[0]
    assert np.trace(own.shape.covariance) < np.trace(trained.shape.covariance)
    between = np.linalg.norm(walk[:, RTHI] - walk[:, RKNE], axis=1)
    pair = np.flatnonzero((own.constraints.pair == [RTHI, RKNE]).all(axis=1))
    assert own.constraints.length[pair] == pytest.approx(np.median(between), abs=0.005)


def test_the_more_frames_the_less_the_training_counts(model, walk):
    trained = model.likelihood
    left = [np.trace(of_subject(trained, walk[::step]).shape.covariance) for step in (60, 10, 1)]
    assert np.trace(trained.shape.covariance) > left[0] > left[1] > left[2]


def test_loosened_markers_sit_anywhere(model):
    trained, which = model.likelihood, np.arange(15) == RTHI
    loose = loosened(trained, which, 0.25)
    assert not (loose.constraints.pair == RTHI).any()
    assert len(loose.constraints) < len(trained.constraints)
    grown = loose.shape.noise - trained.shape.noise
    assert grown[~which].max() == 0
    assert grown[RTHI] == pytest.approx((0.25 * trained.shape.radius) ** 2)


def test_a_take_may_raise_what_a_calibration_asks_for_and_never_lower_it(model):
    calibration = model.likelihood.calibration
    odds = np.linspace(0, 10, 2000)
    assert raised(calibration, odds, np.ones(2000, dtype=bool)).least == pytest.approx(calibration.least)
    assert raised(calibration, odds[:0], odds[:0] > 0) is calibration
    strict = raised(calibration, odds, odds > 5)
    usual = np.searchsorted(calibration.rates, TARGET)
    assert (strict.least[:, usual] >= 5).all()
    assert (strict.least >= calibration.least).all()
