# SPDX-License-Identifier: GPL-3.0-or-later
"""The rigid bodies of the very person in a take: what its rigid groups are called, and their own forms and distances."""

from dataclasses import dataclass

import numpy as np

from .loners import find_loners
from .match import NO_GROUP, Matched, match
from .model import OUTLIERS, RigidBodies
from .steady import Group, Sampled, find_groups, sampled, unbroken
from .structure import Structure, unseen_is_nan
from .ways import ABSENT
from .within import Placed, place_markers

SURE_PLATE = 3.0  # log odds by which a rigid body's group must lead
SURE_MARKER = 5.0  # log odds by which a marker's point must lead within the rigid body
OFTEN_SEEN = 0.8  # part of the frames that tell the whole range of a distance
FEWEST = 3
ALIKE = 0.003  # m, root mean square, that lengths of a rigid body that is the model's own differ by
MOST = 0.8  # part of the sure rigid bodies that must be the model's own for the take to be of a subject it knows
ENOUGH = 0.5  # part of all rigid bodies that must be sure to say so, or otherwise
FEW = 3  # sure rigid bodies that are enough to say that the subject is another, if none is the model's own
STRANGER_LENGTH, STRANGER_SHARE = 0.03, 0.06  # m, and of a distance: how its range differs between people


@dataclass(frozen=True, eq=False)
class Person:
    """What a take itself tells of the rigid bodies in it.

    group    (K,) which of its groups each rigid body surely is, NO_GROUP where none or not sure
    margin   (K,) log odds of that
    placed   which point of the groups each marker is
    sure     (M,) True where that is sure
    groups   those that move, and `props`, those that stand about in the room
    part     (T, P) the number of the unbroken tracklet of each point, -1 where there is none
    lone     (N,) for each unbroken tracklet the marker on no rigid body that it surely is, -1 for most
    rigid bodies   the model's with the forms and distances of this person; rigid bodies that are not sure are left out
    known    True where the rigid bodies are the model's own, False where they are others, None where that is not clear
    """

    group: np.ndarray
    margin: np.ndarray
    placed: Placed
    sure: np.ndarray
    groups: tuple[Group, ...]
    props: tuple[Group, ...]
    part: np.ndarray
    lone: np.ndarray
    rigid_bodies: RigidBodies
    known: bool | None

    @property
    def marker(self) -> np.ndarray:
        """(T, P) the marker of every point, -1 where it is not surely one."""
        names = self.lone.copy()
        for marker in np.flatnonzero(self.sure):
            group = self.groups[self.group[self.placed.rigid_body[marker]]]
            names[list(group.tracklets[self.placed.point[marker]])] = marker
        return np.append(names, -1)[self.part]

    @property
    def prop(self) -> np.ndarray:
        """(T, P) True for points of things that stand about."""
        stands = np.zeros(len(self.lone) + 1, dtype=bool)
        stands[[tracklet for group in self.props for tracklets in group.tracklets for tracklet in tracklets]] = True
        return stands[self.part]


def recognise(
    structure: Structure, rigid_bodies: RigidBodies, points: np.ndarray, tracklet: np.ndarray, rate: float
) -> Person:
    """Who is who in a take of points (T, P, 3) m, with the number of the tracklet of each (T, P).

    `structure` and `rigid bodies` are the model's.
    """
    with unseen_is_nan():
        return _recognise(structure, rigid_bodies, points, unbroken(tracklet, rate), rate)


def _recognise(
    structure: Structure, rigid_bodies: RigidBodies, points: np.ndarray, part: np.ndarray, rate: float
) -> Person:
    seen = sampled(points, part, rate)
    groups, props = find_groups(seen)
    matched = match(structure, groups)
    sure = (matched.group != NO_GROUP) & (matched.margin >= SURE_PLATE)
    group = np.where(sure, matched.group, NO_GROUP)
    placed = place_markers(structure, groups, Matched(group, matched.margin))
    named = (placed.point != ABSENT) & (placed.margin >= SURE_MARKER)
    at = _positions(groups, group, placed, named)
    own = _personal(rigid_bodies, structure, groups, group, placed, named, at)
    lone = np.full(int(part.max(initial=-1)) + 1, -1)
    free = _free(seen, [*groups, *props])
    if len(free) and named.any():
        found = find_loners(own, at, np.flatnonzero(placed.point == ABSENT), seen.points[:, free])
        lone[seen.number[free]] = found
        own = _with_loners(own, at, seen.points[:, free], found)
    known = _known(rigid_bodies, structure, groups, group, placed, named)
    return Person(group, matched.margin, placed, named, tuple(groups), tuple(props), part, lone, own, known)


def _positions(groups: list[Group], group: np.ndarray, placed: Placed, sure: np.ndarray) -> np.ndarray:
    """(F, M, 3) m, where each sure marker is by its rigid body, its own trajectory seen or not; NaN for others."""
    at = np.full((len(groups[0].place) if groups else 0, len(sure), 3), np.nan)
    whole = [one.markers for one in groups]
    for marker in np.flatnonzero(sure):
        at[:, marker] = whole[group[placed.rigid_body[marker]]][:, placed.point[marker]]
    return at


def _free(seen: Sampled, groups: list[Group]) -> np.ndarray:
    """Indices of the tracklets that are in no group."""
    taken = {tracklet for group in groups for tracklets in group.tracklets for tracklet in tracklets}
    return np.flatnonzero([number not in taken for number in seen.number.tolist()])


def _sure_core(structure: Structure, rigid_body: int, placed: Placed, sure: np.ndarray) -> np.ndarray:
    """The markers of a rigid body's core that are sure."""
    own = structure.inner[rigid_body].members[: structure.inner[rigid_body].core]
    return own[sure[own] & (placed.rigid_body[own] == rigid_body)]


def _personal(
    rigid_bodies: RigidBodies, structure: Structure, groups, group, placed: Placed, sure: np.ndarray, at
) -> RigidBodies:
    form, cores = np.zeros_like(rigid_bodies.form), []
    for rigid_body in range(len(structure)):
        own = _sure_core(structure, rigid_body, placed, sure)
        if len(own) >= FEWEST:
            cores.append(own)
            form[own] = groups[group[rigid_body]].form[placed.point[own]]
    middle = (rigid_bodies.low + rigid_bodies.high) / 2
    wider = STRANGER_LENGTH + STRANGER_SHARE * middle
    low, high = np.maximum(rigid_bodies.low - wider, 0), rigid_bodies.high + wider
    for marker in np.flatnonzero(sure):
        others = np.flatnonzero(sure & (np.arange(len(sure)) > marker))
        same = placed.rigid_body[others] == placed.rigid_body[marker]
        _set_ranges(low, high, marker, others, at[:, marker], at[:, others], same)
    return RigidBodies(tuple(cores), form, low, high)


def _set_ranges(low, high, marker: int, others: np.ndarray, at: np.ndarray, there: np.ndarray, same: np.ndarray):
    """Writes into `low` and `high` from where to where distances go: as the take shows it, or as people may differ."""
    distance = np.linalg.norm(there - at[:, None], axis=2)
    for index, other in enumerate(others):
        known = distance[np.isfinite(distance[:, index]), index]
        if not len(known):
            continue
        ends = np.percentile(known, [OUTLIERS, 100 - OUTLIERS])
        if not same[index] and len(known) < OFTEN_SEEN * len(at):
            ends = min(ends[0], low[marker, other]), max(ends[1], high[marker, other])
        low[marker, other], high[marker, other] = ends
        low[other, marker], high[other, marker] = ends


def _with_loners(rigid_bodies: RigidBodies, at: np.ndarray, points: np.ndarray, found: np.ndarray) -> RigidBodies:
    """The rigid bodies with the ranges of the markers on none of them, as their tracklets (F, N, 3) show them."""
    low, high = rigid_bodies.low.copy(), rigid_bodies.high.copy()
    sure = np.flatnonzero(np.isfinite(at[..., 0]).any(axis=0))
    for marker in np.unique(found[found >= 0]):
        own = points[:, found == marker]
        place = np.where(np.isfinite(own), own, 0).sum(axis=1) / np.maximum(np.isfinite(own).sum(axis=1), 1)
        place[~np.isfinite(own[..., 0]).any(axis=1)] = np.nan
        _set_ranges(low, high, marker, sure, place, at[:, sure], np.zeros(len(sure), dtype=bool))
    return RigidBodies(rigid_bodies.groups, rigid_bodies.form, low, high)


def _known(
    rigid_bodies: RigidBodies, structure: Structure, groups, group, placed: Placed, sure: np.ndarray
) -> bool | None:
    """Whether the rigid bodies of the take have the very forms of the model's."""
    alike = []
    for rigid_body in np.flatnonzero(group != NO_GROUP):
        own = _sure_core(structure, rigid_body, placed, sure)
        if len(own) < FEWEST:
            continue
        form = groups[group[rigid_body]].form[placed.point[own]]
        lengths = np.linalg.norm(form[:, None] - form[None], axis=-1)
        alike.append(np.sqrt(((lengths - rigid_bodies.lengths(own)) ** 2).mean()) < ALIKE)
    if len(alike) < ENOUGH * len(structure):
        # Of a few rigid bodies some may be taken for others; that none of them is the model's own is no chance.
        return False if len(alike) >= FEW and not any(alike) else None
    return bool(np.mean(alike) >= MOST)
