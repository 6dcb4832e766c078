# SPDX-License-Identifier: GPL-3.0-or-later
"""From labelled clouds to names; their likelihood against the dense formula; what distances cannot tell, sides do."""

from dataclasses import replace
from itertools import combinations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linear_sum_assignment

from addon.core.data.errors import InputError
from addon.core.geometry.upright import turned, upright_aligned
from addon.core.points.likelihood import solving
from addon.core.points.likelihood.distances import CONSTRAINING, learn_constraints, size_and_fit
from addon.core.points.likelihood.frames import label_frames, label_some
from addon.core.points.likelihood.learn import learn_likelihood, make_trial
from addon.core.points.likelihood.naming import IMPOSSIBLE, NO_POINT, name_worth, one_to_one, settle
from addon.core.points.likelihood.shape import Latent, learn_shape
from addon.core.points.likelihood.sides import heights, learn_sides
from addon.core.simulation.virtual import Act
from addon.demo.take import make_performance
from addon.io.markersets import open_markerset
from addon.io.models import open_model
from tests.core import scenes
from tests.core.points.rigid_bodies import plated
from tests.io.checks import refused

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


@pytest.mark.parametrize("legs", [True, False])
@pytest.mark.parametrize("size", [1.0, 1.1])
def test_half_a_body_is_named_of_a_tall_person_too(legs, size):
    """Among ghosts; its middle is not the cloud's, and a larger half is much like a smaller whole.

    By the likelihood of walkers alone, whom halves of a body are asked of.
    """
    model, generator = open_model("body39"), np.random.default_rng(1)
    likelihood = model.second
    below = {f"{side}{name}" for side in "LR" for name in ("ASI", "PSI", "THI", "KNE", "TIB", "ANK", "HEE", "TOE")}
    worn = np.array([at for at, name in enumerate(model.markerset.markers) if (name in below) is legs])
    points = np.repeat(size * likelihood.shape.mean[None, worn] + np.array([1.0, 2.0, 0.9]), 12, axis=0)
    ghosts = points.mean(axis=(0, 1)) + generator.normal(0, 0.6, (12, 4 * legs, 3))
    points = turned(np.concatenate([points, ghosts], axis=1), generator.uniform(-np.pi, np.pi, 12))
    given = label_some(likelihood, points + generator.normal(0, 0.01, points.shape)).marker[:, : len(worn)]
    assert (given == worn).mean() > 0.95


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


def test_what_has_no_other_side_by_name_and_is_worn_on_one_has_no_mirror_image():
    """A plate's corner at one hip: in a mirror it would be at the other."""
    points = walker(0)
    left, right = (points[:, NAMES.index(name)] for name in ("LASI", "RASI"))
    corner = right + 0.15 * (left - right)
    learned = learn_likelihood([(np.concatenate([points, corner[:, None]], axis=1), "she")], (*NAMES, "corner"))
    constraint = learned.constraints.joined(len(NAMES) + 1)[-1, [NAMES.index(name) for name in ("LASI", "RASI")]]
    true = [np.nanmedian(np.linalg.norm(corner - one, axis=1)) for one in (left, right)]
    assert learned.constraints.length[constraint] == pytest.approx(true, abs=0.01)


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
    refused("no frame shows half", learn_likelihood, [(np.full((5, len(NAMES), 3), np.nan), "a")], NAMES)
    refused("3 markers cannot be told apart", learn_likelihood, [(np.zeros((5, 3, 3)), "a")], NAMES[:3])
    with pytest.raises(InputError, match="no two markers keep their distance"):
        learn_likelihood([(np.random.default_rng(1).random((40, len(NAMES), 3)), "a")], NAMES)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("subjects", [1, 2])
def test_two_names_of_one_place_keep_no_distance(subjects):
    """Of the first subject; of another there are two places."""
    walkers = ((walker(1 + which), 0.02 * which) for which in range(subjects))
    clouds = [np.concatenate([cloud, cloud[:, :1] + apart], axis=1) for cloud, apart in walkers]
    found = learn_constraints(clouds, 0.5)
    assert (0, len(NAMES)) not in {tuple(pair) for pair in found.pair.tolist()}
    assert (found.length > 0).all()


def test_frames_without_points_get_no_names(likelihood):
    chunk = next(label_frames(likelihood, np.full((3, 5, 3), np.nan)))
    assert (chunk.marker == -1).all()
    assert (chunk.confidence == 0).all()


MARKERS = 7
NAMING = [0, 1, 2, 3, 4, NO_POINT, NO_POINT]


@pytest.fixture
def scene(monkeypatch):
    """A model, its ties and one frame whose yaw and size stand still, so that gains are exact."""
    rng = np.random.default_rng(0)
    base = rng.normal(size=(MARKERS, 3))
    swing = 0.1 * rng.normal(size=(200, 1, 3)) * rng.normal(size=(MARKERS, 3))
    clouds = base + swing + 0.02 * rng.normal(size=(200, MARKERS, 3))
    shape = learn_shape([clouds])
    constraints = replace(learn_constraints([clouds], shape.radius), size_sd=1e-12)
    assert len(constraints) > 0
    monkeypatch.setattr(CONSTRAINING, "max_cost", 1e9)
    monkeypatch.setattr(solving.SOLVING, "max_distance_radii", 20.0)
    points = upright_aligned(clouds[:1], shape.mean)
    points = np.concatenate([points, rng.normal(size=(1, 3, 3))], axis=1)
    model = Latent(shape)
    model.yaw_sd = 0.0

    def settled(named):
        return settle(model, constraints, points, np.ones((1, MARKERS + 3), dtype=bool), np.array([named]))

    return model, constraints, settled


def test_score_is_the_dense_gaussian(scene):
    model, constraints, settled = scene
    found = settled(NAMING)
    flat = model.columns.reshape(-1, model.size)
    covariance = flat @ flat.T + np.diag(np.repeat(model.noise, 3))
    known = slice(0, 15)
    offset = (found.points[0, :5] - model.mean[:5]).ravel()
    block = covariance[known, known]
    expected = -0.5 * offset @ np.linalg.solve(block, offset) - 0.5 * np.linalg.slogdet(block)[1]
    expected += 5 * name_worth(model, found.present)[0]
    expected += size_and_fit(constraints, found.points, found.naming)[1][0]
    assert found.score[0] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize(("marker", "point"), [(2, NO_POINT), (2, 8), (5, 7), (6, 9)])
def test_dropping_replacing_and_adding_gain_what_trying_gains(scene, marker, point):
    model, constraints, settled = scene
    before = settled(NAMING)
    tried = list(NAMING)
    tried[marker] = point
    odds = solving.alternatives(model, constraints, before).odds[0, marker]
    gain = (odds[point] if point >= 0 else 0) - (odds[NAMING[marker]] if NAMING[marker] >= 0 else 0)
    assert gain == pytest.approx(settled(tried).score[0] - before.score[0], abs=1e-4)


@pytest.mark.parametrize(
    ("way", "one", "other"),
    [
        *(("move", *pair) for pair in [(2, 5), (0, 6), (2, 1), (3, 4), (0, 3)]),
        *(("swap", *pair) for pair in [(3, 1), (4, 3), (4, 0), (2, 0)]),
    ],
)
def test_moving_and_swapping_gain_what_trying_gains(scene, way, one, other):
    model, constraints, settled = scene
    before = settled(NAMING)
    tried = list(NAMING)
    tried[one], tried[other] = tried[other] if way == "swap" else NO_POINT, tried[one]
    gain = getattr(solving.alternatives(model, constraints, before), way)[0, one, other]
    assert gain == pytest.approx(settled(tried).score[0] - before.score[0], rel=1e-6, abs=1e-4)


def made_up(seed: int) -> np.ndarray:
    """Odds (M, P), some impossible, many below 0; of some seeds whole numbers, of which many are equal."""
    rng = np.random.default_rng(seed)
    odds = rng.normal(rng.normal(), 3, rng.integers(1, 9, 2))
    odds[rng.random(odds.shape) < rng.random()] = IMPOSSIBLE
    return np.round(odds) if seed % 3 == 0 else odds


@settings(deadline=None, max_examples=300)
@given(st.integers(0, 10**6))
def test_the_total_is_the_highest_that_there_is(seed):
    odds = made_up(seed)
    naming = one_to_one(odds[None])[0]
    named = np.flatnonzero(naming != NO_POINT)
    assert len(set(naming[named].tolist())) == len(named)
    assert (odds[named, naming[named]] > 0).all()
    worth = np.maximum(odds, 0)
    best = worth[linear_sum_assignment(worth, maximize=True)].sum()
    assert odds[named, naming[named]].sum() == pytest.approx(best, abs=1e-6)


TARGET = 0.999
NEAR = 0.12  # m; markers farther apart do not merge
FRAMES = 8


@pytest.mark.parametrize("at", [0.5, 0.0])
def test_a_point_of_two_markers_is_either_of_them_or_nobody(at):
    known = open_model("body26")
    markers = np.arange(len(known.markerset))
    wrong = others = given = 0
    for seed in range(3):
        xyz = scenes.walker("body26", seed, [Act(1.0)])
        xyz = xyz[:: len(xyz) // FRAMES][:FRAMES]
        distance = np.median(np.linalg.norm(xyz[:, :, None] - xyz[:, None], axis=-1), axis=0)
        for one, two in combinations(markers, 2):
            if distance[one, two] > NEAR:
                continue
            merged = xyz.copy()
            merged[:, one] += at * (xyz[:, two] - xyz[:, one])
            merged[:, two] = np.nan
            [named] = label_frames(known.likelihood, merged)
            sure = named.sure(TARGET)
            wrong += int(((sure[:, one] >= 0) & ~np.isin(sure[:, one], [one, two])).sum())
            rest = np.setdiff1d(markers, [one, two])
            others += int(((sure[:, rest] >= 0) & (sure[:, rest] != rest)).sum())
            given += int((sure[:, rest] >= 0).sum())
    assert given > 1000
    assert wrong == 0
    assert others <= 0.001 * given


# An elbow, thumb's and little finger's side of a wrist as far from it, and the back of the hand as far from both.
FOREARM = np.array([[0, 0, 0], [0.25, 0.03, 0], [0.25, -0.03, 0], [0.32, 0, 0.04]])
EXCHANGED = [0, 2, 1, 3]


def voices(sides, points, layout_m):
    """What the sides of all markers in points (T, M, 3) say together, each marker with one voice."""
    height = np.nanmean(heights(points[:, sides.markers]), axis=0)
    return (sides.odds(height, 1.0, layout_m) * sides.share(np.isfinite(height)[None])[0]).sum()


def as_people(points):
    """Five people (5, 40, M, 3) m whose points turn about all axes, with some noise."""
    rng = np.random.default_rng(3)
    turns = np.linalg.qr(rng.normal(size=(5, 40, 3, 3)))[0]
    turns[np.linalg.det(turns) < 0] *= -1
    return points @ turns.swapaxes(2, 3) + 0.004 * rng.normal(size=(5, 40, points.shape[-2], 3))


@pytest.fixture
def forearms():
    return as_people(FOREARM)


def test_a_height_is_over_the_plane_of_the_others_by_the_right_hand():
    plane = np.array([[0.2, 0.1, 0.3], [0, 0, 0], [1, 0, 0], [0, 2, 0]])
    assert heights(plane) == pytest.approx(0.3)
    assert heights(plane[[0, 1, 3, 2]]) == pytest.approx(-0.3)
    assert np.isnan(heights(np.where(np.arange(4)[:, None] == 2, np.nan, plane)))
    assert np.isnan(heights(plane[[0, 1, 2, 2]]))


def test_two_markers_that_are_as_far_from_all_else_are_told_apart(forearms):
    sides = learn_sides(list(forearms[:4]), 0.2)
    assert set(sides.markers[:, 0]) == {0, 1, 2, 3}
    right, wrong = (voices(sides, forearms[4][:, names], 0.01) for names in ([0, 1, 2, 3], EXCHANGED))
    assert right > 2 > 0 > -5 > wrong
    assert right <= 4 * np.log(2)


def test_who_is_out_of_sight_says_nothing(forearms):
    sides = learn_sides(list(forearms), 0.2)
    assert sides.odds(np.full(len(sides), np.nan), 1.0, 0.04) == pytest.approx(0)
    hidden = forearms.copy()
    hidden[:, :, 2] = np.nan
    assert not len(learn_sides(list(hidden), 0.2))


def test_a_foot_that_bends_has_an_inner_side_as_its_shank_is_always_above():
    heel, inner, outer = [0, 0, 0], [0.17, 0.05, 0], [0.17, -0.05, 0]
    leg = np.tile([heel, inner, outer, [0.05, 0, 0.3]], (5, 40, 1, 1))
    leg[:, :, 3] += 0.06 * np.random.default_rng(1).normal(size=(5, 40, 3))
    people = as_people(leg)
    sides = learn_sides(list(people[:4]), 0.2)
    assert set(sides.markers[:, 0]) == {0, 1, 2, 3}
    right, wrong = (voices(sides, people[4][:, names], 0.04) for names in ([0, 1, 2, 3], EXCHANGED))
    assert right > 1 > -3 > wrong


def test_who_stands_still_and_shows_half_at_a_time_has_no_marker_beside_itself():
    still = np.tile(np.random.default_rng(0).normal(size=(8, 3)) * (0.2, 0.3, 0.5), (120, 1, 1))
    still[:60, 5:] = still[60:, :3] = np.nan
    markers = learn_sides([still], 0.5).markers
    assert len(markers) and all(len(set(four)) == 4 for four in markers.tolist())


def test_what_bends_between_them_has_no_side(forearms):
    forearms[:, :, 3] += np.random.default_rng(0).normal(size=(5, 40, 3))
    assert not len(learn_sides(list(forearms), 0.2))


@pytest.mark.parametrize("pair", [("LWRA", "LWRB"), ("RWRA", "RWRB"), ("LASI", "RASI"), ("LFHD", "RFHD")])
def test_a_built_in_set_knows_which_side_is_which_on_the_demo(pair):
    model = open_model("body26")
    sides, names = model.learned_likelihood.sides, list(model.markerset.markers)
    points = make_performance(open_markerset("body26")).take.xyz[:60].astype(float)
    exchanged = np.arange(len(names))
    exchanged[[names.index(name) for name in pair]] = [names.index(name) for name in pair[::-1]]
    right, wrong = (voices(sides, some, 0.04) for some in (points, points[:, exchanged]))
    assert right - wrong > 1
