# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that a model is not for are told from those that it is for, and takes that cannot be as they say."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from addon.core.data.errors import JobError
from addon.core.data.progress import finished
from addon.core.data.takes import BY_LIKELIHOOD, Labels
from addon.core.geometry import rotations
from addon.core.points.likelihood.learn import learn_likelihood
from addon.core.points.models import Model
from addon.core.points.motion import LabelledPoints
from addon.core.points.naming import Namer, namer_of
from addon.core.points.possible import (
    GRAVITY,
    POSSIBLE,
    refuse_impossible,
    slow_words,
    times_nearer,
    usual_acceleration,
)
from addon.core.points.refusals import (
    REFUSAL,
    SetFit,
    refuse_floods,
    refuse_others,
    refuse_two_groups,
    refuse_unlike,
    refuse_unrecognised,
)
from addon.core.points.several.pipeline import label_several
from addon.core.points.several.wearers import SeveralOptions
from addon.core.points.whole_take.pipeline import PointOptions, label_take
from addon.core.simulation.virtual import Act
from addon.core.training.segments import segment_markerset
from addon.io.models import open_model
from addon.io.points import read_points
from tests.core.scenes import RATE, anonymous, walker

PLATES = 3  # of four markers each
FRAMES = 60


def person(seed: int, at=(0.0, 0.0)) -> np.ndarray:
    """(T, 15, 3) m: a virtual person in gait15 who walks."""
    return walker("gait15", seed, [Act(FRAMES / 60)])[:FRAMES] + np.array([*at, 0])


def robot(seed: int, frames: int = 300, form: int = 7) -> np.ndarray:
    """(T, 12, 3) m: three rigid plates of four markers that turn about each other."""
    shape, chance = np.random.default_rng(form), np.random.default_rng(seed)
    time = np.arange(frames)[:, None] / 50
    parts = []
    for rigid_body in range(PLATES):
        flat = shape.uniform(-0.12, 0.12, (4, 3))
        swing = rotations.exponential(
            np.column_stack([0.3 * np.sin(time + seed), 0.4 * np.sin(2 * time + rigid_body), time])
        )[0]
        parts.append(
            np.einsum("fij,mj->fmi", swing, flat) + np.array([0.35 * rigid_body - 0.35, 0, 0.5 + 0.3 * rigid_body])
        )
    whole = np.concatenate(parts, axis=1)
    return whole + chance.normal(0, 0.0004, whole.shape)


@pytest.fixture(scope="module")
def plated() -> Model:
    """A model of the robot, whose markers are all on plates."""
    names = tuple(f"M{index}" for index in range(4 * PLATES))
    likelihood = learn_likelihood([(robot(1), "one")], names)
    assert likelihood.rigid_bodies is not None
    return Model(segment_markerset([robot(1)], names, "robot"), likelihood)


def by_likelihood(model: Model) -> Namer:
    return namer_of(model, "likelihood")


def first(count: int) -> Labels:
    """Labels of a person's frames of which the first few markers are named, for sure."""
    labels = Labels.none(FRAMES, 15)
    labels.marker[:, :count], labels.step[:, :count], labels.confidence[:, :count] = range(count), BY_LIKELIHOOD, 1.0
    return labels


def refused(model: Model, points: np.ndarray) -> str:
    with pytest.raises(JobError) as caught:
        refuse_others(model, by_likelihood(model), points)
    return caught.value.message


def test_what_the_model_is_for_passes_and_another_marker_set_is_said_so(model, plated):
    ghosts = np.tile(np.random.default_rng(2).uniform(-1, 1, (3, 3)), (FRAMES, 1, 1))
    refuse_others(model, by_likelihood(model), np.concatenate([person(1), ghosts], axis=1))
    refuse_others(plated, by_likelihood(plated), robot(2))
    half = robot(3)
    half[:, ::4] = np.nan
    refuse_others(plated, by_likelihood(plated), half)
    other = np.random.default_rng(5)
    chaos = np.tile(other.uniform([-0.4, -0.4, 0], [0.4, 0.4, 1.7], (20, 3)), (FRAMES, 1, 1))
    for points in (robot(1), chaos, other.normal(0, 1, (FRAMES, 15, 3))):
        assert "does not look like a take of model gait15" in refused(model, points)
    for points in (person(1), chaos, robot(1, form=8)):
        assert "does not look like a take of model robot" in refused(plated, points)


@pytest.mark.parametrize("distance", [1.5, 4.0])
def test_two_subjects_are_said_so(model, distance):
    both = np.concatenate([person(1), person(2, at=(0.3, distance))], axis=1)
    said = refused(model, both)
    assert "two subjects" in said or "several subjects at once" in said


def test_two_groups_are_two_subjects_where_nothing_names_points(model):
    both = np.concatenate([person(1), person(2, at=(0.3, 2.5))], axis=1)
    with pytest.raises(JobError, match="shows two subjects or more that wear gait15"):
        refuse_two_groups(model, both)
    ghosts = np.tile(np.random.default_rng(2).uniform(1, 1.2, (5, 3)), (FRAMES, 1, 1))
    refuse_two_groups(model, np.concatenate([person(1), ghosts], axis=1))


def test_two_on_plates_are_said_so(plated):
    both = np.concatenate([robot(1), robot(2) + np.array([2.5, 0, 0])], axis=1)
    assert "shows two subjects or more that wear robot" in refused(plated, both)


def test_too_few_points_or_labels_are_said_so_and_a_flood_of_points_before_it_fills_the_memory(model):
    few = np.full((FRAMES, 20, 3), np.nan)
    few[:, :3] = person(1)[:, :3]
    assert "no frame with enough points" in refused(model, few)
    points = person(1)
    with pytest.raises(JobError, match="20% of its markers were recognised for sure"):
        refuse_unrecognised(model, by_likelihood(model), points, first(3))
    refuse_unrecognised(model, by_likelihood(model), points, first(5))
    with pytest.raises(JobError, match="has 16000 points in one frame"):
        refuse_floods(np.zeros((3, 16000, 3)))
    refuse_floods(np.zeros((3, 100, 3)))


@pytest.mark.parametrize(
    ("take", "model", "words"),
    [
        ("clouthier/KneeltoProne01.c3d", "body26", "does not look like a take of model body26"),
        ("tennis/duplicate_labels.c3d", "body26", "does not look like a take of model body26"),
        ("tennis/kinematics_tennis_serve_2players.c3d", "body26", "subjects"),
    ],
)
def test_recorded_takes_that_the_built_in_models_are_not_for(shared_data, take, model, words):
    assert words in refused(open_model(model), read_points(shared_data / "people" / take).xyz)


@pytest.mark.parametrize(
    ("take", "model"),
    [
        ("mcgill/HC044A/HC044A15.c3d", "body26"),
        ("mcgill/HC031A/HC031A06.c3d", "gait15"),
        ("tennis/kinematics_tennis_serve.c3d", "body26"),
    ],
)
def test_recorded_takes_with_many_more_markers_pass(shared_data, take, model):
    known = open_model(model)
    refuse_others(known, by_likelihood(known), read_points(shared_data / "people" / take).xyz)


def test_where_frames_are_not_sure_the_whole_take_must_be(model):
    namer, points = by_likelihood(model), person(1)
    likely, unlikely = (SetFit(0.0, REFUSAL.min_log_likelihood + more) for more in (0.1, -0.1))
    refuse_unlike(model, namer, points, unlikely)
    refuse_unlike(model, namer, points, likely, sure=False)
    with pytest.raises(JobError, match="does not look like a take of model gait15"):
        refuse_unlike(model, namer, points, unlikely, sure=False)
    refuse_unrecognised(model, namer, points, first(12), sure=False)
    with pytest.raises(JobError, match="73% of its markers"):
        refuse_unrecognised(model, namer, points, first(11), sure=False)


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
