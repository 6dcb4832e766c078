# SPDX-License-Identifier: GPL-3.0-or-later
"""Which bones of somebody's rig stand for the parts of a body: by tables, by the words in names, by the form at rest.

The parts are called as in `posing.character.BONES`. What lies between the trunk's parts shares their turns.
"""

import re
import unicodedata
from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from ..body.sides import BODY_SIDES
from ..posing.character import BONE_NAMES, both_sides

PARTS = tuple(BONE_NAMES["RIGIFY"])  # from the hips outwards
NEEDED_PARTS = ("hips", "thigh.L", "thigh.R", "shank.L", "shank.R")
LIMBS = ("upper_arm", "forearm", "hand"), ("thigh", "shank", "foot")
# What the last words of the first bone of a finger are.
FINGER_WORDS = {
    "thumb": "thumb 親指",
    "index": "index fore 人指",
    "middle": "middle mid 中指",
    "ring": "ring third 薬指",
    "pinky": "pinky little 小指",
}
FINGER_PARTS = tuple(part for part in PARTS if part.partition(".")[0] in FINGER_WORDS)
RIGIFY_LIMBS = "shoulder.* upper_arm_fk.* forearm_fk.* hand_fk.* thigh_fk.* shin_fk.* foot_fk.* toe_fk.*", ("L", "R")
# The controls of rigs that follow them by constraints, whose form says nothing: Rigify's, Auto-Rig Pro's, Mixamo's and
# BlenRig's, by FK; Rigify's spine may have another number of bones, or no controls so, and BlenRig's shoulders breathe.
CONTROLS = (
    both_sides("torso spine_fk.002 spine_fk.003 neck head", *RIGIFY_LIMBS),
    both_sides("torso - chest neck head", *RIGIFY_LIMBS),
    both_sides(
        "c_root_master.x c_spine_01.x c_spine_02.x c_neck.x c_head.x",
        "c_shoulder.* c_arm_fk.* c_forearm_fk.* c_hand_fk.* c_thigh_fk.* c_leg_fk.* c_foot_fk.* c_toes_fk.*",
        ("l", "r"),
    ),
    both_sides(
        "Ctrl_Hips Ctrl_Spine Ctrl_Spine2 Ctrl_Neck Ctrl_Head",
        "Ctrl_Shoulder_* Ctrl_Arm_FK_* Ctrl_ForeArm_FK_* Ctrl_Hand_FK_* "
        "Ctrl_UpLeg_FK_* Ctrl_Leg_FK_* Ctrl_Foot_FK_* Ctrl_Toe_FK_*",
        ("Left", "Right"),
    ),
    both_sides(
        "master_torso spine_1_fk spine_3_fk neck_1_fk head_fk",
        "- arm_fk_* forearm_fk_* hand_fk_* thigh_fk_* shin_fk_* foot_fk_* foot_toe_1_fk_*",
        ("L", "R"),
    ),
    {part: name for part, name in BONE_NAMES["RIGIFY"].items() if part not in FINGER_PARTS},
)
# What of them moves the mesh in game files, to which constraints do not go; limbs hang on others than the spine.
DEFORMING = {part: f"DEF-{name}" for part, name in BONE_NAMES["RIGIFY"].items()}
# What the last words of a bone's name are, the surest first, in English and, as MikuMikuDance has them, in Japanese;
# rigs that call bones after their joints have other ones.
BONE_WORDS = {
    "hips": "hips hip pelvis",
    "neck": "neck 首",
    "head": "head 頭",
    "shoulder": "clavicle clav collar shoulder scapula 肩",
    "upper_arm": "upperarm uparm uarm shldrbend arm shldr humerus 腕",
    "forearm": "forearm lowerarm lowarm loarm farm forearmbend elbow ulna ひじ",
    "hand": "hand wrist fist 手首",
    "thigh": "thigh upleg upperleg thighbend femur 足",
    "shank": "shin calf lowerleg lowleg loleg leg shank knee tibia ひざ",
    "foot": "foot ankle talus 足首",
    "toes": "toe toes toebase ball つま先",
} | FINGER_WORDS
JOINT_WORDS = BONE_WORDS | {
    "hips": "hips pelvis",
    "shoulder": "collar clavicle clav scapula",
    "upper_arm": "arm shoulder",
    "forearm": "elbow",
    "hand": "wrist",
    "thigh": "leg hip",
    "shank": "knee",
    "foot": "ankle",
    "toes": "toe toes ball foot",
}
SIDES_IN_NAMES = {"l": "L", "left": "L", "lft": "L", "r": "R", "right": "R", "rgt": "R", "左": "L", "右": "R"}
# Words that say nothing of which part it is, and those of bones that help others.
EMPTY_WORDS = {"base", "bone", "jnt", "joint", "bind", "skin", "stretch", "ctrl", "fk", "def", "org", "c", "x", "m"}
EMPTY_WORDS |= {"proximal"}  # Unity's, of the first bone of a finger
HELPERS = {"ik", "pole", "target", "twist", "roll", "share", "end", "nub", "mch", "tweak", "parent", "helper", "ref"}
NO_CONTROLS = "MCH-", "ORG-"  # what Rigify's bones begin with that hang on controls by constraints
HANGING = 0.75  # physical: the cosine that hair and legs have at least, to the way down
BENT = 0.01  # physical: of a leg's length, that its knee is at least out of line where it says which way it bends
IN_LINE = 0.866  # physical: the cosine to the shank, 30°, that feet never have and what twists it has
LONG_LIMB = 0.3  # physical: of the rig's height, what two limbs of a pair at least reach, unlike ears or a skirt
# paper: of the height (Winter, after Drillis and Contini); the shoulder from beside the breastbone on, as rigs have it
ARM = {"shoulder": 0.09, "upper_arm": 0.186, "forearm": 0.146, "hand": 0.108}


@dataclass(frozen=True, eq=False)
class RestBones:
    """The N bones of an armature at rest."""

    names: tuple[str, ...]  # of each
    parents: np.ndarray  # (N,) index of the one above, -1 for none
    heads: np.ndarray  # (N, 3) where each begins, and
    tails: np.ndarray  # (N, 3) where it ends, in the armature's axes and unit
    held: bool = True  # whether constraints hold those that deform; else controls move nothing

    def above(self, index: int) -> list[int]:
        """A bone and those above it, up to the root."""
        found = []
        while index >= 0:
            found.append(int(index))
            index = self.parents[index]
        return found

    def below(self, index: int) -> list[int]:
        """The bones right below one."""
        return self._children[index]

    @cached_property
    def _children(self) -> Mapping[int, list[int]]:
        found = defaultdict(list)
        for index, above in enumerate(self.parents.tolist()):
            found[above].append(index)
        return found

    @cached_property
    def reaches(self) -> np.ndarray:
        """(N,) how long the longest chain is that each begins."""
        found = np.linalg.norm(self.tails - self.heads, axis=1)
        for index in sorted(range(len(found)), key=lambda one: -len(self.above(one))):
            if (above := self.parents[index]) >= 0:
                way = np.linalg.norm(self.heads[index] - self.heads[above])
                found[above] = max(found[above], way + found[index])
        return found


def match_bones(bones: RestBones) -> dict[str, str]:
    """The bone of a rig for each part of a body that it has one for; none where it is no person's."""
    called = {re.sub(r"_\d+$", "", name): name for name in bones.names} | {name: name for name in bones.names}
    deforming = {part: called[name] for part, name in DEFORMING.items() if name in called}  # Sketchfab adds numbers
    if not bones.held and set(NEEDED_PARTS) <= deforming.keys():
        return deforming
    for table in CONTROLS if bones.held else ():
        controls = {part: name for part, name in table.items() if name != "-"}
        if set(controls.values()) <= set(bones.names):
            fingers = {part: bones.names[at] for part, at in match_names(bones).items() if part in FINGER_PARTS}
            return controls | {part: name for part, name in fingers.items() if not name.startswith(NO_CONTROLS)}
    found = match_names(bones)
    if not set(NEEDED_PARTS[1:]) <= found.keys():
        found = match_form(bones)
    else:
        found |= _lacking(bones, found)
    found = _with_sides(bones, _with_trunk(bones, found))
    named = {part: bones.names[found[part]] for part in PARTS if part in found}
    return {part: name for part, name in named.items() if not name.startswith(NO_CONTROLS)}


def read_as(names: Iterable[str]) -> dict[str, str]:
    """The parts of a body that names say, by name; of rigs whose trunk has many bones the hips, neck and head alone."""
    return {name: part for name, (part, _) in _read(names).items()}


def _read(names: Iterable[str]) -> dict[str, tuple[str, int]]:
    """The parts that names say, by name, with how far down its list of words the one stands that says it."""
    words = {name: _words(name) for name in names}
    last = {own[-1] for own, _ in words.values() if own}
    table = JOINT_WORDS if {"elbow", "knee"} <= last else BONE_WORDS
    if "ankle" not in last:  # where some call that the foot
        table = table | {part: BONE_WORDS[part] for part in ("foot", "toes")}
    parts: dict[str, list[tuple[int, str]]] = {}
    for part, known in table.items():
        for rank, word in enumerate(known.split()):
            for name, (own, side) in words.items():
                # The longest of the last words that is known: "fore arm" is no arm.
                last_two = "".join(own[-2:]), "".join(own[:-3:-1])
                if word in (*last_two, *own[-1:]) and (bool(side) or part in ("hips", "neck", "head")):
                    parts.setdefault(name, []).append((rank, f"{part}.{side}" if side else part))
    return {name: (part, rank) for name, (rank, part) in ((name, min(found)) for name, found in parts.items())}


def match_map(moved: Mapping[str, str]) -> dict[str, str]:
    """The bone of a rig for each part of a body, by the bones that those of another rig move, whose names say parts."""
    found = {part: moved[name] for name, part in reversed(read_as(sorted(moved)).items())}
    spine = [name for name in sorted(moved) if {"spine", "chest"} & set(_words(name)[0][-1:])]
    if spine:
        found |= {"spine": moved[spine[0]]} if len(spine) > 1 else {}
        found["chest"] = moved[spine[-1]]
    return {part: found[part] for part in PARTS if part in found}


def match_names(bones: RestBones) -> dict[str, int]:
    """The parts that the words in the names of bones say: of several the control that moves others, or the surest name.

    A volume in one is the last choice; where constraints hold nothing, so is what neither hangs on another part nor
    carries one. What hangs on no arm of its side is no finger. Toes that are apart have no bone for all. Knees and
    elbows that carry nothing are poles, if limbs are whole without.
    """
    ends = [name for at, name in enumerate(bones.names) if not bones.below(at)]
    poles = {name for name in ends if _words(name)[0][-1:] in (["knee"], ["elbow"])}
    found, read = defaultdict(list), _read(name for name in bones.names if name not in poles)
    bent = {f"{part}.{side}" for limb in LIMBS for part in limb[:2] for side in BODY_SIDES}
    if not bent <= {part for part, _ in read.values()}:
        read = _read(bones.names)
    carrying = {one for name in read for one in bones.above(bones.names.index(name))[1:]}
    for name, (part, rank) in read.items():
        at, words = bones.names.index(name), _words(name, keep=True)[0]
        above = bones.above(at)[1:]
        beside = [one for parent in above[:1] for one in bones.below(parent) if one != at]
        near = {read[bones.names[one]][0] for one in (*above, *beside) if bones.names[one] in read}
        if part in FINGER_PARTS and not {f"{one}{part[-2:]}" for one in LIMBS[0]} & near:
            continue
        volume = part in near and not bones.below(at)
        alone = not bones.held and at not in carrying and not any(bones.names[one] in read for one in above)
        found[part].append((bones.held and "fk" not in words, alone or volume, rank, len(words), len(above), at))
    first = {part: min(several) for part, several in found.items() if part in PARTS}
    for part in [part for part in first if part.startswith("toes")]:
        foot = first.get(f"foot.{part[-1]}", [bones.parents[first[part][-1]]])[-1]
        if sum(one[:-1] == first[part][:-1] and foot in bones.above(one[-1]) for one in found[part]) > 1:
            del first[part]
    return _suiting(bones, {part: one[-1] for part, one in first.items()}, found)


def _suiting(
    bones: RestBones, named: dict[str, int], found: Mapping[str, Sequence[tuple[float, ...]]]
) -> dict[str, int]:
    """The named parts with thighs that go down and, where constraints hold nothing, no shoulder that carries no arm.

    `found` has all bones that are called like each part: what comes before a thigh goes to the side in the pelvis, and
    may be called likewise.
    """
    named = dict(named)
    for side in BODY_SIDES:
        shoulder, arm, thigh = (f"{part}.{side}" for part in ("shoulder", "upper_arm", "thigh"))
        if not bones.held and {shoulder, arm} <= named.keys() and named[shoulder] not in bones.above(named[arm]):
            del named[shoulder]
        if thigh in named:
            chain = _chain(bones, named[thigh])
            down = chain[int(np.argmax(_downwards(bones, chain)))]
            named[thigh] = down if down in [one[-1] for one in found[thigh]] else named[thigh]
    return named


def _words(name: str, keep: bool = False) -> tuple[list[str], str]:
    """The words of a bone's name in small letters and its side, "" for none; none of what only helps another bone."""
    spaced = re.sub(
        r"(?<=[a-z0-9])(?=[A-Z])|(?<=\b[LR])(?=[A-Z]{1,2}[a-z])|(?<=[A-Za-z])(?=\d)",
        " ",
        unicodedata.normalize("NFKC", name).rsplit(":", 1)[-1].replace("_", " "),
    )
    spaced = re.sub(r"\b(left|right|左|右)(?=[^\W\d_])", r"\1 ", spaced.lower())
    words = re.findall(r"[^\W\d_]+", spaced)
    side = next((SIDES_IN_NAMES[word] for word in words if word in SIDES_IN_NAMES), "")
    if HELPERS & set(words):
        return [], side
    return [word for word in words if keep or word not in (*SIDES_IN_NAMES, *EMPTY_WORDS)], side


def _lacking(bones: RestBones, found: Mapping[str, int]) -> dict[str, int]:
    """What no name says of limbs, whatever it is called: by the form, where that is of one mind on all others."""
    limbs = [[f"{part}.{side}" for part in limb] for limb in LIMBS for side in BODY_SIDES]
    limbs = [limb for limb in limbs if any(part in found for part in limb) and not set(limb) <= found.keys()]
    form = match_form(bones) if limbs else {}
    limbs = [limb for limb in limbs if all(found.get(part, form.get(part)) == form.get(part) for part in limb)]
    return {part: form[part] for limb in limbs for part in limb if part in form and part not in found}


def _with_trunk(bones: RestBones, found: Mapping[str, int]) -> dict[str, int]:
    """The same with the trunk: hips where legs and trunk meet, chest where arms do, spine and neck at their ends.

    Hips that are called so may carry what they meet at, as of a Biped the first bone of the spine.
    """
    found = dict(found)
    legs = [found[f"thigh.{side}"] for side in BODY_SIDES if f"thigh.{side}" in found]
    arms = [found[part] for side in BODY_SIDES for part in (f"shoulder.{side}", f"upper_arm.{side}") if part in found]
    hips = _meeting(bones, [*legs, *arms] or [-1])
    if hips is not None and len(legs) > 1 and found.get("hips") not in bones.above(hips):
        found["hips"] = hips
    chest = _meeting(bones, arms) if len(arms) > 1 else None
    if chest is not None and chest == found.get("neck"):  # on which some rigs hang the arms
        chest = int(bones.parents[chest])
    if chest is None or "hips" not in found:
        return found
    between, low = bones.above(chest), found["hips"] if hips is None else hips
    between = between[: between.index(low)] if low in between else []
    if between:
        found |= {"chest": chest} | ({"spine": between[-1]} if len(between) > 1 else {})
    for side in BODY_SIDES:  # a shoulder whose name says nothing
        way = bones.above(found.get(f"upper_arm.{side}", -1))
        if f"shoulder.{side}" not in found and chest in way[2:]:
            found[f"shoulder.{side}"] = way[way.index(chest) - 1]
    return _with_neck(bones, found, chest, arms)


def _with_sides(bones: RestBones, found: dict[str, int]) -> dict[str, int]:
    """The same with the sides exchanged where toes are behind the feet: names then are as who looks at it sees them.

    Feet without toes may end anywhere; they are behind where knees bend so, too.
    """
    legs, toes = (
        [[found.get(f"{part}.{side}") for side in BODY_SIDES] for part in parts] for parts in (LIMBS[1], ["toes"])
    )
    if any(None in pair for pair in legs):
        return found
    thighs, knees, feet = bones.heads[np.array(legs)]
    way = (thighs - feet).mean(axis=0)
    back = np.cross(way, thighs[0] - thighs[1])
    if None not in toes[0]:
        ahead = bones.heads[np.array(toes[0])] - feet
    elif ((2 * knees - thighs - feet) @ back > 2 * BENT * np.linalg.norm(way) * np.linalg.norm(back)).all():
        ahead = bones.tails[np.array(legs[2])] - feet
    else:
        return found
    if not (ahead @ back > np.linalg.norm(ahead, axis=1) * np.linalg.norm(back) / 2).all():  # not down from the ankle
        return found
    other = dict(zip(BODY_SIDES, BODY_SIDES[::-1], strict=True))
    names = {part: part.partition(".") for part in found}
    return {f"{name}{dot}{other.get(side, side)}": found[part] for part, (name, dot, side) in names.items()}


def _with_neck(bones: RestBones, found: dict[str, int], chest: int, arms: list[int]) -> dict[str, int]:
    """The same with neck and head: of what goes up from the chest the first bone, and the longest before a fork."""
    if "head" not in found:
        limbs = {one for arm in arms for one in bones.above(arm)}
        rest = [one for one in bones.below(chest) if one not in limbs]
        if not rest:
            return found
        up, aside = (
            way / np.linalg.norm(way)
            for way in np.diff(bones.heads[[found["hips"], chest, arms[0], arms[-1]]], axis=0)[::2]
        )

        def high(one: int) -> float:  # and in the middle, unlike wings
            ways = bones.heads[_chain(bones, one)] - bones.heads[chest]
            return float(np.max(ways @ up - np.abs(ways @ aside)))

        chain = _chain(bones, max(rest, key=high))
        fork = next((at for at, one in enumerate(chain) if at and len(bones.below(one)) != 1), 0)
        ways = np.diff([*bones.heads[chain], bones.tails[chain[-1]]], axis=0)
        hangs = ways @ up < -HANGING * np.linalg.norm(ways, axis=1)
        heads = [chain[at] for at in range(1, fork + 1) if not hangs[at]] or chain
        found |= {
            "neck": chain[0],
            "head": max(heads, key=lambda one: np.linalg.norm(bones.tails[one] - bones.heads[one])),
        }
    way = bones.above(found["head"])
    if chest in way and way.index(chest) > 1:
        found["neck"] = way[way.index(chest) - 1]
    if found.get("neck") == found["head"]:
        del found["neck"]
    return found


def _meeting(bones: RestBones, several: list[int]) -> int | None:
    """The lowest bone that is above all of several; None where there is none."""
    ways = [bones.above(one) for one in several]
    return next((one for one in ways[0] if all(one in way for way in ways)), None) if ways else None


def _chain(bones: RestBones, first: int) -> list[int]:
    """A bone and what goes on from it, by the longest way at each fork."""
    chain = [first]
    while below := bones.below(chain[-1]):
        chain.append(max(below, key=lambda one: _way(bones, chain[-1], one)))
    return chain


def _way(bones: RestBones, above: int, first: int) -> float:
    """How long the way is from a bone's head over the one below it to the end of the longest chain."""
    return float(np.linalg.norm(bones.heads[first] - bones.heads[above])) + bones.reaches[first]


def match_form(bones: RestBones) -> dict[str, int]:
    """The limbs of a person by the form at rest: a pair of legs, and farther from the root a pair of arms.

    Left and right are told by the way that the feet point. None where it is no person's.
    """
    pairs = _pairs(bones) if bones.names else []
    if not pairs:
        return {}
    _, legs = pairs[0]
    feet = [foot for one in legs if (foot := _leg(bones, one)) is not None]
    if len(feet) < len(legs):
        return {}
    arms = _arms(bones, pairs[1][1]) if len(pairs) > 1 else []
    down = np.mean([bones.heads[foot[2]] - bones.heads[foot[0]] for foot in feet], axis=0)
    up = _nearest_axis(-down)
    ahead = np.mean([bones.tails[_chain(bones, foot[2])[-1]] - bones.heads[foot[2]] for foot in feet], axis=0)
    left = np.cross(up, ahead - up * (up @ ahead))
    found: dict[str, int] = {}
    for chains, words in ((feet, ("thigh", "shank", "foot", "toes")), (arms, tuple(ARM))):
        for side, chain in zip(BODY_SIDES, sorted(chains, key=lambda one: -bones.heads[one[-1]] @ left), strict=False):
            own = words[: len(chain)] if chains is feet else words[-len(chain) :]
            found |= {f"{part}.{side}": one for part, one in zip(own, chain, strict=True)}
    return found


def _pairs(bones: RestBones) -> list[tuple[int, tuple[int, int]]]:
    """The bones from which two long chains part that mirror each other, the nearest to the root first."""
    size = float(np.ptp(bones.heads, axis=0).max())
    found = []

    def first_three(one: int) -> float:  # farther on, one of both may hold something
        way = bones.heads[_chain(bones, one)[:3]]
        return float(np.linalg.norm(np.diff(way, axis=0), axis=1).sum())

    for at in sorted(range(len(bones.names)), key=lambda one: len(bones.above(one))):
        long = [one for one in bones.below(at) if bones.reaches[one] > LONG_LIMB * size]
        twins = [
            (apart, one, other)
            for number, one in enumerate(long)
            for other in long[:number]
            if (apart := abs(first_three(one) - first_three(other))) < 0.01 * size
        ]
        found += [(at, min(twins)[1:])] if twins else []
    return found


def _leg(bones: RestBones, first: int) -> list[int] | None:
    """Thigh, shank, foot and, where there are any, toes; the foot is the first bone that turns off the way down.

    Or off the shank, where it is short: a steep one.
    """
    chain = _chain(bones, first)
    downwards, ways = _downwards(bones, chain), np.diff(bones.heads[chain], axis=0)
    lengths = np.linalg.norm(ways, axis=1)
    hip = int(np.argmax(downwards))  # what comes before goes to the side in the pelvis

    def is_steep(at: int) -> bool:
        short = at < len(ways) and 2 * lengths[at] < lengths[at - 1]
        return short and bool(ways[at] @ ways[at - 1] < IN_LINE * lengths[at] * lengths[at - 1])

    foot = next((at for at in range(hip + 2, len(chain)) if not downwards[at] or is_steep(at)), None)
    if foot is None:
        return None
    middle = (bones.heads[chain[hip]] + bones.heads[chain[foot]]) / 2
    knee = min(chain[hip + 1 : foot], key=lambda one: np.linalg.norm(bones.heads[one] - middle))
    return [chain[hip], knee, *chain[foot : foot + 2]]


def _downwards(bones: RestBones, chain: list[int]) -> np.ndarray:
    """(K,) whether each bone of a chain goes down, as the whole of it does."""
    ways = np.array([*(bones.heads[one] for one in chain[1:]), bones.tails[chain[-1]]]) - bones.heads[chain]
    axis = _nearest_axis(bones.heads[chain[-1]] - bones.heads[chain[0]])
    return ways @ axis > HANGING * np.linalg.norm(ways, axis=1)


def _arms(bones: RestBones, firsts: Sequence[int]) -> list[list[int]]:
    """The bones of both arms as long in proportion as a person's; with shoulders where they begin near the middle.

    None where one has too few; where a shoulder alone is missing, the others.
    """
    half = float(np.linalg.norm(bones.heads[firsts[0]] - bones.heads[firsts[1]])) / 2
    chains = sorted((_chain(bones, first) for first in firsts), key=lambda chain: bones.reaches[chain[0]])
    chain = chains[0]  # the other hand may hold something
    long = ARM["shoulder"] / sum(ARM.values()) * bones.reaches[chain[0]]
    people = np.log(list(ARM.values()))[0 if half < long else 1 :]
    places = np.array([*(bones.heads[one] for one in chain), bones.tails[chain[-1]]])
    along = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(places, axis=0), axis=1))])
    found, wanted = {}, people[-max(len(chain), len(ARM) - 1) :]
    for begins in combinations(range(1, min(map(len, chains))), len(wanted) - 1):
        lengths = np.maximum(np.diff(along[[0, *begins, len(chain)]]), 1e-9)
        found[(0, *begins)] = float(np.ptp(np.log(lengths) - wanted))
    begins = min(found, key=found.__getitem__, default=())
    return [[chain[at] for at in begins] for chain in chains if begins]


def _nearest_axis(way: np.ndarray) -> np.ndarray:
    """(3,) the axis, to either side, that a direction (3,) is nearest to."""
    axis = np.zeros(3)
    at = int(np.argmax(np.abs(way)))
    axis[at] = np.sign(way[at])
    return axis
