# SPDX-License-Identifier: GPL-3.0-or-later
"""Finding a person from nothing but blobs, how sure each label is, and the second thoughts that give names back."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from addon.core.blobs.confidence import CONFIDENCE, named_confidences, swap_doubts
from addon.core.blobs.jointly import name_jointly
from addon.core.blobs.search import HELD, Hints, find_subject, first_starts, settle, with_arms_held
from addon.core.blobs.subject import Setup, refit, standing_exchanges
from addon.core.blobs.swaps import Swaps, swap_names, without_own
from addon.core.body.bodies import BodyModel
from addon.core.body.prior import Prior
from addon.core.data.takes import CONFLICT, EXCLUSIVE, REMAINING
from addon.core.geometry.views import Sight, split_views
from addon.core.papers.virtual_occlusions.cloud import build_cloud
from addon.core.papers.virtual_occlusions.labelling import Frame, Naming, Rules, name_markers
from addon.core.simulation.rigs import paper_rig, ring_rig
from addon.core.simulation.simulate import CaptureOptions
from tests.core.papers.virtual_occlusions.test_labelling import consistent, expect_at
from tests.core.scenes import CLEAN, FLAWLESS, blobs_at, built_in, film, person_of, stand

PLAIN = CaptureOptions(noise=0.3, reflections=0, flicker=0.0)
ROOM = CaptureOptions(noise=0.5, reflections=2, flicker=0.5)
BLURRED = CaptureOptions(noise=2.0, reflections=2, flicker=0.5)


@cache
def found_in(name, seed, facing, height, cameras=4):
    generator = np.random.default_rng(seed)
    rig = paper_rig(generator) if cameras == 4 else ring_rig(cameras, generator=generator)
    scene = stand(built_in(name), rig, seed, facing, height, PLAIN)
    return scene, find_subject(scene.views()[0], Setup.of(rig, scene.markerset), Hints())


def marked(scene, found):
    """Which blobs are right, and which have a name, row for row with the scene's blobs."""
    row, good = scene.given(found.naming.frame.view, found.naming)
    right, given = scene.truth == "", np.zeros(len(scene.blobs), bool)
    right[row], given[row] = good, True
    return right, given


def turn_off(scene, found):
    """Angle between the way the person faces and the way we think, rad."""
    facing, truth = (2 * np.arctan2(*one.quaternion[0, [3, 0]]) for one in (found.subject.bodies, scene.bodies))
    return abs((facing - truth + np.pi) % (2 * np.pi) - np.pi)


@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_through_360_degrees_and_from_1_1_to_2_metres(name):
    """A2, A3, A24, A30: no hints, every facing, children to giants, in the paper's rig put up by hand."""
    perfect, wrong, named = 0, 0, 0
    for number in range(12):
        scene, found = found_in(name, number, number * np.pi / 6, 1.1 + 0.9 * ((5 * number) % 12) / 11)
        right, given = marked(scene, found)
        perfect += right.all()
        wrong += (given & ~right).sum()
        named += given.sum()
        assert turn_off(scene, found) < np.radians(25)
        distance = found.expected.points - scene.points[0]
        assert np.median(np.linalg.norm(distance, axis=1)) < 0.02
    assert perfect >= 11
    assert wrong <= 0.005 * named


@pytest.mark.parametrize("cameras", [2, 3, 6, 12])
def test_any_number_of_cameras(cameras):
    """A25: from two cameras to twelve; fewer name less, but hardly wrong."""
    scene, found = found_in("gait15", 5, 1.0, 1.7, cameras)
    right, given = marked(scene, found)
    assert right[given].mean() > 0.95
    assert right.mean() > (0.6 if cameras == 2 else 0.9)


def by_step(name, options, rules=None, people=20):
    """Labels of each step (4,), and those of them that are right, over so many people in hand-made rigs."""
    all_of, right_of = np.zeros((2, 4))
    for number in range(people):
        rig = paper_rig(np.random.default_rng(number + 40))
        scene = stand(built_in(name), rig, number + 40, number * 0.8, 1.2 + 0.1 * (number % 8), options)
        found = find_subject(scene.views()[0], replace(Setup.of(rig, scene.markerset), rules=rules or Rules()), Hints())
        step = found.naming.step[found.naming.slot >= 0]
        np.add.at(all_of, step, 1)
        np.add.at(right_of, step, scene.given(found.naming.frame.view, found.naming)[1])
    return all_of, right_of


@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_no_step_is_wrong_in_a_plain_room(name):
    """A28: each of the three steps on its own, and each has something to say."""
    all_of, right_of = by_step(name, ROOM)
    assert all_of[0] == 0 and (all_of[1:] >= 5).all()
    assert all_of[EXCLUSIVE] > 20 * (all_of[CONFLICT] + all_of[REMAINING])
    assert right_of[EXCLUSIVE] == all_of[EXCLUSIVE]
    assert right_of[CONFLICT] >= 0.95 * all_of[CONFLICT]
    assert right_of[REMAINING] >= 0.95 * all_of[REMAINING]


@pytest.mark.parametrize("name", ["gait15", "body26"])
def test_step_1_stays_right_where_the_later_steps_err(name):
    """A28: with blobs off by 2 px, steps 2 and 3 are right in most cases, step 1 in all but one in 500.

    What keeps it right is that it leaves to step 2 what a second marker would fit nearly as well.
    """
    all_of, right_of = by_step(name, BLURRED, people=100)
    wrong = all_of - right_of
    assert all_of[CONFLICT] >= 150 and all_of[REMAINING] >= 75
    assert wrong[EXCLUSIVE] <= 0.002 * all_of[EXCLUSIVE]
    assert 15 <= wrong[CONFLICT] <= 0.3 * all_of[CONFLICT]
    assert 10 <= wrong[REMAINING] <= 0.3 * all_of[REMAINING]
    hasty, right_of_hasty = by_step(name, BLURRED, Rules(min_lead=0.0), people=100)
    assert (hasty - right_of_hasty)[EXCLUSIVE] > wrong[EXCLUSIVE]


def test_a_rival_that_fits_as_well_lowers_the_confidence():
    """Knees and ankles alone could face either way, left being right: never sure."""
    markerset, rig = built_in("gait15"), paper_rig()
    scene = stand(markerset, rig, 8, options=CLEAN)
    kept = [markerset.index(name) for name in ("RKNE", "LKNE", "RANK", "LANK")]
    view = split_views(blobs_at(list(rig.project(scene.points[0, kept]))), rig)[0]
    found = find_subject(view, Setup.of(rig, markerset), Hints())
    assert found is None or found.confidence < 0.9


def test_hints_narrow_the_search():
    """A hinted facing is started from and preferred, a hinted height is started from and held."""
    scene, _ = found_in("gait15", 2, 1.0, 1.3)
    setup = Setup.of(scene.cameras, scene.markerset)
    view = scene.views()[0]
    cloud = build_cloud(view, setup.sight)
    starts = first_starts(view, cloud, setup, Hints(1.3, 1.0))
    facing = 2 * np.arctan2(starts.quaternion[:, 3], starts.quaternion[:, 0])
    assert facing[-1] == pytest.approx(1.0)
    assert starts.scale == pytest.approx(np.full((len(starts), 3), 1.3))
    found = find_subject(view, setup, Hints(1.3, 1.0))
    right, _ = marked(scene, found)
    assert right.all() and turn_off(scene, found) < np.radians(25)


@pytest.mark.parametrize(("taller", "degrees"), [(0.0, 180), (0.2, -20), (0.2, 20)])
def test_a_hint_may_be_off_and_does_not_turn_the_subject_round(taller, degrees):
    """A21: off by 20° and a hand, the paper's tolerance for a start; and a hint to the wrong side is no order."""
    scene, _ = found_in("body26", 4, 2.0, 1.6)
    hints = Hints(1.6 + taller, 2.0 + np.radians(degrees))
    right, _ = marked(scene, find_subject(scene.views()[0], Setup.of(scene.cameras, scene.markerset), hints))
    assert right.mean() > 0.97


@pytest.mark.parametrize("count", [0, 1, 3])
def test_nobody_where_there_are_no_blobs(count):
    rig = paper_rig()
    pixels = [np.random.default_rng(c).uniform(50, 400, (count, 2)) for c in range(4)]
    assert find_subject(split_views(blobs_at(pixels), rig)[0], Setup.of(rig, built_in("gait15")), Hints()) is None


RIG = paper_rig()
SIGHT = Sight(RIG)


def one_blob(rival_at, visible=True, taken=False):
    """Confidence of the one blob of marker 0 in camera 0; a second marker is expected `rival_at` m beside it."""
    points = np.array([[0, 0, 1.0], [0, 0, 1.0 + rival_at]])
    pixels = [RIG.project(points)[0, :2] if taken else RIG.project(points)[0, :1]] + [np.zeros((0, 2))] * 3
    view = split_views(blobs_at(pixels), RIG)[0]
    shown = np.array([True, visible])
    naming = Naming.empty(Frame(view, SIGHT, expect_at(points, 0.02, shown), Rules()))
    naming.give(np.array([0]), np.array([0]), np.array([0]), EXCLUSIVE)
    if taken:
        naming.give(np.array([0]), np.array([1]), np.array([1]), EXCLUSIVE)
    return named_confidences(naming, CONFIDENCE)[0, 0]


def test_doubts_of_twins_strangers_and_exchanges():
    assert one_blob(0.0) == pytest.approx(0.5)
    assert one_blob(0.5) == pytest.approx(1)
    assert one_blob(0.02, visible=False) > one_blob(0.02)
    assert one_blob(0.02, taken=True) == pytest.approx(1)
    swaps = Swaps(np.array([[1, 0, 2, 3], [0, 2, 1, 3]]), np.array([0.0, 20.0]))
    assert swap_doubts(swaps, 4) == pytest.approx([0.5, 0.5, 1 / (1 + np.exp(-10)), 1])
    assert (swap_doubts(Swaps(np.zeros((0, 3), int), np.zeros(0)), 3) == 1).all()
    assert swap_doubts(Swaps(np.array([[1, 0]]), np.array([-1e9])), 2) == pytest.approx([0, 0])


def test_limbs_are_exchanged_of_a_set_whose_names_show_no_sides():
    named = built_in("body26")
    plain = replace(named, markers=tuple(name.lower() for name in named.markers))
    np.testing.assert_array_equal(standing_exchanges(plain), standing_exchanges(named))


def test_wrong_labels_are_less_sure_than_right_ones():
    """The confidence ranks: over scenes with close markers and a model a little off, wrong names come last."""
    right, wrong = [], []
    for seed in range(60):
        generator = np.random.default_rng(seed)
        points = generator.uniform([-0.15, -0.15, 0.9], [0.15, 0.15, 1.2], (10, 3))
        rows = [np.flatnonzero(generator.random(10) < 0.7) for _ in range(4)]
        pixels = [image[kept] for image, kept in zip(RIG.project(points), rows, strict=True)]
        expected = expect_at(points + generator.normal(0, 0.01, points.shape), 0.01)
        naming = name_markers(split_views(blobs_at(pixels), RIG)[0], SIGHT, expected, Rules())
        camera, marker = np.nonzero(naming.slot >= 0)
        sure = named_confidences(naming, CONFIDENCE)[camera, marker]
        for c, m, chance in zip(camera, marker, sure, strict=True):
            (right if rows[c][naming.slot[c, m]] == m else wrong).append(chance)
    assert 0 < len(wrong) < 0.05 * len(right)
    assert np.mean(right) > np.mean(wrong)


RING = ring_rig(8)


@cache
def case(name="body26", seed=2, rig=RIG):
    scene = stand(built_in(name), rig, seed, facing=0.8, options=FLAWLESS)
    setup = Setup.of(rig, scene.markerset)
    return scene, setup, find_subject(scene.views()[0], setup, Hints())


def true_naming(scene, found):
    """Every blob named as it really is."""
    view, names = scene.views()[0], list(scene.markerset.markers)
    naming = Naming.empty(Frame(view, found.naming.frame.sight, found.expected, found.naming.frame.rules))
    for camera, slot in np.argwhere(view.real):
        marker = names.index(scene.truth[view.row[camera, slot]].split("|")[0])
        naming.give(np.array([camera]), np.array([marker]), np.array([slot]), EXCLUSIVE)
    return naming


def fitted(scene, setup, found, naming):
    subject = without_own(found.subject, setup)
    prior = Prior(setup.model, upright_sd=0.35)
    subject, state = refit(naming, subject, setup, 4, prior)
    return subject, state, prior


def order_of(scene, *pairs):
    """The exchange of pairs of markers, "A-B" each."""
    order = np.arange(len(scene.markerset))
    for pair in pairs:
        first, second = (scene.markerset.index(name) for name in pair.split("-"))
        order[first], order[second] = second, first
    return order


LEGS, APART = ("LKNE-RKNE", "LANK-RANK", "LHEE-RHEE", "LTOE-RTOE"), ("LFHD-RFHD", "LWRA-LFIN", "RWRA-RFIN")


@pytest.mark.parametrize("names", [("LFHD-RFHD",), ("LWRA-LFIN",), ("LANK-LHEE",), LEGS, APART])
def test_swapped_neighbours_get_their_names_back(names):
    scene, setup, found = case()
    naming = true_naming(scene, found)
    right = naming.slot.copy()
    swap_names(naming, order_of(scene, *names))
    subject, state, prior = fitted(scene, setup, found, naming)
    swaps = settle(naming, subject, state, setup, prior)
    assert np.array_equal(consistent(naming).slot, right)
    assert swaps.loss.min() >= 0, (swaps.orders[swaps.loss < 0], swaps.loss.min())


def test_of_too_few_markers_for_a_body_nothing_is_exchanged():
    scene, setup, found = case()
    naming = true_naming(scene, found)
    camera, marker = np.nonzero(naming.slot >= 0)
    naming.withdraw(camera[1:], marker[1:])
    subject, state, prior = fitted(scene, setup, found, naming)
    assert not len(settle(naming, subject, state, setup, prior).orders)


def test_neighbours_of_a_marker_that_was_never_put_on_get_their_names_back():
    """One of the head's four is not there; another has its name, and a single blob of a third is named as that one."""
    scene, setup, found = case(rig=RING)
    naming = true_naming(scene, found)
    absent, beside, behind = (scene.markerset.index(name) for name in ("RFHD", "LFHD", "LBHD"))
    view = naming.frame.view
    camera = np.flatnonzero(naming.slot[:, absent] >= 0)
    gone = view.real.copy()
    gone[camera, naming.slot[camera, absent]] = False
    naming.withdraw(camera, np.full(len(camera), absent))
    view = replace(view, real=gone)
    right = naming.slot.copy()
    swap_names(naming, order_of(scene, "LFHD-RFHD"))
    cameras = np.flatnonzero((naming.slot[:, behind] >= 0) & (naming.slot[:, beside] < 0))
    camera = cameras[:1]
    assert len(cameras) >= 3  # so that two are left, which fix the point
    slot = naming.slot[camera, behind]
    naming.withdraw(camera, np.array([behind]))
    naming.give(camera, np.array([beside]), slot, EXCLUSIVE)
    subject, state, prior = fitted(scene, setup, found, naming)
    settle(naming, subject, state, setup, prior)
    right[camera, behind] = -1
    assert np.array_equal(consistent(naming).slot[:, [absent, beside, behind]], right[:, [absent, beside, behind]])


FOUR = ring_rig(4, generator=np.random.default_rng(5))


def standing(arms=None, moved=(), seed=4, options=ROOM):
    """Somebody in `body26`, the arms held in one of the ways `HELD`, with markers worn (name, offset m) elsewhere."""
    markerset = built_in("body26")
    model = BodyModel(markerset)
    person = person_of(markerset, seed, 1.75)
    if arms is not None:
        person = with_arms_held(person, model).pick([1 + arms])
    own = person.own.copy()
    for name, offset in moved:
        own[0, markerset.index(name)] += np.array(offset) / 1.75
    return film(markerset, FOUR, replace(person, own=own), replace(options, seed=seed))


def wrong_in(scene, naming):
    """Blobs with a name that is not theirs, and blobs of markers without one."""
    view = scene.views()[0]
    row, right = scene.given(view, naming)
    return (~right).sum(), (scene.truth[np.setdiff1d(view.row[view.real], row)] != "").sum()


def test_a_marker_worn_elsewhere_is_named_and_said_to_be():
    scene = standing(moved=[("LWRB", (0.0, 0.0, -0.11))])
    model, sight = BodyModel(scene.markerset), Sight(FOUR)
    points = model.pose(replace(scene.bodies, own=0 * scene.bodies.own)).markers[0]
    inside = sight.inside(sight.image(sight.local(points[None])))[0]
    naming, elsewhere = name_jointly(Frame(scene.views()[0], sight, expect_at(points, 0.015, inside), Rules(pixel=0.5)))
    marker = scene.markerset.index("LWRB")
    named = [scene.truth[scene.views()[0].row[c, k]] for c, k in enumerate(naming.slot[:, marker]) if k >= 0]
    assert len(named) >= 2 and all("LWRB" in one.split("|") for one in named)
    assert elsewhere[marker]


@pytest.mark.parametrize("arms", np.flatnonzero(~HELD[:, 1].any(axis=1)).tolist())
def test_stretched_arms_are_found_wherever_they_point(arms):
    scene = standing(arms, seed=arms)
    found = find_subject(scene.views()[0], Setup.of(FOUR, scene.markerset), Hints(), alone=True)
    wrong, missed = wrong_in(scene, found.naming)
    assert wrong <= 1 and missed <= 2


def test_of_many_cameras_neighbours_do_not_crowd_out_a_marker():
    cameras, markerset = ring_rig(20, generator=np.random.default_rng(5)), built_in("gait15")
    scene = film(markerset, cameras, person_of(markerset, 2, 1.75), replace(ROOM, reflections=0, seed=2))
    found = find_subject(scene.views()[0], Setup.of(cameras, markerset), Hints(), alone=True)
    assert wrong_in(scene, found.naming) == (0, 0)
