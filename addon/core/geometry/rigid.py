# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigid groups of points: which points move as one, how they lie in each frame, and where two groups meet."""

from collections.abc import Sequence

import numpy as np

MIN_POINTS = 3  # with fewer a turn is not known
MEAN_ROUNDS = 3  # of laying frames on their mean, which is settled then


def laid_on(shape: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rotation (F, 3, 3) and place (F, 3) that lay a shape (N, 3) on points (F, N, 3), NaN where missing (Kabsch).

    A point of the shape is at turn @ point + place. NaN in frames with fewer than three points.
    """
    seen = np.isfinite(points).all(axis=2) & np.isfinite(shape).all(axis=1)
    count = np.maximum(seen.sum(axis=1), 1)[:, None]
    known, plain = np.where(seen[..., None], points, 0.0), np.nan_to_num(shape)
    there = known.sum(axis=1) / count
    here = (seen @ plain) / count
    away = np.where(seen[..., None], known - there[:, None], 0.0)
    outer = np.einsum("fni,fnj->fij", away, plain - here[:, None])
    turn, _ = best_turns(outer)
    place = there - np.einsum("fij,fj->fi", turn, here)
    few = seen.sum(axis=1) < MIN_POINTS
    turn[few], place[few] = np.nan, np.nan
    return turn, place


def best_turns(outer: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The rotations (F, 3, 3) nearest to sums of outer products of points and shape (F, 3, 3): Kabsch's.

    Also the sums' singular values (F, 3), the last negative where the nearest orthogonal matrix is a mirror image.
    """
    left, values, right = np.linalg.svd(outer)
    side = np.sign(np.linalg.det(left @ right))
    values[:, 2] *= side
    left[:, :, 2] *= side[:, None]
    return left @ right, values


def in_axes(turn: np.ndarray, place: np.ndarray, points: np.ndarray) -> np.ndarray:
    """Points (F, N, 3) in the axes of a rigid body with rotation (F, 3, 3) and place (F, 3)."""
    return np.einsum("fji,fnj->fni", turn, points - place[:, None])


def mean_form(form: np.ndarray, points: np.ndarray) -> np.ndarray:
    """The mean (N, 3) of what points (F, N, 3), NaN where missing, form when each frame is laid on the mean.

    It lies where `form` (N, 3), the first guess, does; points that are in no frame stay there (Procrustes analysis).
    """
    for _ in range(MEAN_ROUNDS):
        back = in_axes(*laid_on(form, points), points)
        seen = np.isfinite(back).all(axis=2)
        total = np.where(seen[..., None], back, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)[:, None]
        form = np.where(seen.any(axis=0)[:, None], total, form)
    return form


def pairwise_distances(points: np.ndarray) -> np.ndarray:
    """(..., N, N) between points (..., N, 3); NaN where one is missing. By products, which is fast for many points."""
    square = (points**2).sum(axis=-1)
    squares = square[..., :, None] + square[..., None, :] - 2 * (points @ points.swapaxes(-1, -2))
    return np.sqrt(np.maximum(squares, 0))


def distance_ranges(distance: np.ndarray, percents: Sequence[float], fewest: int = 1) -> np.ndarray:
    """(3, K) standard deviation and two percentiles of K distances (K, T) m, NaN where missing.

    NaN for those that are known in fewer frames. NumPy's own functions that look for NaN take ten times as long.
    """
    found = np.full((3, len(distance)), np.nan)
    count = np.isfinite(distance).sum(axis=1)
    whole = (count == distance.shape[1]) & (count >= fewest)
    found[0, whole] = distance[whole].std(axis=1)
    found[1:, whole] = np.percentile(distance[whole], percents, axis=1)
    for row in np.flatnonzero(~whole & (count >= fewest)):
        known = distance[row, np.isfinite(distance[row])]
        found[:, row] = known.std(), *np.percentile(known, percents)
    return found


def rigid_clusters(spread: np.ndarray, weight: np.ndarray, limit: float) -> list[list[int]]:
    """What moves as one, by how much distances vary, spread (N, N), over so many frames seen together, weight (N, N).

    Mean linkage over the pairs that were seen together, up to `limit`; points on their own are clusters too.
    """
    total, known = spread * weight, weight.copy()
    members = [[index] for index in range(len(spread))]
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(known > 0, total / known, np.inf)
    while len(mean) and mean.min() < limit:
        one, two = np.unravel_index(mean.argmin(), mean.shape)
        members[one] += members[two]
        members[two] = []
        for table in (total, known):
            table[one] += table[two]
            table[:, one] = table[one]
            table[two], table[:, two] = 0, 0
            table[one, one] = 0
        row = np.where(known[one] > 0, total[one] / np.maximum(known[one], 1), np.inf)
        mean[one], mean[:, one] = row, row
        mean[two], mean[:, two] = np.inf, np.inf
    return [cluster for cluster in members if cluster]


def centre_of_rotation(
    turns: np.ndarray, places: np.ndarray, likely: np.ndarray, pull: float = 0.0, share: float = 1.0
) -> tuple[np.ndarray, float]:
    """Where two rigid bodies meet, and how far, root mean square, the point of one is from the other's.

    turns (F, 2, 3, 3) and places (F, 2, 3); `likely` is one point (3,) where they are against a rest pose in which both
    have the point in one place, else a point in the axes of each, (2, 3). What is like it is found by least squares,
    drawn to `likely` with `pull` where the motion does not tell, from the `share` of the frames that agree best.
    (Ehrig and others, A survey of formal methods for determining the centre of rotation, 2006.)
    """
    fine = np.isfinite(turns).all(axis=(1, 2, 3))
    if not fine.any():
        return likely, np.inf
    one, two = turns[fine, 0], turns[fine, 1]
    matrix = one - two if likely.ndim == 1 else np.concatenate([one, -two], axis=2)
    offset, start = places[fine, 1] - places[fine, 0], likely.ravel()
    kept = np.ones(len(matrix), dtype=bool)
    for _ in range(1 if share == 1 else 2):
        normal = np.einsum("fji,fjk->ik", matrix[kept], matrix[kept]) / kept.sum()
        right = np.einsum("fji,fj->i", matrix[kept], offset[kept]) / kept.sum()
        point = start + np.linalg.solve(normal + pull**2 * np.eye(len(start)), right - normal @ start)
        square = ((matrix @ point - offset) ** 2).sum(axis=1)
        # A trajectory that goes astray takes its whole rigid body with it; the joint is what most frames say.
        kept = square <= np.quantile(square, share)
    return point.reshape(likely.shape), float(np.sqrt(square[kept].mean()))
