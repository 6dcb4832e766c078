# SPDX-License-Identifier: GPL-3.0-or-later
"""The ways in which the points of a group may be the markers of a rigid body: all of a small one, the likely of a large."""

from itertools import combinations, permutations

import numpy as np

from ...geometry.rigid import laid_on

ABSENT = -1
MOST = 7  # markers of a rigid body, or points of a group, of which all ways are tried
FORM_SD, FORM_SHARE = 0.012, 0.15  # m, and of a length, that lengths within a rigid body differ by
BASES = 8  # triples of markers that a large rigid body is laid by
WITHIN = 2.0  # standard deviations that a side of such a triple may be off
KEPT = 30  # ways of laying a large rigid body that are looked at more closely


def ways_of(form: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(W, n) indices of points (p, 3) m for the markers (n, 3) m of a rigid body, ABSENT where a marker has none.

    All ways where the rigid body has MOST markers at most: of the points those nearest to their middle. There are millions
    of ways for a larger one, and its form tells which are worth a look.
    """
    if len(form) > MOST:
        return _likely(form, points)
    near = np.argsort(np.linalg.norm(points, axis=1), kind="stable")[:MOST]
    chosen = _all(len(form), len(near))
    return np.where(chosen >= 0, near[chosen], ABSENT)


def spread_of(lengths: np.ndarray) -> np.ndarray:
    """The standard deviation, m, of lengths, m, within a rigid body, from one subject's to another's."""
    return np.hypot(FORM_SD, FORM_SHARE * lengths)


def _all(markers: int, points: int) -> np.ndarray:
    """(W, n) every way to give n markers a point each, ABSENT for some where the points are too few."""
    if points >= markers:
        return np.array(list(permutations(range(points), markers)))
    taken = np.array(list(permutations(range(markers), points)))
    ways = np.full((len(taken), markers), ABSENT)
    np.put_along_axis(ways, taken, np.arange(points)[None], axis=1)
    return ways


def _likely(form: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(W, n) the ways that lay three markers on three points best, and each with any two markers exchanged."""
    laid = [_assigned(form, points, *pair) for base in _bases(form) for pair in _on_points(form, points, base)]
    laid.sort(key=lambda row: row[0])
    ways = np.array([way for _, way in laid] or np.full((1, len(form)), ABSENT))
    ways = ways[np.sort(np.unique(ways, axis=0, return_index=True)[1])][:KEPT]
    exchanged = [ways]
    for one, two in combinations(range(len(form)), 2):
        other = ways.copy()
        other[:, [one, two]] = ways[:, [two, one]]
        exchanged.append(other)
    return np.unique(np.concatenate(exchanged), axis=0)


def _bases(form: np.ndarray) -> np.ndarray:
    """(B, 3) the triples of markers with the largest triangles."""
    triples = np.array(list(combinations(range(len(form)), 3)))
    one, two, three = form[triples].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(two - one, three - one), axis=1)
    return triples[np.argsort(-area, kind="stable")[:BASES]]


def _on_points(form: np.ndarray, points: np.ndarray, base: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotation and place that lay a triple of markers on every triple of points with sides alike, the best KEPT."""
    triples = np.array(list(permutations(range(len(points)), 3)), int).reshape(-1, 3)
    wanted = _sides(form[base])
    off = np.abs(_sides(points[triples]) - wanted) / spread_of(wanted)
    fits = np.flatnonzero((off < WITHIN).all(axis=1))
    turn, place = laid_on(form[base], points[triples[fits]])
    # Sorted by how near the other markers come to any point.
    moved = np.einsum("tij,nj->tni", turn, form) + place[:, None]
    nearest = np.linalg.norm(moved[:, :, None] - points, axis=-1).min(axis=2)
    best = np.argsort(nearest.sum(axis=1), kind="stable")[:KEPT]
    return list(zip(turn[best], place[best], strict=True))


def _sides(corners: np.ndarray) -> np.ndarray:
    """(…, 3) m, the sides of triangles (…, 3, 3) m."""
    return np.linalg.norm(corners - np.roll(corners, -1, axis=-2), axis=-1)


def _assigned(form: np.ndarray, points: np.ndarray, turn: np.ndarray, place: np.ndarray) -> tuple[float, np.ndarray]:
    """How far, m, a rigid body that is laid so is from points in all, and the point of each marker that makes it least."""
    from scipy.optimize import linear_sum_assignment

    apart = np.linalg.norm((form @ turn.T + place)[:, None] - points, axis=-1)
    marker, point = linear_sum_assignment(apart)
    way = np.full(len(form), ABSENT)
    way[marker] = point
    return float(apart[marker, point].sum()), way
