# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigid bodies: groups of three or more markers that move as one rigid thing, and how far apart any two markers ever are.

Where most markers are on rigid bodies, a pose that was never seen is no trouble: each rigid body is found by its own form, and
rigid bodies are put together by what the distances between their markers allow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

RIGID = 0.015  # radii: standard deviation of a distance within a rigid body
APART = (
    5.0  # times as much must distances to markers off a rigid body vary: in a few steps a whole limb keeps its form too
)
KEPT = 0.021  # radii that distances within what stands apart so vary by: a rigid body with what is worn right beside it
STEADIEST = 0.001  # m, that any distance is taken to vary by
ON_PLATES = 0.85  # part of the markers that must be on rigid bodies for a set to be one on rigid bodies
PROP = 0.003  # m that distances of a prop, on which all markers are one rigid body, vary by
MOVED = 0.03  # m, standard deviation of where it is: who stands still keeps his form too
FEWEST = 3
MOST_BASES = 8
NOISE = 0.0007  # m, of a measured distance
STRETCH = 0.003  # of a length, between takes
SLACK = 0.25  # of a distance's range, and
SLACK_LENGTH = 0.02  # m, that it may leave the range by before it counts
ANYWHERE = 50.0  # m, for two markers never seen together
OUTLIERS = 0.5  # per cent at either end of a distance's range that are left out


@dataclass(frozen=True, eq=False)
class RigidBodies:
    """Rigid groups of M markers, and the distances between all.

    groups  for each rigid body the indices (n,) of its markers
    form    (M, 3) m, each marker in its rigid body's own axes; 0 for markers on none
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

    def lengths(self, group: np.ndarray) -> np.ndarray:
        """(n, n) m, the distances within a rigid body."""
        form = self.form[group]
        return np.linalg.norm(form[:, None] - form[None], axis=-1)

    def bases(self, group: np.ndarray) -> list[tuple[int, int, int]]:
        """Triples of places in a rigid body to recognise it by, the largest triangles first, the longest side first."""
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


def learn_rigid_bodies(subjects: Sequence[np.ndarray], radius: float) -> RigidBodies | None:
    """The rigid bodies of labelled clouds, one array (T, M, 3) m a subject, NaN where missing; `radius` is the shape's.

    None for a set that is not worn on rigid bodies, as its markers move against each other or none at all.
    """
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
    tree = _tree(spread)
    groups = _rigid_groups(tree, RIGID * radius)
    on_plates = _prop(tree, everyone) or _part_apart(tree, markers, KEPT * radius) >= ON_PLATES
    if not groups or not on_plates:
        return None
    form = np.zeros((markers, 3))
    for group in groups:
        form[group] = _form(everyone[:, group])
    return RigidBodies(tuple(groups), form, low, high)


def _tree(spread: np.ndarray) -> np.ndarray:
    """Markers grown together by complete linkage of how much their distances vary, (M, M) m, as SciPy has it."""
    from scipy.cluster.hierarchy import linkage

    return linkage(np.minimum(spread, 10.0)[np.triu_indices(len(spread), 1)], "complete")


def _rigid_groups(tree: np.ndarray, limit: float) -> list[np.ndarray]:
    """Groups in which every distance is steady."""
    from scipy.cluster.hierarchy import fcluster

    cluster = fcluster(tree, limit, "distance")
    groups = [np.flatnonzero(cluster == index) for index in np.unique(cluster)]
    return [group for group in groups if len(group) >= FEWEST]


def _prop(tree: np.ndarray, points: np.ndarray) -> bool:
    """Whether the markers, points (T, M, 3) m, are all one rigid thing that was moved about."""
    return bool(tree[-1, 2] < PROP and np.nanstd(points, axis=0).max() > MOVED)


def _part_apart(tree: np.ndarray, markers: int, limit: float) -> float:
    """The part of the markers that is in groups much steadier within than towards any other."""
    members = [[index] for index in range(markers)]
    height = [0.0] * markers
    on_plate = np.zeros(markers, dtype=bool)
    for one, two, varies, _ in tree:
        for group in (int(one), int(two)):
            steady = height[group] < limit and varies >= APART * max(height[group], STEADIEST)
            if steady and len(members[group]) >= FEWEST:
                on_plate[members[group]] = True
        members.append(members[int(one)] + members[int(two)])
        height.append(varies)
    return float(on_plate.mean())


def _form(points: np.ndarray) -> np.ndarray:
    """(n, 3) the mean form of a rigid body seen as points (T, n, 3), by rotating every frame onto the mean so far."""
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
