# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigid groups of points: how they lie in each frame, and where two of them meet."""

import numpy as np

MIN_POINTS = 3  # with fewer a turn is not known


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


def centre_of_rotation(
    turns: np.ndarray, places: np.ndarray, likely: np.ndarray, pull: float = 0.0
) -> tuple[np.ndarray, float]:
    """Where two rigid bodies meet, and how far, root mean square, the point of one is from the other's.

    turns (F, 2, 3, 3) and places (F, 2, 3) against a rest pose in which both have the point in one place (3,): that
    place is found by least squares, drawn to `likely` (3,) with `pull` where the motion does not fix it.
    """
    fine = np.isfinite(turns).all(axis=(1, 2, 3))
    if not fine.any():
        return likely, np.inf
    between, offset = turns[fine, 0] - turns[fine, 1], places[fine, 1] - places[fine, 0]
    normal = np.einsum("fji,fjk->ik", between, between) / len(between)
    right = np.einsum("fji,fj->i", between, offset) / len(between)
    point = likely + np.linalg.solve(normal + pull**2 * np.eye(3), right - normal @ likely)
    miss = between @ point - offset
    return point, float(np.sqrt((miss**2).sum(axis=1).mean()))
