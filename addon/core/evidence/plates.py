# SPDX-License-Identifier: GPL-3.0-or-later
"""Plates: groups of three or more markers that move as one rigid thing, and how far apart any two markers ever are.

Where most markers are on plates, a pose that was never seen is no trouble: each plate is found by its own form, and
plates are put together by what the distances between their markers allow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

RIGID = 0.015  # radii: standard deviation of a distance within a plate
FEWEST = 3
MOST_BASES = 8
NOISE = 0.0007  # m, of a measured distance
STRETCH = 0.003  # of a length, between takes
SLACK = 0.25  # of a distance's range, and
SLACK_LENGTH = 0.02  # m, that it may leave the range by before it counts
ANYWHERE = 50.0  # m, for two markers never seen together
OUTLIERS = 0.5  # per cent at either end of a distance's range that are left out


@dataclass(frozen=True, eq=False)
class Plates:
    """Rigid groups of M markers, and the distances between all.

    groups  for each plate the indices (n,) of its markers
    form    (M, 3) m, each marker in its plate's own axes; 0 for markers on none
    low, high  (M, M) m, the range of every distance
    """

    groups: tuple[np.ndarray, ...]
    form: np.ndarray
    low: np.ndarray
    high: np.ndarray

    @cached_property
    def slack(self) -> np.ndarray:
        """(M, M) m, how softly the range of a distance ends."""
        return SLACK * (self.high - self.low) + SLACK_LENGTH

    @property
    def covered(self) -> float:
        """The part of all markers that is on a plate."""
        return sum(map(len, self.groups)) / len(self.form)

    def lengths(self, group: np.ndarray) -> np.ndarray:
        """(n, n) m, the distances within a plate."""
        form = self.form[group]
        return np.linalg.norm(form[:, None] - form[None], axis=-1)

    def bases(self, group: np.ndarray) -> list[tuple[int, int, int]]:
        """Triples of places in a plate to recognise it by, the largest triangles first, the longest side first."""
        form = self.form[group]
        scored = []
        for triple in combinations(range(len(group)), 3):
            sides = [(np.linalg.norm(form[a] - form[b]), a, b) for a, b in combinations(triple, 2)]
            _, first, second = max(sides)
            third = next(place for place in triple if place not in (first, second))
            area = np.linalg.norm(np.cross(form[second] - form[first], form[third] - form[first]))
            scored.append((area, first, second, third))
        return [row[1:] for row in sorted(scored, reverse=True)[:MOST_BASES]]

    def breach(self, distance: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """How far distances, m, between markers lie outside what was ever seen, in slacks."""
        low, high, slack = (table[first, second] for table in (self.low, self.high, self.slack))
        return np.maximum(np.maximum(low - distance, distance - high), 0) / slack


def learn_plates(subjects: Sequence[np.ndarray], radius: float) -> Plates:
    """The plates of labelled clouds, one array (T, M, 3) m a subject, NaN where missing; `radius` is the shape's."""
    markers = subjects[0].shape[1]
    everyone = np.concatenate(subjects)
    spread, low, high = np.full((3, markers, markers), np.nan)
    for one in range(markers):
        distance = np.linalg.norm(everyone - everyone[:, one : one + 1], axis=-1)
        some = np.isfinite(distance).sum(axis=0) > 1
        known = distance[:, some]
        spread[one, some] = np.nanstd(known, axis=0)
        low[one, some], high[one, some] = np.nanpercentile(known, [OUTLIERS, 100 - OUTLIERS], axis=0)
    never = ~np.isfinite(low)
    spread[never] = np.inf
    low[never], high[never] = 0, ANYWHERE
    groups = _rigid_groups(spread, RIGID * radius)
    form = np.zeros((markers, 3))
    for group in groups:
        form[group] = _form(everyone[:, group])
    return Plates(tuple(groups), form, low, high)


def _rigid_groups(spread: np.ndarray, limit: float) -> list[np.ndarray]:
    """Groups in which every distance is steady, grown by complete linkage."""
    from scipy.cluster.hierarchy import fcluster, linkage

    condensed = np.minimum(spread, 10.0)[np.triu_indices(len(spread), 1)]
    cluster = fcluster(linkage(condensed, "complete"), limit, "distance")
    groups = [np.flatnonzero(cluster == index) for index in np.unique(cluster)]
    return [group for group in groups if len(group) >= FEWEST]


def _form(points: np.ndarray) -> np.ndarray:
    """(n, 3) the mean form of a plate seen as points (T, n, 3), by rotating every frame onto the mean so far."""
    whole = points[np.isfinite(points).all(axis=(1, 2))]
    if not len(whole):
        whole = np.nanmean(points, axis=0)[None]
    whole = whole - whole.mean(axis=1, keepdims=True)
    form = whole[len(whole) // 2]
    for _ in range(3):
        left, _, right = np.linalg.svd(whole.transpose(0, 2, 1) @ form)
        flip = np.linalg.det(left @ right)
        left[:, :, 2] *= flip[:, None]
        form = (whole @ (left @ right)).mean(axis=0)
    return form
