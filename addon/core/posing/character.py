# SPDX-License-Identifier: GPL-3.0-or-later
"""A posed body as the skeleton of a character: the bones and names that rigs have, at rest in a T-pose.

A segment moves its bones rigidly, so every bone is where the body has it, whatever its rest. The rest is what copies of
rotations from one rig to another count from: upright, arms out to the sides with the palms down, looking along -y, as
characters do in Blender.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..body.sides import BODY_SIDES
from ..data.errors import InputError
from ..geometry.rotations import least_turn

# From the body's axes (x forward, y left) to a character's (-y forward, x left).
FACING = np.array([[0.0, 1, 0], [-1, 0, 0], [0, 0, 1]])
# Parts of the way at which bones begin that a body's segments have no joints for, as in people: from the back's joint
# to the neck's, from there to the top of the head, and from there to the shoulder's.
WHOLE_WAY = 0.0, 1.0
CHEST, SKULL, SHOULDER = 0.5, 0.4, 0.15
# The ball of the foot, as a part of the way from the ankle to the toes' tips. Learned: there the built-in sets have the
# marker on the head of the second metatarsal.
BALL = 0.87
# paper: how much farther the bones of toes go, of the way from the ankle to the ball, which is 0.075 of the height: the
# foot ends 0.113 of it ahead of the ankle (Winter, after Drillis and Contini), in 0.011 of flesh
TOES = 0.36
UPWARDS, DOWNWARDS, FORWARDS = (0.0, 0, 1), (0.0, 0, -1), (0.0, -1, 0)


@dataclass(frozen=True)
class BoneSite:
    """A bone of a character."""

    name: str  # as in `BONE_NAMES`
    parent: str | None  # None for the root
    segment: str  # of the body, that moves it
    towards: str | None  # the segment whose joint is ahead of it; None for the own far end
    direction: tuple[float, float, float] | None  # of the bone at rest, None for as the body has it
    part: tuple[float, float] = WHOLE_WAY  # it begins so far, and ends so far, of the way there
    start: str | None = None  # the segment whose joint that way begins at, None for its own


def _arm_and_leg(side: str) -> tuple[BoneSite, ...]:
    out = (1.0 if side == BODY_SIDES[0] else -1.0, 0.0, 0.0)
    arm, forearm, hand, thigh, shank, foot = (
        f"{name}.{side}" for name in ("upper_arm", "forearm", "hand", "thigh", "shank", "foot")
    )
    shoulder = f"shoulder.{side}"
    return (
        BoneSite(shoulder, "chest", "thorax", arm, out, part=(SHOULDER, 1.0), start="head"),
        BoneSite(arm, shoulder, arm, forearm, out),
        BoneSite(forearm, arm, forearm, hand, out),
        BoneSite(hand, forearm, hand, None, out),
        BoneSite(thigh, "hips", thigh, shank, DOWNWARDS),
        BoneSite(shank, thigh, shank, foot, DOWNWARDS),
        BoneSite(foot, shank, foot, None, None, part=(0.0, BALL)),
        BoneSite(f"toes.{side}", foot, foot, None, FORWARDS, part=(BALL, 1.0)),
    )


BONES = (
    BoneSite("hips", None, "pelvis", "thorax", None),
    BoneSite("spine", "hips", "thorax", "head", UPWARDS, part=(0.0, CHEST)),
    BoneSite("chest", "spine", "thorax", "head", UPWARDS, part=(CHEST, 1.0)),
    BoneSite("neck", "chest", "head", None, UPWARDS, part=(0.0, SKULL)),
    BoneSite("head", "neck", "head", None, UPWARDS, part=(SKULL, 1.0)),
    *_arm_and_leg("L"),
    *_arm_and_leg("R"),
)
# Those of a body that has a lumbar spine, toes and clavicles of its own, as `posing.finer` gives it.
LUMBAR_BONES = (
    BoneSite("hips", None, "pelvis", "lumbar", None),
    BoneSite("spine", "hips", "lumbar", "thorax", UPWARDS),
    BoneSite("chest", "spine", "thorax", "head", UPWARDS),
)
TOE_BONES = tuple(
    bone
    for side in BODY_SIDES
    for bone in (
        BoneSite(f"foot.{side}", f"shank.{side}", f"foot.{side}", f"toes.{side}", None),
        BoneSite(f"toes.{side}", f"foot.{side}", f"toes.{side}", None, FORWARDS),
    )
)
CLAVICLE_BONES = tuple(
    BoneSite(f"shoulder.{side}", "chest", f"clavicle.{side}", f"upper_arm.{side}", (out, 0.0, 0.0))
    for side, out in zip(BODY_SIDES, (1.0, -1.0), strict=True)
)
# Those of fingers that have markers of their own, as `posing.ends` gives them.
FINGER_BONES = tuple(
    BoneSite(f"{finger}.{side}", f"hand.{side}", f"{finger}.{side}", None, (out, ahead, 0.0))
    for side, out in zip(BODY_SIDES, (1.0, -1.0), strict=True)
    for finger, ahead in (("thumb", -1.0), ("index", 0.0), ("middle", 0.0), ("ring", 0.0), ("pinky", 0.0))
)
_TRUNK_BONES = ("hips", "spine", "chest", "neck", "head")
_LIMB_BONES = ("shoulder", "upper_arm", "forearm", "hand", "thigh", "shank", "foot", "toes")
_FINGER_BONES = ("thumb", "index", "middle", "ring", "pinky")


def toes_of(foot: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The ball of a foot and where toes end (…, 3), by where the foot's capsule ends; at rest, from the ankle."""
    ball = BALL * foot
    return ball, ball + TOES * ball * (1, 1, 0)


def toes_axis(toes: np.ndarray) -> np.ndarray:
    """(…, 3) the axis at rest, square to toes (…, 3), that they bend upwards about."""
    axis = np.cross(toes, UPWARDS)
    return axis / np.linalg.norm(axis, axis=-1, keepdims=True)


def both_sides(trunk: str, limbs: str, sides: tuple[str, str], fingers: str = "") -> Mapping[str, str]:
    """The names of all bones; in `limbs` and `fingers` the side stands where `*` is."""
    names = dict(zip(_TRUNK_BONES, trunk.split(), strict=True))
    parts = (*_LIMB_BONES, *(_FINGER_BONES if fingers else ()))
    for side, word in zip(BODY_SIDES, sides, strict=True):
        for limb, name in zip(parts, f"{limbs} {fingers}".split(), strict=True):
            names[f"{limb}.{side}"] = name.replace("*", word)
    return names


# What rigs call the bones: HumanIK's names, which Mixamo and most retargeting know; Unreal's mannequin; Rigify's human.
BONE_NAMES = {
    "HUMANIK": both_sides(
        "Hips Spine Spine1 Neck Head",
        "*Shoulder *Arm *ForeArm *Hand *UpLeg *Leg *Foot *ToeBase",
        ("Left", "Right"),
        "*HandThumb1 *HandIndex1 *HandMiddle1 *HandRing1 *HandPinky1",
    ),
    "UNREAL": both_sides(
        "pelvis spine_01 spine_02 neck_01 head",
        "clavicle_* upperarm_* lowerarm_* hand_* thigh_* calf_* foot_* ball_*",
        ("l", "r"),
        "thumb_01_* index_01_* middle_01_* ring_01_* pinky_01_*",
    ),
    "RIGIFY": both_sides(
        "spine spine.001 spine.003 spine.004 spine.006",
        "shoulder.* upper_arm.* forearm.* hand.* thigh.* shin.* foot.* toe.*",
        ("L", "R"),
        "thumb.01.* f_index.01.* f_middle.01.* f_ring.01.* f_pinky.01.*",
    ),
}


@dataclass(frozen=True, eq=False)
class Character:
    """The B bones of a character of one size, at rest."""

    names: tuple[str, ...]  # as in `BONE_NAMES`, parents before children
    parents: np.ndarray  # (B,) -1 for the root
    heads: np.ndarray  # (B, 3) m, where each begins in the T-pose, and
    tails: np.ndarray  # (B, 3) m, where it ends
    segment: np.ndarray  # (B,) index of the segment of the body that moves it
    starts: np.ndarray  # (B, 3) m, where it begins in that segment's axes from its joint
    turns: np.ndarray  # (B, 3, 3) from that segment's axes to those of the T-pose

    def posed(self, joints: np.ndarray, rotations: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Where bones begin (F, B, 3) m and how they are turned from the rest (F, B, 3, 3), world.

        From the joints (F, J, 3) m of a body and the rotations (F, J, 3, 3) of its segments; NaN stays NaN.
        """
        carried = rotations[:, self.segment]
        heads = joints[:, self.segment] + (carried @ self.starts[..., None])[..., 0]
        return heads, carried @ np.ascontiguousarray(self.turns.swapaxes(1, 2))  # a view takes three times as long


def character_of(segments: Sequence[str], joints: np.ndarray, ends: np.ndarray) -> Character:
    """The character of a body at rest: its segments' names, joints (J, 3) m and far ends (J, 3) m in the body's axes.

    It has the bones of what the body has: no arms on legs alone. Raises InputError where it is no person's.
    """
    there = set(segments)
    finer = {site.name: site for site in CLAVICLE_BONES if site.segment in there}
    finer |= {site.name: site for site in TOE_BONES if f"toes.{site.name[-1]}" in there}
    finer |= {site.name: site for site in LUMBAR_BONES if "lumbar" in there}
    sites = [*BONES, *(site for site in FINGER_BONES if f"hand.{site.name[-1]}" in there)]
    sites = [finer.get(site.name, site) for site in sites if {site.segment, site.start or site.segment} <= there]
    if not {"pelvis", "thigh.L", "thigh.R"} <= there:
        raise InputError(
            f"the marker set has no person's skeleton (its segments: {', '.join(segments[:4])}, …); expected one with "
            "pelvis and legs, such as the built-in ones or one that was learned from a person's movement"
        )
    names = tuple(site.name for site in sites)
    parents = np.array([names.index(site.parent) if site.parent in names else -1 for site in sites])
    index = {name: at for at, name in enumerate(segments)}
    begin, end = (np.array(part) for part in zip(*(_ends(site, index, joints, ends) for site in sites), strict=True))
    turns = np.array([_turn(site, two - one) for site, one, two in zip(sites, begin, end, strict=True)])
    heads = np.zeros_like(begin)
    for at, above in enumerate(parents):
        if above >= 0:
            heads[at] = heads[above] + turns[above] @ (begin[at] - begin[above])
    feet = [at for at, site in enumerate(sites) if site.segment.startswith("foot")]
    heads[:, 2] += (begin[feet, 2] - heads[feet, 2]).mean() if feet else begin[0, 2]
    segment = np.array([index[site.segment] for site in sites])
    tails = heads + np.einsum("bij,bj->bi", turns, end - begin)
    return Character(names, parents, heads, tails, segment, begin - joints[segment], turns)


def _ends(site: BoneSite, index: Mapping[str, int], joints: np.ndarray, ends: np.ndarray):
    """Where a bone begins and ends on the body at rest."""
    own = index[site.segment]
    first = joints[index[site.start or site.segment]]
    last = ends[own] if site.towards is None or site.towards not in index else joints[index[site.towards]]
    return first + site.part[0] * (last - first), first + site.part[1] * (last - first)


def _turn(site: BoneSite, bone: np.ndarray) -> np.ndarray:
    """(3, 3) from a body's axes to those of the T-pose: the least turn that makes the bone (3,) point as it should."""
    if site.direction is None:
        return FACING
    ahead, goal = FACING @ bone, np.array(site.direction)
    if ahead @ goal < (1e-9 - 1) * np.linalg.norm(ahead):  # half a turn has no least one: about the way it looks
        return np.diag([-1.0, 1, -1]) @ FACING
    return least_turn(ahead, goal) @ FACING
