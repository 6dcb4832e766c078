# SPDX-License-Identifier: GPL-3.0-or-later
"""Virtual people: they stand on the floor, walk where they face, swing their arms, and are people of the marker set."""

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.simulation.virtual import DEMO, Act, draw_person, perform
from tests.core.toybody import toy_markerset

MARKERSET = toy_markerset()
MODEL = BodyModel(MARKERSET)
RATE = 60.0


def person(seed=0):
    return draw_person(MARKERSET, np.random.default_rng(seed))


def soles(bodies):
    """(T, 4, 3) heel and toe of the left foot, then of the right, on the underside of their capsules."""
    capsules, posed = MARKERSET.capsules, MODEL.pose(bodies)
    points = []
    for side in "LR":
        foot = MARKERSET.skeleton.segments.index(f"foot.{side}")
        for end in (capsules.start[foot], capsules.end[foot]):
            at = posed.joints[:, foot] + posed.rotations[:, foot] @ (end * bodies.scale[0])
            points.append(at - [0, 0, capsules.radius[foot] * bodies.scale[0].mean()])
    return np.stack(points, axis=1)


def marker(bodies, name):
    return MODEL.pose(bodies).markers[:, MARKERSET.index(name)]


@pytest.fixture(scope="module")
def walk():
    return perform(MODEL, person(), [Act(1), Act(4, stride=1.0), Act(1)], RATE, facing=0.5)


def test_people_differ_as_much_as_the_marker_set_says_and_those_of_one_seed_not_at_all():
    people = [person(seed) for seed in range(300)]
    heights = np.array([one.scale.mean() for one in people])
    assert heights.mean() == pytest.approx(MARKERSET.spread.height, abs=0.02)
    assert heights.std() == pytest.approx(MARKERSET.spread.height_sd, rel=0.2)
    assert np.std([one.shape[0, 0] for one in people]) == pytest.approx(0.9, abs=0.15)
    off = np.array([np.linalg.norm(one.own[0], axis=1) for one in people])
    assert np.sqrt((off**2).mean(axis=0)) == pytest.approx(MARKERSET.spread.marker_sd, rel=0.15)
    assert np.array_equal(person(3).own, person(3).own)
    one, two = (perform(MODEL, person(), DEMO, RATE, seed=4) for _ in range(2))
    assert np.array_equal(one.bends, two.bends)
    assert not np.array_equal(one.bends, perform(MODEL, person(), DEMO, RATE, seed=5).bends)


@pytest.mark.parametrize("rate", [30.0, 100.0, 59.94])
def test_a_performance_lasts_as_long_as_its_acts(rate):
    bodies = perform(MODEL, person(), DEMO, rate)
    assert len(bodies) == round(sum(act.seconds for act in DEMO) * rate)
    assert all(np.isfinite(getattr(bodies, name)).all() for name in type(bodies).__dataclass_fields__)
    assert np.linalg.norm(bodies.quaternion, axis=1) == pytest.approx(np.ones(len(bodies)))


def test_someone_always_stands_on_the_floor_does_not_slide_and_walks_the_way_they_face(walk):
    lowest = soles(walk)[..., 2].min(axis=1)
    assert lowest.min() > -0.015
    assert lowest.max() < 0.02
    points = soles(walk)
    speed = np.linalg.norm(np.diff(points[..., :2], axis=0), axis=-1) * RATE
    # In every frame some part of a sole is as good as still, while the body goes at a walking pace.
    assert np.percentile(speed.min(axis=1), 90) < 0.2
    travelled = np.linalg.norm(walk.translation[-1, :2] - walk.translation[0, :2])
    assert 0.7 < travelled / 4 < 1.6
    way = walk.translation[-1, :2] - walk.translation[0, :2]
    assert np.arctan2(way[1], way[0]) == pytest.approx(0.5, abs=0.15)
    assert np.abs(walk.translation[0, :2] + walk.translation[-1, :2]).max() < 0.3


def test_raised_arms_are_above_the_head_and_turns_turn():
    bodies = perform(MODEL, person(), [Act(1), Act(2, left=1.0), Act(2, turn=np.pi / 2), Act(1)], RATE)
    up = int(2.0 * RATE)
    assert marker(bodies, "LWRA")[up, 2] > marker(bodies, "LFHD")[up, 2]
    assert marker(bodies, "RWRA")[up, 2] < marker(bodies, "LASI")[up, 2] + 0.1
    hips = marker(bodies, "LASI") - marker(bodies, "RASI")
    facing = np.unwrap(np.arctan2(-hips[:, 0], hips[:, 1]))
    assert facing[-1] - facing[0] == pytest.approx(np.pi / 2, abs=0.1)


def test_a_marker_set_without_legs_is_told_so():
    from dataclasses import replace

    skeleton = replace(
        MARKERSET.skeleton, segments=tuple(name.replace("L", "X") for name in MARKERSET.skeleton.segments)
    )
    legless = replace(MARKERSET, skeleton=skeleton)
    with pytest.raises(ValueError, match=r"foot\.L"):
        perform(BodyModel(legless), draw_person(legless, np.random.default_rng(0)), DEMO, RATE)
