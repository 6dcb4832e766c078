# SPDX-License-Identifier: GPL-3.0-or-later
"""Feet of a posed body on the ground, on a walk whose floor and plants are known."""

import subprocess
import sys

import numpy as np
import pytest

from addon.core.data.errors import InputError
from addon.core.filling.ground import _knees, settled
from addon.core.geometry import rotations

RATE = 100.0
SEGMENTS = ("pelvis", "thorax", "thigh.L", "shank.L", "foot.L", "thigh.R", "shank.R", "foot.R")
PARENTS = (-1, 0, 0, 2, 3, 0, 5, 6)
THIGH, SHANK, ANKLE, STEP = 0.42, 0.40, 0.08, 0.35
LEG = [[0, 0, -THIGH], [0, 0, -SHANK]]
OFFSETS = np.array([[0, 0, 0], [0, 0, 0.2], [0, 0.09, 0], *LEG, [0, -0.09, 0], *LEG])
TIP = np.array([0.16, 0.0, -ANKLE])
ENDS = np.zeros((len(SEGMENTS), 3))
ENDS[[4, 7]] = TIP
FEET, STRIDE, STANCE = (4, 7), 110, 66  # frames of a stride, and in which a foot is planted


def about_y(angle: np.ndarray) -> np.ndarray:
    return rotations.turn_of(np.multiply.outer(angle, [0.0, 1.0, 0.0]))


def chained(root: np.ndarray, turns: np.ndarray) -> np.ndarray:
    joints = np.empty((*turns.shape[:2], 3))
    for at, above in enumerate(PARENTS):
        joints[:, at] = root if above < 0 else joints[:, above] + turns[:, above] @ OFFSETS[at]
    return joints


def bend_leg(turns: np.ndarray, root: np.ndarray, foot: int, x: np.ndarray, z: np.ndarray):
    """Turns thigh and shank so that the ankle is at x and z (F,) m."""
    ahead, down = x - root[:, 0], root[:, 2] - z
    far = np.hypot(ahead, down)
    hip = np.arccos((THIGH**2 + far**2 - SHANK**2) / (2 * THIGH * far))
    knee = np.arccos((THIGH**2 + SHANK**2 - far**2) / (2 * THIGH * SHANK))
    thigh = -(np.arctan2(ahead, down) + hip)
    turns[:, foot - 2], turns[:, foot - 1] = about_y(thigh), about_y(thigh + np.pi - knee)


def walk(strides: int = 5, rise: float = 0.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joints and rotations of a walk along x, on stairs if so, and (F, 2) whether left and right are planted."""
    frames = np.arange(strides * STRIDE)
    turns = np.tile(np.eye(3), (len(frames), len(SEGMENTS), 1, 1))
    root = np.zeros((len(frames), 3))
    root[:, 0], root[:, 2] = 2 * STEP * frames / STRIDE, 0.84 + rise * (frames / STRIDE - 0.5)
    planted = np.empty((len(frames), 2), bool)
    for side, foot in enumerate(FEET):
        phase, number = (frames + side * STRIDE // 2) % STRIDE, (frames + side * STRIDE // 2) // STRIDE
        planted[:, side] = phase < STANCE
        swing = np.clip((phase - STANCE) / (STRIDE - STANCE), 0, 1)
        x = 2 * STEP * (number + swing * swing * (3 - 2 * swing) - side / 2) + STEP * STANCE / STRIDE
        z = ANKLE + 0.07 * np.sin(np.pi * swing) ** 2 + rise * (number + swing - side / 2)
        bend_leg(turns, root, foot, x, z)
    return chained(root, turns), turns, planted


def wavering(**walking) -> tuple[np.ndarray, ...]:
    """A walk as posed on markers: slowly off by 0.3°, feet by 1.5°, as skin moves, with noise, and 12 mm low.

    Its joints and turns, where joints are in truth, and which feet are planted.
    """
    right, turns, planted = walk(**walking)
    rng, count, root = np.random.default_rng(0), len(turns), right[:, 0]
    slow = np.cumsum(rng.normal(0, 1, (count, len(SEGMENTS), 3)), axis=0)
    slow -= np.linspace(0, 1, count)[:, None, None] * slow[-1]
    slow *= np.radians(0.3) / slow.std(axis=0)
    slow[:, FEET] *= 5
    off = slow + rng.normal(0, np.radians(0.1), slow.shape)
    turned = turns @ rotations.turn_of(off)
    return chained(root + rng.normal(0, 0.0005, root.shape) - [0, 0, 0.012], turned), turned, right, planted


def points_of(joints: np.ndarray, turns: np.ndarray, side: int) -> np.ndarray:
    """(F, 3, 3) ankle, ball and tip of a foot."""
    foot = FEET[side]
    return joints[:, foot, None] + np.stack([turns[:, foot] @ (part * TIP) for part in (0.0, 0.87, 1.0)], axis=1)


def slides(joints: np.ndarray, turns: np.ndarray, planted: np.ndarray) -> np.ndarray:
    """How far ankle and ball go in each plant but its first and last 0.05 s, m."""
    found = []
    for side in (0, 1):
        edges = np.flatnonzero(np.diff(np.r_[0, planted[:, side], 0])).reshape(-1, 2)
        for start, stop in np.add(edges, [5, -5]).tolist():
            part = points_of(joints, turns, side)[start:stop, :2, :2]
            found += np.linalg.norm(np.ptp(part, axis=0), axis=1).tolist()
    return np.array(found)


def lowest(joints: np.ndarray, turns: np.ndarray) -> np.ndarray:
    return np.min([points_of(joints, turns, side)[..., 2].min(axis=1) for side in (0, 1)], axis=0)


def test_planted_feet_hold_still_on_the_floor_and_nothing_else_changes():
    joints, turned, right, planted = wavering()
    assert np.median(slides(joints, turned, planted)) > 0.008
    assert (lowest(joints, turned) < -0.005).mean() > 0.5
    now, after = settled(joints, turned, SEGMENTS, PARENTS, ENDS, RATE)
    held = slides(now, after, planted)
    assert np.median(held) < 0.001
    assert np.quantile(held, 0.99) < 0.002
    assert (lowest(now, after) < -0.002).mean() < 0.01
    # Nearer to the truth than it was posed, by no jumps, and with legs of the same length.
    for foot in FEET:
        off, was = (np.linalg.norm(one[:, foot] - right[:, foot], axis=1) for one in (now, joints))
        assert off.mean() < was.mean()
    jumps, jumped = (np.linalg.norm(np.diff(one[:, FEET], 2, axis=0), axis=2).max() for one in (now, joints))
    assert jumps < jumped
    for at, above in enumerate(PARENTS[1:], 1):
        lengths = np.linalg.norm(now[:, at] - now[:, above], axis=1)
        np.testing.assert_allclose(lengths, np.linalg.norm(OFFSETS[at]), atol=1e-9)
    np.testing.assert_array_equal(after[:, :2], turned[:, :2])
    np.testing.assert_allclose(after.swapaxes(-1, -2) @ after, np.broadcast_to(np.eye(3), after.shape), atol=1e-9)


@pytest.mark.parametrize(("higher", "rests"), [(0.012, 0.0), (0.045, 0.045)])
def test_balls_of_planted_feet_are_equally_high_but_not_on_a_step(higher, rests):
    joints, turns, _ = walk()
    raised = joints + (np.arange(len(joints)) >= 3 * STRIDE + STANCE)[:, None, None] * [0, 0, higher]
    now, after = settled(raised, turns, SEGMENTS, PARENTS, ENDS, RATE)
    balls = points_of(now, after, 0)[:, 1, 2]
    np.testing.assert_allclose(balls[4 * STRIDE + 20 : 4 * STRIDE + 40] - balls[30], rests, atol=0.002)


def test_feet_hold_still_on_stairs():
    joints, turned, _, planted = wavering(rise=0.25)
    assert np.median(slides(joints, turned, planted)) > 0.008
    held = slides(*settled(joints, turned, SEGMENTS, PARENTS, ENDS, RATE), planted)
    assert np.quantile(held, 0.95) < 0.001
    planted[: STRIDE // 2] = False  # who stands beside a foot that goes is known, but not before one went
    assert slides(*settled(joints, turned, SEGMENTS, PARENTS, ENDS, RATE), planted).max() < 0.002


def test_what_stands_well_already_stays_as_it_is():
    joints, turns, _ = walk()
    now, after = settled(joints, turns, SEGMENTS, PARENTS, ENDS, RATE)
    np.testing.assert_allclose(now, joints, atol=1e-3)
    np.testing.assert_allclose(after, turns, atol=0.02)


def test_a_foot_that_is_held_up_a_floor_elsewhere_and_a_world_on_its_side():
    _, turns, _ = walk(2)
    turns[:] = turns[0]  # somebody stands with a knee up, and sways
    turns[:, 2], turns[:, 3:5] = about_y(np.array(-1.4)), about_y(np.array(0.1))
    root = np.zeros((len(turns), 3))
    root[:, 1] = 0.004 * np.sin(np.arange(len(root)) / 20)
    root[:, 2] = -points_of(chained(root, turns), turns, 1)[0, :, 2].min()
    swaying = chained(root, turns)
    now, _ = settled(swaying, turns, SEGMENTS, PARENTS, ENDS, RATE)
    assert np.ptp(now[:, 4, 1]) > 0.006
    assert np.ptp(now[20:-20, 7, 1]) < 1e-4
    joints, turned, _, planted = wavering()
    for off in (-0.7, 0.4):
        now, after = settled(np.add(joints, [0, 0, off]), turned, SEGMENTS, PARENTS, ENDS, RATE)
        assert np.quantile(slides(now, after, planted), 0.99) < 0.002
        assert abs(np.median(lowest(now, after)) - off) < 0.03
    flat = about_y(np.array(np.pi / 2))
    now, after = settled(joints @ flat.T, flat @ turned, SEGMENTS, PARENTS, ENDS, RATE)
    assert np.abs(now - joints @ flat.T).max() < 0.04


def test_a_knee_that_is_bent_backwards_straightens_where_its_foot_goes_farther():
    lower = np.linspace(0, 0.002, 20)
    hip, knee = np.zeros((20, 1, 3)), np.tile([-0.03, 0.0, -0.4], (20, 1, 1))
    ankle = np.stack([0 * lower, 0 * lower, -0.8 - lower], axis=1)[:, None]
    length = np.linalg.norm(knee[0], axis=1)
    bent = _knees(hip, knee, ankle, np.tile([1.0, 0, 0], (20, 1, 1)), length, length, 2 * length)
    np.testing.assert_allclose(np.linalg.norm([bent, ankle - bent], axis=3), length[0], atol=1e-9)
    assert bent[0, 0, 0] == pytest.approx(-0.03) and (np.diff(bent[:, 0, 0]) > 0).all()


def test_frames_without_a_body_stay_without_one_and_who_has_no_legs_as_they_are():
    joints, turned, _, _ = wavering()
    joints[130:134], turned[130:134] = np.nan, np.nan
    joints[:7], turned[:7] = np.nan, np.nan
    now, after = settled(joints, turned, SEGMENTS, PARENTS, ENDS, RATE)
    np.testing.assert_array_equal(np.isnan(now), np.isnan(joints))
    assert np.isfinite(after[7:130]).all()
    assert (lowest(now, after)[7:130] > -0.002).all()
    names = [f"bone {at}" for at in range(len(SEGMENTS))]
    now, after = settled(joints, turned, names, PARENTS, ENDS, RATE)
    np.testing.assert_allclose(now, joints, atol=1e-9)
    assert after is turned
    nobody = np.full_like(joints, np.nan)
    assert settled(nobody, turned, SEGMENTS, PARENTS, ENDS, RATE)[0] is nobody


def test_a_body_is_settled_and_retargeted_without_scipy_for_whose_import_a_window_would_wait():
    code = (
        "from addon.core.retarget.retargeting import _planted; from tests.core.filling.test_ground import *; "
        "joints, turned, *_ = wavering(); settled(joints, turned, SEGMENTS, PARENTS, ENDS, RATE); "
        "_planted(joints[:, 0], joints[:, 0, 2], RATE, np.ones(len(joints), bool)); "
        "print([name for name in sys.modules if name.startswith('scipy')])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_smoothing_takes_shaking_out_of_the_body_and_leaves_its_lengths():
    right, turns, planted = walk()
    rng = np.random.default_rng(1)
    turned = turns @ rotations.turn_of(rng.normal(0, np.radians(0.5), (*turns.shape[:2], 3)))
    joints = chained(right[:, 0] + rng.normal(0, 0.003, right[:, 0].shape), turned)
    shaking = [np.linalg.norm(np.diff(one, 2, axis=0), axis=2).mean() for one in (joints, right)]
    now, after = settled(joints, turned, SEGMENTS, PARENTS, ENDS, RATE, cutoff=6.0)
    calm = np.linalg.norm(np.diff(now, 2, axis=0), axis=2).mean()
    assert calm < shaking[0] / 10
    assert np.quantile(slides(now, after, planted), 0.99) < 0.002
    np.testing.assert_allclose(np.linalg.norm(now[:, 3] - now[:, 2], axis=1), THIGH, atol=1e-9)
    # A quaternion that changes its sign between two frames is no turn.
    spin = rotations.turn_of(np.multiply.outer(np.linspace(0, 4 * np.pi, len(turns)), [0, 0, 1.0]))[:, None]
    spun = settled(joints @ spin[:, 0].swapaxes(-1, -2), spin @ turned, SEGMENTS, PARENTS, ENDS, RATE, cutoff=6.0)[1]
    off = rotations.rotation_vector(spin[:, 0].swapaxes(-1, -2) @ spun[:, 0])
    assert np.linalg.norm(off, axis=1)[20:-20].max() < np.radians(5)
    with pytest.raises(InputError, match="the cut-off of the smoothing is 60 Hz"):
        settled(joints, turned, SEGMENTS, PARENTS, ENDS, RATE, cutoff=60.0)


TOED = (*SEGMENTS, "toes.L", "toes.R")
TOED_PARENTS = (*PARENTS, *FEET)
TOES = np.array([0.05, 0, 0])
TOED_ENDS = np.vstack([ENDS, TOES, TOES])


def with_toes(joints: np.ndarray, turns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same body with toes as its feet are, which begin at 0.87 of the way to the tips."""
    balls = np.stack([points_of(joints, turns, side)[:, 1] for side in (0, 1)], axis=1)
    return np.concatenate([joints, balls], axis=1), np.concatenate([turns, turns[:, FEET]], axis=1)


def standing(heel: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Somebody who stands on balls of feet that are so high (F,) m, pitched forwards by (F,) rad."""
    turns = np.tile(np.eye(3), (len(up), len(SEGMENTS), 1, 1))
    turns[:, FEET] = about_y(up)[:, None]
    joints = chained(np.zeros((len(up), 3)), turns)
    joints[..., 2] += (heel - points_of(joints, turns, 0)[:, 1, 2])[:, None]
    joints[..., 0] -= (points_of(joints, turns, 0)[:, 1, 0])[:, None]
    return with_toes(joints, turns)


def bent(turns: np.ndarray) -> np.ndarray:
    """(F,) degrees that toes point upwards from the foot."""
    bend = turns[:, FEET[0]].swapaxes(1, 2) @ turns[:, -2]
    return np.degrees(np.arctan2(bend[:, 2, 0], bend[:, 0, 0]))


def test_toes_stay_on_the_floor_while_the_heel_lifts_and_are_straight_far_from_it():
    frames = np.arange(500)
    up, high = 0.9 * np.clip((frames - 300) / 40, 0, 1), 0.02 + 0.2 * np.clip((frames - 400) / 40, 0, 1)
    joints, turns = standing(high, up)
    now, after = settled(joints, turns, TOED, TOED_PARENTS, TOED_ENDS, RATE)
    np.testing.assert_allclose(bent(after)[:390], np.degrees(up[:390]), atol=1)
    assert np.ptp(now[:190, -2, :2], axis=0).max() < 0.001
    tips = now[:, -2:] + (after[:, -2:] @ TOES)
    assert tips[..., 2].min() > 0
    assert np.abs(bent(after)[460:]).max() < 0.1
    assert np.abs(np.diff(bent(after))).max() < 8  # 52° in the 0.1 s in which they straighten
    down, _ = np.array_split(settled(*standing(high - 0.3, up), TOED, TOED_PARENTS, TOED_ENDS, RATE)[1], [390])
    np.testing.assert_allclose(bent(down), np.degrees(up[:390]), atol=1)  # that floor is lower


def test_toes_bend_as_far_as_toes_do_and_not_on_the_back_of_a_foot():
    up = np.concatenate([np.zeros(900), np.linspace(0, 2 * np.pi, 721)])
    joints, turns = standing(np.full(len(up), 0.09), up)
    after = settled(joints, turns, TOED, TOED_PARENTS, TOED_ENDS, RATE)[1]
    there = bent(after)
    assert 85 < there.max() <= 90.1
    assert np.abs(np.diff(there)).max() < 5
    assert np.abs(there[np.abs(up - 1.2 * np.pi) < 0.5]).max() < 1
    turns[:, -2:] = turns[:, -2:] @ about_y(np.array(1.0))  # curled in the air, farther than toes go
    joints[..., 2] += np.clip(np.arange(len(up)) - 850, 0, 50)[:, None] / 50
    curled = bent(settled(joints, turns, TOED, TOED_PARENTS, TOED_ENDS, RATE)[1])[920:]
    np.testing.assert_allclose(curled, np.degrees(-0.7), atol=0.5)


def test_the_ball_holds_still_while_the_foot_turns_on_its_tip_and_its_heel_comes_down_elsewhere():
    frames = np.arange(400)
    step = np.clip((frames - 200) / 30, 0, 1)
    joints, turns = standing(np.full(len(frames), 0.02), 0.7 * (1 - step * step * (3 - 2 * step)))
    turn = rotations.turn_of(np.multiply.outer(0.6 * step, [0.0, 0.0, 1.0]))
    still = joints[:, -2:] + turns[:, -2:] @ [0.01, 0, 0.025]  # such as a marker on the ball
    joints = (joints - still[:, :1]) @ turn.swapaxes(1, 2) + still[:1, :1]
    joints[:, :, 0] += 0.008 * (frames > 300)[:, None]  # as of markers that were knocked
    assert np.ptp(joints[:, -2, :2], axis=0).max() > 0.015
    now, _ = settled(joints, turn[:, None] @ turns, TOED, TOED_PARENTS, TOED_ENDS, RATE)
    assert np.ptp(now[:, -2, :2], axis=0).max() < 0.001


def eased(start: float, seconds: float) -> np.ndarray:
    """(600,) from 0 to 1 within so many seconds from then on."""
    part = np.clip((np.arange(600) / RATE - start) / seconds, 0, 1)
    return part * part * (3 - 2 * part)


def with_left_foot_raised(raised: np.ndarray, goes: np.ndarray, down: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Somebody whose left foot is so high and points down so far, while the right one goes so far ahead; (F,) each."""
    turns = np.tile(np.eye(3), (len(raised), len(SEGMENTS), 1, 1))
    root = np.tile([0.0, 0.0, 0.84], (len(raised), 1))
    for foot, x, z in zip(FEET, (0 * goes, goes), (raised, 0 * raised), strict=True):
        bend_leg(turns, root, foot, x, ANKLE + z)
    turns[:, FEET[0]] = about_y(down)
    return with_toes(chained(root, turns), turns)


@pytest.mark.parametrize("start", [1.0, 4.0])
def test_a_foot_that_is_lifted_slowly_and_level_is_lifted(start):
    raised = 0.05 * eased(start, 0.6)
    joints, turns = with_left_foot_raised(raised, 0 * raised, 0 * raised)
    now, _ = settled(joints, turns, TOED, TOED_PARENTS, TOED_ENDS, RATE)
    np.testing.assert_allclose(now[:, FEET[1]], joints[:, FEET[1]], atol=0.001)
    off = np.linalg.norm(now - joints, axis=2)[:, [FEET[0], -2]].max(axis=1)
    assert off.max() < 0.02
    np.testing.assert_allclose(off[[50, 300, 580]], 0, atol=0.001)


HOP, JUMP = 0.3 * eased(2.0, 0.3), 0.03 * (np.arange(600) >= 250)


@pytest.mark.parametrize(("start", "goes"), [(1.0, HOP), (1.0, JUMP), (1.7, HOP)])
def test_a_foot_in_the_air_carries_nobody_while_the_other_moves(start, goes):
    slowly = 0.3 * np.clip((np.arange(600) / RATE - 1) / 3.5, 0, 1)
    joints, turns = with_left_foot_raised(slowly, goes / 3, 0 * goes)
    now, _ = settled(joints, turns, TOED, TOED_PARENTS, TOED_ENDS, RATE)
    assert np.linalg.norm(now - joints, axis=2)[:, [FEET[0], -2]].max() < 0.02
    up = eased(start, 0.3) - eased(4.0 - start, 0.3)  # at last the other goes all the while
    joints, turns = with_left_foot_raised(0.5 * up, goes, 0.7 * up)
    now, after = settled(joints, turns, TOED, TOED_PARENTS, TOED_ENDS, RATE)
    there = up > 0.9
    np.testing.assert_allclose(now[there, FEET[0]], joints[there, FEET[0]], atol=0.001)
    np.testing.assert_allclose(bent(after)[there], 0, atol=1)


def test_where_nobody_rests_or_the_floor_is_not_below_toes_are_as_the_feet():
    joints, turns = with_toes(*walk()[:2])
    flat = about_y(np.array(np.pi / 2))
    after = settled(joints @ flat.T, flat @ turns, TOED, TOED_PARENTS, TOED_ENDS, RATE)[1]
    np.testing.assert_allclose(bent(after), 0, atol=1e-6)
    joints[:, :, 0] += np.arange(len(joints))[:, None]
    after = settled(joints, turns, TOED, TOED_PARENTS, TOED_ENDS, RATE)[1]
    np.testing.assert_allclose(bent(after), 0, atol=1e-6)
