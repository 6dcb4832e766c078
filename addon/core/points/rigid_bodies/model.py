# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigid bodies: groups of three or more markers that move as one, and how far from each other any two markers ever are.

Where most markers are on rigid bodies, a pose that was never seen is no trouble: each rigid body is found by its own
form, and rigid bodies are put together by what the distances between their markers allow.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from ...data.physical import MARKER_LIMITS
from ...geometry.rigid import MIN_POINTS, distance_ranges, mean_form, pairwise_distances


class RIGID_BODY:
    """When markers are on rigid bodies, and how far their distances may leave what was seen."""

    # radii, standard deviation of every distance within a rigid body
    max_rigid_sd: float = 0.015  # physical: 12 mm, as skin moves
    # times as much as within must distances to markers off a rigid body vary, on the Clouthier takes on plates and the
    # McGill walks on the skin: in a few steps a whole limb keeps its form too
    min_separation: float = 5.0  # measured
    # radii that distances may vary by within what is separate so, on the same takes: a rigid body with what sits right
    # beside it
    max_separate_sd: float = 0.021  # measured
    max_marker_m: float = 0.012  # that a marker may be off its place on a rigid body; physical: its own width
    min_sd_m: float = 0.001  # that any distance is taken to vary by; physical: how exact cameras are
    # of the markers that must be on rigid bodies for the set to be
    min_marker_part: float = 0.85  # measured on the same takes
    # standard deviation of where a prop is
    min_prop_move_m: float = 0.03  # physical: who stands still keeps their form too
    # of a distance's range that it may leave the range by, besides what plates put on by hand do, as no take shows all
    # poses; without it 1,106 of 133,000 names on plates are wrong
    slack_range: float = 0.25  # measured


MAX_BASES = 8  # triangles that a rigid body is recognised by: some may be hidden, all are too many
RANGE_TAILS = [0.5, 99.5]  # per cent of a distance, between which its range is; beyond are outliers
UNSEEN_M = 50.0  # how far two markers may be from each other that were never seen together: anywhere


@dataclass(frozen=True, eq=False)
class RigidBodies:
    """Rigid groups of M markers, and the distances between all."""

    members: tuple[np.ndarray, ...]  # for each rigid body the indices (n,) of its markers
    form: np.ndarray  # (M, 3) m, each marker in its rigid body's own axes; 0 for markers on none
    # (M, M) m, the range of every distance
    low: np.ndarray
    high: np.ndarray

    @cached_property
    def slack(self) -> np.ndarray:
        """(M, M) m, how softly the range of a distance ends."""
        return RIGID_BODY.slack_range * (self.high - self.low) + MARKER_LIMITS.placed_m

    def lengths(self, group: np.ndarray) -> np.ndarray:
        """(n, n) m, the distances within a rigid body."""
        return pairwise_distances(self.form[group])

    @cached_property
    def bases(self) -> list[list[tuple[int, int, int]]]:
        """Triples of places to know each rigid body by, the largest triangles and their longest side first."""
        return [self._bases(group) for group in self.members]

    def _bases(self, group: np.ndarray) -> list[tuple[int, int, int]]:
        form = self.form[group]
        scored = []
        for triple in combinations(range(len(group)), 3):
            sides = [(np.linalg.norm(form[a] - form[b]), a, b) for a, b in combinations(triple, 2)]
            _, first, second = max(sides)
            third = next(place for place in triple if place not in (first, second))
            area = np.linalg.norm(np.cross(form[second] - form[first], form[third] - form[first]))
            scored.append((area, first, second, third))
        return [row[1:] for row in sorted(scored, reverse=True)[:MAX_BASES]]

    def breach(self, distance: np.ndarray, first: np.ndarray, second: np.ndarray) -> np.ndarray:
        """How far distances, m, between markers lie outside what was ever seen, in slacks."""
        low, high, slack = (table[first, second] for table in (self.low, self.high, self.slack))
        return np.maximum(np.maximum(low - distance, distance - high), 0) / slack


def learn_rigid_bodies(subjects: Sequence[np.ndarray], radius: float) -> RigidBodies | None:
    """The rigid bodies of labelled clouds, one array (T, M, 3) m a subject, NaN where missing; `radius` is the shape's.

    None for a set that is not on rigid bodies, as its markers move against each other or none at all.
    """
    markers = subjects[0].shape[1]
    everyone = np.concatenate(subjects)
    spread, low, high = distance_tables(everyone, RANGE_TAILS, fewest=2)
    never = ~np.isfinite(low)
    spread[never] = np.inf
    low[never], high[never] = 0, UNSEEN_M
    tree = _tree(spread)
    groups = _rigid_groups(tree, RIGID_BODY.max_rigid_sd * radius)
    separate = _separate_part(tree, markers, RIGID_BODY.max_separate_sd * radius) >= RIGID_BODY.min_marker_part
    if not groups or not (separate or _is_prop(tree, everyone)):
        return None
    form = np.zeros((markers, 3))
    for group in groups:
        form[group] = _form(everyone[:, group])
    return RigidBodies(tuple(groups), form, low, high)


def distance_tables(points: np.ndarray, tails: list[float], fewest: int) -> np.ndarray:
    """(3, M, M) m, what `distance_ranges` says of all distances of points (T, M, 3), tails in per cent."""
    tables = np.full((3, *points.shape[1:2] * 2), np.nan)
    columns = np.ascontiguousarray(points.transpose(1, 2, 0))
    for one in range(len(columns)):
        distance = np.sqrt(np.square(columns[one:] - columns[one]).sum(axis=1))
        tables[:, one, one:] = tables[:, one:, one] = distance_ranges(distance, tails, fewest)
    return tables


def _tree(spread: np.ndarray) -> np.ndarray:
    """Markers grown together by complete linkage of how much their distances vary, (M, M) m, as SciPy has it."""
    from scipy.cluster.hierarchy import linkage

    return linkage(np.minimum(spread, 10.0)[np.triu_indices(len(spread), 1)], "complete")


def _rigid_groups(tree: np.ndarray, limit: float) -> list[np.ndarray]:
    """Groups in which no distance varies by more than `limit`, m."""
    from scipy.cluster.hierarchy import fcluster

    cluster = fcluster(tree, limit, "distance")
    groups = [np.flatnonzero(cluster == index) for index in np.unique(cluster)]
    return [group for group in groups if len(group) >= MIN_POINTS]


def _is_prop(tree: np.ndarray, points: np.ndarray) -> bool:
    """Whether the markers, points (T, M, 3) m, are all one thing, rigid but for noise, that was moved about."""
    return bool(tree[-1, 2] < MARKER_LIMITS.noise_m and np.nanstd(points, axis=0).max() > RIGID_BODY.min_prop_move_m)


def _separate_part(tree: np.ndarray, markers: int, limit: float) -> float:
    """The part of the markers that is in groups whose distances vary much less within than towards any other."""
    members = [[index] for index in range(markers)]
    height = [0.0] * markers
    separate = np.zeros(markers, dtype=bool)
    for one, two, varies, _ in tree:
        for group in (int(one), int(two)):
            rigid = height[group] < limit and varies >= RIGID_BODY.min_separation * max(
                height[group], RIGID_BODY.min_sd_m
            )
            if rigid and len(members[group]) >= MIN_POINTS:
                separate[members[group]] = True
        members.append(members[int(one)] + members[int(two)])
        height.append(varies)
    return float(separate.mean())


def _form(points: np.ndarray) -> np.ndarray:
    """(n, 3) the mean form of a rigid body seen as points (T, n, 3), its middle at 0."""
    whole = points[np.isfinite(points).all(axis=(1, 2))]
    if not len(whole):
        whole = np.nanmean(points, axis=0)[None]
    whole = whole - whole.mean(axis=1, keepdims=True)
    return mean_form(whole[len(whole) // 2], whole)


def linking_order(loose: np.ndarray) -> list[int]:
    """K rigid bodies from the best linked on, each next to one before it, by how loosely they are linked, (K, K)."""
    loose = np.where(np.eye(len(loose), dtype=bool), np.inf, loose)
    order = [int(np.argmin(np.sort(loose, axis=1)[:, :2].sum(axis=1)))]
    while len(order) < len(loose):
        rest = [index for index in range(len(loose)) if index not in order]
        order.append(min(rest, key=lambda index: loose[index, order].min()))
    return order
