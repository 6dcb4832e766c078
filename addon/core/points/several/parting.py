# SPDX-License-Identifier: GPL-3.0-or-later
"""Which tracklets are on the same body: those that stay near each other and keep their distance, over all of the take.

Before anything is named. Two markers of one person are never far from each other, and most distances on a body keep;
between people they do not keep unless both stand still, and then there is room between them. A tracklet goes with those
to which it holds on best while it is there; these live on when it ends, so people are followed through contact.
"""

from dataclasses import dataclass

import numpy as np

from ...data.takes import evenly_spread
from .holding import HOLDING_ON, Holding

NO_BODY = -1


@dataclass(frozen=True)
class PartingPeopleOptions:
    """How tracklets are parted into bodies. All reckoned.

    clear          times that it must hold on to one body as it does to any other, for it to be that one's alone
    at_once        of the clearest lead, by which tracklets are given to bodies together
    starts         frames in which bodies are looked for first, spread over the take
    outer          part of the points that are not farther out than where another body is looked for: ghosts are
    min_points     of a body in a frame that is begun with
    group_rounds   in which such a frame's points find their bodies
    rounds         of going through all tracklets again
    """

    clear: float = 1.6
    at_once: float = 0.5
    starts: int = 60
    outer: float = 0.9
    min_points: int = 4
    group_rounds: int = 20
    rounds: int = 12


PARTING_PEOPLE = PartingPeopleOptions()


@dataclass(frozen=True, eq=False)
class PartedBodies:
    """N tracklets parted among K bodies.

    hold  (N, K) how well each holds on to each body, 1/m²
    body  (N,) that to which it holds on best, NO_BODY where to none
    may   (N, K) True for the bodies that it may be on: one where that is clear, else several
    """

    hold: np.ndarray
    body: np.ndarray
    may: np.ndarray


def parted(points: np.ndarray, tracklet: np.ndarray, holding: Holding, count: int) -> PartedBodies:
    """Tracklets (T, L) of points (T, L, 3) m parted among so many bodies; of one they are all."""
    if count == 1:
        every = len(holding)
        return PartedBodies(holding.best()[:, None], np.zeros(every, int), np.ones((every, 1), bool))
    body = _first_bodies(points, tracklet, holding, count)
    hold = np.zeros((len(body), count))
    for _ in range(PARTING_PEOPLE.rounds):
        hold = holding.on(body, count)
        best = np.where(hold.max(axis=1) > 0, hold.argmax(axis=1), NO_BODY)
        if (best == body).all():
            break
        body = best
    most = hold.max(axis=1, keepdims=True)
    return PartedBodies(hold, body, (hold * PARTING_PEOPLE.clear >= most) & (most > 0))


def _first_bodies(points: np.ndarray, tracklet: np.ndarray, holding: Holding, count: int) -> np.ndarray:
    """(N,) the body of each tracklet to begin with: from the frame on in which bodies are farthest from each other."""
    best, chosen, frames = -1.0, None, holding.frames
    for frame in frames[evenly_spread(len(frames), PARTING_PEOPLE.starts)].tolist():
        lane = np.flatnonzero(tracklet[frame] >= 0)
        group, apart = _groups(points[frame][lane], count)
        if group is not None and apart > best:
            best, chosen = apart, (tracklet[frame, lane], group)
    body = np.full(len(holding), NO_BODY)
    if chosen is None:
        return body
    body[chosen[0]] = chosen[1]
    return _grown(holding, body, count)


def _groups(points: np.ndarray, count: int) -> tuple[np.ndarray | None, float]:
    """Points (P, 3) m in `count` groups on the floor (P,), and how far these are from each other, for their widths."""
    if len(points) < 2 * count:
        return None, 0.0
    flat, options = points[:, :2], PARTING_PEOPLE
    far = int(options.outer * len(flat))
    centres = _middle(flat)[None]
    for place in range(count):
        away = _away(flat, centres).min(axis=1)
        centres = np.concatenate([centres[:place], flat[away.argsort()[far]][None]])
    group = np.zeros(0, int)
    for _ in range(options.group_rounds):
        before, group = group, _away(flat, centres).argmin(axis=1)
        if np.array_equal(before, group):
            break
        if np.bincount(group, minlength=count).min() < options.min_points:
            return None, 0.0
        centres = np.array([_middle(flat[group == one]) for one in range(count)])
    size = np.bincount(group, minlength=count)
    away = _away(flat, centres)
    own = np.take_along_axis(away, group[:, None], axis=1)[:, 0]
    others = np.where(np.arange(count) == group[:, None], np.inf, away).min(axis=1)
    # The usual lead of a point's own group, where groups are of like size.
    return group, float(np.quantile(others - own, 1 - options.outer) * size.min() / size.max())


def _middle(flat: np.ndarray) -> np.ndarray:
    """(2,) the median of each column of (P, 2): NumPy's takes longer over few points than all else here."""
    order = np.sort(flat, axis=0)
    return (order[(len(order) - 1) // 2] + order[len(order) // 2]) / 2


def _away(flat: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(P, K) how far points (P, 2) are from centres (K, 2)."""
    off = flat[:, None] - centres
    return np.sqrt(off[..., 0] ** 2 + off[..., 1] ** 2)


def _grown(holding: Holding, body: np.ndarray, count: int) -> np.ndarray:
    """(N,) bodies of all tracklets, from those known on: always the one next that holds on to a body most clearly."""
    body = body.copy()
    top = np.zeros((len(body), count, HOLDING_ON.holds))
    for index in np.flatnonzero(body != NO_BODY).tolist():
        _hear(top, *holding.of_tracklet(index), body[index])
    left = body == NO_BODY
    while left.any():
        hold = top.mean(axis=2)
        order = np.sort(hold, axis=1)
        lead = (order[:, -1] - order[:, -2]) * left
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
