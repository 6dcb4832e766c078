# SPDX-License-Identifier: GPL-3.0-or-later
"""Which tracklets are on the same body: those that stay near each other and keep their distance, over all of the take.

Before anything is named. Two markers of one person are never far from each other, and most distances on a body keep;
between people they do not keep unless both stand still, and then there is room between them (`places`). A tracklet goes
with those to which it holds on best while it is there; these live on when it ends, so people are followed through
contact.
"""

from dataclasses import dataclass
from typing import Self

import numpy as np

from ...data.takes import evenly_spread
from ..refusals import far_groups
from .holding import HOLDING_ON, Holding
from .places import BY_PLACE, NO_BODY, bodies_by_place, grouped


@dataclass(frozen=True)
class PartingPeopleOptions:
    """How tracklets are parted into bodies. All reckoned.

    clear          times that it must hold on to one body as it does to any other, for it to be that one's alone
    at_once        of the clearest lead, by which tracklets are given to bodies together
    rounds         of going through all tracklets again
    firm           part of how well tracklets usually hold on to others, that is needed to be on anybody
    holds          part of how well a tracklet holds on to whatever it does best, below which it is not on a body;
                   chosen of 0.3 to 0.8 on `returning` and `returning-acting` of tests/accuracy/actors.py
    whole          part of the markers of a set that must be on nobody for somebody to be there
    fullest        part of the most that are so, in which those who come at the same time are parted
    gap_m          between what one who comes shows, and anything else
    max_stays      of all together
    """

    clear: float = 1.6
    at_once: float = 0.5
    rounds: int = 12
    firm: float = 0.2
    holds: float = 0.5
    whole: float = 0.55
    fullest: float = 0.9
    gap_m: float = 0.5
    max_stays: int = 24


PARTING_PEOPLE = PartingPeopleOptions()


@dataclass(frozen=True, eq=False)
class PartedBodies:
    """N tracklets parted among K bodies, or stays of bodies.

    hold  (N, K) how well each holds on to each body, 1/m²
    body  (N,) that to which it holds on best, NO_BODY where to none
    may   (N, K) True for the bodies that it may be on: one where that is clear, else several
    """

    hold: np.ndarray
    body: np.ndarray
    may: np.ndarray

    def joined(self, whose: np.ndarray, count: int) -> Self:
        """The same of so many bodies, where each of the K is a stay (K,) of one of them; of NO_BODY, nobody's."""
        own = whose[:, None] == np.arange(count)
        hold = np.where(own, self.hold[:, :, None], 0.0).max(axis=1)
        body = np.where(self.body == NO_BODY, NO_BODY, whose[self.body])
        return type(self)(hold, body, (self.may[:, :, None] & own).any(axis=1))


def parted(points: np.ndarray, tracklet: np.ndarray, holding: Holding, count: int, markers: int = 0) -> PartedBodies:
    """Tracklets (T, L) of points (T, L, 3) m parted among so many bodies; of one they are all.

    Whoever leaves and comes back holds on to nothing of before: where so many `markers` as a set has are on none of the
    bodies, they are a stay of their own, which stands after the bodies that are seen together. With 0 nobody leaves.
    """
    if count == 1:
        every = len(holding)
        return PartedBodies(holding.best()[:, None], np.zeros(every, int), np.ones((every, 1), bool))
    begun = bodies_by_place(points, tracklet, holding.frames, len(holding), count)
    body = _with_stays(points, tracklet, holding, begun, count, markers)
    stays = int(body.max(initial=-1)) + 1
    if stays > count:
        count = stays
    else:
        body = _grown(holding, begun, count)
    hold = np.zeros((len(body), count))
    for _ in range(PARTING_PEOPLE.rounds):
        hold = holding.on(body, count)
        best = np.where(hold.max(axis=1) > 0, hold.argmax(axis=1), NO_BODY)
        if (best == body).all():
            break
        body = best
    most = hold.max(axis=1, keepdims=True)
    return PartedBodies(hold, body, (hold * PARTING_PEOPLE.clear >= most) & (most > 0))


def _with_stays(
    points: np.ndarray, tracklet: np.ndarray, holding: Holding, body: np.ndarray, count: int, markers: int
) -> np.ndarray:
    """(N,) bodies of tracklets, from those known on, and as further ones the stays of whoever comes, or comes back."""
    if not markers:
        return body
    best = holding.best()
    firm = best >= PARTING_PEOPLE.firm * np.median(best[best > 0]) if (best > 0).any() else np.zeros(len(best), bool)
    while count < PARTING_PEOPLE.max_stays:
        body = _grown(holding, body, count, PARTING_PEOPLE.holds * best)
        left = np.append((body == NO_BODY) & firm, False)
        groups = _coming(points, tracklet, holding, left, markers)
        if not groups:
            break
        for group in groups:
            body[group] = count
            count += 1
    return body


def _coming(
    points: np.ndarray, tracklet: np.ndarray, holding: Holding, left: np.ndarray, markers: int
) -> list[np.ndarray]:
    """The tracklets of each who is there in the frame that shows best how many of `markers` are on no body yet.

    left (N + 1,) are those that are on none; the last is no tracklet.
    """
    alone = left[tracklet[holding.frames]].sum(axis=1)
    frame, most = holding.frames[alone.argmax()], alone.max()
    if most < PARTING_PEOPLE.whole * markers:
        return []
    people = max(round(most / markers), 1)
    if people > 1:
        fullest = holding.frames[alone >= PARTING_PEOPLE.fullest * most]
        best = -np.inf
        for at in fullest[evenly_spread(len(fullest), BY_PLACE.starts)].tolist():
            own = np.flatnonzero(left[tracklet[at]])
            group, apart = grouped(points[at, own], people)
            if group is not None and apart > best:
                best, found = apart, [tracklet[at, own[group == one]] for one in range(people)]
        if best > -np.inf:
            return [some for some in found if len(some) >= PARTING_PEOPLE.whole * markers]
    own = np.flatnonzero(left[tracklet[frame]])
    groups = far_groups(points[frame, own], PARTING_PEOPLE.gap_m, PARTING_PEOPLE.whole * markers)
    return [tracklet[frame, own[group]] for group in groups]


def _grown(holding: Holding, body: np.ndarray, count: int, least: np.ndarray | float = 0.0) -> np.ndarray:
    """(N,) bodies of all tracklets, from those known on: always the one next that holds on to a body most clearly.

    Without those that hold on to none so well as `least` (N,).
    """
    body = body.copy()
    top = np.zeros((len(body), count, HOLDING_ON.holds))
    for index in np.flatnonzero(body != NO_BODY).tolist():
        _hear(top, *holding.of_tracklet(index), body[index])
    left = body == NO_BODY
    while left.any():
        hold = top.mean(axis=2)
        order = np.sort(hold, axis=1)
        lead = (order[:, -1] - order[:, -2]) * (left & (order[:, -1] >= least))
        if lead.max() <= 0:
            break
        some = np.flatnonzero(left & (lead >= PARTING_PEOPLE.at_once * lead.max()))
        for index in some.tolist():
            body[index] = hold[index].argmax()
            left[index] = False
            _hear(top, *holding.of_tracklet(index), body[index])
    return body


def _hear(top: np.ndarray, others: np.ndarray, strength: np.ndarray, body: int):
    """Puts how well others (K,) hold on to one more tracklet of a body (K,) among the best of it, top (N, B, H)."""
    own = top[others, body]
    rows, least = np.arange(len(own)), own.argmin(axis=1)
    own[rows, least] = np.maximum(own[rows, least], strength)
    top[others, body] = own
