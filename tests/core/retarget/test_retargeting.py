# SPDX-License-Identifier: GPL-3.0-or-later
"""The bones of rigs by name, form or map; their turns by a body's motion: where limbs reach, which feet are planted."""

from dataclasses import replace

import numpy as np
import pytest

from addon.core.body.bodies import BodyModel
from addon.core.geometry.rotations import rotation_vector, turn_of
from addon.core.posing.character import BONE_NAMES, both_sides, character_of
from addon.core.posing.finer import finer
from addon.core.retarget.matching import CONTROLS, DEFORMING, RestBones, match_bones, match_map, read_as
from addon.core.retarget.retargeting import Rig, _fading, axes_at_rest, retarget, stands
from addon.io.bone_maps import read_bone_map
from addon.io.markersets import open_markerset
from tests.inputs.rigs import A_POSE, HANGING, MAYA, MIXAMO, NAMELESS, T_POSE, UNREAL, VRM, RigBone, rig_bones
from tests.io.checks import memory_within, refused

RATE = 100.0


def rest_of(bones, names):
    """Bones as `match_bones` takes them."""
    parts = [bone.part for bone in bones]
    parents = np.array([-1 if bone.parent is None else parts.index(bone.parent) for bone in bones])
    ends = (np.array([getattr(bone, end) for bone in bones]) for end in ("head", "tail"))
    return RestBones(tuple(names.get(part, part) for part in parts), parents, *ends)


def rig(arms=T_POSE, size=1.0, thigh=0.5, raised=0.0):
    bones, up = rest_of(rig_bones(arms, size, thigh), {}), np.array([0, 0, raised])
    return Rig(bones.names, bones.parents, bones.heads + up, bones.tails + up)


def both(at, *parts):
    """Where the parts of both sides are."""
    return [at[f"{part}.{side}"] for part in parts for side in "LR"]


def segment_of(character):
    """The segment of each part of a character."""
    return dict(zip(character.names, character.segment, strict=True))


def moved(one, parts, way):
    """The rig, some of whose bones are elsewhere by `way` (3,) m."""
    for end in (one.heads, one.tails):
        end[both(one.at, *parts)] += way
    return one


def degrees(turns):
    """How far turns (..., 3, 3) turn."""
    return np.degrees(np.linalg.norm(rotation_vector(turns), axis=-1))


@pytest.fixture(scope="module")
def squats():
    """A body whose feet stay on one spot while the knees bend and straighten: its character, joints and rotations."""
    model = BodyModel(finer(open_markerset("actor41")))
    segments = list(model.markerset.skeleton.segments)
    angle = 0.5 - 0.3 * np.cos(np.linspace(0, 4 * np.pi, 120))
    bends = np.zeros((120, len(segments), 3))
    for side in "LR":  # about the body's left: hips back and the knees ahead, feet flat
        for part, share in (("thigh", -1), ("shank", 2), ("foot", -1)):
            bends[:, segments.index(f"{part}.{side}"), 1] = share * angle
    bodies = model.rest(120, 1.75)
    bodies.bends[:] = bends
    posed = model.pose(bodies)
    feet, toes = ([segments.index(f"{part}.{side}") for side in "LR"] for part in ("foot", "toes"))
    rest = model.pose(model.rest(1, 1.75))
    joints = posed.joints - (posed.joints[:, feet] - rest.joints[:, feet]).mean(axis=1, keepdims=True)
    ends = rest.joints[0] + np.array([0.15, 0, 0])
    ends[toes] = rest.joints[0, toes] + np.array([0.05, 0, 0])
    for segment, joint in enumerate(rest.joints[0]):
        children = np.flatnonzero(model.parents == segment)
        if len(children):
            ends[segment] = rest.joints[0, children].mean(axis=0) if segments[segment] != "head" else joint
    return character_of(segments, rest.joints[0], ends), (joints, posed.rotations)


def places(one, turns, hips):
    """(F, C, 3) where the bones of a rig begin."""
    found = np.empty((*turns.shape[:2], 3))
    found[:, 0] = hips
    for index, above in enumerate(one.follows[1:], 1):
        found[:, index] = found[:, above] + turns[:, above] @ (one.heads[index] - one.heads[above])
    return found


@pytest.mark.parametrize(("down", "high", "raised"), [(0.6, 0.05, 0.0), (0.35, 0.06, -1.0), (1.3, 0.22, 0.0)])
def test_a_long_foot_that_hangs_in_the_air_comes_out_of_the_floor_smoothly_and_legs_stay(squats, down, high, raised):
    character, (joints, rotations) = squats
    at = segment_of(character)
    hung = np.sin(np.pi * np.clip((np.arange(120) - 40) / 40, 0, 1))[:, None] ** 2
    turns = rotations[:1].repeat(120, axis=0)
    for segment in both(at, "foot", "toes"):
        turns[:, segment] = turn_of(down * hung * [0, 1.0, 0]) @ turns[:, segment]
    motion, one = (joints[:1] + high * hung[..., None] * [0, 0, 1], turns), rig(raised=raised)
    for end in (one.heads, one.tails):
        end[both(one.at, "foot", "toes"), 1] *= 2
    found = [retarget(character, motion, RATE, one, feet, hands=False) for feet in (False, True)]
    balls = [places(one, *posed)[:, both(one.at, "toes")] for posed in found]
    low = [place[..., 2].min() - 0.02 for place in balls]
    assert low[0] < -0.02 < -0.012 < low[1]
    assert np.ptp(balls[1][: 42 if down < 1 else 36], axis=0).max() < 0.0002, "planted feet stay"
    legs = both(one.at, "thigh", "shank")
    np.testing.assert_allclose(found[1][0][55:65, legs], found[0][0][55:65, legs], atol=0.01)
    assert np.abs(np.diff(found[1][0][:, one.at["foot.L"]], n=2, axis=0)).max() < 0.05


@pytest.mark.parametrize(("size", "thigh", "raised"), [(1.2, 0.56, 0.0), (0.8, 0.45, 0.0), (1.0, 0.5, -1.0)])
def test_planted_feet_do_not_slide_and_stand_on_the_floor(squats, size, thigh, raised):
    one = rig(size=size, thigh=thigh, raised=raised * size)
    slid = {}
    for feet in (False, True):
        ankles = places(one, *retarget(*squats, RATE, one, feet, hands=False))[:, both(one.at, "foot")]
        slid[feet] = np.ptp(ankles, axis=0).max()
    assert slid[True] < 0.001
    assert slid[True] < slid[False] / 5
    np.testing.assert_allclose(ankles[..., 2], 0.09 * size, atol=0.03 if raised else 0.012)


@pytest.mark.parametrize(("begin", "end", "way"), [(50, 53, 0.0), (30, 75, 2.0)])
def test_around_a_gap_of_the_body_a_rig_moves_as_without_it(squats, begin, end, way):
    character, (joints, rotations) = squats
    one, gone, found = rig(size=1.1, thigh=0.55), joints.copy(), []
    gone[end:, :, 0] += way
    gone[begin:end] = np.nan
    for motion in ((joints, rotations), (gone, rotations)):
        posed = retarget(character, motion, RATE, one, feet=True, hands=False)
        found.append(places(one, *posed)[:, both(one.at, "foot", "thigh")])
    off = found[1] - found[0]
    off[end:] -= off[-1]
    off[begin:end] = 0
    assert (np.abs(off).max(axis=(0, 2)) < [0.001, 0.001, 0.005, 0.005]).all()


def test_the_motion_of_a_rig_takes_little_memory_beside_itself(squats):
    """As a button's press waits for it, which fresh memory is a good part of in a long take."""
    character, motion = squats
    motion = tuple(np.concatenate([part] * 20) for part in motion)
    turns, _ = retarget(character, motion, RATE, rig(), feet=True, hands=True)  # which may load modules
    with memory_within(2 * turns.nbytes):
        retarget(character, motion, RATE, rig(), feet=True, hands=True)


@pytest.mark.parametrize("feet", [True, False])
def test_a_rig_stands_on_the_floor_where_feet_are_kept_however_high_the_person_s_own_are(squats, feet):
    character, (joints, rotations) = squats
    one, found = rig(), []
    for raised in (0.0, 0.02):
        motion = joints + np.array([0, 0, raised]), rotations
        found.append(places(one, *retarget(character, motion, RATE, one, feet, hands=False))[..., 2])
    assert (np.ptp(found, axis=0).max() < 0.002) == feet


def test_a_planted_foot_a_little_lower_than_the_other_stands_level_and_a_pit_is_kept(squats):
    character, (joints, rotations) = squats
    lower, one = joints.copy(), rig()
    lower[:, both(segment_of(character), "thigh", "shank", "foot", "toes")[::2]] -= (0, 0, 0.02)
    balls, feet = (both(one.at, part) for part in ("toes", "foot"))
    turns, hips = retarget(character, (lower, rotations), RATE, one, feet=True, hands=False)
    np.testing.assert_allclose(places(one, turns, hips)[:, balls, 2], 0.02, atol=0.002)
    assert turns[:, feet, 2, 2].min() > 0.999
    pits = [retarget(character, (joints - (0, 0, deep), rotations), RATE, one, True, False) for deep in (0, 0.3)]
    np.testing.assert_allclose(places(one, *pits[0])[..., 2] - 0.3, places(one, *pits[1])[..., 2], atol=0.02)


@pytest.mark.parametrize("size", [0.1, 1.0])
def test_a_flat_foot_that_steps_down_where_no_floor_is_stays_nearly_level_in_the_air(squats, size):
    character, (joints, rotations) = squats
    along = np.clip((np.arange(240) - 80) / 80, 0, 1)
    way = np.stack([0.6 * along, 0 * along, 0.05 * np.sin(np.pi * along) - 0.3 * along**2 * (3 - 2 * along)], axis=1)
    motion, one = (joints[:1] + way[:, None], rotations[:1].repeat(240, axis=0)), rig(size=size)
    foot = retarget(character, motion, RATE, one, feet=True, hands=False)[0][:, one.at["foot.L"]]
    assert foot[:, 2, 2].min() > np.cos(0.2)
    assert degrees(foot[1:] @ foot[:-1].swapaxes(1, 2)).max() < 3


def on_tiptoe(squats, most=0.9, frames=15):
    """A body that comes up on its toes and stays so: its character, joints and rotations."""
    character, (joints, rotations) = squats
    lift = most * np.clip((np.arange(120) - 40) / frames, 0, 1)
    still, turns = joints[:1].repeat(120, axis=0), rotations[:1].repeat(120, axis=0)
    foot, toes = (both(segment_of(character), part) for part in ("foot", "toes"))
    way = still[:, toes] - still[:, foot]
    up = turn_of(np.outer(lift, [0.0, 1, 0]))[:, None]
    turns[:, foot] = up @ turns[:, foot]
    others = np.delete(np.arange(still.shape[1]), toes)
    still[:, others] += (way - (up @ way[..., None])[..., 0]).mean(axis=1, keepdims=True)
    return character, (still, turns)


def test_who_comes_up_on_the_toes_turns_on_the_ball_of_the_foot_and_toes_go_as_the_body_s(squats):
    character, (still, turns) = on_tiptoe(squats)
    one = rig(size=1.15)
    found = retarget(character, (still, turns), RATE, one, feet=True, hands=False)
    feet, toes = (both(one.at, part) for part in ("foot", "toes"))
    balls = places(one, *found)[:, toes]
    assert np.ptp(balls[..., :2], axis=0).max() < 0.003
    tips = balls[..., 2] + np.einsum("fsij,sj->fsi", found[0][:, toes], one.tails[toes] - one.heads[toes])[..., 2]
    np.testing.assert_allclose(tips, one.tails[toes, 2] * np.ones((120, 1)), atol=0.006)
    np.testing.assert_allclose(found[0][:40, toes], found[0][:40, feet], atol=0.02)


@pytest.mark.parametrize(("thigh", "long"), [(0.5, 0.09), (0.8, 0.25)])  # of a drawn figure, than its shank
def test_longer_toes_than_the_body_s_are_not_in_the_floor_though_straight_when_the_ball_has_left_it(
    squats, thigh, long
):
    character, (still, turns) = on_tiptoe(squats)
    at, one = segment_of(character), rig(size=1.15, thigh=thigh)
    toes = one.at["toes.L"]
    one.tails[toes] = one.heads[toes] - (0, long, 0)
    left = still + 0.08 * np.clip((np.arange(120) - 70) / 15, 0, 1)[:, None, None] * [0, 0, 1]
    turns[70:, at["toes.L"]] = turns[70:, at["foot.L"]]
    moved, hips = retarget(character, (left, turns), RATE, one, feet=True, hands=False)
    tip = places(one, moved, hips)[:, toes] + moved[:, toes] @ (one.tails - one.heads)[toes]
    assert tip[:, 2].min() > one.tails[toes, 2] - 0.004


@pytest.mark.parametrize("way", [(0, -0.08, 0), (0, -0.02, -0.06), (0, 0.05, -0.08)])  # long, high and steep feet
def test_a_foot_of_another_form_rolls_on_its_ball_and_leaves_the_knee_as_it_is(squats, way):
    one = moved(rig(size=1.15), ["toes"], way)
    knees, balls = [], []
    for feet in (False, True):
        turns, hips = retarget(*on_tiptoe(squats), RATE, one, feet, hands=False)
        knees.append(degrees(turns[:, one.at["thigh.L"]].swapaxes(1, 2) @ turns[:, one.at["shank.L"]]))
        balls.append(places(one, turns, hips)[:, one.at["toes.L"]])
    np.testing.assert_allclose(*knees, atol=4)
    assert np.ptp(balls[1][:, :2], axis=0).max() < 0.003 < np.ptp(balls[0][:, :2], axis=0).max()


@pytest.mark.parametrize("way", [(0, 0, 0), (0, -0.02, -0.06), (0, 0.05, -0.03), None])
def test_a_foot_does_not_jump_where_the_leg_is_over_its_ball_or_it_is_short_and_a_roll_helps_little(squats, way):
    one = rig(size=1.15)
    feet, toes = (both(one.at, part) for part in ("foot", "toes"))
    for end in (one.heads, one.tails):
        end[toes] = end[toes] + way if way else one.heads[feet] + (0, -0.002, 0)
    turns = retarget(*on_tiptoe(squats, 1.2, 50), RATE, one, feet=True, hands=False)[0][:, one.at["foot.L"]]
    assert degrees(turns[1:] @ turns[:-1].swapaxes(1, 2)).max() < 2.5 * np.degrees(1.2 / 50)


def test_legs_in_the_air_are_as_the_body_s_and_they_and_the_hips_get_there_smoothly(squats):
    character, (still, turns) = on_tiptoe(squats)
    gone = 0.001 * np.clip(np.arange(120) - 80, 0, None) ** 2
    one = moved(rig(size=1.15), ["toes"], (0, -0.08, -0.03))
    motion = still + gone[:, None, None] * [0, 0, 1], turns
    (free, free_hips), (kept, hips) = (retarget(character, motion, RATE, one, feet, False) for feet in (False, True))
    legs = both(one.at, "thigh", "shank", "foot")
    np.testing.assert_allclose(kept[110:, legs], free[110:, legs], atol=1e-9)
    assert np.abs(kept[80, legs] - free[80, legs]).max() > 0.01
    far = (places(one, kept, hips) - places(one, free, free_hips))[70:]
    assert np.linalg.norm(np.diff(far, 2, axis=0), axis=2).max() * RATE < 0.2  # m/s
    backwards = retarget(character, tuple(values[::-1] for values in motion), RATE, one, True, False)
    for found, ahead in zip(backwards, (kept, hips), strict=True):
        np.testing.assert_allclose(found[::-1], ahead, atol=1e-9)


def test_what_fades_goes_on_as_its_own_plant_went_and_not_as_the_noise_of_a_frame():
    rows = np.r_[0:30, 400:411]
    values = (rows >= 400) + 0.01 * (-1.0) ** rows
    assert _fading(rows, values[:, None] * np.ones(3), 600, 100).max() < 1.05


def test_a_foot_that_ends_where_it_begins_and_one_that_is_never_planted_are_turned(squats):
    one, (character, (joints, turns)) = rig(), on_tiptoe(squats)
    one.heads[both(one.at, "toes")] = one.heads[both(one.at, "foot")]
    away = np.arange(120)[:, None, None] * [0.1, 0, 0]
    for there in (joints, joints + away):
        assert all(np.isfinite(found).all() for found in retarget(character, (there, turns), RATE, one, True, False))


def test_hips_that_are_wider_turn_less_so_that_planted_feet_do_not_bend_legs(squats):
    character, (joints, turns) = squats
    at = segment_of(character)
    still, turns = joints[:1].repeat(120, axis=0), turns[:1].repeat(120, axis=0)
    turned = 0.3 * np.sin(np.linspace(0, 4 * np.pi, 120))
    half = 0.5 * np.linalg.norm(joints[0, at["thigh.L"]] - joints[0, at["thigh.R"]])
    long = joints[0, at["thigh.L"], 2] - joints[0, at["foot.L"], 2]
    turns[:, at["hips"]] = turn_of(np.outer(turned, [0, 0, 1.0])) @ turns[:, at["hips"]]
    for side, sign in zip("LR", (1, -1), strict=True):  # legs swing about the body's left, where their feet stay
        swing = turn_of(np.outer(sign * half * np.sin(turned) / long, [0, -1.0, 0]))
        for part in ("thigh", "shank"):
            turns[:, at[f"{part}.{side}"]] = swing @ turns[:, at[f"{part}.{side}"]]
    off, hips = {}, {}
    for wider in (0.0, 0.3):
        one = rig()
        moved(one, ["thigh", "shank", "foot", "toes"], np.outer([1, -1] * 4, [wider / 2, 0, 0]))
        legs = both(one.at, "thigh", "shank")
        found = [retarget(character, (still, turns), RATE, one, feet, hands=False)[0] for feet in (False, True)]
        off[wider] = degrees(found[0][:, legs].swapaxes(2, 3) @ found[1][:, legs]).max()
        hips[wider] = np.ptp(np.arctan2(found[1][:, one.at["hips"], 1, 0], found[1][:, one.at["hips"], 0, 0]))
    assert off[0.0] < 2
    assert off[0.3] < 3
    assert hips[0.3] < 0.7 * hips[0.0]


def without_toes(whole):
    """A rig without its toes, and which of its bones there still are."""
    kept = [index for index, part in enumerate(whole.parts) if not part.startswith("toes")]
    follows = np.array([kept.index(above) if above >= 0 else -1 for above in whole.follows[kept]])
    return Rig(tuple(whole.parts[index] for index in kept), follows, whole.heads[kept], whole.tails[kept]), kept


# To other sides, and ahead, as short and as long as importers make a bone at the end.
@pytest.mark.parametrize("end", [(0.02, 0.05, 0.1), (0.1, 0, 0), (0, 0.1, -0.05), (0, -0.005, 0), (0, -0.4, -0.05)])
def test_a_foot_without_toes_whose_bone_points_elsewhere_stands_as_one_with_toes(squats, end):
    whole = rig(size=1.1)
    one, kept = without_toes(whole)
    feet = both(one.at, "foot")
    one.tails[feet] = one.heads[feet] + end
    found = [retarget(*on_tiptoe(squats), RATE, each, feet=True, hands=False)[0] for each in (one, whole)]
    np.testing.assert_allclose(found[0], found[1][:, kept], atol=0.1)


def test_toes_that_end_in_the_distance_are_as_long_as_the_body_s_like_those_that_end_aside(squats):
    character, (joints, turns) = on_tiptoe(squats)
    at = segment_of(character)
    joints = joints + 0.1 * np.linspace(0, 1, 120)[:, None, None] * [0, 0, 1]
    turns[:, at["toes.L"]] = turns[:, at["foot.L"]]
    one, found = rig(size=1.1), []
    toes = both(one.at, "toes")
    for end in ((0, -1.5, 0), (0.1, 0, 0)):
        one.tails[toes] = one.heads[toes] + end
        found.append(retarget(character, (joints, turns), RATE, one, feet=True, hands=False)[0])
    np.testing.assert_allclose(*found, atol=1e-9)


def test_a_rig_without_toes_whose_origin_is_elsewhere_stands_on_its_soles_not_its_ankles(squats):
    found = [retarget(*squats, RATE, without_toes(rig(raised=up))[0], feet=True, hands=False)[1] for up in (-1, 0)]
    np.testing.assert_allclose(*found, atol=0.04)


def test_a_rig_without_toes_whose_ankles_are_high_stands_on_its_origin(squats):
    one, high = without_toes(rig())[0], 0.25
    for end in (one.heads, one.tails):
        end += (0, 0, high)
    ankles = places(one, *retarget(*squats, RATE, one, feet=True, hands=False))[:, both(one.at, "foot"), 2]
    np.testing.assert_allclose(ankles, 0.09 + high, atol=0.012)


def test_a_rig_stands_whose_head_is_over_its_hips_over_its_knees():
    places = dict(zip(rig(HANGING).parts, rig(HANGING).heads, strict=True))
    assert stands(places)
    assert not stands({part: place[[2, 1, 0]] for part, place in places.items()})
    assert not stands(places | {"shank.R": places["thigh.R"] + [0.1, 0, 0.4]})
    apart = {
        part: places[part] + [5 if part.endswith("L") else -5, 0, 0]
        for part in places
        if part[:5] in ("thigh", "shank")
    }
    assert not stands(places | apart), "its bones are of another size than its places"


def test_arms_that_are_all_straight_at_rest_warn_of_no_angle(squats):
    """As those of files are, whichever way they hang."""
    for angle in np.radians([3, 27, 75]):
        one, way = rig(), np.array([np.cos(angle), 0, -np.sin(angle)])
        for number, part in enumerate(("upper_arm.L", "forearm.L", "hand.L")):
            one.heads[one.at[part]] = one.heads[one.at["upper_arm.L"]] + 0.27 * number * way
            one.tails[one.at[part]] = one.heads[one.at[part]] + 0.1 * way
        with np.errstate(invalid="raise"):
            retarget(*squats, RATE, one, feet=False, hands=False)


def test_hands_go_where_the_body_s_are_in_a_larger_room(squats):
    character, (joints, rotations) = squats
    one = rig(HANGING, size=1.3)
    found = places(one, *retarget(character, (joints, rotations), RATE, one, feet=True, hands=True))
    own = character.posed(joints, rotations)[0]
    apart = found[:, one.at["hand.L"]] - found[:, one.at["hand.R"]]
    body = own[:, character.names.index("hand.L")] - own[:, character.names.index("hand.R")]
    scale = np.linalg.norm(apart, axis=1) / np.linalg.norm(body, axis=1)
    legs = [
        np.linalg.norm(np.diff(path, axis=0), axis=1).sum()
        for path in (
            one.heads[[one.at[f"{part}.L"] for part in ("thigh", "shank", "foot")]],
            character.heads[[character.names.index(f"{part}.L") for part in ("thigh", "shank", "foot")]],
        )
    ]
    np.testing.assert_allclose(scale, legs[0] / legs[1], rtol=0.01)


def test_axes_of_a_rig_are_those_it_has_at_rest():
    turn = np.array([[0.0, 0, 1], [1, 0, 0], [0, 1, 0]])
    one = rig()
    for leaning in (0.0, 0.2):  # all of it to the side
        turned = turn @ turn_of(np.array([0, leaning, 0]))
        axes = axes_at_rest({part: turned @ one.heads[index] for part, index in one.at.items()})
        np.testing.assert_allclose(axes, turned, atol=1e-12)
    uneven = {part: one.heads[index] for part, index in one.at.items()}
    uneven["thigh.L"] = uneven["thigh.L"] + (0, 0, 0.05)  # a hip alone
    against = uneven | {"foot.L": uneven["foot.L"] + (0, 0, 0.05), "upper_arm.L": uneven["upper_arm.L"] - (0, 0, 0.03)}
    alone = {part: place for part, place in uneven.items() if not part.startswith(("foot", "upper_arm"))}
    together = against | {"foot.R": against["foot.L"]}
    for places in (uneven, against, alone, together):
        np.testing.assert_allclose(axes_at_rest(places)[2, 2], 1, atol=1e-12)


AS_IT_IS = np.eye(3)


def at_rest(names, arms=T_POSE, turn=AS_IT_IS, extra=()):
    """A person's rig with such names; `extra` bones are name, parent's part and head."""
    bones = {bone.part: bone for bone in rig_bones(arms)}
    for name, part, head in extra:
        if part not in names:  # another one of the extra bones
            bones[part] = replace(bones[part], tail=np.array(head))
        bones[name] = RigBone(name, part, np.array(head), np.add(head, (0, 0, 0.02)))
    rest = rest_of(list(bones.values()), names)
    return replace(rest, heads=rest.heads @ turn.T, tails=rest.tails @ turn.T)


def without_between(names):
    return {part: name for part, name in names.items() if part != "between"}


# Where words lie: a leg is a thigh where there are knees, a shoulder a clavicle where there are arms, wrists are hands.
AVATAR = both_sides(
    "Hips Spine Upper_Chest Neck Head", "*_shoulder *_arm *_elbow *_wrist *_leg *_knee *_ankle *_toe", ("Left", "Right")
) | {"between": "Chest"}
FK_CONTROLS = both_sides(
    "FK-Hips FK-Spine FK-Chest FK-Neck FK-Head",
    "FK-Shoulder.* FK-UpperArm.* FK-Forearm.* FK-Wrist.* FK-Thigh.* FK-Knee.* FK-Foot.* FK-Toes.*",
    ("L", "R"),
) | {"between": "FK-RibCage"}
FEET_ARE_FEET = MAYA | {f"{part}.{side}": f"{side}_{part.title()[:4]}" for part in ("foot", "toes") for side in "LR"}
UPPER_LAST = both_sides(
    "root spine1 spine3 neck head", "*Clavicle *ArmUpper *ArmLower *Hand *LegUpper *LegLower *Foot *Toe", ("L", "R")
) | {"between": "spine2"}


@pytest.mark.parametrize("arms", [T_POSE, A_POSE, HANGING])
@pytest.mark.parametrize("names", [MIXAMO, UNREAL, VRM, MAYA, AVATAR, FK_CONTROLS, FEET_ARE_FEET, UPPER_LAST, NAMELESS])
def test_bones_are_known_by_names_or_form(names, arms):
    assert match_bones(at_rest(names, arms)) == without_between(names)


def test_limbs_of_two_bones_each_and_hips_that_part_are_known_by_form():
    """As where limbs have twist bones in line, and each leg hangs on a bone of the pelvis."""
    bones = []
    for bone in rig_bones(A_POSE):
        middle, name = (bone.head + bone.tail) / 2, bone.part.partition(".")[0]
        if name == "thigh":
            hips = rig_bones()[0].head
            bones.append(RigBone(f"half {bone.part}", "hips", hips, bone.head))
        first = f"half {bone.part}" if name == "thigh" else bone.parent
        if name in ("forearm", "hand", "shank", "foot"):
            first = f"twist {bone.parent}"
        bones.append(replace(bone, parent=first))
        if name in ("upper_arm", "forearm", "thigh", "shank"):
            bones.append(RigBone(f"twist {bone.part}", bone.part, middle, bone.tail))
    names = {bone.part: f"Bone.{at:03d}" for at, bone in enumerate(bones)}
    found = match_bones(rest_of(bones, names))
    assert found == {part: names[part] for part in found}
    assert len(found) == len(NAMELESS) - 1


def test_a_steep_foot_without_a_name_is_known_by_its_length():
    """As of a drawn figure, or on a high heel: the toes begin under the ankle, a little ahead."""
    bones = at_rest(NAMELESS)
    heads, tails = bones.heads.copy(), bones.tails.copy()
    for side in "LR":
        foot, toes = (bones.names.index(NAMELESS[f"{part}.{side}"]) for part in ("foot", "toes"))
        heads[toes] = tails[foot] = heads[foot] + (0, -0.04, -0.07)
    assert match_bones(replace(bones, heads=heads, tails=tails)) == without_between(NAMELESS)


def test_left_is_told_by_the_feet_where_names_say_nothing():
    """In any axes: y up, and a rig that looks the other way."""
    for turn in (np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.diag([-1.0, -1, 1])):
        assert match_bones(at_rest(NAMELESS, turn=turn)) == without_between(NAMELESS)


@pytest.mark.parametrize("gone", ["none", "toes"])
def test_sides_that_are_named_as_who_looks_at_a_rig_sees_them_are_exchanged(gone):
    own, mirrored = without_between(UNREAL), np.diag([-1.0, 1, 1])
    other = {part: own[f"{part[:-1]}{'LR'[part[-1] == 'L']}" if "." in part else part] for part in own}
    bones = rest_of([bone for bone in rig_bones() if not bone.part.startswith(gone)], UNREAL)
    turned = replace(bones, heads=bones.heads @ mirrored, tails=bones.tails @ mirrored)
    assert match_bones(turned) == {part: name for part, name in other.items() if not part.startswith(gone)}


def test_sides_are_as_they_are_named_where_feet_without_toes_end_behind_but_knees_do_not():
    bones = [bone for bone in rig_bones() if not bone.part.startswith("toes")]
    for at, bone in enumerate(bones):
        if bone.part.startswith("foot"):
            bones[at] = replace(bone, tail=np.add(bone.head, (0, 0.1, 0)))
    assert match_bones(rest_of(bones, UNREAL)).items() <= without_between(UNREAL).items()


def test_sides_of_feet_that_point_down_are_as_they_are_named():
    """Where toes begin right under the ankles of legs that are ahead, which is a little behind."""
    bones = at_rest(UNREAL)
    heads = bones.heads.copy()
    for side in "lr":
        knee, foot, toes = (bones.names.index(f"{name}_{side}") for name in ("calf", "foot", "ball"))
        heads[[knee, foot], 1] -= (0.06, 0.12)
        heads[toes] = heads[foot] - (0, 0, 0.09)
    assert match_bones(replace(bones, heads=heads)) == without_between(UNREAL)


@pytest.mark.parametrize("gone", ["hand", "forearm hand", "shoulder"])
def test_arms_of_too_few_bones_are_left_out_but_not_for_a_shoulder(gone):
    """Which is where the upper arm begins."""
    places = {bone.part: bone for bone in rig_bones()}
    bones = []
    for bone in places.values():
        name, _, side = bone.part.partition(".")
        if name in ("shoulder", *gone.split()):
            continue
        if name == "upper_arm":
            bone = replace(bone, parent="chest", head=places[f"shoulder.{side}"].head)
        bones.append(bone)
    found = match_bones(rest_of(bones, NAMELESS))
    assert found["foot.R"] == NAMELESS["foot.R"]
    assert found.get("forearm.L") == (NAMELESS["forearm.L"] if gone == "shoulder" else None)


@pytest.mark.parametrize("names", [NAMELESS, UNREAL])
@pytest.mark.parametrize("gone", ["hand.R", "forearm.L forearm.R hand.L hand.R"])
def test_long_arms_of_few_bones_are_none_by_form(names, gone):
    bones = [bone for bone in rig_bones(A_POSE) if bone.part not in gone.split()]
    last = ["forearm.R"] if gone == "hand.R" else ["upper_arm.L", "upper_arm.R"]
    bones = [replace(bone, tail=4 * bone.tail - 3 * bone.head) if bone.part in last else bone for bone in bones]
    arms = {part for part in names if part.startswith(("shoulder", "upper_arm", "forearm", "hand"))}
    left = {bone.part for bone in bones} - (arms | {"spine", "chest", "neck", "head"} if names is NAMELESS else set())
    found = match_bones(rest_of(bones, names))
    assert found == {part: name for part, name in without_between(names).items() if part in left}


def test_arms_that_hang_on_the_neck_do_not_make_it_the_chest():
    bones = at_rest(UNREAL)
    names, parents = list(bones.names), bones.parents.copy()
    parents[[names.index(f"clavicle_{side}") for side in "lr"]] = names.index("neck_01")
    assert match_bones(replace(bones, parents=parents)) == without_between(UNREAL)


@pytest.mark.parametrize("gone", ["hand", "foot", "hand foot"])
def test_knees_and_elbows_at_the_end_of_limbs_that_are_called_after_joints_are_no_poles(gone):
    joints = {
        "upper_arm": "Shoulder",
        "forearm": "Elbow",
        "hand": "Wrist",
        "thigh": "Hip",
        "shank": "Knee",
        "foot": "Ankle",
    }
    names = {part: f"{part[-1]}_{joints[part[:-2]]}" if part[:-2] in joints else name for part, name in UNREAL.items()}
    lost = [*gone.split(), *(["toes"] if "foot" in gone else [])]
    bones = [bone for bone in rig_bones(T_POSE) if bone.part.partition(".")[0] not in lost]
    names = {bone.part: names[bone.part] for bone in bones}
    assert match_bones(rest_of(bones, names)) == without_between(names)


@pytest.mark.parametrize("parts", ["hand foot", "upper_arm foot"])
def test_what_no_name_says_of_a_limb_the_form_does(parts):
    names = UNREAL | {
        f"{part}.{side}": f"own{number}_{side}" for number, part in enumerate(parts.split()) for side in "LR"
    }
    assert match_bones(at_rest(names)) == without_between(names)


def test_what_the_form_calls_otherwise_than_names_is_left_out():
    """A bone of the upper arm before the forearm, and no hands."""
    bones = [bone for bone in rig_bones() if not bone.part.startswith("hand")]
    for side in "LR":
        upper, lower = (
            next(bone for bone in bones if bone.part == f"{part}.{side}") for part in ("upper_arm", "forearm")
        )
        biceps = RigBone(f"biceps.{side}", upper.part, (upper.head + upper.tail) / 2, upper.tail)
        bones[bones.index(lower)] = replace(lower, parent=biceps.part)
        bones.append(biceps)
    names = {part: name for part, name in without_between(UNREAL).items() if not part.startswith("hand")}
    assert match_bones(rest_of(bones, UNREAL)) == names


def hanging_on(part, name, *places):
    """Extra bones, each on the one before, and the first on a part's."""
    return [(f"{name}{number}", part if not number else f"{name}{number - 1}", at) for number, at in enumerate(places)]


WINGS = [one for x in (0.1, -0.1) for one in hanging_on("chest", f"wing{x}", (x, 0.1, 1.5), (6 * x, 0.2, 1.9))]
FINGERS = (MIXAMO, "mixamorig:LeftHandIndex{}"), (UNREAL, "index_0{}_l"), (VRM, "J_Bip_L_Index{}")
# A rig, its arms, bones more, and which of these are fingers.
BESIDE = {
    "helpers": (UNREAL, T_POSE, [
        ("upperarm_twist_01_l", "upper_arm.L", (0.3, 0, 1.45)),
        ("ik_hand_l", "hips", (0.74, 0, 1.45)),
        ("thumb_01_l", "hand.L", (0.78, 0, 1.4)),
        ("DEF-thigh_l", "hips", (0.1, 0, 0.9)),
        ("skirt_mid_r", "hips", (-0.1, 0, 0.7)),
        ("foot_thumb_01_l", "foot.L", (0.1, -0.2, 0.02)),
        ("lMid1", "hand.L", (0.8, 0, 1.4)),
    ], {"thumb.L": "thumb_01_l", "middle.L": "lMid1"}),
    "volumes as of Second Life, in a rig that calls bones after joints": (MAYA, T_POSE, [
        ("L_Arm", "upper_arm.L", (0.3, 0, 1.45)),
        ("R_Leg", "thigh.R", (-0.1, 0, 0.8)),
        ("HEAD", "head", (0, 0, 1.7)),
        ("Eye", "head", (0, 0, 1.7)),
        ("L_Toe", "toes.L", (0.1, -0.2, 0)),
        ("R_Ball", "foot.R", (-0.1, -0.1, 0)),
        ("R_Heel", "toes.R", (-0.1, 0.1, 0)),
    ], {}),
    "poles": (UNREAL, T_POSE, [("knee_l", "foot.L", (0.1, -0.5, 0.5)), ("elbow_l", "hips", (0.5, 0.4, 1.4))], {}),
    "a thing": (UNREAL, T_POSE, [("weapon_hand_l", "hips", (1, 0, 1)), ("weapon_l", "weapon_hand_l", (1, 0, 1.2))], {}),
    "hair": (NAMELESS, A_POSE, hanging_on("head", "hair", (0, 0.1, 1.8), (0, 0.2, 1.5), (0, 0.2, 1.0)), {}),
    "a sword": (NAMELESS, A_POSE, hanging_on("hand.R", "sword", *((-0.8, y, 1.45) for y in (-0.02, -0.6, -1.2))), {}),
    "wings": (NAMELESS, A_POSE, WINGS, {}),
    **{
        f"a finger called {name}": (names, T_POSE, [
            (name.format(number), "hand.L", (0.8 + 0.03 * number, 0, 1.45)) for number in (1, 2, 3)
        ], {"index.L": name.format(1)})
        for names, name in FINGERS
    },
}  # fmt: skip


@pytest.mark.parametrize(("names", "arms", "extra", "fingers"), BESIDE.values(), ids=BESIDE)
def test_bones_beside_those_of_a_person_are_none_but_the_first_of_fingers(names, arms, extra, fingers):
    assert match_bones(at_rest(names, arms, extra=extra)) == without_between(names) | fingers


METATARSALS = hanging_on("toes.L", "toe1-", (0.1, -0.1, 0)) + hanging_on(
    "foot.L", "toe2-", (0.12, -0.05, 0), (0.12, -0.1, 0)
)


@pytest.mark.parametrize("side", ["L", "R"])
def test_arms_without_shoulders_have_none_though_a_hand_holds_something_long(side):
    bones = [replace(bone, parent="chest") if bone.part.startswith("upper_arm") else bone for bone in rig_bones(A_POSE)]
    bones = [bone for bone in bones if not bone.part.startswith("shoulder")]
    for hand in [bone for bone in bones if bone.part.startswith("hand")]:
        bones.append(RigBone(f"finger {hand.part}", hand.part, hand.tail, 2 * hand.tail - hand.head))
        if hand.part[-1] == side:
            bones.append(RigBone("sword", hand.part, hand.tail, hand.tail - (0, 1.2, 0)))
    own = {part: name for part, name in without_between(NAMELESS).items() if not part.startswith("shoulder")}
    assert match_bones(rest_of(bones, NAMELESS)) == own


@pytest.mark.parametrize(
    ("first", "extra"), [("toe1-1.L", [("toe2-1.L", "foot.L", (0.1, -0.1, 0))]), ("metatarsal1.L", METATARSALS)]
)
def test_toes_that_are_apart_have_no_bone_for_all(first, extra):
    called = {"toe1-0": "toe1-1.L", "toe2-0": "metatarsal2.L", "toe2-1": "toe2-1.L"}
    names = UNREAL | {"toes.L": first} | called
    found = match_bones(at_rest(names, extra=[*extra, ("ball_end_r", "toes.R", (0, -0.2, 0))]))
    assert found == {part: name for part, name in without_between(UNREAL).items() if part != "toes.L"}


def test_in_files_of_games_controls_that_are_left_are_no_head_and_no_shoulders():
    """What hangs on nothing, and what the arm does not hang on."""
    bones = [replace(bone, parent="chest") if bone.part.startswith("upper_arm") else bone for bone in rig_bones()]
    bones.append(RigBone("head_", None, np.array([0, -0.5, 1.6]), np.array([0, -0.5, 1.7])))
    own = without_between(UNREAL)
    found = match_bones(replace(rest_of(bones, UNREAL), held=False))
    assert found == {part: name for part, name in own.items() if not part.startswith("shoulder")}


def test_a_biped_s_pelvis_is_its_hips_though_legs_hang_on_its_spine():
    bones = [replace(bone, parent="low") if bone.parent == "hips" else bone for bone in rig_bones()]
    hips = bones[0]
    bones.append(RigBone("low", "hips", hips.tail, np.add(hips.tail, (0, 0, 0.05))))
    assert match_bones(rest_of(bones, UNREAL)) == without_between(UNREAL)
    with_low = without_between(NAMELESS) | {"hips": "low"}
    assert match_bones(rest_of(bones, NAMELESS)) == with_low, "which names alone say"


def test_a_bone_of_the_pelvis_that_is_called_a_thigh_is_none():
    bones = [replace(bone, parent=f"__{bone.part}") if bone.part.startswith("thigh") else bone for bone in rig_bones()]
    at = {bone.part: bone.head for bone in bones}
    bones += [RigBone(f"__thigh.{side}", "hips", at["hips"], at[f"thigh.{side}"]) for side in "LR"]
    assert match_bones(rest_of(bones, UNREAL)) == without_between(UNREAL)


@pytest.mark.parametrize("table", CONTROLS)
def test_control_rigs_are_known_by_their_controls(table):
    names = tuple(name for name in table.values() if name != "-")
    far = np.zeros((len(names), 3))
    found = match_bones(RestBones(names, np.full(len(names), -1), far, far))
    assert found == {part: name for part, name in table.items() if name != "-"}


def test_of_mixamo_s_control_rig_the_controls_are_moved_not_the_bones_that_follow_them():
    names = (*MIXAMO.values(), *CONTROLS[3].values(), "Foot_FK_Left", "Ctrl_Hand_IK_Left")
    far = np.zeros((len(names), 3))
    found = match_bones(RestBones(names, np.full(len(names), -1), far, far))
    assert (found["hips"], found["thigh.L"], found["foot.L"]) == (
        "Ctrl_Hips",
        "Ctrl_UpLeg_FK_Left",
        "Ctrl_Foot_FK_Left",
    )


def test_in_files_of_games_what_deforms_is_moved_not_controls_that_move_nothing():
    extra = [("thigh_fk_l", "hips", (0.1, 0, 0.94)), ("lowerarm_fk_l", "chest", (0.48, 0, 1.45))]
    rig = at_rest(UNREAL, extra=extra)
    assert match_bones(rig)["thigh.L"] == "thigh_fk_l"
    assert match_bones(replace(rig, held=False)) == without_between(UNREAL)
    for number in ("", "_012"):  # as Sketchfab adds
        there = {part: name + number for part, name in DEFORMING.items() if not part.startswith("toes")}
        names = (*there.values(), *CONTROLS[0].values())
        far = np.zeros((len(names), 3))
        assert match_bones(RestBones(names, np.full(len(names), -1), far, far, held=False)) == there


def test_bones_that_hang_on_controls_are_none_of_a_person_s():
    names = UNREAL | {"hips": "ORG-pelvis", "chest": "MCH-spine_03"}
    assert match_bones(at_rest(names)).keys() == without_between(UNREAL).keys() - {"hips", "chest"}


@pytest.mark.parametrize("names", [(), ("Bone", "Bone.001")])
def test_what_is_no_person_matches_nothing(names):
    ends = np.arange(3.0) * np.arange(len(names))[:, None]
    assert match_bones(RestBones(names, np.arange(len(names)) - 1, ends, ends + 1)) == {}


@pytest.mark.parametrize(
    ("name", "part"),
    [
        ("lShldrBend", "upper_arm.L"),
        ("CC_Base_R_Forearm", "forearm.R"),
        ("Bip01 L Calf", "shank.L"),
        ("ValveBiped.Bip01_R_UpperArm", "upper_arm.R"),
        ("leftUpperLeg", "thigh.L"),
        ("DEF-upper_arm.L.001", "upper_arm.L"),
        ("LoLeg_R", "shank.R"),
        ("Fist.L", "hand.L"),
        ("RForeArm", "forearm.R"),
        ("Skeleton_LUArm", "upper_arm.L"),
        ("RFArm", "forearm.R"),
        ("leg_lower.R", "shank.R"),
        ("thigh_stretch.l", "thigh.L"),
        ("CC_Base_Hip", "hips"),
        ("LeftHandThumb1", "thumb.L"),
        ("lMid1", "middle.L"),
        ("l_toebase_JNT", "toes.L"),
        ("LeftIndexProximal", "index.L"),
        ("little_proximal.R", "pinky.R"),
        ("LeftIndexDistal", None),
        ("左足首", "foot.L"),
        ("左人指１", "index.L"),
        ("third1_R", "ring.R"),
        ("ひじ.R", "forearm.R"),
        ("右足ＩＫ", None),
        ("左肩P", None),
        ("hand_ik.L", None),
        ("lThighTwist", None),
    ],
)
def test_names_are_read(name, part):
    assert read_as([name]).get(name) == part


def test_a_map_of_another_rig_says_the_parts():
    moved = {name: f"own {part}" for part, name in BONE_NAMES["HUMANIK"].items()} | {"Spine2": "own chest"}
    assert match_map(moved) == {part: f"own {part}" for part in BONE_NAMES["HUMANIK"]}


def test_bones_without_a_partner_are_left_out(tmp_path):
    path = tmp_path / "a.bmap"
    path.write_bytes(b"c_head.x%False%\r\nHead\r\nFalse\r\nFalse\r\n\r\nNone%False%\r\nEnd\r\nFalse\r\nFalse\r\n")
    assert read_bone_map(path) == {"Head": "c_head.x"}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.json", "[]"),
        ("a.json", '{"bones": 3}'),
        ("a.json", '{"bones": [1, {"SourceBoneName": ["a"], "DestinationBoneName": "b"}]}'),
        ("a.bmap", "one\n\n\n\n"),
    ],
)
def test_what_maps_nothing_is_refused(tmp_path, name, text):
    (tmp_path / name).write_text(text)
    refused(r"maps no bones; expected a \.bmap", read_bone_map, tmp_path / name)
