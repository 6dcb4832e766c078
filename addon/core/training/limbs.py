# SPDX-License-Identifier: GPL-3.0-or-later
"""Which limbs of a person the rigid groups of markers are that a take shows, whatever the markers are called.

Groups that move as one and the joints between them are a tree (`segments`); so is a body. Every way to read the one as
the other is a guess, and the joints' places are what a known body is then posed on.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import permutations, product

import numpy as np

from ..body.sides import BODY_SIDES
from ..data.markersets import MarkerSet
from ..geometry.rigid import laid_on
from .segments import Segments

LEG, ARM = ("thigh", "shank", "foot"), ("upper_arm", "forearm")
# Segments whose markers' middle is shown too: the joint at the near end does not say where the far one points.
ENDS = ("head", "foot", "forearm")
TRUNK, BACK, HEAD_SEGMENT = "pelvis", "thorax", "head"


@dataclass(frozen=True)
class LimbOptions:
    """What of a tree of groups may be a person.

    max_spine    joints from the pelvis' group to the thorax'; physical: lumbar, thoracic and one between
    max_guesses  ways to read the tree that are tried, of those with most groups; memory: each is posed
    """

    max_spine: int = 3
    max_guesses: int = 48


LIMBS = LimbOptions()


@dataclass(frozen=True)
class Limb:
    """A group of markers read as a segment: the segment's name, the group, and the next one on the pelvis' side."""

    segment: str
    group: int
    above: int


def readings(found: Segments) -> list[tuple[Limb, ...]]:
    """The ways to read a tree of groups as a person with two arms and two legs, those with most groups.

    Of each way its mirror image is another one. Empty where the tree is no person's.
    """
    near = _neighbours(found.parents)
    ways = [
        way for pelvis in near for spine in _paths(near, pelvis, -1, LIMBS.max_spine + 1) for way in _read(near, spine)
    ]
    ways.sort(key=len, reverse=True)
    most = [way for way in ways if len(way) == len(ways[0])]
    return most[: LIMBS.max_guesses]


def _neighbours(parents: np.ndarray) -> dict[int, list[int]]:
    near: dict[int, list[int]] = {group: [] for group in range(len(parents))}
    for group, above in enumerate(parents):
        if above >= 0:
            near[group].append(int(above))
            near[int(above)].append(group)
    return near


def _paths(near: dict[int, list[int]], start: int, origin: int, longest: int) -> Iterator[tuple[int, ...]]:
    """Ways along the tree from `start`, away from `origin`, of one to `longest` groups."""
    yield (start,)
    if longest > 1:
        for following in near[start]:
            if following != origin:
                for rest in _paths(near, following, start, longest - 1):
                    yield (start, *rest)


def _read(near: dict[int, list[int]], spine: tuple[int, ...]) -> Iterator[tuple[Limb, ...]]:
    """The ways to read the tree where the pelvis is the first group of `spine` and the thorax its last."""
    if len(spine) < 2:
        return
    pelvis, thorax = spine[0], spine[-1]
    # Feet may bear no markers; a leg without a shank does not show how it bends.
    legs = _limbs(near, pelvis, spine[1], len(LEG) - 1, len(LEG))
    arms = _limbs(near, thorax, spine[-2], len(ARM), len(ARM))
    pairs = [(one, two) for one, two in permutations(legs, 2) if one[0] != two[0] and len(one) == len(two)]
    for pair, (left, right) in product(pairs, permutations(arms, 2)):
        if left[0] == right[0]:
            continue
        limbs = []
        for side, leg, arm in zip(BODY_SIDES, pair, (left, right), strict=True):
            limbs += _chain(LEG, side, pelvis, leg) + _chain(ARM, side, thorax, arm)
        # Who never nods shows no head of its own: its markers are found on the body afterwards.
        heads = [group for group in near[thorax] if group not in (spine[-2], left[0], right[0])]
        yield from ((Limb(HEAD_SEGMENT, head, thorax), *limbs) for head in heads) if heads else (tuple(limbs),)


def _limbs(near: dict[int, list[int]], root: int, origin: int, fewest: int, most: int) -> list[tuple[int, ...]]:
    """The chains of groups that hang on a group, but for those on the side of `origin`."""
    chains = (path for group in near[root] if group != origin for path in _paths(near, group, root, most))
    return [chain for chain in chains if len(chain) >= fewest]


def _chain(names: Sequence[str], side: str, root: int, groups: Sequence[int]) -> list[Limb]:
    above = (root, *groups)
    return [
        Limb(f"{name}.{side}", group, above[at]) for at, (name, group) in enumerate(zip(names, groups, strict=False))
    ]


def sites_of(found: Segments, points: np.ndarray, way: Sequence[Limb]) -> np.ndarray:
    """(T, G, 3) m what a reading says of where a person is in frames (T, M, 3) of the size of `found`.

    The joint at each limb's near end, then the markers' middle of each of its `ENDS`; NaN where not shown.
    """
    lies = [laid_on(found.shape[list(group)], points[:, list(group)]) for group in found.members]
    joints = [_meeting(found, lies, limb) for limb in way]
    ends = [points[:, list(found.members[limb.group])].mean(axis=1) for limb in way if _is_end(limb)]
    return np.stack(joints + ends, axis=1)


def _meeting(found: Segments, lies: Sequence[tuple[np.ndarray, np.ndarray]], limb: Limb) -> np.ndarray:
    """(T, 3) where a limb's group meets the one above: half-way between where each of them has it."""
    child = limb.group if found.parents[limb.group] == limb.above else limb.above
    both = np.array([lies[group][0] @ found.joints[child] + lies[group][1] for group in (limb.group, limb.above)])
    count = np.isfinite(both).sum(axis=0)
    return np.where(count > 0, np.nansum(both, axis=0), np.nan) / np.maximum(count, 1)


def _is_end(limb: Limb) -> bool:
    return limb.segment.partition(".")[0] in ENDS


def guide(body: MarkerSet, way: Sequence[Limb], sd: float) -> MarkerSet:
    """A known body whose markers are what `sites_of` a reading gives; `sd` heights is how well they are known."""
    segments = body.skeleton.segments
    carriers = [segments.index(limb.segment) for limb in way]
    ends = [segments.index(limb.segment) for limb in way if _is_end(limb)]
    places = [np.zeros(3)] * len(way) + [body.offsets[body.attachment == segment].mean(axis=0) for segment in ends]
    joints, modes = len(segments), body.spread.modes
    still = np.zeros((len(modes), len(places), 3))
    return replace(
        body,
        markers=tuple(f"site {number}" for number in range(len(places))),
        aliases={},
        attachment=np.array(carriers + ends),
        offsets=np.array(places),
        spread=replace(
            body.spread,
            modes=np.concatenate([modes[:, :joints], still], axis=1),
            marker_sd=np.full(len(places), sd),
        ),
    )


def has_limbs(body: MarkerSet) -> bool:
    """Whether a known body has a trunk, a head, arms and legs, and markers on its ends."""
    segments = body.skeleton.segments
    wanted = [HEAD_SEGMENT, *(f"{name}.{side}" for side in BODY_SIDES for name in (*LEG, *ARM))]
    if not {TRUNK, BACK, *wanted} <= set(segments):
        return False
    ends = [name for name in wanted if name.partition(".")[0] in ENDS]
    return all((body.attachment == segments.index(name)).any() for name in ends)
