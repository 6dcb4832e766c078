# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes that a model is not for, or that cannot be as they say; and frames in no order, which teach their subject."""

from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from addon.core.body.sides import MIRROR
from addon.core.data.errors import ForceableError, JobError
from addon.core.data.progress import Progress, finished, rising
from addon.core.data.takes import BY_LIKELIHOOD, NO_MARKER, Labels
from addon.core.points import refusals, unordered
from addon.core.points.likelihood.frames import label_frames
from addon.core.points.likelihood.learn import Trial, learn_likelihood, make_trial
from addon.core.points.models import Model, namer_of
from addon.core.points.motion import LabelledPoints
from addon.core.points.possible import MEND_POINTS, MirroredError, refuse_impossible, refuse_labelled, slow_words
from addon.core.points.several.pipeline import label_several
from addon.core.points.several.wearers import SeveralOptions
from addon.core.points.tracklets import cut
from addon.core.points.unordered import is_unordered, learn_subject
from addon.core.points.whole_take import pipeline
from addon.core.points.whole_take.mirrored import refuse_mirrored
from addon.core.points.whole_take.pipeline import NamedFrames, PointOptions, label_take
from addon.core.simulation.virtual import Act
from addon.core.training.segments import segment_markerset
from addon.io.models import open_model
from addon.io.points import read_points
from tests.core.data.test_takes import packed
from tests.core.scenes import RATE, anonymous, walker
from tests.core.training.test_transfer import leg

FRAMES = 60
LEFT_LEG = {"LASI", "RASI", "LPSI", "RPSI", "LTHI", "LKNE", "LTIB", "LANK", "LHEE", "LTOE"}


def person(seed: int, at=(0.0, 0.0)) -> np.ndarray:
    """(T, 15, 3) m: a virtual person in gait15 who walks."""
    return walker("gait15", seed, [Act(FRAMES / 60)])[:FRAMES] + np.array([*at, 0])


def robot(seed: int, form: int = 7) -> np.ndarray:
    """(T, 12, 3) m: three rigid plates of four markers that turn about each other."""
    return leg(300, 2.0, seed, form)


@pytest.fixture(scope="module")
def plated() -> Model:
    names = tuple(f"M{index}" for index in range(12))
    likelihood = learn_likelihood([(robot(1), "one")], names)
    assert likelihood.rigid_bodies is not None
    return Model(segment_markerset([robot(1)], names, "robot"), likelihood)


def first(count: int) -> Labels:
    """Labels of a person's frames of which the first few markers are named, for sure."""
    labels = Labels.none(FRAMES, 15)
    labels.marker[:, :count], labels.step[:, :count], labels.confidence[:, :count] = range(count), BY_LIKELIHOOD, 1.0
    return labels


def refused(model: Model, points: np.ndarray) -> str:
    with pytest.raises(JobError) as caught:
        refusals.refuse_others(model, namer_of(model, "likelihood"), points)
    return caught.value.message


def test_what_the_model_is_for_passes_and_another_marker_set_is_said_so(model, plated):
    ghosts = np.tile(np.random.default_rng(2).uniform(-1, 1, (3, 3)), (FRAMES, 1, 1))
    refusals.refuse_others(model, namer_of(model, "likelihood"), np.concatenate([person(1), ghosts], axis=1))
    refusals.refuse_others(plated, namer_of(plated, "likelihood"), robot(2))
    half = robot(3)
    half[:, ::4] = np.nan
    refusals.refuse_others(plated, namer_of(plated, "likelihood"), half)
    other = np.random.default_rng(5)
    chaos = np.tile(other.uniform([-0.4, -0.4, 0], [0.4, 0.4, 1.7], (20, 3)), (FRAMES, 1, 1))
    for points in (robot(1), chaos, other.normal(0, 1, (FRAMES, 15, 3))):
        assert "does not look like a take of model gait15" in refused(model, points)
    for points in (person(1), chaos, robot(1, form=8)):
        assert "does not look like a take of model robot" in refused(plated, points)


def test_a_take_that_the_first_likelihood_refuses_is_named_by_the_second():
    """A leg alone, which among people who hold their arms and legs in every way may be anything."""
    model = open_model("body39")
    own = [at for at, name in enumerate(model.markerset.markers) if name in LEFT_LEG]
    walk = walker("body39", 3, [Act(FRAMES / 60)])[:FRAMES, own]
    take = anonymous(walk, 60.0)
    with pytest.raises(JobError, match="does not look like a take of model body39"):
        finished(label_take(take, replace(model, second=None), PointOptions("likelihood")))
    for force in (False, True):
        told: list[Progress] = []
        work = label_take(take, model, PointOptions("likelihood", force=force))
        given = finished(rising(work), told.append).labels.marker
        assert (given == own).mean() > 0.9
        shares = [one.fraction for one in told]
        assert shares == sorted(shares) and 0.5 < shares[-1] < 1, "it is named twice"


@pytest.mark.parametrize(("first_refuses", "sure", "kept"), [(True, False, 0), (True, True, 1), (False, True, 0)])
def test_the_likelier_of_two_is_kept_though_it_refuses_the_take_where_frames_are_not_sure(
    monkeypatch, first_refuses, sure, kept
):
    """The first is the likelier; single frames are `sure` by the second alone."""
    model, first_likelihood = open_model("body39"), open_model("body39").likelihood
    asked = ("first", "second")

    def named(take, tracklet, one, _):
        yield from ()
        labels = Labels.none(*take.xyz.shape[:2])
        second = one.likelihood is not first_likelihood
        return NamedFrames(take, tracklet, one, None, None, labels, True, None, sure and second)

    def whole(frames, _):
        yield from ()
        second = frames.model.likelihood is not first_likelihood
        fit = SimpleNamespace(log_likelihood=8.0 - second)
        return SimpleNamespace(fit=fit, which=asked[second]), "its own"

    def refuse(_, solution, *__):
        if first_refuses and solution.which == "first":
            raise refusals.UnsuitedError("says too little")

    for name, stub in (("name_frames", named), ("as_a_whole", whole), ("refuse_named", refuse)):
        monkeypatch.setattr(pipeline, name, stub)
    monkeypatch.setattr(pipeline, "decided_of", lambda frames, *_: f"doubts {frames.other.which}")
    take = anonymous(walker("body39", 3, [Act(FRAMES / 60)])[:FRAMES])
    work = pipeline._likelier(take, cut(take.xyz, take.rate), model, PointOptions("likelihood"))
    _, solution, verdict = finished(work)
    assert solution.which == asked[kept]
    assert verdict == ("doubts first" if kept else "its own")


@pytest.mark.parametrize("laned", [False, True])
def test_a_mirrored_take_is_told_by_frames_of_enough_named_markers_whatever_is_named(laned):
    """Most frames show three of them, which look the same in a mirror."""
    model, walk = open_model("body39"), walker("body39", 3, [Act(FRAMES / 60)])[:FRAMES]
    walk[: 2 * FRAMES // 3, 3:] = np.nan
    for points in (walk, walk * MIRROR):
        take = packed(points) if laned else anonymous(points)
        named = np.where(np.isfinite(take.xyz[..., 0]), np.arange(take.xyz.shape[1]), NO_MARKER)
        named[named == model.markerset.markers.index("RBAK")] = NO_MARKER
        refuse = partial(refuse_mirrored, take, named, [model], MEND_POINTS)
        if points is walk:
            refuse()
        else:
            with pytest.raises(MirroredError, match="single frames fit the mirror image of body39 clearly better"):
                refuse()


def test_two_subjects_are_said_so(model, plated):
    for distance in (1.5, 4.0):
        both = np.concatenate([person(1), person(2, at=(0.3, distance))], axis=1)
        said = refused(model, both)
        assert "two subjects" in said or "several subjects at once" in said
    both = np.concatenate([robot(1), robot(2) + np.array([2.5, 0, 0])], axis=1)
    assert "shows two subjects or more that wear robot" in refused(plated, both)


def test_two_groups_are_two_subjects_where_nothing_names_points(model):
    both = np.concatenate([person(1), person(2, at=(0.3, 2.5))], axis=1)
    with pytest.raises(JobError, match="shows two subjects or more that wear gait15"):
        refusals.refuse_two_groups(model, both)
    ghosts = np.tile(np.random.default_rng(2).uniform(1, 1.2, (5, 3)), (FRAMES, 1, 1))
    refusals.refuse_two_groups(model, np.concatenate([person(1), ghosts], axis=1))


def test_too_few_points_or_labels_are_said_so_and_a_flood_of_points_before_it_fills_the_memory(model):
    few = np.full((FRAMES, 20, 3), np.nan)
    few[:, :3] = person(1)[:, :3]
    assert "no frame with enough points" in refused(model, few)
    points = person(1)
    with pytest.raises(JobError, match="20% of what could be its markers was recognised for sure"):
        refusals.refuse_unrecognised(model, namer_of(model, "likelihood"), points, first(3))
    refusals.refuse_unrecognised(model, namer_of(model, "likelihood"), points, first(5))
    with pytest.raises(JobError, match="has 16000 points in one frame"):
        refusals.refuse_floods(np.zeros((3, 16000, 3)))
    refusals.refuse_floods(np.zeros((3, 100, 3)))


@pytest.mark.parametrize(
    ("take", "model", "words"),
    [
        ("clouthier/KneeltoProne01", "body26", "does not look like a take of model body26"),
        ("tennis/duplicate_labels", "body26", "does not look like a take of model body26"),
        ("tennis/kinematics_tennis_serve_2players", "body26", "subjects"),
        ("mcgill/HC044A/HC044A15", "body26", ""),  # with many more markers
        ("mcgill/HC031A/HC031A06", "gait15", ""),
        ("tennis/kinematics_tennis_serve", "body26", ""),
    ],
)
def test_recorded_takes_that_a_built_in_model_is_or_is_not_for(shared_data, take, model, words):
    known, points = open_model(model), read_points(shared_data / "people" / f"{take}.c3d").xyz
    if words:
        assert words in refused(known, points)
    else:
        refusals.refuse_others(known, namer_of(known, "likelihood"), points)


def test_where_frames_are_not_sure_the_whole_take_must_be(model):
    namer, points = namer_of(model, "likelihood"), person(1)
    likely, unlikely = (refusals.SetFit(0.0, 5.0, refusals.REFUSAL.min_layout + more) for more in (0.1, -0.1))
    refusals.refuse_unlike(model, namer, points, unlikely)
    refusals.refuse_unlike(model, namer, points, likely, sure=False)
    for fit, why in (
        (unlikely, "the points do not lie as its markers do"),
        (refusals.NO_FIT, "no frame shows enough of its"),
    ):
        with pytest.raises(JobError, match=f"of model gait15: {why}"):
            refusals.refuse_unlike(model, namer, points, fit, sure=False)
    refusals.refuse_unrecognised(model, namer, points, first(12), sure=False)
    with pytest.raises(JobError, match="73% of what could be its markers"):
        refusals.refuse_unrecognised(model, namer, points, first(11), sure=False)


@pytest.fixture(scope="module")
def walk() -> np.ndarray:
    """(T, 15, 3) m: a virtual person who walks, in columns of any order."""
    markers = walker("gait15", 3, [Act(1.5, 0.8), Act(1.5, 0.9)])[: int(3 * RATE)]
    return markers[:, np.random.default_rng(3).permutation(15)]


def labelled(points: np.ndarray, rate: float, model, **options) -> LabelledPoints:
    return finished(label_take(anonymous(points, rate), model, replace(PointOptions("likelihood"), **options)))


def test_a_rate_ten_times_too_high_and_frames_out_of_their_order_are_named(model, walk):
    labelled(walk, RATE, model)
    refuse_impossible(walk, 4.5 * RATE, None, [model])  # as hard as a sprinter's legs swing
    with pytest.raises(JobError, match=r"has a rate that cannot be: at 600 Hz .* such as 60 Hz"):
        labelled(walk, 10 * RATE, model)
    labelled(walk, 10 * RATE, model, force=True)
    with pytest.raises(JobError, match="has a rate that cannot be"):
        finished(label_several(anonymous(walk, 10 * RATE), SeveralOptions(model, 2), PointOptions("likelihood")))
    with pytest.raises(JobError, match=r"has its frames out of order: "):
        labelled(walk[np.random.default_rng(0).permutation(len(walk))], RATE, model)


def test_a_subject_who_is_there_for_a_part_of_the_take_is_named_as_in_that_part_alone(model, walk):
    brief = walk[:40]
    nobody = np.full((9 * len(brief), *brief.shape[1:]), np.nan)
    alone = labelled(brief, RATE, model).labels.marker
    there = labelled(np.concatenate([nobody, brief, nobody]), RATE, model).labels.marker
    np.testing.assert_array_equal(there[len(nobody) :][: len(brief)], alone)
    assert (alone != NO_MARKER).all()


def test_so_is_one_of_few_frames_at_which_nobody_is_so_fast(model, walk):
    for frames in (30, 60, len(walk)):
        with pytest.raises(ForceableError, match=r"at 20000 Hz half of its points are faster than \d+ m/s, which"):
            refuse_impossible(walk[:frames], 20_000.0, None, [model])
        refuse_impossible(walk[:frames], 1.5 * RATE, None, [model])
    refuse_impossible(walk[:60].repeat(10, axis=0), 10 * RATE, None, [model])


@settings(max_examples=12)
@given(st.sampled_from([1000.0, 100.0, 39.37, 25.4, 10.0, 2.54]), st.booleans(), st.integers(-180, 180))
@example(times=2.54, too_small=True, turn=2)
def test_a_wrong_unit_is_named(model, walk, times, too_small, turn):
    angle = np.deg2rad(turn)
    turned = walk @ np.array([[np.cos(angle), np.sin(angle), 0], [-np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    with pytest.raises(ForceableError, match=r"seems to be in .* and is taken for|has a unit that cannot be"):
        labelled(turned / times if too_small else turned * times, RATE, model)


@pytest.mark.parametrize("times", [0.001, 10])
def test_a_wrong_unit_is_told_of_labelled_points_of_which_most_frames_show_one_limb(times):
    markerset, points = open_model("gait15").markerset, person(3)
    points[3:, [name not in ("RANK", "RHEE", "RTOE") for name in markerset.markers]] = np.nan
    refuse_labelled(markerset, points)
    with pytest.raises(ForceableError, match="has a unit that cannot be: its points are about"):
        refuse_labelled(markerset, times * points)


@pytest.mark.filterwarnings("error")
def test_points_that_are_all_in_one_place_are_refused_without_a_warning(model, walk):
    with pytest.raises(ForceableError, match="does not look like a take of model"):
        labelled(np.ones_like(walk), RATE, model)


def test_the_unit_is_said_where_frames_are_sure_of_it_and_who_is_slow_can_be_at_any_rate(model, walk):
    with pytest.raises(JobError, match=r"seems to be in cm and is taken for mm: its points are 0\.1 times as far"):
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


def test_columns_that_programs_fill_with_the_next_point_that_appears_are_no_wrong_rate(walk, model):
    refilled = walk.copy()
    for begin in range(0, len(walk), 8):
        refilled[begin : begin + 7] = walk[begin : begin + 7, np.random.default_rng(begin).permutation(walk.shape[1])]
        refilled[begin + 7 : begin + 8] = np.nan
    refuse_impossible(refilled, RATE, None, [model])


HERTZ, TARGET, SHOWN, HIDDEN = 100.0, 0.999, 120, 4
RTHI = 3


@pytest.fixture(scope="module")
def odd_walk() -> np.ndarray:
    """(T, 15, 3) m of a virtual person who walks and wears the right thigh's marker 12 cm higher and farther out."""
    markers = walker("gait15", 5, [Act(1.2, 0.4), Act(1.2, 0.9)], HERTZ, noise=0.001)[:: 240 // SHOWN][:SHOWN]
    outward = markers[:, 1] - markers[:, 2]
    outward /= np.linalg.norm(outward, axis=1, keepdims=True)
    markers[:, RTHI] += 0.06 * outward + [0, 0, 0.1]
    return markers


@pytest.fixture(scope="module")
def clouds(odd_walk) -> Trial:
    """Its frames in random order, points without names."""
    generator = np.random.default_rng(1)
    return make_trial(odd_walk[generator.permutation(len(odd_walk))], (HIDDEN, HIDDEN), (0, 0), generator)


@pytest.fixture(scope="module")
def alone(model, clouds) -> Labels:
    """What frames say on their own."""
    return Labels.join(label_frames(model.likelihood, clouds.points))


def right(labels: Labels, clouds: Trial) -> float:
    """The part of the points that have their own name, sure enough; none may have another's."""
    marker = labels.sure(TARGET)
    assert (marker == clouds.truth)[marker >= 0].mean() > 0.997
    return float((marker == clouds.truth)[clouds.truth >= 0].mean())


def test_what_is_sure_names_the_rest_and_finds_the_marker_worn_elsewhere(model, clouds, alone):
    learned = finished(learn_subject(model.likelihood, clouds.points, alone))
    assert (alone.sure(TARGET) == RTHI).sum() < 0.2 * (clouds.truth == RTHI).sum()
    named = Labels.join(label_frames(learned, clouds.points))
    assert right(named, clouds) > 0.98 > 0.95 > right(alone, clouds)
    assert (named.sure(TARGET) == RTHI).sum() > 0.9 * (clouds.truth == RTHI).sum()


def test_the_pipeline_learns_where_nothing_connects_frames(model, clouds):
    points = clouds.points
    assert is_unordered(model, cut(points, HERTZ))
    work = label_take(anonymous(points, HERTZ), model, PointOptions("likelihood"))
    shares = []
    chunk = finished(work, lambda progress: shares.append(progress.fraction)).whole()
    assert shares == sorted(shares)
    marker = chunk.labels.marker
    assert (marker == clouds.truth)[clouds.truth >= 0].mean() > 0.98
    assert not any("behind a gap" in suspect.words for suspect in chunk.suspects)


@settings(max_examples=25)
@given(length=st.integers(1, 9), rate=st.integers(10, 240), in_order=st.booleans())
@example(length=2, rate=120, in_order=False)
@example(length=2, rate=120, in_order=True)
@example(length=4, rate=60, in_order=True)
def test_trajectories_of_few_frames_have_the_names_of_their_own_frames(model, odd_walk, length, rate, in_order):
    # Each trajectory is so many frames long and has a column of its own; they follow on each other, or in no order.
    generator = np.random.default_rng(length)
    starts = np.arange(0, 60, length)
    order = starts if in_order else generator.permutation(starts)
    pieces = [odd_walk[start : min(start + length, 60)] for start in order]
    points = np.full((60, 15 * len(pieces), 3), np.nan)
    truth, first = np.full(points.shape[:2], -1), 0
    for number, piece in enumerate(pieces):
        frames, columns = slice(first, first + len(piece)), slice(15 * number, 15 * (number + 1))
        marker = generator.permutation(15)
        points[frames, columns], truth[frames, columns] = piece[:, marker], marker
        first += len(piece)
    marker = labelled(points, float(rate), model).whole().labels.marker
    assert (marker == truth)[marker >= 0].mean() > 0.999
    assert (marker == truth)[truth >= 0].mean() > 0.99


def test_too_little_that_is_sure_leaves_the_training(model, clouds, alone):
    none = alone.kept(np.zeros(alone.marker.shape, dtype=bool))
    assert finished(learn_subject(model.likelihood, clouds.points, none)) is model.likelihood


def test_ghosts_are_no_marker_that_nobody_wears(model, odd_walk, monkeypatch):
    generator = np.random.default_rng(2)
    without = odd_walk.copy()
    without[:, RTHI] = np.nan
    clouds = make_trial(without, (2, 2), (3, 3), generator)
    alone = Labels.join(label_frames(model.likelihood, clouds.points))
    monkeypatch.setattr(unordered, "KEEPING_TRIALS", 1)
    learned = finished(learn_subject(model.likelihood, clouds.points, alone))
    marker = Labels.join(label_frames(learned, clouds.points)).sure(TARGET)
    assert (marker == RTHI).mean() < 0.005
