# SPDX-License-Identifier: GPL-3.0-or-later
"""The take's motion on rigs of people's own: any names, rest, size, place and rotation mode; what is theirs stays."""

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from unittest.mock import MagicMock

import bpy
import numpy as np
import pytest
from mathutils import Euler, Matrix, Vector

from addon.core.geometry.rotations import turn_of
from addon.core.posing.character import both_sides
from addon.core.posing.finer import finer
from addon.io.markersets import open_markerset
from addon.scene import take as takes
from addon.scene.armature import continuous_angles
from addon.scene.relabelled import show_again
from addon.scene.retargeting import ReadyRig
from tests.inputs.rigs import (
    A_POSE,
    HANGING,
    MIXAMO,
    NAMELESS,
    UNREAL,
    VRM,
    add_rig,
    bones_of,
    generated,
    hanging,
    mixamo,
    nameless,
    rig_bones,
    unreal,
)
from tests.inputs.worn import with_fingers

from .hands import add_object, choose, only, ours, press, refused, reopen

LIMBS = {"upper_arm": "forearm", "forearm": "hand", "thigh": "shank", "shank": "foot"}
MOST_OFF = np.radians(0.1)  # without feet to be kept, limbs point as the body's do
BY_IK_OFF = np.radians(5)  # as a knee that is hardly bent has no plane


def retargeted(rig, feet=False, **settings):
    """The action that the button gives a rig."""
    bpy.context.view_layer.objects.active = rig
    rig.mocap_autolabel.keep_feet = feet
    for name, value in settings.items():
        setattr(rig.mocap_autolabel, name, value)
    assert bpy.ops.mocap_autolabel.retarget() == {"FINISHED"}
    return rig.animation_data.action


def ways_off(take, rig, names):
    """(F, limbs) rad between the limbs of a rig and those of the take's body, in frames in which it was found."""
    segments, motion = take.markerset.skeleton.segments, take.motion
    off = []
    for index in np.flatnonzero(np.isfinite(motion.joints).all(axis=(1, 2))):
        bpy.context.scene.frame_set(int(motion.frames[index]))
        row = []
        for side in "LR":
            for begin, end in LIMBS.items():
                places = [rig.matrix_world @ rig.pose.bones[names[f"{part}.{side}"]].head for part in (end, begin)]
                own = [motion.joints[index, segments.index(f"{part}.{side}")] for part in (end, begin)]
                way, goal = np.array(places[0] - places[1]), own[0] - own[1]
                row.append(np.arccos(min(way @ goal / np.linalg.norm(way) / np.linalg.norm(goal), 1.0)))
        off.append(row)
    return np.array(off)


@pytest.mark.parametrize(("make", "names"), [(mixamo, MIXAMO), (unreal, UNREAL), (hanging, VRM), (nameless, NAMELESS)])
def test_limbs_point_as_the_body_s(shown, make, names):
    rig = make()
    for number, bone in enumerate(rig.pose.bones if make is unreal else ()):
        bone.rotation_mode = ("XYZ", "AXIS_ANGLE", "ZXY")[number % 3]
    assert retargeted(rig).name == f"{shown.name} retargeted"
    assert ways_off(shown, rig, names).max() < MOST_OFF


def on_the_hips(rig):
    """Feet and hands hang on the hips, as the former do where a solver by IK brings the legs to them."""
    with bones_of(rig) as bones:
        for part in ("foot.L", "foot.R", "hand.L"):
            bones[UNREAL[part]].parent = bones[UNREAL["hips"]]


def on_the_hips_unturned(rig):
    """And do not turn with them."""
    on_the_hips(rig)
    for part in ("foot.L", "hand.L"):
        rig.data.bones[UNREAL[part]].use_inherit_rotation = False


def within_limits(rig):
    for part in ("thigh.L", "forearm.R"):
        held = rig.pose.bones[UNREAL[part]].constraints.new("LIMIT_ROTATION")
        held.use_limit_x = held.use_limit_y = held.use_limit_z = True
        held.owner_space = "LOCAL"
    held = rig.pose.bones[UNREAL["hips"]].constraints.new("LIMIT_LOCATION")
    held.use_min_x = held.use_max_x = True


def hanging_on_two(rig):
    target = rig.pose.bones[UNREAL["hand.L"]].constraints.new("ARMATURE").targets.new()
    target.target, target.subtarget = rig, UNREAL["hips"]


def stretched_to_others(rig):
    rig.pose.bones[UNREAL["shank.L"]].constraints.new("STRETCH_TO").target = add_object("box")
    curve = add_object("curve", bpy.data.curves.new("curve", "CURVE"))
    curve.data.splines.new("BEZIER").bezier_points.add(1)
    curve.data.splines[0].bezier_points[1].co = 1, 0, 1
    held = rig.pose.bones[UNREAL["chest"]].constraints.new("SPLINE_IK")
    held.target, held.chain_count = curve, 3


def under_strips(rig):
    """With another action that poses all of it, pushed down."""
    pose = bpy.data.actions.new("pose")
    rig.animation_data_create().action = pose
    for bone in rig.pose.bones:
        bone.rotation_quaternion, bone.location, bone.scale = (0.8, 0.6, 0, 0), (0.05, 0, 0), (1, 1.2, 1)
        for channel in ("rotation_quaternion", "location", "scale"):
            bone.keyframe_insert(channel, frame=1)
    rig.animation_data.nla_tracks.new().strips.new("pose", 1, pose)
    rig.animation_data.action = None


def loose_under_strips(rig):
    on_the_hips(rig)
    under_strips(rig)


@pytest.mark.parametrize(
    "change",
    [on_the_hips, on_the_hips_unturned, within_limits, hanging_on_two, stretched_to_others, loose_under_strips],
)
def test_limbs_hold_together_and_point_as_the_body_s_however_bones_hang(shown, change):
    other, rig = (add_rig(rig_bones(A_POSE, 1.02, 0.48, 0.7), UNREAL) for _ in range(2))
    retargeted(other)
    change(rig)
    for _ in range(2):
        retargeted(rig)
        assert ways_off(shown, rig, UNREAL).max() < MOST_OFF
        poses = ([one.pose.bones[name].matrix for name in UNREAL.values()] for one in (other, rig))
        np.testing.assert_allclose(*poses, atol=1e-4)
    assert rig.animation_data.use_nla


def test_an_action_that_adds_to_strips_scales_nothing(shown):
    rig = add_rig(rig_bones(), UNREAL)
    under_strips(rig)
    rig.animation_data.action_blend_type = "ADD"
    curves = retargeted(rig).layers[0].strips[0].channelbags[0].fcurves
    assert not [curve for curve in curves if curve.data_path.endswith("scale")]


@pytest.mark.parametrize("part", ["spine", "between", "chest", "head", "shoulder.L", "hand.L", "foot.R", "toes.L"])
def test_what_drivers_turn_beside_arms_and_legs_stays_and_limbs_point_as_the_body_s(shown, part):
    rig = add_rig(rig_bones(A_POSE), UNREAL)
    turned_by_a_driver(rig, rig.pose.bones[UNREAL[part]])
    rig.pose.bones[0]["IK_FK"] = 0.0
    action = retargeted(rig)
    assert list(json.loads(action["mocap_switched"]).values()) == [0.0]
    assert ways_off(shown, rig, UNREAL).max() < MOST_OFF
    paths = [curve.data_path for curve in action.layers[0].strips[0].channelbags[0].fcurves]
    assert not [path for path in paths if f'"{UNREAL[part]}"' in path]


@pytest.mark.parametrize("channel", ["location", "hide_viewport"])
def test_a_rig_on_what_is_animated_is_refused_and_on_what_stands_still_is_not(shown, channel):
    rig, above, top = add_rig(rig_bones(), UNREAL), add_object("box"), add_object("box")
    rig.parent, above.parent = above, top
    top.keyframe_insert(channel, frame=1)
    if channel == "location":
        with pytest.raises(RuntimeError, match=f"hangs on {top.name}, which is animated"):
            retargeted(rig)
        assert rig.animation_data is None
    else:
        retargeted(rig)


def test_a_bone_that_a_driver_scales_unevenly_is_not_taken_for_one_that_is_turned(shown):
    rig = add_rig(rig_bones(A_POSE), UNREAL)
    rig.pose.bones[UNREAL["between"]].driver_add("scale", 1).driver.expression = "1.2"
    retargeted(rig)


BLENRIG = both_sides(
    "master_torso spine_1_fk spine_3_fk neck_1_fk head_fk",
    "shoulder_* arm_fk_* forearm_fk_* hand_fk_* thigh_fk_* shin_fk_* foot_fk_* foot_toe_1_fk_*",
    ("L", "R"),
) | {"between": "spine_2_fk"}


@pytest.mark.parametrize(("names", "expression"), [(BLENRIG, "1 - on"), (UNREAL, "on")])
def test_legs_of_blenrig_are_switched_to_fk_and_of_no_other_rig(shown, names, expression):
    rig = add_rig(rig_bones(), names)
    rig.pose.bones[0]["ik_leg_L"] = 0.0
    solver = rig.pose.bones[names["shank.L"]].constraints.new("IK")
    solver.target, solver.chain_count = add_object("box"), 2
    driver = solver.driver_add("influence").driver
    on, driver.expression = driver.variables.new(), expression
    on.name, on.targets[0].id, on.targets[0].data_path = "on", rig, f'pose.bones["{names["hips"]}"]["ik_leg_L"]'
    retargeted(rig)
    assert ways_off(shown, rig, names).max() < MOST_OFF
    rig.animation_data.action = bpy.data.actions.new("own")
    ours("scene.retargeting").follow_actions()
    assert rig.pose.bones[0]["ik_leg_L"] == 0.0


def test_planted_feet_stay_where_bones_do_not_turn_with_others(shown):
    poses = []
    for inherits in (True, False):
        rig = add_rig(rig_bones(), UNREAL)
        for bone in rig.data.bones:
            bone.use_inherit_rotation = inherits
        retargeted(rig, feet=True)
        bpy.context.scene.frame_set(int(shown.motion.frames[-1]))
        poses.append([np.array(bone.matrix) for bone in rig.pose.bones])
    np.testing.assert_allclose(*poses, atol=1e-4)


def test_bones_that_end_far_away_are_found_and_toes_bend_as_where_they_do_not(shown):
    """As glTF's importer makes them of a rig with a scale of its own."""
    turns = []
    for longer in (1.0, 100.0):
        rig = add_rig(rig_bones(A_POSE), NAMELESS)
        with bones_of(rig) as bones:
            for bone in bones:
                bone.tail = bone.head + (bone.tail - bone.head) * longer
        retargeted(rig, feet=True)
        assert {row.bone for row in rig.mocap_autolabel.bones} - {""} == set(NAMELESS.values()) - {NAMELESS["between"]}
        bpy.context.scene.frame_set(int(shown.motion.frames[-1]))
        turns.append([np.array(bone.matrix)[:3, :3] for bone in rig.pose.bones])
    np.testing.assert_allclose(*turns, atol=0.2)  # toes of unknown length are as long as the body's


def test_toes_that_are_apart_say_where_a_foot_ends():
    rig = add_rig(rig_bones(), UNREAL)
    with bones_of(rig) as own:
        foot, toes, twin = own[UNREAL["foot.L"]], own[UNREAL["toes.L"]], own.new("twin")
        foot.length *= 0.4
        twin.head, twin.tail, twin.parent = toes.head, toes.tail, foot
    bones = [(part, name) for part, name in UNREAL.items() if not part.startswith(("toes", "between"))]
    rest = ReadyRig.of(rig, bones, np.eye(4)).rest
    ball = next(bone.head for bone in rig_bones() if bone.part == "toes.L")
    np.testing.assert_allclose(rest.tails[rest.at["foot.L"]], ball, atol=1e-5)


def test_toes_end_where_a_bone_at_their_end_begins_however_an_importer_lays_them():
    rig, tip = add_rig(rig_bones(), UNREAL), (0.14, -0.22, 0.02)
    with bones_of(rig) as own:
        toes = own[UNREAL["toes.L"]]
        toes.tail = toes.head + Vector((0, 0.01, 0.2))
        for name, place in (("heel", (0.1, 0.3, 0.0)), ("end", tip)):
            bone = own.new(name)
            bone.head, bone.tail, bone.parent = place, (0, 0, 0.3), toes
    bones = [(part, name) for part, name in UNREAL.items() if part != "between"]
    rest = ReadyRig.of(rig, bones, np.eye(4)).rest
    np.testing.assert_allclose(
        rest.tails[[rest.at["toes.L"], rest.at["toes.R"]]], [tip, (-0.13, -0.2, 0.02)], atol=1e-5
    )


def test_the_guide_s_script_moves_a_rig_without_a_window(shown, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    rig = mixamo()
    rig.name = "rig"
    bpy.data.libraries.write("rig.blend", {rig})
    bpy.data.objects.remove(rig)
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "walk.blend"))
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "walk.blend"))
    guide = (Path(__file__).parents[2] / "docs" / "guide" / "export.md").read_text("utf-8")
    exec(guide.partition("```py\n")[2].partition("```")[0], {})
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "walk on rig.blend"))
    action = bpy.data.objects["rig"].animation_data.action
    assert action.name == f"{shown.name} retargeted" and action.frame_range[1] == shown.motion.frames[-1]


def test_in_a_scene_of_another_rate_a_rig_moves_at_its_own_speed(shown):
    poses, scene = [], bpy.context.scene
    for rate in (60, 24):
        scene.render.fps, rig = rate, mixamo()
        retargeted(rig)
        assert bpy.ops.mocap_autolabel.add_character() == {"FINISHED"}
        for frame in range(24):
            whole, part = divmod(frame * rate / 60, 1.0)
            scene.frame_set(101 + int(whole), subframe=part)
            both = rig, next(item for item in bpy.data.objects if item.name.startswith(f"{shown.name} character"))
            poses.append([np.array(bone.matrix) for item in both for bone in item.pose.bones])
        bpy.data.objects.remove(both[1])
    assert scene.render.fps == 24 and (scene.frame_start, scene.frame_end) == (101, 124)
    found = [index for index in range(24) if index not in (3, 4)]
    np.testing.assert_allclose(*np.array(poses).reshape(2, 24, -1)[:, found], rtol=1e-4, atol=1e-4)


def test_keys_have_no_handles_until_blender_lays_them_for_who_makes_curves_of_the_lines(shown):
    """To lay them takes twice as long as all else that makes keys."""
    rig = mixamo()
    retargeted(rig)
    curve = ours("scene.ownership").curves_of(rig)[0]
    assert not any(curve.keyframe_points[5].handle_left)
    area = bpy.context.window.screen.areas[0]
    before, area.type = area.type, "DOPESHEET_EDITOR"
    area.spaces[0].mode = "ACTION"
    with bpy.context.temp_override(area=area, region=next(one for one in area.regions if one.type == "WINDOW")):
        bpy.ops.action.select_all(action="SELECT")
        bpy.ops.action.interpolation_type(type="BEZIER")
    area.type = before
    point = curve.keyframe_points[5]
    assert point.interpolation == "BEZIER"
    assert point.co.x - point.handle_left[0] == pytest.approx(1 / 3, abs=1e-4)


def test_played_as_the_take_rigs_and_characters_keep_their_speed(shown, capfd):
    scene, rig = bpy.context.scene, mixamo()
    scene.mocap_autolabel.take.objects.link(rig)
    scene.render.fps, scene.render.fps_base = 24, 1
    assert bpy.ops.mocap_autolabel.follow_rate() == {"FINISHED"}
    action = retargeted(rig)
    assert bpy.ops.mocap_autolabel.add_character() == {"FINISHED"}
    character = next(item for item in bpy.data.objects if item.name.startswith(f"{shown.name} character"))
    first, last = (int(shown.motion.frames[end]) for end in (0, -1))
    assert action.frame_range[1] < last - 1
    assert bpy.ops.mocap_autolabel.play_as_take() == {"FINISHED"}
    for one in (action, character.animation_data.action):
        np.testing.assert_allclose(one.frame_range, (first, last), atol=0.01)
    assert ways_off(shown, rig, MIXAMO).max() < MOST_OFF
    assert "old rate is kept" not in capfd.readouterr().out
    action.layers[0].strips[0].channelbags[0].fcurves[0].keyframe_points[0].co.y += 1  # by hand
    scene.render.fps = 30
    assert bpy.ops.mocap_autolabel.follow_rate() == {"FINISHED"}
    assert f"The old rate is kept by {rig.name}:" in capfd.readouterr().out
    assert action.frame_range[1] > character.animation_data.action.frame_range[1]
    before = character.animation_data.action.frame_range[:]
    scene.render.fps = 1  # in which keys would be one to Blender
    assert bpy.ops.mocap_autolabel.follow_rate() == {"FINISHED"}
    assert f"The old rate is kept by {rig.name}, {character.name}" in capfd.readouterr().out
    assert character.animation_data.action.frame_range[:] == before


def test_labelled_again_after_the_scene_s_rate_was_changed_rig_and_range_go_along_and_no_other_take(shown):
    scene, rigs = bpy.context.scene, [mixamo(), mixamo()]
    walk = scene.mocap_autolabel.take
    walk[takes.SOURCE] = "walk.csv"
    other = takes.show_take(bpy.context, replace(shown, name="other", source="other.csv"))
    for take, rig in zip((walk, other), rigs, strict=True):
        scene.mocap_autolabel.take = take
        retargeted(rig)
    scene.mocap_autolabel.take = walk
    [marker] = [item for item in other.all_objects if item.get("mocap_marker") == "LKNE"]
    action, *left = [item.animation_data.action for item in (*rigs, marker)]
    before = [list(one.frame_range) for one in left]
    scene.render.fps, scene.render.fps_base = 24, 1
    scene.frame_set(111)
    show_again(bpy.context, replace(shown, source="walk.csv"), whole=True)
    np.testing.assert_allclose(action.frame_range, (101, 101 + 23 * 24 / 60), atol=0.01)
    assert (scene.frame_start, scene.frame_end, scene.frame_float) == (101, 110, 105)
    assert [list(one.frame_range) for one in left] == before, "a person left it frame by frame"


def test_rest_poses_make_no_difference(shown):
    frames = shown.motion.frames[np.isfinite(shown.motion.joints).all(axis=(1, 2))]
    turns = []
    for rest in (0.0, HANGING):
        rig = add_rig(rig_bones(rest, roll=0.7 if rest else 0.0), VRM)
        axes = {part: np.array(rig.data.bones[name].matrix_local)[:3, :3] for part, name in VRM.items()}
        retargeted(rig)
        rows = []
        for frame in frames:
            bpy.context.scene.frame_set(int(frame))
            pose = {part: np.array(rig.pose.bones[name].matrix)[:3, :3] @ axes[part].T for part, name in VRM.items()}
            rows.append([pose["chest"].T @ pose[f"{part}.L"] for part in ("hand", "forearm", "shank")])
        turns.append(np.array(rows))
    # A twist of 1.7 degrees is left, because the arms of this rig do not hang in one plane.
    down = np.radians(HANGING)  # the arm's own turn from one rest to the other is in the second alone
    lowered = np.array([[np.cos(down), 0, np.sin(down)], [0, 1, 0], [-np.sin(down), 0, np.cos(down)]])
    np.testing.assert_allclose(turns[1][:, :2] @ lowered, turns[0][:, :2], atol=0.05)
    np.testing.assert_allclose(turns[1][:, 2], turns[0][:, 2], atol=0.05)


def test_rigify_is_moved_by_its_controls(shown):
    import addon_utils

    if addon_utils.enable("rigify", default_set=True) is None:
        pytest.skip("this Blender has no Rigify")
    rig, words = generated(), {part: part for part in LIMBS} | {"hand": "hand", "shank": "shin", "foot": "foot"}
    rig.pose.bones["chest"].rotation_quaternion = 0.8, 0.6, 0, 0
    retargeted(rig)
    assert rig.pose.bones["chest"].matrix_basis == Matrix()
    curves = rig.animation_data.action.layers[0].strips[0].channelbags[0].fcurves
    assert not [curve.data_path for curve in curves if '"MCH-' in curve.data_path]
    assert {f'pose.bones["toe_ik.{side}"].rotation_quaternion' for side in "LR"} <= {one.data_path for one in curves}
    names = {f"{part}.{side}": f"ORG-{word}.{side}" for part, word in words.items() for side in "LR"}
    assert ways_off(shown, rig, names).max() < MOST_OFF
    parents = [rig.pose.bones[f"{limb}_parent.{side}"] for limb in ("upper_arm", "thigh") for side in "LR"]
    assert {parent["IK_FK"] for parent in parents} == {1.0}
    curves = rig.animation_data.action.layers[0].strips[0].channelbags[0].fcurves
    curves.remove(curves.find(f'pose.bones["{parents[2].name}"]["IK_FK"]'))  # from IK to FK
    parents[2]["IK_FK"] = 0.0
    rig.update_tag()
    off = ways_off(shown, rig, names)  # the left leg's are the third and the fourth
    assert MOST_OFF < off[:, 2:4].max() < BY_IK_OFF
    # In a file of a game constraints are gone, and trunk and limbs hang on different bones.
    game = generated()
    for bone in game.pose.bones:
        for held in list(bone.constraints):
            bone.constraints.remove(held)
    game.pose.bones["hand_ik.L"].constraints.new("CHILD_OF")  # of a person's own
    retargeted(game)
    names = {f"{part}.{side}": f"DEF-{word}.{side}" for part, word in words.items() for side in "LR"}
    assert ways_off(shown, game, names).max() < MOST_OFF
    hips, thigh = (game.data.bones[f"DEF-{name}"].head_local for name in ("spine", "thigh.L"))
    apart = game.pose.bones["DEF-spine"].head - game.pose.bones["DEF-thigh.L"].head
    assert apart.length == pytest.approx((hips - thigh).length, abs=1e-4)


def test_fingers_that_are_worn_move_those_of_rigs_and_of_the_character(empty, made, extension, tmp_path):
    import addon_utils

    if addon_utils.enable("rigify", default_set=True) is None:
        pytest.skip("this Blender has no Rigify")
    markerset = finer(with_fingers(open_markerset("body39")))
    take = replace(made.take(8, markerset=markerset), rate=60.0)
    motion = take.motion
    empty.scene.mocap_autolabel.take = takes.show_take(empty, take)
    bpy.ops.object.armature_human_metarig_add()
    bpy.ops.pose.rigify_generate()
    rig = bpy.context.object
    retargeted(rig)
    segments, armature = markerset.skeleton.segments, next(one for one in bpy.data.objects if "mocap_scale" in one)
    fingers = {"thumb.L": "thumb.01.L", "index.L": "f_index.01.L", "pinky.R": "f_pinky.01.R"}
    for index in np.flatnonzero(np.isfinite(motion.joints).all(axis=(1, 2))):
        empty.scene.frame_set(int(motion.frames[index]))
        for finger, bone in fingers.items():
            at = segments.index(finger)
            rest = armature.data.bones[finger]
            way = motion.rotations[index, at] @ (rest.tail_local - rest.head_local).normalized()
            own = rig.matrix_world.to_3x3() @ rig.pose.bones[f"ORG-{bone}"].vector.normalized()
            assert np.degrees(np.arccos(np.clip(np.dot(way, own), -1, 1))) < 1
    assert bpy.ops.mocap_autolabel.export_bvh(filepath=str(tmp_path / "a.bvh")) == {"FINISHED"}
    assert "LeftHandIndex1" in (tmp_path / "a.bvh").read_text()


@pytest.mark.parametrize("mode", ["XYZ", "XZY", "YXZ", "YZX", "ZXY", "ZYX"])
def test_angles_are_those_that_blender_would_choose_after_those_before(mode):
    turns = turn_of(np.cumsum(np.random.default_rng(1).normal(0, 0.3, (3000, 3)), axis=0))
    before, expected = Euler((0, 0, 0), mode), []
    for turn in turns.tolist():
        before = Matrix(turn).to_euler(mode, before)
        expected.append(before[:])
    np.testing.assert_allclose(continuous_angles(mode, turns), expected, atol=1e-5)
    poles = turn_of(np.pi / 2 * np.vstack([np.eye(3), -np.eye(3)]))
    for turn, angles in zip(poles, continuous_angles(mode, poles).tolist(), strict=True):
        np.testing.assert_allclose(Euler(angles, mode).to_matrix(), turn, atol=1e-5)


def leg_by_ik(hung=False, last="shank.L"):
    """Mixamo's rig with its left leg by IK down to its `last` bone, and the foot turned as the control; with both.

    The pole may hang on the control.
    """
    rig = mixamo()
    with bones_of(rig) as bones:
        for name, place in (("control", bones[MIXAMO["foot.L"]].head), ("pole", bones[MIXAMO["shank.L"]].head)):
            own = bones.new(name)
            own.head = place + Vector((0, 0, 60 if name == "pole" else 0))
            own.tail = own.head + Vector((0, 0, 10))
        bones["pole"].parent = bones["control"] if hung else None
    solver = rig.pose.bones[MIXAMO[last]].constraints.new("IK")
    solver.target = solver.pole_target = rig
    solver.subtarget, solver.pole_subtarget, solver.chain_count = "control", "pole", 2
    copied = rig.pose.bones[MIXAMO["foot.L"]].constraints.new("COPY_ROTATION")
    copied.target, copied.subtarget = rig, "control"
    return rig, solver, copied


@pytest.mark.parametrize(("hung", "last"), [(False, "shank.L"), (True, "shank.L"), (False, "foot.L")])
def test_legs_by_ik_are_moved_by_fk_and_their_controls_go_along(shown, hung, last):
    rig, solver, copied = leg_by_ik(hung, last)
    retargeted(rig)
    assert ways_off(shown, rig, MIXAMO).max() < MOST_OFF
    assert solver.influence == copied.influence == 0.0
    for frame in shown.motion.frames[::20]:
        bpy.context.scene.frame_set(int(frame))
        hip, knee, ankle = (rig.pose.bones[MIXAMO[f"{part}.L"]].head for part in ("thigh", "shank", "foot"))
        assert (rig.pose.bones["control"].head - ankle).length < 0.01  # cm
        bent, pole = (place - hip.lerp(ankle, 0.5) for place in (knee, rig.pose.bones["pole"].head))
        assert bent.dot(pole) > 0.9 * bent.length * pole.length


def test_a_control_that_something_else_holds_stays_and_the_leg_moves(shown):
    rig, solver, copied = leg_by_ik()
    held = rig.pose.bones["control"].constraints.new("COPY_TRANSFORMS")
    held.target, copied.mute, copied.influence = add_object("box"), True, 0.5
    rig.pose.bones["control"].location.x = 3
    own = bpy.data.actions.new("own")
    for _ in range(3):  # a later time it is switched as it was before the first, whatever action it has by then
        action = retargeted(rig)
        assert (solver.influence, copied.influence, held.influence) == (0, 0.5, 1)
        assert json.loads(action["mocap_switched"]) == {solver.path_from_id("influence"): 1.0}
        assert rig.pose.bones["control"].location.x == 3
        action.use_fake_user, rig.animation_data.action = True, action if own.users else own
    rig.animation_data.action = action
    assert ways_off(shown, rig, MIXAMO).max() < MOST_OFF


def test_what_was_switched_is_known_whatever_a_rig_is_called(shown):
    rig, solver, _ = leg_by_ik()
    retargeted(rig)
    copy, (other, theirs, _) = rig.copy(), leg_by_ik()
    bpy.context.scene.collection.objects.link(copy)
    name, rig.name = rig.name, "renamed"
    copy.animation_data.action = None
    retargeted(rig)
    assert len([one for one in bpy.data.actions if "retargeted" in one.name]) == 1
    other.name, theirs.influence = name, 0.0  # by a person
    for one, known in ((rig, 1), (copy, 1), (other, 0)):
        one.animation_data_create().action = None
        assert json.loads(retargeted(one)["mocap_switched"]).get(solver.path_from_id("influence"), 0) == known


def test_drivers_by_time_are_asked_at_the_frame_that_is_shown(shown):
    rig = mixamo()
    copied = rig.pose.bones[MIXAMO["shank.L"]].constraints.new("COPY_ROTATION")
    copied.target, copied.subtarget = rig, MIXAMO["shank.R"]
    copied.driver_add("influence").driver.expression = "1.0 if frame < 50 else 0.0"
    retargeted(rig)
    assert ways_off(shown, rig, MIXAMO).max() < MOST_OFF


def test_a_persons_own_action_finds_the_rig_as_it_was(shown):
    rig, solver, copied = leg_by_ik()
    own = rig.animation_data_create().action = bpy.data.actions.new("own")
    copied.influence = 0.5
    action, follow = retargeted(rig), ours("scene.retargeting").follow_actions
    follow()
    assert (solver.influence, copied.influence) == (0, 0)
    for _ in range(2):
        for mine, influences in ((own, (1, 0.5)), (action, (0, 0))):
            rig.animation_data.action, rig.animation_data.action_slot = mine, mine.slots[0] if mine.slots else None
            follow()
            bpy.context.scene.frame_set(101)
            assert (solver.influence, copied.influence) == influences
    rig.animation_data.action = own
    follow()
    solver.influence = 0.25
    follow()
    assert solver.influence == 0.25, "it is his by then"


def test_what_a_person_switched_or_keyed_otherwise_is_theirs(shown):
    rig, solver, copied = leg_by_ik()
    bone, follow = rig.pose.bones["control"], ours("scene.retargeting").follow_actions
    bone["IK_FK"], bone["ik_fk_switch"] = 0.5, 0.0
    own = bpy.data.actions.new("own")
    action = retargeted(rig)
    action.use_fake_user = own.use_fake_user = True
    del bone["ik_fk_switch"]
    bone["IK_FK"] = 0.25
    rig.animation_data.action = own
    follow()  # whatever is gone is no error, neither now nor ever after
    assert (bone["IK_FK"], solver.influence, copied.influence) == (0.25, 1, 1)
    assert "mocap_switched" not in rig
    copied.influence = 0.75
    rig.animation_data.action, rig.animation_data.action_slot = action, action.slots[0]
    follow()
    bpy.context.scene.frame_set(101)
    assert (bone["IK_FK"], copied.influence) == (1, 0)
    rig.animation_data.action = own
    ours("ui").after_undo()  # the step that was undone to may be from before that was heard
    assert (bone["IK_FK"], copied.influence) == (0.25, 0.75)


def test_what_a_file_was_saved_with_is_a_persons(shown, tmp_path):
    rig, solver, _ = leg_by_ik()
    retargeted(rig)
    solver_path = solver.path_from_id("influence")
    rig.animation_data.action, name = bpy.data.actions.new("own"), rig.name
    reopen(tmp_path / "mine.blend")
    rig = bpy.data.objects[name]
    ours("scene.retargeting").follow_actions()
    assert rig.path_resolve(solver_path) == 0


def test_an_override_of_a_linked_rig_is_moved(shown, tmp_path):
    rig, path = mixamo(), str(tmp_path / "rig.blend")
    name = rig.name
    bpy.data.libraries.write(path, {rig})
    bpy.data.objects.remove(rig)
    with bpy.data.libraries.load(path, link=True) as (_, linked):
        linked.objects = [name]
    rig = linked.objects[0].override_create()
    bpy.context.scene.collection.objects.link(rig)
    retargeted(rig)
    assert ways_off(shown, rig, MIXAMO).max() < MOST_OFF
    rig.mocap_autolabel.bones["neck"].bone = ""
    assert bpy.ops.mocap_autolabel.retarget() == {"FINISHED"}
    reopen(tmp_path / "mine.blend")
    bpy.context.view_layer.objects.active = rig = bpy.data.objects[name]
    assert bpy.ops.mocap_autolabel.retarget() == {"FINISHED"}
    assert rig.mocap_autolabel.bones["neck"].bone == "", "Blender does not save what is chosen for an override"
    assert rig.mocap_autolabel.bones["head"].bone == MIXAMO["head"]


def test_a_rig_is_as_it_was_where_its_keys_cannot_be_told_or_its_hips_stay(shown, monkeypatch):
    rig, solver, _ = leg_by_ik()
    rig.animation_data_create().action = own = bpy.data.actions.new("own")
    rig.pose.bones["control"].location.x = 3
    with monkeypatch.context() as patch, pytest.raises(RuntimeError, match="ZeroDivisionError"):
        patch.setattr(ours("scene.ik_controls").Along, "channels", lambda *_: 1 / 0)
        retargeted(rig)
    assert rig.animation_data.action == own and solver.influence == 1
    assert rig.pose.bones["control"].location.x == 3
    retargeted(rig)
    held = rig.pose.bones[MIXAMO["hips"]].constraints.new("COPY_LOCATION")
    held.target = add_object("held to")
    rig.animation_data.action = other = bpy.data.actions.new("other")
    refused("does not go where it is put; expected it without constraints", "retarget")
    assert rig.animation_data.action == other and not other.use_fake_user and len(bpy.data.actions) == 4
    assert solver.influence == 0


def test_of_several_performers_one_moves_the_rig_and_a_preview_follows_who_that_is(empty, made, extension):
    take, rig = made.pair(12, markerset=open_markerset("body26")), add_rig(rig_bones(), MIXAMO)
    bpy.context.scene.mocap_autolabel.take = takes.show_take(bpy.context, take)
    action = retargeted(rig, performer="ann")
    keys = keyed(rig)
    rig.mocap_autolabel.performer = "bob"
    is_new(rig, keys, action)
    assert action.name == "duet bob retargeted"
    bpy.context.scene.frame_set(int(take.motion.frames[0]))
    hips = [rig.pose.bones[MIXAMO[f"thigh.{side}"]].head for side in "LR"]
    segments = list(open_markerset("body26").skeleton.segments)
    body = take.motion.joints[0, [len(segments) + segments.index(f"thigh.{side}") for side in "LR"]]
    apart = np.array(hips[0] - hips[1])[:2], (body[0] - body[1])[:2]
    assert apart[0] @ apart[1] > 0.99 * np.linalg.norm(apart[0]) * np.linalg.norm(apart[1])
    rig.mocap_autolabel.performer = "ann"
    assert keyed(rig) == keys
    press("bake_retarget")
    rig.mocap_autolabel.performer = "bob"
    assert keyed(rig) == keys
    assert action.name == "duet ann on rig"


def test_what_a_person_made_is_kept_and_what_was_retargeted_replaced(shown):
    rig = add_rig(rig_bones(), MIXAMO)
    own = bpy.data.actions.new("mine")
    rig.animation_data_create().action = own
    first = retargeted(rig)
    assert own.use_fake_user
    assert rig.animation_data.action == first != own
    again = retargeted(rig)
    assert [one.name for one in bpy.data.actions if "retargeted" in one.name] == [again.name]
    bag = again.layers[0].strips[0].channelbag(again.slots[0])
    bag.fcurves[0].keyframe_points[0].co.y += 1  # by hand
    assert retargeted(rig) != again
    assert again.use_fake_user
    assert len(bpy.data.actions) >= 3
    action, matched_before = rig.animation_data.action, ours("scene.retargeting").matched_before
    assert matched_before(rig)
    action["mocap_matched"] = json.dumps(json.loads(action["mocap_matched"]) | {"neck": "gone"})
    assert not matched_before(rig), "the rig does not have them all"


def keyed(rig):
    """The values of all keys of a rig, by what they move."""
    curves = ours("scene.ownership").curves_of(rig)
    return {(one.data_path, one.array_index): [key.co.y for key in one.keyframe_points] for one in curves}


def is_new(rig, before, action):
    """Asserts that a rig has other keys in the same action, those that Retarget gives it; gives them."""
    now = keyed(rig)
    assert now != before and rig.animation_data.action == action
    bpy.context.view_layer.objects.active = rig
    press("retarget")
    assert keyed(rig) == now and rig.animation_data.action == action
    return now


def swap():
    """Corrects a take so that its body moves otherwise."""
    bpy.context.scene.mocap_autolabel.subjects.markerset = "body26"
    choose("LWRA", "LKNE")
    press("swap_markers", scope="WHOLE")


def test_until_it_is_baked_an_action_follows_choices_bones_and_corrections(shown):
    rig, hand = mixamo(), f'pose.bones["{MIXAMO["hand.L"]}"].rotation_quaternion'
    action, own = retargeted(rig), rig.mocap_autolabel
    keys = keyed(rig)
    for name in ("keep_feet", "keep_hands"):
        setattr(own, name, True)
        keys = is_new(rig, keys, action)
    own.bones["hand.L"].bone = ""
    keys = is_new(rig, keys, action)
    assert (hand, 0) not in keys
    press("match_bones")
    keys = is_new(rig, keys, action)
    assert (hand, 0) in keys
    swap()
    keys = is_new(rig, keys, action)
    press("bake_retarget")
    assert action.name == f"{shown.name} on {rig.name}"
    own.keep_feet = False
    press("remove_correction", index=0)
    assert keyed(rig) == keys and action.use_fake_user
    bpy.context.view_layer.objects.active = rig
    refused("Press Retarget first", "bake_retarget")
    assert retargeted(rig) != action


@pytest.mark.parametrize(("pixels", "longest"), [(280, 16), (560, 43)])
def test_a_pair_of_names_that_has_no_room_in_a_row_has_two(shown, monkeypatch, pixels, longest):
    rig, panels, layout, drawn = mixamo(), ours("ui.panels"), MagicMock(), MagicMock()
    own = [SimpleNamespace(name=part, bone="b" * length) for length in (16, 17, 43, 44) for part in ("hand.L",)]
    rig.mocap_autolabel.bones.clear()
    monkeypatch.setattr(panels, "fold", lambda *_: drawn)
    monkeypatch.setattr(panels, "is_left_behind", lambda *_: False)
    pairs = SimpleNamespace(bones=own)
    sidebar = SimpleNamespace(
        region=SimpleNamespace(width=2 * pixels),
        preferences=SimpleNamespace(system=SimpleNamespace(ui_scale=2.0)),
        scene=bpy.context.scene,
    )
    panels._draw_rig(
        sidebar, layout, SimpleNamespace(name="rig", mocap_autolabel=pairs, animation_data=None, data=None)
    )
    column = drawn.column()
    in_one = [call.args[0].bone for call in column.split().prop_search.mock_calls]
    in_two = [call.args[0].bone for call in column.prop_search.mock_calls]
    assert max(map(len, in_one)) == longest and sorted(map(len, in_one + in_two)) == [16, 17, 43, 44]
    assert len(column.label.mock_calls) == len(in_two)


def test_a_bone_that_is_chosen_no_more_is_posed_as_before(shown):
    rig = mixamo()
    hand, head = (rig.pose.bones[MIXAMO[part]] for part in ("hand.L", "head"))
    for bone in (hand, head):
        bone.rotation_mode, bone.rotation_euler = "XYZ", (0.1, 0.2, 0.3)
    retargeted(rig)
    own = rig.mocap_autolabel
    bpy.context.scene.frame_set(120)
    before = hand.rotation_euler.copy()
    own.bones["hand.L"].bone = ""
    assert before != hand.rotation_euler == Euler((0.1, 0.2, 0.3))
    bpy.context.scene.frame_set(110)
    assert hand.rotation_euler == Euler((0.1, 0.2, 0.3)) != head.rotation_euler
    hand.rotation_euler = 0.4, 0.5, 0.6  # theirs by now
    own.bones["thigh.R"].bone = ""  # without which nobody moves: the preview stays as it is
    assert head.rotation_euler != Euler((0.1, 0.2, 0.3))
    own.bones["thigh.R"].bone = MIXAMO["thigh.R"]
    own.keep_feet = True
    press("discard_retarget")
    assert hand.rotation_euler == Euler((0.4, 0.5, 0.6)) and head.rotation_euler == Euler((0.1, 0.2, 0.3))


def test_choices_work_with_the_settled_body_that_is_there_until_it_or_its_rest_is_another(shown, monkeypatch):
    rig, moving, asked = mixamo(), ours("core.retarget.moving").Moving, []
    settled = moving.settled
    monkeypatch.setattr(moving, "settled", lambda body: asked.append(body) or settled(body))
    retargeted(rig)
    for wanted in (True, False):
        rig.mocap_autolabel.keep_hands = wanted
    assert len(asked) == 1
    swap()
    assert len(asked) == 2
    [own] = only(bpy.context.scene.mocap_autolabel.take, "ARMATURE")
    with bones_of(own) as bones:
        bones["hand.L"].tail.x += 0.01
    retargeted(rig)
    assert len(asked) == 3


def test_a_preview_that_cannot_follow_or_has_a_persons_keys_stays_as_it_is(shown):
    rig, preview = mixamo(), ours("scene.rig_preview")
    action, own = retargeted(rig), rig.mocap_autolabel
    keys, bone = keyed(rig), own.bones["hand.L"].bone
    own.bones["hand.L"].bone = MIXAMO["hand.R"]  # which is a part already
    assert keyed(rig) == keys and preview.is_left_behind(bpy.context, rig)
    own.bones["hand.L"].bone = bone
    assert not preview.is_left_behind(bpy.context, rig)
    ours("scene.ownership").curves_of(rig)[0].keyframe_points[0].co.y += 1  # by hand
    keys = keyed(rig)
    own.keep_hands = True
    assert keyed(rig) == keys and preview.is_left_behind(bpy.context, rig)
    assert retargeted(rig) != action and action.use_fake_user
    press("discard_retarget")
    assert rig.animation_data.action == action and keyed(rig) == keys
    press("discard_retarget")
    assert rig.animation_data.action is None and action in [*bpy.data.actions]


@pytest.mark.parametrize("with_action", [True, False])
def test_discarded_a_preview_leaves_action_pose_and_switches_as_they_were(shown, tmp_path, with_action):
    rig, solver, _ = leg_by_ik()
    rig.pose.bones["control"].location.x, rig.pose.bones["control"]["IK_FK"] = 3, 0.0
    rig.pose.bones[MIXAMO["head"]].rotation_quaternion = turned = 0.8, 0.6, 0, 0
    if with_action:
        rig.animation_data_create().action = bpy.data.actions.new("mine")
        rig.keyframe_insert("location", frame=1)
    retargeted(rig)
    rig.mocap_autolabel.keep_hands = True
    assert solver.influence == 0 and rig.pose.bones["control"]["IK_FK"] == 1.0
    name, solver = rig.name, solver.path_from_id("influence")
    reopen(tmp_path / "mine.blend")
    bpy.context.view_layer.objects.active = rig = bpy.data.objects[name]
    rig.mocap_autolabel.bones["head"].bone = ""
    press("discard_retarget")
    action = rig.animation_data.action
    assert [one for one in bpy.data.actions if "mine" in one.name or "retargeted" in one.name] == [action] * with_action
    assert not with_action or rig.animation_data.action_slot == action.slots[0]
    assert rig.path_resolve(solver) == 1
    assert (rig.pose.bones["control"].location.x, rig.pose.bones["control"]["IK_FK"]) == (3, 0.0)
    np.testing.assert_allclose(rig.pose.bones[MIXAMO["head"]].rotation_quaternion, turned)


def test_a_preview_in_a_strip_that_is_tweaked_cannot_be_discarded(shown):
    rig = mixamo()
    action, data = retargeted(rig), rig.animation_data
    track = data.nla_tracks.new()
    track.strips.new("strip", 1, action)
    data.action, data.nla_tracks.active = None, track
    data.use_tweak_mode = True
    refused("a strip of rig is in tweak mode; expected", "discard_retarget")
    assert data.action == action


@pytest.mark.parametrize("end", ["discard", "remove", "bake"])
def test_a_preview_of_another_take_takes_the_place_of_the_first_ones_and_nothing_of_that_is_left(shown, made, end):
    rig, settings = mixamo(), bpy.context.scene.mocap_autolabel
    rig.animation_data_create().action = own = bpy.data.actions.new("mine")
    action, keys, first = retargeted(rig), keyed(rig), settings.take
    other = replace(made.take(24, markerset=open_markerset("body26")), rate=60.0, name="other")
    settings.take = second = takes.show_take(bpy.context, other)
    assert retargeted(rig, keep_hands=True) == action and action.name == "other retargeted" and keyed(rig) != keys
    settings.take = first
    press("clear")  # the first take's, which moves the rig no more
    assert rig.animation_data.action == action
    settings.take = second
    press({"discard": "discard_retarget", "remove": "clear", "bake": "bake_retarget"}[end])
    left = {one.name for one in bpy.data.actions if one.name not in ("Mocap: walk", "Mocap: other")}
    assert left == {"mine"} | ({"other on rig"} if end == "bake" else set())
    assert rig.animation_data.action == (bpy.data.actions["other on rig"] if end == "bake" else own)


@pytest.mark.parametrize("change", ["none", "scene", "keys", "baked"])
def test_a_preview_goes_with_its_take_and_what_is_baked_or_changed_by_hand_stays(shown, change):
    rig, solver, _ = leg_by_ik()
    rig.animation_data_create().action = own = bpy.data.actions.new("mine")
    action = retargeted(rig)
    assert solver.influence == 0
    if change == "keys":
        ours("scene.ownership").curves_of(rig)[0].keyframe_points[0].co.y += 1  # by hand
    elif change == "baked":
        press("bake_retarget")
    elif change == "scene":
        bpy.data.scenes.new("another").collection.objects.link(rig)
        bpy.context.scene.collection.objects.unlink(rig)
    goes = change in ("none", "scene")
    press("clear")
    assert rig.animation_data.action == (own if goes else action)
    assert solver.influence == goes
    assert ours("scene.rig_preview").preview_on(rig) is None
    assert len([one for one in bpy.data.actions if "retargeted" in one.name or " on " in one.name]) == (not goes)


def test_a_preview_of_a_linked_take_stays_in_a_scene_that_the_take_stays_in(shown, monkeypatch):
    rig, scene = mixamo(), bpy.context.scene
    action = retargeted(rig)
    bpy.data.scenes.new("another").collection.objects.link(rig)
    monkeypatch.setattr(ours("scene.rig_preview"), "is_linked", lambda take: True)
    for gone, now in ((True, action), (False, None)):
        (scene.collection.objects.unlink if gone else scene.collection.objects.link)(rig)
        ours("scene.rig_preview").leave_take(bpy.context, scene.mocap_autolabel.take)
        assert rig.animation_data.action == now


def test_undo_takes_a_choice_back_with_what_followed_it_and_a_bake(shown):
    rig = mixamo()
    name, keys = rig.name, []

    def step(done):
        done()
        bpy.ops.ed.undo_push(message="step")
        keys.append(keyed(bpy.data.objects[name]))

    bpy.ops.ed.undo_push(message="before")
    step(lambda: retargeted(rig))
    step(lambda: setattr(rig.mocap_autolabel, "keep_feet", True))
    step(lambda: press("bake_retarget"))
    step(lambda: retargeted(rig, feet=False))
    step(lambda: press("discard_retarget"))
    assert keys[0] != keys[1] == keys[2] == keys[4]
    for number in (3, 2, 1, 0):
        bpy.ops.ed.undo()
        rig = bpy.data.objects[name]
        assert keyed(rig) == keys[number]
        assert (ours("scene.rig_preview").preview_on(rig) is None) == (number == 2)
    bpy.ops.ed.undo()
    assert not [one for one in bpy.data.actions if "retargeted" in one.name]


def test_undone_a_correction_that_was_followed_a_moment_later_leaves_the_rig_as_before(shown, monkeypatch):
    rig, reposing = mixamo(), ours("ops.reposing")
    name, follow_soon = rig.name, reposing.follow_soon
    retargeted(rig)
    before = keyed(rig)
    bpy.ops.ed.undo_push(message="before")
    monkeypatch.setattr(ours("ops.correcting"), "follow_soon", lambda **_: None)  # no time yet, as in a window
    swap()
    bpy.ops.ed.undo_push(message="swap")
    assert keyed(rig) == before
    follow_soon()
    followed = keyed(rig)
    assert followed != before
    for step, keys in ((bpy.ops.ed.undo, before), (bpy.ops.ed.redo, followed)) * 2:
        step()
        now = keyed(bpy.data.objects[name])
        assert now.keys() == keys.keys()
        np.testing.assert_allclose([*now.values()], [*keys.values()], atol=1e-4)


def test_maps_of_other_add_ons_choose_the_bones(shown, tmp_path):
    rig = add_rig(rig_bones(), NAMELESS)
    bpy.context.view_layer.objects.active = rig
    pairs = {part: (NAMELESS[part], name) for part, name in MIXAMO.items()}
    settings = "%False%ABSOLUTE%0.0,0.0,0.0%0.0,0.0,0.0%1.0%False%False%"
    bmap = "".join(f"{own}{settings}\n{source}\nFalse\nFalse\n\n" for own, source in pairs.values())
    bones = [{"SourceBoneName": source, "DestinationBoneName": own} for own, source in pairs.values()]
    for name, text in (("a.bmap", bmap), ("a.json", json.dumps({"bones": bones}))):
        (tmp_path / name).write_text(text)
        rig.mocap_autolabel.bones.clear()
        assert bpy.ops.mocap_autolabel.read_bone_map(filepath=str(tmp_path / name)) == {"FINISHED"}
        found = {row.name: row.bone for row in rig.mocap_autolabel.bones}
        assert found == {part: NAMELESS[part] for part in found}


def turned_by_a_driver(rig, bone):
    bone.rotation_mode = "XYZ"
    bone.driver_add("rotation_euler", 0).driver.expression = "0"


def lying_down(rig):
    """At rest its bones go along one axis, as in files that have nothing but turns."""
    with bones_of(rig) as bones:
        for side in "LR":
            for part in ("shank", "foot", "toes"):
                bone = bones[MIXAMO[f"{part}.{side}"]]
                bone.head.z, bone.tail.z = 2 * 0.94 - bone.head.z, 2 * 0.94 - bone.tail.z


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda rig: setattr(rig, "scale", (1, 1, 2)), "expected its scale applied"),
        (lambda rig: setattr(rig, "hide_viewport", True), "is disabled in viewports"),
        (lambda rig: rig.mocap_autolabel.bones.add(), "has no bone for hips.* under Bones in Use It"),
        *(
            (
                lambda rig, name=name: turned_by_a_driver(rig, rig.pose.bones[name]),
                f"{name} of rig does not turn as it is put; expected it without drivers",
            )
            for name in (MIXAMO["hips"], MIXAMO["upper_arm.L"], MIXAMO["shank.R"])
        ),
        (lying_down, "rig does not stand at rest; expected its head over its hips"),
    ],
)
def test_a_rig_that_cannot_be_moved_says_why(shown, change, words):
    rig = add_rig(rig_bones(), MIXAMO)
    change(rig)
    bpy.context.view_layer.objects.active = rig
    bpy.context.view_layer.update()
    with pytest.raises(RuntimeError, match=words):
        bpy.ops.mocap_autolabel.retarget()
    assert rig.animation_data is None or (rig.animation_data.action is None and rig.animation_data.use_nla)


def test_hips_connected_to_a_root_go_with_it(shown):
    rig = mixamo()
    with bones_of(rig) as bones:
        hips, root = bones[0], bones.new("root")
        root.head, root.tail = hips.head * 0.5, hips.head
        hips.parent, hips.use_connect = root, True
    rig.pose.bones["root"].rotation_quaternion = 0.8, 0.6, 0, 0
    bpy.ops.object.mode_set(mode="POSE")
    action = retargeted(rig)
    assert bpy.context.mode == "POSE" and len(bpy.data.scenes) == 1
    bpy.ops.object.mode_set(mode="OBJECT")
    rig.pose.bones["root"].rotation_quaternion = 0.8, 0.6, 0, 0  # what the action says holds all the same
    rig.pose.bones["root"].scale.y = 2
    assert action.layers[0].strips[0].channelbags[0].fcurves.find('pose.bones["root"].rotation_quaternion')
    other = mixamo()
    retargeted(other)
    for frame in (int(shown.motion.frames[0]), int(shown.motion.frames[-1])):
        bpy.context.scene.frame_set(frame)
        heads = [(one.matrix_world @ one.pose.bones[MIXAMO["hand.L"]].head) for one in (rig, other)]
        assert (heads[0] - heads[1]).length < 1e-4


def test_what_is_posed_between_bones_of_a_leg_is_put_at_rest(shown):
    """As bones of a file that comes in with an animation are."""
    rig = unreal()
    with bones_of(rig) as bones:
        shank, between = bones[UNREAL["shank.L"]], bones.new("between")
        between.head, between.tail, between.parent = shank.head, shank.tail, shank.parent
        shank.parent = between
    rig.pose.bones["between"].location = 0.1, 0.1, 0
    retargeted(rig)
    assert rig.pose.bones["between"].matrix_basis == Matrix()
    assert ways_off(shown, rig, UNREAL).max() < MOST_OFF


def test_what_the_former_action_keys_above_the_hips_is_put_at_rest_but_not_what_a_person_posed(shown):
    heads = {}
    for how in ("still", "posed", "keyed"):
        rig = unreal()
        with bones_of(rig) as bones:
            bones.new("root").tail = 0, 0, 0.1
            bones[UNREAL["hips"]].parent = bones["root"]
        rig.pose.bones["root"].location.y = 0.0 if how == "still" else -0.08
        if how == "keyed":
            rig.pose.bones["root"].keyframe_insert("location", frame=1)
        retargeted(rig, feet=True)
        heads[how] = rig.pose.bones[UNREAL["hips"]].head.copy()
    assert (heads["keyed"] - heads["still"]).length < 1e-4 < 0.01 < (heads["posed"] - heads["still"]).length


def test_what_is_posed_above_hips_but_not_above_legs_is_put_at_rest(shown):
    rigs, names = [unreal(), unreal()], [UNREAL[part] for part in ("hips", "foot.L", "head")]
    for rig in rigs:
        with bones_of(rig) as bones:
            for name in ("root", "waist"):
                bones.new(name).tail = 0, 0, 0.1
            bones[UNREAL["hips"]].parent, bones["waist"].parent = bones["waist"], bones["root"]
            for side in "LR":
                bones[UNREAL[f"thigh.{side}"]].parent = bones["root"]
        retargeted(rig)
        for part in ("hips", "spine"):
            rig.mocap_autolabel.bones[part].bone = UNREAL[part]
    rig.pose.bones["waist"].location, rig.pose.bones["waist"].rotation_quaternion = (0, 0, 0.1), (0.9, 0.2, 0.3, 0.1)
    for rig in rigs:
        retargeted(rig, feet=True)
    for frame in (int(shown.motion.frames[0]), int(shown.motion.frames[-1])):
        bpy.context.scene.frame_set(frame)
        np.testing.assert_allclose(*([rig.pose.bones[name].head for name in names] for rig in rigs), atol=1e-4)


def test_feet_stand_as_at_rest_on_a_rig_whose_root_is_tilted(shown):
    _, tilted = rigs = [unreal(), unreal()]
    with bones_of(tilted) as bones:
        bones.new("root").tail = 0, 0.3, 0.1
        bones[UNREAL["hips"]].parent = bones["root"]
    tilted.pose.bones["root"].rotation_quaternion = 0.9, 0.2, 0.3, 0.1
    for rig in rigs:
        retargeted(rig, feet=True)
    for frame in (int(shown.motion.frames[0]), int(shown.motion.frames[-1])):
        bpy.context.scene.frame_set(frame)
        places = [[rig.pose.bones[UNREAL[f"{part}.L"]].head for part in ("foot", "toes")] for rig in rigs]
        np.testing.assert_allclose(*places, atol=1e-3)


def test_what_hangs_on_a_rig_does_not_move_each_time_it_is_asked(shown):
    rig, solver, _ = leg_by_ik()
    seen = []
    bpy.app.handlers.depsgraph_update_post.append(lambda scene, _: seen.append(scene))
    try:
        retargeted(rig)
    finally:
        bpy.app.handlers.depsgraph_update_post.pop()
    assert solver.influence == 0 and 0 < seen.count(bpy.context.scene) < 4
