# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that cannot be as they say: each is one sentence that names the unit, the rate or the order."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.points.motion import LabelledPoints
from addon.core.points.possible import (
    GRAVITY,
    POSSIBLE,
    refuse_impossible,
    slow_words,
    times_nearer,
    usual_acceleration,
)
from addon.core.points.several.pipeline import label_several
from addon.core.points.several.wearers import SeveralOptions
from addon.core.points.whole_take.pipeline import PointOptions, label_take
from addon.core.simulation.virtual import Act
from addon.io.points import read_points
from tests.core.scenes import RATE, anonymous, walker


@pytest.fixture(scope="module")
def walk() -> np.ndarray:
    """(T, 15, 3) m: a virtual person who walks, in columns of any order."""
    markers = walker("gait15", 3, [Act(1.5, 0.8), Act(1.5, 0.9)])[: int(3 * RATE)]
    return markers[:, np.random.default_rng(3).permutation(15)]


def labelled(points: np.ndarray, rate: float, model, **options) -> LabelledPoints:
    return finished(label_take(anonymous(points, rate), model, replace(PointOptions("likelihood"), **options)))


def test_a_rate_ten_times_too_high_and_frames_out_of_their_order_are_named(model, walk):
    labelled(walk, RATE, model)
    with pytest.raises(JobError, match=r"has a rate that cannot be: at 600 Hz .* such as 60 Hz"):
        labelled(walk, 10 * RATE, model)
    with pytest.raises(JobError, match="has a rate that cannot be"):
        finished(label_several(anonymous(walk, 10 * RATE), SeveralOptions(model, 2), PointOptions("likelihood")))
    with pytest.raises(JobError, match=r"has its frames out of order: "):
        labelled(walk[np.random.default_rng(0).permutation(len(walk))], RATE, model)


@settings(max_examples=12)
@given(st.sampled_from([1000.0, 100.0, 39.37, 25.4, 10.0, 2.54]), st.booleans(), st.integers(-180, 180))
def test_a_wrong_unit_is_named(model, walk, times, too_small, turn):
    angle = np.deg2rad(turn)
    turned = walk @ np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    with pytest.raises(JobError, match=r"seems to be in .* and is taken for|has a unit that cannot be"):
        labelled(turned / times if too_small else turned * times, RATE, model)


def test_the_unit_is_said_where_frames_are_sure_of_it_and_who_is_slow_can_be_at_any_rate(model, walk):
    with pytest.raises(
        JobError, match=r"seems to be in cm and is taken for mm: its points are 0\.1 times as far apart"
    ):
        labelled(walk / 10, RATE, model)
    generator = np.random.default_rng(1)
    standing = walk[:1] + generator.normal(0, 0.001, walk.shape)
    for rate in (10.0, RATE, 1000.0):
        refuse_impossible(standing, rate, None, [model])
        refuse_impossible(standing[::-1], rate, None, [model])
    refuse_impossible(walk, RATE / 10, None, [model])


def test_a_rate_too_low_is_something_to_look_at_and_neither_no_order_nor_a_shaking_hand_is_wrong(walk, model):
    assert slow_words(walk, RATE) == slow_words(walk[::6], RATE / 6) == ""
    assert slow_words(walk, RATE / 10).endswith("m/s at 6 Hz: look whether the rate is ten times as high")
    standing = walk[:1] + np.random.default_rng(1).normal(0, 0.001, walk.shape)
    assert slow_words(standing, RATE / 10) == ""
    generator = np.random.default_rng(2)
    clouds = np.stack([frame[generator.permutation(15)] for frame in generator.permutation(walk)])
    refuse_impossible(clouds, RATE, None, [model])
    refuse_impossible(clouds.repeat(2, axis=0), 2 * RATE, None, [model])
    generator, time = np.random.default_rng(4), np.arange(300) / 100
    hand = generator.uniform(-0.08, 0.08, (1, 15, 3)) + 0.08 * np.sin(2 * np.pi * 6 * time)[:, None, None]
    refuse_impossible(hand, 100.0, None, [model])


@pytest.mark.parametrize("name", ["mcgill/HC036A", "actors53/p1", "clouthier", "cmu41/s02", "tennis", "gaps"])
def test_recorded_people_are_far_from_what_cannot_be(shared_data, name):
    for path in sorted((shared_data / "people" / name).glob("*.c3d")):
        take = read_points(path)
        assert usual_acceleration(take.xyz, take.rate) < GRAVITY / POSSIBLE.part / 2, path
        assert times_nearer(take.xyz) < POSSIBLE.nearer / 2.5, path
