# SPDX-License-Identifier: GPL-3.0-or-later
"""The bones of rigs by their names, and by their form where names say nothing."""

import numpy as np
import pytest

from addon.core.posing.character import BONE_NAMES
from addon.core.retarget.matching import CONTROLS, RestBones, match_bones, match_map, read_as
from tests.inputs.rigs import A_POSE, HANGING, MAYA, MIXAMO, NAMELESS, T_POSE, UNREAL, VRM, rig_bones

AS_IT_IS = np.eye(3)


def at_rest(names, arms=T_POSE, turn=AS_IT_IS, extra=()):
    """A person's rig with such names; `extra` bones are name, parent's part and head."""
    bones = rig_bones(arms)
    parts = [bone.part for bone in bones]
    parents = [-1 if bone.parent is None else parts.index(bone.parent) for bone in bones]
    heads, tails = [bone.head @ turn.T for bone in bones], [bone.tail @ turn.T for bone in bones]
    for _, part, head in extra:
        parents.append(parts.index(part))
        heads.append(np.array(head, float) @ turn.T)
        tails.append((np.array(head, float) + np.array([0, 0, 0.02])) @ turn.T)
    called = (*(names[part] for part in parts), *(name for name, _, _ in extra))
    return RestBones(called, np.array(parents), np.array(heads), np.array(tails))


def without_between(names):
    return {part: name for part, name in names.items() if part != "between"}


@pytest.mark.parametrize("arms", [T_POSE, A_POSE, HANGING])
@pytest.mark.parametrize("names", [MIXAMO, UNREAL, VRM, MAYA, NAMELESS])
def test_bones_are_known_by_names_or_form(names, arms):
    assert match_bones(at_rest(names, arms)) == without_between(names)


def test_left_is_told_by_the_feet_where_names_say_nothing():
    """In any axes: y up, and a rig that looks the other way."""
    for turn in (np.array([[1.0, 0, 0], [0, 0, 1], [0, -1, 0]]), np.diag([-1.0, -1, 1])):
        assert match_bones(at_rest(NAMELESS, turn=turn)) == without_between(NAMELESS)


def test_bones_that_help_others_are_passed_over():
    extra = [
        ("upperarm_twist_01_l", "upper_arm.L", (0.3, 0, 1.45)),
        ("ik_hand_l", "hips", (0.74, 0, 1.45)),
        ("thumb_01_l", "hand.L", (0.78, 0, 1.4)),
        ("DEF-thigh_l", "hips", (0.1, 0, 0.9)),
    ]
    assert match_bones(at_rest(UNREAL, extra=extra)) == without_between(UNREAL)


@pytest.mark.parametrize("table", CONTROLS)
def test_control_rigs_are_known_by_their_controls(table):
    names = tuple(name for name in table.values() if name != "-")
    far = np.zeros((len(names), 3))
    found = match_bones(RestBones(names, np.full(len(names), -1), far, far))
    assert found == {part: name for part, name in table.items() if name != "-"}


def test_what_is_no_person_matches_nothing():
    bones = RestBones(("Bone", "Bone.001"), np.array([-1, 0]), np.zeros((2, 3)), np.ones((2, 3)))
    assert match_bones(bones) == {}


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
        ("CC_Base_Hip", "hips"),
        ("LeftHandThumb1", None),
        ("hand_ik.L", None),
        ("lThighTwist", None),
    ],
)
def test_names_are_read(name, part):
    assert read_as([name]).get(name) == part


def test_a_map_of_another_rig_says_the_parts():
    moved = {name: f"own {part}" for part, name in BONE_NAMES["HUMANIK"].items()} | {"Spine2": "own chest"}
    assert match_map(moved) == {part: f"own {part}" for part in BONE_NAMES["HUMANIK"]}
