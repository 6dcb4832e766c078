# SPDX-License-Identifier: GPL-3.0-or-later
"""Rigid groups of points: how they lie in each frame, and where two of them meet."""

import numpy as np

FEWEST = 3


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
    left, _, right = np.linalg.svd(outer)
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    turn = left @ right
    place = there - np.einsum("fij,fj->fi", turn, here)
    few = seen.sum(axis=1) < FEWEST
    turn[few], place[few] = np.nan, np.nan
    return turn, place


def centre_of_rotation(
    turns: np.ndarray, places: np.ndarray, likely: np.ndarray, pull: float = 0.0
) -> tuple[np.ndarray, float]:
    """Where two rigid bodies meet, and how far, root mean square, the point of one is from the other's.

    turns (F, 2, 3, 3) and places (F, 2, 3) against a rest pose in which both have the point in one place (3,): that
    place is found by least squares, drawn to `likely` (3,) with `pull` where the motion does not tell.
    """
    fine = np.isfinite(turns).all(axis=(1, 2, 3))
    if not fine.any():
        return likely, np.inf
    between, apart = turns[fine, 0] - turns[fine, 1], places[fine, 1] - places[fine, 0]
    normal = np.einsum("fji,fjk->ik", between, between) / len(between)
    right = np.einsum("fji,fj->i", between, apart) / len(between)
    point = likely + np.linalg.solve(normal + pull**2 * np.eye(3), right - normal @ likely)
    miss = between @ point - apart
    return point, float(np.sqrt((miss**2).sum(axis=1).mean()))
