# SPDX-License-Identifier: GPL-3.0-or-later
"""The controls by IK of a rig whose limbs are moved by FK: they go along, so that switching to IK changes nothing."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import product

import bpy
import numpy as np

from ..core.body.sides import BODY_SIDES
from ..core.posing.character import BONES, FINGER_BONES
from ..core.retarget.matching import LIMBS
from .armature import rotation_channel

STRAIGHT_PART = 0.1  # physical: of a bone's length; a joint that is less aside bends this way and that
# What controls by IK are called where one by FK has these words: of hands, feet and toes, and the poles.
BY_IK = (("fk", "ik"), ("FK", "IK"))
POLES = (("_fk", "_ik_target"), ("thigh_fk", "leg_pole"), ("arm_fk", "arms_pole"))
ABOVE = {bone.name: bone.parent for bone in (*BONES, *FINGER_BONES)}
NOT_ASIDE = 1e-9  # m; a limb that never bends has no way to bend to


@dataclass(frozen=True, eq=False)
class Along:
    """What goes along with bones that are moved by FK: a control by IK, or a loose bone with what it is loose from."""

    bone: str  # its name
    limb: tuple[int, ...]  # indices of the bones that it goes with: an end's one, of a pole those of its limb
    carrier: int  # index of what carries where it is, -1 for nothing
    turner: int  # index of what it turns with, -1 for nothing
    mode: str  # how it turns
    matrix: np.ndarray  # (4, 4) where it is at rest
    steps: np.ndarray  # (3, 3) how far it goes for a unit of each of its location's channels

    def channels(self, heads: np.ndarray, turns: np.ndarray, rest: np.ndarray) -> Iterator[tuple[str, str, np.ndarray]]:
        """What moves it, by where bones begin (F, C, 3), and at rest (C, 3), and their turns (F, C, 3, 3)."""
        own, place = self.matrix[:3, :3], self.matrix[:3, 3]
        goal, by = (
            heads[:, at] + turns[:, at] @ (place - rest[at]) if at >= 0 else place
            for at in (self.limb[0], self.carrier)
        )
        if len(self.limb) > 1:
            upper, lower, end = (heads[:, at] for at in self.limb)
            far = np.linalg.norm(place - rest[self.limb[1]])
            goal = lower + far * _aside(upper, lower, end, turns[:, self.limb[0]])
        back, unturned = (
            turns[:, at].swapaxes(1, 2) if at >= 0 else np.eye(3)[None] for at in (self.carrier, self.turner)
        )
        yield self.bone, "location", (back @ (goal - by)[..., None])[..., 0] @ np.linalg.inv(self.steps)
        if len(self.limb) == 1:
            yield self.bone, *rotation_channel(self.mode, own.T @ (unturned @ turns[:, self.limb[0]]) @ own)


def controls_by_ik(rig: bpy.types.Object, bones: list[tuple[str, str]]) -> list[tuple[str, tuple[int, ...]]]:
    """The names of the controls by IK of limbs that are moved by FK, with the bones that each goes with, as `Along`."""
    parts, names = ([one[at] for one in bones] for at in (0, 1))
    found: dict[str, tuple[int, ...]] = {}
    for side, limb in product(BODY_SIDES, LIMBS):
        if not {f"{part}.{side}" for part in limb} <= set(parts):
            continue
        upper, lower, end = whole = tuple(parts.index(f"{part}.{side}") for part in limb)
        held = [one for at in (lower, end) for one in rig.pose.bones[names[at]].constraints]
        solvers = [one for one in held if one.type == "IK" and one.target == rig]
        ends = [names[end].replace(*words) for words in BY_IK] + [one.subtarget for one in solvers]
        poles = [names[upper].replace(*words) for words in POLES] + [one.pole_subtarget for one in solvers]
        for several, with_ in ((ends, (end,)), (poles, whole)):
            found |= {name: with_ for name in several if name in rig.pose.bones and name not in names}
    for at in [at for at, part in enumerate(parts) if part.startswith("toes")]:
        several = {names[at].replace(*words) for words in BY_IK} - {names[at]}
        found |= {name: (at,) for name in several if name in rig.pose.bones}
    return list(found.items())


def loose_bones(parts: Sequence[str], carriers: np.ndarray) -> dict[int, int]:
    """Those of a rig's bones that do not hang on what they do in a body, by `carriers`; with that, both indices."""
    at, loose = {part: index for index, part in enumerate(parts)}, {}
    for index, part in enumerate(parts):
        above = ABOVE.get(part)
        while above is not None and above not in at:
            above = ABOVE[above]
        way = index
        while above is not None and way not in (at[above], -1):
            way = carriers[way]
        if way < 0:
            loose[index] = at[above]
    return loose


def carriers_of(follows: np.ndarray, count: int, limbs: Sequence[tuple[int, ...]], goes: Sequence[bool]) -> list[int]:
    """Which of C bones carries each of K controls, -1 for none, by what each bone and control follows (C + K,).

    A control that goes with an end carries as that end does. One that stays, and a pole, turn as what carries them.
    """
    carriers: list[int] = []
    for at in follows[count:].tolist():
        other = at - count
        with_end = other >= 0 and goes[other] and len(limbs[other]) == 1
        carriers.append(at if other < 0 else limbs[other][0] if with_end else carriers[other])
    return carriers


def _aside(upper: np.ndarray, lower: np.ndarray, end: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """(F, 3) the way to which a limb between joints (F, 3) bends, or nearly.

    Where it is straight, it is where it is seen from the upper bone, which turns (F, 3, 3), when it bends.
    """
    along = end - upper
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    bent = lower - upper
    bent = bent - (bent * along).sum(axis=1, keepdims=True) * along
    mean = np.einsum("fji,fj->i", turns, bent)
    mean *= STRAIGHT_PART * np.linalg.norm(lower - upper, axis=1).mean() / max(np.linalg.norm(mean), NOT_ASIDE)
    way = bent + turns @ mean
    return way / np.maximum(np.linalg.norm(way, axis=1, keepdims=True), NOT_ASIDE)
