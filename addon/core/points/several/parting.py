# SPDX-License-Identifier: GPL-3.0-or-later
"""Which tracklets are on the same body: those that stay near each other and keep their distance, over all of the take.

Before anything is named. Two markers of one person are never far from each other, and most distances on a body keep;
between people they do not keep unless both stand still, and then there is room between them (`places`). A tracklet goes
with those of the strongest affinity while it is there; these live on when it ends, so people are followed through
contact.
"""

from dataclasses import dataclass

import numpy as np

from ...data.made import Table
from ...data.takes import evenly_spread
from ..refusals import REFUSAL, far_groups
from .affinity import AFFINE_TRACKLETS, Affinity
from .counting import COUNTING, firm_tracklets
from .places import NO_BODY, PLACES_TRIED, bodies_by_place, grouped


@dataclass(frozen=True)
class PartingPeopleOptions:
    """How tracklets are parted into bodies.

    clear    measured: times the affinity to any other body that a tracklet's affinity to one must be, to be that one's
             alone; in 20 kinds of meetings 1.3 has a tenth more points on the wrong body alone, 2.2 twice as many on
             several
    on_body  part of a tracklet's strongest affinity, below which it is not on a body; measured of 0.3 to 0.8 on
             `returning` and `returning-acting` of tests/accuracy/actors.py
    """

    clear: float = 1.6
    on_body: float = 0.5


PARTING_PEOPLE = PartingPeopleOptions()
GIVEN_TOGETHER = 0.5  # part of the clearest lead from which on tracklets are given to bodies together; by time
MAX_PRESENCES = 24  # of all together; by time


@dataclass(frozen=True, eq=False)
class PartedBodies:
    """N tracklets parted among K bodies, or presences of bodies.

    body  (N,) that of the strongest affinity, NO_BODY where there is none
    may   (N, K) True for the bodies that it may be on: one where that is clear, else several
    """

    body: np.ndarray
    may: np.ndarray

    def joined(self, whose: np.ndarray, count: int) -> "PartedBodies":
        """The same of so many bodies, where each of the K is a presence (K,) of one; of NO_BODY, nobody's."""
        own = whose[:, None] == np.arange(count)
        body = np.where(self.body == NO_BODY, NO_BODY, whose[self.body])
        return PartedBodies(body, (self.may[:, :, None] & own).any(axis=1))


def parted(points: Table, tracklet: np.ndarray, affinity: Affinity, count: int, markers: int) -> PartedBodies:
    """Tracklets (T, L) of points (T, L, 3) m parted among so many bodies; of one they are all.

    Whoever leaves and comes back has no tracklet of before: where so many `markers` as a set has are on none of the
    bodies, they are a presence that comes after the bodies that are seen together.
    """
    if count == 1:
        return PartedBodies(np.zeros(len(affinity), int), np.ones((len(affinity), 1), bool))
    begun = bodies_by_place(points, tracklet, affinity.frames, len(affinity), count)
    body = _with_presences(points, tracklet, affinity, begun, count, markers)
    count = max(count, int(body.max(initial=-1)) + 1)
    strength_to = affinity.on(_grown(affinity, body, count), count)
    most = strength_to.max(axis=1, keepdims=True)
    body = np.where(most[:, 0] > 0, strength_to.argmax(axis=1), NO_BODY)
    return PartedBodies(body, (strength_to * PARTING_PEOPLE.clear >= most) & (most > 0))


def _with_presences(
    points: Table, tracklet: np.ndarray, affinity: Affinity, body: np.ndarray, count: int, markers: int
) -> np.ndarray:
    """(N,) bodies of tracklets, from those known on; presences of whoever comes, or comes back, are further ones."""
    best, firm = affinity.best(), firm_tracklets(affinity)
    while count < MAX_PRESENCES:
        body = _grown(affinity, body, count, PARTING_PEOPLE.on_body * best)
        left = np.append((body == NO_BODY) & firm, False)
        groups = _coming(points, tracklet, affinity, left, markers)
        if not groups:
            break
        for group in groups:
            body[group] = count
            count += 1
    return body


def _coming(
    points: Table, tracklet: np.ndarray, affinity: Affinity, left: np.ndarray, markers: int
) -> list[np.ndarray]:
    """The tracklets of each who is there in the frame that shows best how many of `markers` are on no body yet.

    left (N + 1,) are those that are on none; the last is no tracklet.
    """
    alone = left[tracklet[affinity.frames]].sum(axis=1)
    frame, most = affinity.frames[alone.argmax()], alone.max()
    if most < COUNTING.whole * markers:
        return []
    people = max(round(most / markers), 1)
    if people > 1:
        full = affinity.frames[alone >= COUNTING.whole * people * markers]
        best = -np.inf
        for at in full[evenly_spread(len(full), PLACES_TRIED)].tolist():
            own = np.flatnonzero(left[tracklet[at]])
            group, apart = grouped(points[at, own], people)
            if group is not None and apart > best:
                best, found = apart, [tracklet[at, own[group == one]] for one in range(people)]
        if best > -np.inf:
            return [some for some in found if len(some) >= COUNTING.whole * markers]
    own = np.flatnonzero(left[tracklet[frame]])
    groups = far_groups(points[frame, own], REFUSAL.gap_m, COUNTING.whole * markers)
    return [tracklet[frame, own[group]] for group in groups]


def _grown(affinity: Affinity, body: np.ndarray, count: int, least: np.ndarray | float = 0.0) -> np.ndarray:
    """(N,) bodies of all tracklets, from those known on: always the one next whose affinity to a body is clearest.

    Without those whose affinity to none is `least` (N,).
    """
    body = body.copy()
    top = np.zeros((len(body), count, AFFINE_TRACKLETS))
    for index in np.flatnonzero(body != NO_BODY).tolist():
        _add_to_best(top, *affinity.of_tracklet(index), body[index])
    left = body == NO_BODY
    while left.any():
        strength_to = top.mean(axis=2)
        order = np.sort(strength_to, axis=1)
        lead = (order[:, -1] - order[:, -2]) * (left & (order[:, -1] >= least))
        if lead.max() <= 0:
            break
        some = np.flatnonzero(left & (lead >= GIVEN_TOGETHER * lead.max()))
        for index in some.tolist():
            body[index] = strength_to[index].argmax()
            left[index] = False
            _add_to_best(top, *affinity.of_tracklet(index), body[index])
    return body


def _add_to_best(top: np.ndarray, others: np.ndarray, strength: np.ndarray, body: int):
    """Puts the affinities (K,) of others to one more tracklet of a body among the strongest to it, top (N, B, H)."""
    own = top[others, body]
    rows, least = np.arange(len(own)), own.argmin(axis=1)
    own[rows, least] = np.maximum(own[rows, least], strength)
    top[others, body] = own
