# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a rigid body may be: every set of points in a frame that has its form, three markers or more of it."""

from dataclasses import dataclass

import numpy as np

from ..likelihood.naming import NO_POINT
from .model import NOISE, STRETCH, RigidBodies

GATE = 6.0  # standard deviations of a length
LEAST_GATE = 0.005  # m
NEAR = 0.012  # m that a further marker may be from where the first three put it
WORTH = 7.0  # log likelihood of one more point that fits
BENT = 4.0  # the most that a bent rigid body costs, for every number that fixes it
KEPT = 10  # placements of a rigid body in a frame


@dataclass(frozen=True, eq=False)
class Placements:
    """K placements of a rigid body of n markers in each of F frames.

    points  (F, K, n) index of the point, NO_POINT where the marker is hidden
    score   (F, K) log likelihood, -inf where there are fewer placements
    """

    points: np.ndarray
    score: np.ndarray


def distances(points: np.ndarray) -> np.ndarray:
    """(F, P, P) m between points (F, P, 3), infinite to where there is none."""
    known = np.nan_to_num(points)
    square = (known**2).sum(axis=2)
    apart = square[:, :, None] + square[:, None] - 2 * (known @ known.transpose(0, 2, 1))
    apart = np.sqrt(np.maximum(apart, 0))
    gone = ~np.isfinite(points[..., 0])
    apart[np.broadcast_to(gone[:, :, None] | gone[:, None], apart.shape)] = np.inf
    apart[:, np.arange(points.shape[1]), np.arange(points.shape[1])] = np.inf
    return apart


def place(rigid_bodies: RigidBodies, group: np.ndarray, points: np.ndarray, apart: np.ndarray) -> Placements:
    """The likeliest placements of a rigid body in frames of points (F, P, 3) m whose distances are `apart` (F, P, P)."""
    lengths = rigid_bodies.lengths(group)
    form = rigid_bodies.form[group]
    rows, scores = [], []
    for base in rigid_bodies.bases(group):
        frame, corners = _triangles(lengths, base, apart)
        if len(frame):
            found = _completed(form, base, points, frame, corners)
            rows.append(np.concatenate([frame[:, None], found], axis=1))
    if not rows:
        return _none(len(points), len(group))
    rows = np.unique(np.concatenate(rows), axis=0)
    scores = _scores(lengths, apart, rows[:, 0], rows[:, 1:])
    return _best(len(points), rows, scores)


def _none(frames: int, markers: int) -> Placements:
    return Placements(np.full((frames, 1, markers), NO_POINT), np.full((frames, 1), -np.inf))


def _gate(length: float) -> float:
    return max(GATE * np.hypot(NOISE, STRETCH * length), LEAST_GATE)


def _triangles(lengths: np.ndarray, base, apart: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Frames (K,) and points (K, 3) of all triangles with the sides of the base."""
    first, second, third = base
    longest = lengths[first, second]
    frame, one, two = np.nonzero(np.abs(apart - longest) < _gate(longest))
    near = np.abs(apart[frame, one] - lengths[first, third]) < _gate(lengths[first, third])
    near &= np.abs(apart[frame, two] - lengths[second, third]) < _gate(lengths[second, third])
    row, three = np.nonzero(near)
    return frame[row], np.stack([one[row], two[row], three], axis=1)


def _axes(corners: np.ndarray) -> np.ndarray:
    """(..., 3, 3) right-handed axes, one a row, of triangles (..., 3, 3)."""
    along = corners[..., 1, :] - corners[..., 0, :]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    side = corners[..., 2, :] - corners[..., 0, :]
    side = side - (side * along).sum(axis=-1, keepdims=True) * along
    side = side / np.maximum(np.linalg.norm(side, axis=-1, keepdims=True), 1e-9)
    return np.stack([along, side, np.cross(along, side)], axis=-2)


def _completed(form, base, points, frame, corners) -> np.ndarray:
    """(K, n) the points of whole rigid bodies on triangles: the nearest to where each further marker must be."""
    at = points[frame[:, None], corners]
    local = (form - form[list(base)].mean(axis=0)) @ _axes(form[list(base)]).T
    expected = local @ _axes(at) + at.mean(axis=1, keepdims=True)
    found = np.full((len(frame), len(form)), NO_POINT)
    found[:, list(base)] = corners
    for marker in range(len(form)):
        if marker in base:
            continue
        gap = np.linalg.norm(np.nan_to_num(points[frame], nan=np.inf) - expected[:, marker, None], axis=-1)
        nearest = gap.argmin(axis=1)
        free = (found != nearest[:, None]).all(axis=1)
        good = free & (gap[np.arange(len(gap)), nearest] < NEAR)
        found[good, marker] = nearest[good]
    return found


def _scores(lengths, apart, frame, found) -> np.ndarray:
    """(K,) how many points fit, and how well their distances do."""
    known = found >= 0
    both = known[:, :, None] & known[:, None] & ~np.eye(len(lengths), dtype=bool)
    measured = apart[frame[:, None, None], np.maximum(found, 0)[:, :, None], np.maximum(found, 0)[:, None]]
    spread = np.hypot(NOISE, STRETCH * lengths)
    off = np.where(both, ((np.where(both, measured, 0) - lengths) / spread) ** 2, 0)
    # Skin gives way now and then: far off costs little more than off.
    mean = 2 * np.log1p(off / 2).sum(axis=(1, 2)) / both.sum(axis=(1, 2))
    count = known.sum(axis=1)
    return WORTH * (count - 2) - 0.5 * (3 * count - 6) * np.minimum(mean, BENT)


def _best(frames: int, rows: np.ndarray, scores: np.ndarray) -> Placements:
    """The best few placements of every frame out of rows (N, 1 + n) of frame and points."""
    order = np.lexsort((-scores, rows[:, 0]))
    rows, scores = rows[order], scores[order]
    starts = np.searchsorted(rows[:, 0], np.arange(frames + 1))
    rank = np.arange(len(rows)) - starts[rows[:, 0]]
    kept = rank < KEPT
    rows, scores, rank = rows[kept], scores[kept], rank[kept]
    width = int(rank.max()) + 1
    points = np.full((frames, width, rows.shape[1] - 1), NO_POINT)
    score = np.full((frames, width), -np.inf)
    points[rows[:, 0], rank], score[rows[:, 0], rank] = rows[:, 1:], scores
    return Placements(points, score)
