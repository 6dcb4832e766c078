# SPDX-License-Identifier: GPL-3.0-or-later
"""From labelled clouds to names: a made-up walker and one in plates, with hidden markers and ghosts."""

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.geometry.upright import turned
from addon.core.points.likelihood.frames import label_frames, label_some
from addon.core.points.likelihood.learn import learn_likelihood
from addon.core.points.likelihood.trials import make_trial
from addon.core.simulation.virtual import Act
from addon.io.markersets import open_markerset
from tests.core import scenes
from tests.core.points.rigid_bodies import plated

NAMES = open_markerset("gait15").markers


def walker(seed: int, frames: int = 150) -> np.ndarray:
    """(T, 15, 3) m of a virtual person who walks and turns."""
    return scenes.walker("gait15", seed, [Act(1.5, stride=0.9), Act(1.0, stride=0.6, turn=1.5)], noise=0.002)[:frames]


@pytest.fixture(scope="module")
def likelihood():
    return learn_likelihood([(walker(seed), f"person {seed}") for seed in range(5)], NAMES)


def named(likelihood, trial, target=0.99):
    chunks = list(label_frames(likelihood, trial.points))
    marker = np.concatenate([chunk.sure(target) for chunk in chunks])
    given = marker >= 0
    return (
        marker,
        (given & (marker != trial.truth)).sum() / given.sum(),
        (given & (marker == trial.truth)).sum() / (trial.truth >= 0).sum(),
    )


def test_a_stranger_is_named_with_markers_hidden_and_ghosts_about_and_none_twice_in_a_frame(likelihood):
    trial = make_trial(walker(77), (0, 3), (0, 2), np.random.default_rng(1))
    _, wrong, recall = named(likelihood, trial)
    assert wrong < 0.01
    assert recall > 0.97
    trial = make_trial(walker(78), (0, 4), (3, 6), np.random.default_rng(2))
    marker, _, _ = named(likelihood, trial, target=0)
    for row in marker:
        given = row[row >= 0]
        assert len(np.unique(given)) == len(given)


def test_one_labelled_take_names_another_person():
    """How others differ is taken for granted; who was recorded, and the mirror image of that, say nothing of it."""
    alone = learn_likelihood([(walker(0), "only one")], NAMES)
    assert alone.rigid_bodies is None
    for seed in (60, 61, 62):
        trial = make_trial(walker(seed), (0, 3), (0, 2), np.random.default_rng(seed))
        _, wrong, recall = named(alone, trial, target=0.999)
        assert wrong < 0.01
        assert recall > 0.7


def test_frames_know_nothing_of_each_other_and_order_and_heading_do_not_matter(likelihood):
    trial = make_trial(walker(79), (0, 3), (0, 2), np.random.default_rng(3))
    whole = label_some(likelihood, trial.points)
    broken = trial.points.copy()
    broken[10] = np.random.default_rng(4).normal(size=broken[10].shape)
    again = label_some(likelihood, broken)
    others = np.arange(len(broken)) != 10
    assert (again.marker[others] == whole.marker[others]).all()
    assert np.allclose(again.confidence[others], whole.confidence[others])
    trial = make_trial(walker(80)[:40], (0, 2), (0, 1), np.random.default_rng(5))
    order = np.random.default_rng(6).permutation(trial.points.shape[1])
    turn = turned(trial.points, np.full(40, 2.5)) + np.array([4.0, -2.0, 0.0])
    plain, other = label_some(likelihood, trial.points), label_some(likelihood, turn[:, order])
    sure = (plain.confidence > 0.99)[:, order]
    assert (other.marker[sure] == plain.marker[:, order][sure]).mean() > 0.999


def test_plates_are_found_in_poses_that_were_never_seen():
    likelihood = learn_likelihood([(plated.walk(plated.body(), frames=200), "she")], plated.NAMES)
    assert likelihood.rigid_bodies is not None
    assert sorted(map(len, likelihood.rigid_bodies.members)) == [4] * len(plated.SEGMENTS)
    trial = make_trial(plated.walk(plated.body(), 2, frames=200), (0, 4), (0, 6), np.random.default_rng(3))
    _, wrong, recall = named(likelihood, trial)
    assert wrong < 0.01
    assert recall > 0.9


def test_training_says_what_is_wrong_with_takes():
    with pytest.raises(InputError, match="no take shows RTOE"):
        gone = walker(1)
        gone[:, NAMES.index("RTOE")] = np.nan
        learn_likelihood([(gone, "a")], NAMES)
    with pytest.raises(InputError, match="no frame shows half"):
        learn_likelihood([(np.full((5, len(NAMES), 3), np.nan), "a")], NAMES)
    with pytest.raises(InputError, match="too few"):
        learn_likelihood([(np.zeros((5, 3, 3)), "a")], NAMES[:3])


def test_frames_without_points_get_no_names(likelihood):
    chunk = next(label_frames(likelihood, np.full((3, 5, 3), np.nan)))
    assert (chunk.marker == -1).all()
    assert (chunk.confidence == 0).all()


def test_a_frame_in_a_crowd_is_nothing_to_its_neighbours(likelihood):
    trial = make_trial(walker(78, 20), (0, 3), (0, 2), np.random.default_rng(2))
    ghosts = np.full((20, 8, 3), np.nan)
    ghosts[5] = trial.points[5, :1] + np.random.default_rng(3).normal(0, 0.5, (8, 3))
    crowded = np.concatenate([trial.points, ghosts], axis=1)
    alone, together = label_some(likelihood, trial.points), label_some(likelihood, crowded)
    others = np.arange(20) != 5
    width = trial.points.shape[1]
    assert (together.marker[others, :width] == alone.marker[others]).all()
    assert np.allclose(together.confidence[others, :width], alone.confidence[others], atol=1e-9)
    assert (together.marker[others, width:] < 0).all()
