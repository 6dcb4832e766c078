# SPDX-License-Identifier: GPL-3.0-or-later
"""Turning clouds of points about the vertical: the one rotation that gravity leaves unknown."""

import numpy as np


def turned(points: np.ndarray, yaw: np.ndarray) -> np.ndarray:
    """Points (..., P, 3) turned counter-clockwise about z by yaw (...,), rad."""
    cosine, sine = np.cos(yaw)[..., None], np.sin(yaw)[..., None]
    x, y = points[..., 0], points[..., 1]
    return np.stack([cosine * x - sine * y, sine * x + cosine * y, points[..., 2]], axis=-1)


def best_yaw(points: np.ndarray, goal: np.ndarray) -> np.ndarray:
    """(N,) rad, the yaw that turns points (N, P, 3) best onto a goal (N, P, 3) or (P, 3), in least squares."""
    along = (points[..., 0] * goal[..., 0] + points[..., 1] * goal[..., 1]).sum(axis=1)
    across = (points[..., 0] * goal[..., 1] - points[..., 1] * goal[..., 0]).sum(axis=1)
    return np.arctan2(across, along)


def upright_aligned(points: np.ndarray, template: np.ndarray) -> np.ndarray:
    """Each frame of labelled points (T, M + E, 3), NaN where missing, turned and moved onto template (M, 3).

    The least squares fit by yaw and translation over the markers present; E points that are none of them go along.
    """
    present = np.isfinite(points[..., :1])
    known = np.where(present, points, 0)
    fitted, markers = present[:, : len(template)], known[:, : len(template)]
    count = np.maximum(fitted.sum(axis=1, keepdims=True), 1)
    centre = markers.sum(axis=1, keepdims=True) / count
    goal_centre = (template * fitted).sum(axis=1, keepdims=True) / count
    yaw = best_yaw((markers - centre) * fitted, template - goal_centre)
    return np.where(present, turned(known - centre, yaw) + goal_centre, np.nan)
