# SPDX-License-Identifier: GPL-3.0-or-later
"""Bodies as groups of points on the floor: which points are whose in frames in which bodies are apart.

From the frame in which they are farthest from each other they are followed, as long as nobody can have become another
body, or a thing, between two frames that are looked at. It says what those who stand still do not show by keeping
their distances.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ...data.made import Table
from ...data.takes import evenly_spread

NO_BODY = -1


@dataclass(frozen=True)
class PlacesOptions:
    """How bodies are told apart by where they are.

    outer      measured: part of the points that are not farther out than where another body is looked for, as ghosts
               are; 0.8 and 0.97 part 20 kinds of meetings worse, by 0.3 and 0.1 % of the points
    apart_m    between the middles of bodies that are followed by their places; physical: nearer, shoulders touch
    missed     measured: frames in a row without somebody, after which nobody is followed any more; where they are
               followed on, 1 % more of the points of meetings are on the wrong body
    gone_over  measured: part of the tracklets that were one body's, beyond which nobody is followed any more where they
               are another's, on `lying` of tests/accuracy/actors.py: who lies has feet where somebody else may stand
    """

    outer: float = 0.9
    apart_m: float = 0.4
    missed: int = 4
    gone_over: float = 0.03


BY_PLACE = PlacesOptions()
PLACES_TRIED = 60  # frames in which bodies are looked for first, spread over the take; by time
GROUPING_ROUNDS = 20  # in which such a frame's points find their bodies; it is still before
POINTS_OF_BODY = 4  # of a body in a frame


def bodies_by_place(points: Table, tracklet: np.ndarray, frames: np.ndarray, every: int, count: int) -> np.ndarray:
    """(N,) the body of each of `every` tracklet to begin with, NO_BODY where its place does not say it.

    Of points (T, L, 3) m of tracklets (T, L) in the frames (F,) that are looked at, for so many bodies.
    """
    best, chosen = -1.0, None
    for place in evenly_spread(len(frames), PLACES_TRIED).tolist():
        own = tracklet[frames[place]] >= 0
        group, apart = grouped(points[frames[place]][own], count)
        if group is not None and apart > best:
            best, chosen = apart, (place, own, group)
    body = np.full(every, NO_BODY)
    if chosen is None:
        return body
    place, own, group = chosen
    flat = points[frames[place], own, :2]
    centres = _middles(flat, group, count)
    fewest = np.bincount(group, minlength=count) / 2
    votes = np.zeros((every, count), int)
    for way in (frames[place:], frames[place::-1]):
        _follow(points, tracklet, way.tolist(), centres, fewest, votes)
    clear = (votes > 0).sum(axis=1) == 1
    body[clear] = votes[clear].argmax(axis=1)
    body[tracklet[frames[place], own]] = group
    return body


def _follow(
    points: Table,
    tracklet: np.ndarray,
    frames: Iterable[int],
    centres: np.ndarray,
    fewest: np.ndarray,
    votes: np.ndarray,
):
    """Adds to votes (N, K) whose each tracklet is by frames from that with centres (K, 2) on, while all are apart.

    A body of fewer than the `fewest` (K,) points is not there.
    """
    missed, count = 0, len(centres)
    for frame in frames:
        own = tracklet[frame] >= 0
        flat = points[frame, own, :2]
        group = _away(flat, centres).argmin(axis=1)
        if (np.bincount(group, minlength=count) < fewest).any():
            missed += 1
            if missed > BY_PLACE.missed:
                return
            continue
        missed, centres = 0, _middles(flat, group, count)
        between = _away(centres, centres)
        np.fill_diagonal(between, np.inf)
        if between.min() < BY_PLACE.apart_m:
            return
        # Nearer to the own body's middle than half-way to the next.
        sure = _leads(_away(flat, centres), group) >= between.min(axis=1)[group] / 2
        own, group = tracklet[frame, own][sure], group[sure]
        known = votes[own].any(axis=1)
        gone_over = known & (votes[own].argmax(axis=1) != group)
        if gone_over.sum() > BY_PLACE.gone_over * known.sum():
            return
        votes[own, group] += 1


def grouped(points: Table, count: int) -> tuple[np.ndarray | None, float]:
    """Points (P, 3) m in `count` groups on the floor (P,), and how far these are from each other, for their widths."""
    if len(points) < 2 * count:
        return None, 0.0
    flat, options = points[:, :2], BY_PLACE
    far = int(options.outer * len(flat))
    centres = _middle(flat)[None]
    for place in range(count):
        away = _away(flat, centres).min(axis=1)
        centres = np.concatenate([centres[:place], flat[away.argsort()[far]][None]])
    group = np.zeros(0, int)
    for _ in range(GROUPING_ROUNDS):
        before, group = group, _away(flat, centres).argmin(axis=1)
        if np.array_equal(before, group):
            break
        if np.bincount(group, minlength=count).min() < POINTS_OF_BODY:
            return None, 0.0
        centres = _middles(flat, group, count)
    size = np.bincount(group, minlength=count)
    # The usual lead of a point's own group, where groups are of like size.
    usual = np.quantile(_leads(_away(flat, centres), group), 1 - options.outer)
    return group, float(usual * size.min() / size.max())


def _leads(away: np.ndarray, group: np.ndarray) -> np.ndarray:
    """(P,) by how much points, away (P, K) from centres, are nearer to that of their group (P,) than to any other."""
    own = np.take_along_axis(away, group[:, None], axis=1)[:, 0]
    return np.where(np.arange(away.shape[1]) == group[:, None], np.inf, away).min(axis=1) - own


def _middles(flat: np.ndarray, group: np.ndarray, count: int) -> np.ndarray:
    """(K, 2) those of so many groups (P,) of points (P, 2)."""
    return np.array([_middle(flat[group == one]) for one in range(count)])


def _middle(flat: np.ndarray) -> np.ndarray:
    """(2,) the median of each column of (P, 2): NumPy's takes longer over few points than all else here."""
    order = np.sort(flat, axis=0)
    return (order[(len(order) - 1) // 2] + order[len(order) // 2]) / 2


def _away(flat: np.ndarray, centres: np.ndarray) -> np.ndarray:
    """(P, K) how far points (P, 2) are from centres (K, 2)."""
    off = flat[:, None] - centres
    return np.sqrt(off[..., 0] ** 2 + off[..., 1] ** 2)
