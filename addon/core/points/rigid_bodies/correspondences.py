# SPDX-License-Identifier: GPL-3.0-or-later
"""How the points of a cluster may be the markers of a rigid body: all for a small one, the likely for a large."""

from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from ...data.takes import NO_POINT
from ...geometry.rigid import laid_on


@dataclass(frozen=True)
class CorrespondenceOptions:
    """How much lengths within a rigid body differ from subject to subject.

    form_sd_m   standard deviation; measured on the raw take S09_KneeltoRun02
    form_share  the same of a length, besides; measured on it
    """

    form_sd_m: float = 0.012
    form_share: float = 0.15


CORRESPONDENCE = CorrespondenceOptions()
MAX_ALL = 7  # markers of a rigid body, or points of a cluster, of which all are tried: of 8 there are 40,320
BASES = 8  # triples of markers that a large rigid body is laid by; by time
MAX_SIDE_SDS = 2.0  # that a side of such a triple may be off: of eight triples one is nearer
PLACEMENTS_KEPT = 30  # placements of a large rigid body that are looked at more closely; by time
INDEPENDENT = 3  # distances that are all the evidence there is of a place; more are partly the same
MAX_COST = 8.0  # the most that one fact counts against, log likelihood: four standard deviations


def correspondences(form: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(W, n) indices of points (p, 3) m for the markers (n, 3) m of a rigid body, NO_POINT where a marker has none.

    All where the rigid body has MAX_ALL markers at most: of the points those nearest to their middle. There are
    millions for a larger one, and its form tells which are worth a look.
    """
    if len(form) <= MAX_ALL:
        near = np.argsort(np.linalg.norm(points, axis=1), kind="stable")[:MAX_ALL]
        chosen = _all(len(form), len(near))
        return np.where(chosen >= 0, near[chosen], NO_POINT)
    return _likely(form, points)


def spread_of(lengths: np.ndarray) -> np.ndarray:
    """The standard deviation, m, of lengths, m, within a rigid body, from one subject's to another's."""
    return np.hypot(CORRESPONDENCE.form_sd_m, CORRESPONDENCE.form_share * lengths)


def _all(markers: int, points: int) -> np.ndarray:
    """(W, n) all assignments of a point each to n markers, NO_POINT for some where the points are too few."""
    if points >= markers:
        return np.array(list(permutations(range(points), markers)))
    taken = np.array(list(permutations(range(markers), points)))
    tried = np.full((len(taken), markers), NO_POINT)
    np.put_along_axis(tried, taken, np.arange(points)[None], axis=1)
    return tried


def _likely(form: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(W, n) those that lay three markers on three points best, and each with any two markers exchanged."""
    laid = [_assigned(form, points, *pair) for base in _bases(form, BASES) for pair in _on_points(form, points, base)]
    laid.sort(key=lambda row: row[0])
    tried = np.array([assigned for _, assigned in laid] or np.full((1, len(form)), NO_POINT))
    tried = tried[np.sort(np.unique(tried, axis=0, return_index=True)[1])][:PLACEMENTS_KEPT]
    exchanged = [tried]
    for one, two in combinations(range(len(form)), 2):
        other = tried.copy()
        other[:, [one, two]] = tried[:, [two, one]]
        exchanged.append(other)
    return np.unique(np.concatenate(exchanged), axis=0)


def _bases(form: np.ndarray, count: int) -> np.ndarray:
    """(B, 3) the triples of markers with the largest triangles."""
    triples = np.array(list(combinations(range(len(form)), 3)))
    one, two, three = form[triples].transpose(1, 0, 2)
    area = np.linalg.norm(np.cross(two - one, three - one), axis=1)
    return triples[np.argsort(-area, kind="stable")[:count]]


def _on_points(form: np.ndarray, points: np.ndarray, base: np.ndarray) -> list[tuple[np.ndarray, np.ndarray]]:
    """Rotation and place that lay a triple of markers on every triple of points with sides alike, the best few."""
    triples = np.array(list(permutations(range(len(points)), 3)), int).reshape(-1, 3)
    wanted = _sides(form[base])
    off = np.abs(_sides(points[triples]) - wanted) / spread_of(wanted)
    fits = np.flatnonzero((off < MAX_SIDE_SDS).all(axis=1))
    turn, place = laid_on(form[base], points[triples[fits]])
    # Sorted by how near the other markers come to any point.
    moved = np.einsum("tij,nj->tni", turn, form) + place[:, None]
    nearest = np.linalg.norm(moved[:, :, None] - points, axis=-1).min(axis=2)
    best = np.argsort(nearest.sum(axis=1), kind="stable")[:PLACEMENTS_KEPT]
    return list(zip(turn[best], place[best], strict=True))


def _sides(corners: np.ndarray) -> np.ndarray:
    """(…, 3) m, the sides of triangles (…, 3, 3) m."""
    return np.linalg.norm(corners - np.roll(corners, -1, axis=-2), axis=-1)


def _assigned(form: np.ndarray, points: np.ndarray, turn: np.ndarray, place: np.ndarray) -> tuple[float, np.ndarray]:
    """How far, m, a rigid body that is laid so is from points in all, and the points (n,) that make it least."""
    from scipy.optimize import linear_sum_assignment

    distance = np.linalg.norm((form @ turn.T + place)[:, None] - points, axis=-1)
    marker, point = linear_sum_assignment(distance)
    assigned = np.full(len(form), NO_POINT)
    assigned[marker] = point
    return float(distance[marker, point].sum()), assigned
