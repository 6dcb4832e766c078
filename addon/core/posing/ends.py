# SPDX-License-Identifier: GPL-3.0-or-later
"""What limbs end in, which a marker set's own segments lack: toes, and fingers that have markers of their own.

Toes go on from the ball of the foot and bend there, by the markers ahead of it, or as the floor has it. A finger is one
bone that turns about the knuckle; in a recorded hand that held and let go it carried tips and middles to 1 mm.
"""

import re
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ..body.sides import BODY_SIDES
from ..data.markersets import Capsules, MarkerSet, Skeleton
from .character import toes_axis, toes_of

STILL_RAD = 0.01  # physical: standard deviation of what no joint does, or no marker shows, as a clavicle about itself
# measured: of the bend of toes, by a marker on the big one: as people walk none to 31° at 90 %; and of fingers
BENDS_RAD = 0.5
# What markers on fingers are called, and how far the bone begins from the wrist, of a hand's length.
FINGERS = {
    "thumb": (("thumb", "thm"), 0.25),
    "index": (("index", "idx"), 0.5),
    "middle": ((r"mid(?=dle|tip|\d|$)",), 0.5),  # a hand has a middle, too
    "ring": (("ring", "rng"), 0.5),
    "pinky": (("pinky", "little", "pnk"), 0.5),
}
HAND = 0.108  # paper: heights, how long a hand is (Winter, after Drillis and Contini)
FINGER_RADIUS = 0.005  # physical: heights, half of how thick a finger is


@dataclass(frozen=True, eq=False)
class LimbEnd:
    """A segment to be added at the end of another; lengths are heights, in the axes of that from its joint."""

    name: str
    parent: int
    # (3,) where it begins and ends
    joint: np.ndarray
    end: np.ndarray
    radius: float  # of its capsule
    markers: np.ndarray  # that it carries
    bends: np.ndarray  # (3, 3) the projection on the axes that it bends about


def with_ends(markerset: MarkerSet) -> MarkerSet:
    """The set with toes on its feet and the fingers that have markers; itself where it has them or no feet."""
    ends = [one for one in (*_toes(markerset), *_fingers(markerset)) if one.name not in markerset.skeleton.segments]
    if not ends:
        return markerset
    skeleton, capsules, spread, count = (
        markerset.skeleton,
        markerset.capsules,
        markerset.spread,
        len(markerset.skeleton),
    )
    attachment, offsets, cut = markerset.attachment.copy(), markerset.offsets.copy(), capsules.end.copy()
    for number, one in enumerate(ends, count):
        attachment[one.markers] = number
        offsets[one.markers] -= one.joint
        if one.name.startswith("toes"):
            cut[capsules.segment == one.parent] = one.joint
    joints, reach = np.array([one.joint for one in ends]), np.array([one.end - one.joint for one in ends])
    stiffness = np.zeros((3 * count, 3 * count)) if spread.stiffness is None else spread.stiffness
    for one in ends:
        stiffness = _beside(stiffness, (np.eye(3) - one.bends) / STILL_RAD**2)
    return replace(
        markerset,
        skeleton=Skeleton(
            (*skeleton.segments, *(one.name for one in ends)),
            np.concatenate([skeleton.parents, [one.parent for one in ends]]),
            np.concatenate([skeleton.offsets, joints]),
        ),
        attachment=attachment,
        offsets=offsets,
        capsules=Capsules(
            np.concatenate([capsules.segment, count + np.arange(len(ends))]),
            np.concatenate([capsules.start, 0 * joints]),
            np.concatenate([cut, reach]),
            np.concatenate([capsules.radius, [one.radius for one in ends]]),
        ),
        spread=replace(
            spread,
            modes=np.insert(spread.modes, [count] * len(ends), 0.0, axis=1),
            pose_mean=np.concatenate([spread.pose_mean, 0 * joints]),
            pose_covariance=_beside(spread.pose_covariance, BENDS_RAD**2 * np.eye(joints.size)),
            poses=np.zeros((0, 0, 3)),
            stiffness=stiffness,
        ),
    )


def _beside(one: np.ndarray, other: np.ndarray) -> np.ndarray:
    """Two square matrices as the blocks of one."""
    whole = np.zeros(np.add(one.shape, other.shape))
    whole[: len(one), : len(one)], whole[len(one) :, len(one) :] = one, other
    return whole


def _toes(markerset: MarkerSet) -> Iterator[LimbEnd]:
    """Those of feet that are one capsule each."""
    segments, capsules = markerset.skeleton.segments, markerset.capsules
    feet = [segments.index(name) for side in BODY_SIDES if (name := f"foot.{side}") in segments]
    capsule = [np.flatnonzero(capsules.segment == foot) for foot in feet]
    for foot, own in zip(feet, capsule, strict=True) if all(len(own) == 1 for own in capsule) else ():
        side, (ball, end) = segments[foot][-1], toes_of(capsules.end[own[0]])
        on, ahead = np.flatnonzero(markerset.attachment == foot), ball * (1, 1, 0)
        reach = markerset.offsets[on] @ ahead
        moved = reach > (ball + end) @ ahead / 2
        if not ((reach[~moved] > 0).any() and (reach < 0).any()):  # what is left is to show how the foot is turned
            moved[:] = False
        axis, radius = toes_axis(end - ball), float(capsules.radius[own[0]])
        yield LimbEnd(f"toes.{side}", foot, ball, end, radius, on[moved], np.outer(axis, axis))


def _fingers(markerset: MarkerSet) -> Iterator[LimbEnd]:
    """Those with markers ahead of the knuckle that are called as they are."""
    segments, called = markerset.skeleton.segments, np.array([_finger(marker) for marker in markerset.markers])
    for side in (side for side in BODY_SIDES if f"hand.{side}" in segments):
        hand = segments.index(f"hand.{side}")
        on, reach = markerset.attachment == hand, np.linalg.norm(markerset.offsets, axis=1)
        first = np.array([FINGERS[name][1] * HAND if name else np.inf for name in called])
        if not (on & (reach <= first)).any():
            continue  # what is left is to show how the hand is turned
        for name, (_, knuckle) in FINGERS.items():
            own = np.flatnonzero(on & (called == name) & (reach > first))
            if not len(own):
                continue
            way = markerset.offsets[own].mean(axis=0)
            way /= np.linalg.norm(way)
            joint, end = knuckle * HAND * way, max(HAND, (markerset.offsets[own] @ way).max()) * way
            yield LimbEnd(f"{name}.{side}", hand, joint, end, FINGER_RADIUS, own, np.eye(3) - np.outer(way, way))


def _finger(marker: str) -> str:
    """The finger that the first word of one in a marker's name says; empty for none."""
    words = ((re.search(word, marker.lower()), name) for name, (words, _) in FINGERS.items() for word in words)
    return min(((found.start(), name) for found, name in words if found), default=(0, ""))[1]
