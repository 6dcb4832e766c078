# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers in space from their blobs in two or more cameras, robust to one camera that is wrong."""

import numpy as np

from .views import Sight

PARALLEL = 1e-4  # smallest share of the mean eigenvalue below which the rays fix no depth
REFINEMENTS = 2


def triangulate(image: np.ndarray, seen: np.ndarray, sight: Sight) -> tuple[np.ndarray, np.ndarray]:
    """Points (B, M, 3) m and residuals (B, M) m of markers seen at normalised image points (B, C, M, 2).

    `seen` (B, C, M) says which cameras count. Starts from the point nearest to all rays, then weighs every camera by
    its distance, so that the residual is the reprojection error at the point's depth (root mean square over cameras,
    m). NaN where fewer than two cameras see a marker or their rays are parallel.
    """
    weight = seen.astype(float)
    direction = _directions(image, sight)
    across = np.eye(3) - direction[..., :, None] * direction[..., None, :]
    points = _nearest(across, weight, sight)
    for _ in range(REFINEMENTS):
        distance = np.linalg.norm(points[:, None] - sight.centres[:, None], axis=-1)
        points = _nearest(across, weight / np.maximum(distance, 1e-3) ** 2, sight)
    miss = np.einsum("bcmij,bcmj->bcmi", across, points[:, None] - sight.centres[:, None])
    squares = np.einsum("bcmi,bcmi->bcm", miss, miss) * weight
    counts = weight.sum(axis=1)
    with np.errstate(invalid="ignore", divide="ignore"):
        residual = np.sqrt(squares.sum(axis=1) / np.maximum(counts, 1))
    lost = counts < 2
    points[lost], residual[lost] = np.nan, np.nan
    residual[~np.isfinite(points[..., 0])] = np.nan
    return points, residual


def ray_misses(points: np.ndarray, image: np.ndarray, sight: Sight) -> np.ndarray:
    """(B, C, M) m between points (B, M, 3) and the rays of normalised image points (B, C, M, 2)."""
    direction = _directions(image, sight)
    arm = points[:, None] - sight.centres[:, None]
    along = np.einsum("bcmi,bcmi->bcm", arm, direction)
    return np.sqrt(np.maximum(np.einsum("bcmi,bcmi->bcm", arm, arm) - along**2, 0))


def _directions(image: np.ndarray, sight: Sight) -> np.ndarray:
    """(B, C, M, 3) unit directions in the world."""
    local = np.concatenate([image, np.ones((*image.shape[:-1], 1))], axis=-1)
    direction = local @ sight.rotation
    return direction / np.linalg.norm(direction, axis=-1, keepdims=True)


def _nearest(across: np.ndarray, weight: np.ndarray, sight: Sight) -> np.ndarray:
    """(B, M, 3) the points nearest to their weighted rays; NaN where the rays do not fix one."""
    normal = np.einsum("bcm,bcmij->bmij", weight, across)
    right = np.einsum("bcm,bcmij,cj->bmi", weight, across, sight.centres, optimize=True)
    scale = np.trace(normal, axis1=-2, axis2=-1)[..., None, None] / 3
    unsure = np.linalg.det(normal / np.where(scale > 0, scale, 1.0)) < PARALLEL
    safe = np.where(unsure[..., None, None], np.eye(3), normal)
    points = np.linalg.solve(safe, right[..., None])[..., 0]
    points[unsure] = np.nan
    return points
