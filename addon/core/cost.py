# SPDX-License-Identifier: GPL-3.0-or-later
"""How badly a body explains the blobs: the paper's equation 7, made smooth, truncated and two-sided.

Equation 7 adds, over cameras and visible markers, the distance to the nearest blob. Its inner minimum jumps and it
never asks whether the blobs are explained, so here

    F = Σ_markers ρ(blobs seen from the marker) + Σ_blobs ρ(visible markers seen from the blob)
    ρ = -2 s² log( e^(-r²/2s²) + Σ e^(-d²/2s²) )

with d the distance in metres at the body's depth. ρ tends to min(d², r²) of the nearest as s shrinks: the paper's
"only small values are considered" is the truncation r. Squares, because Levenberg-Marquardt minimises squares.
"""

from dataclasses import dataclass

import numpy as np

from .views import Sight, View


@dataclass(frozen=True, eq=False)
class Pull:
    """What the data says to B bodies' markers.

    cost      (B,) F, in units of s²
    gradient  (B, M, 3) half of dF / d marker
    hessian   (B, M, 3, 3) its Gauss-Newton second derivative
    """

    cost: np.ndarray
    gradient: np.ndarray
    hessian: np.ndarray


def blob_pull(markers, visible, view: View, sight: Sight, softness: float, reach: float) -> Pull:
    """F and its derivatives for markers (B, M, 3) m that are visible (B, C, M) in a frame's view.

    `softness` is s and `reach` is r, m.
    """
    local = sight.local(markers)
    image = sight.image(local)
    depth = np.maximum(local[..., 2].mean(axis=2), 0.1)
    between, chance = _closeness(view, image, depth, visible, softness)
    outside = np.exp(-0.5 * (reach / softness) ** 2)
    of_marker, of_blob = chance.sum(axis=3) + outside, chance.sum(axis=2) + outside
    cost = -2 * (np.log(of_marker).sum(axis=(1, 2)) + (np.log(of_blob) * view.real).sum(axis=(1, 2)))
    weight = chance * (1 / of_marker[..., None] + 1 / of_blob[:, :, None, :])
    weight *= 0.5 * (depth / softness)[:, :, None, None] ** 2
    slope = sight.derivatives(local, image)
    back = slope.swapaxes(-1, -2)
    toward = (weight[..., None, :] @ between)[..., 0, :]
    gradient = -(back @ toward[..., None])[..., 0].sum(axis=1)
    hessian = (back @ (slope * weight.sum(axis=3)[..., None, None])).sum(axis=1)
    return Pull(cost / 2, gradient, hessian)


def _closeness(view, image, depth, visible, softness):
    """Offsets marker → blob (B, C, M, K, 2), normalised, and e^(-d²/2s²) of those a marker may claim."""
    between = view.image[None, :, None] - image[:, :, :, None]
    square = between[..., 0] ** 2 + between[..., 1] ** 2
    square *= (depth**2 / (-2 * softness**2))[:, :, None, None]
    chance = np.exp(square)
    chance *= visible[..., None]
    return between, chance


def cloud_pull(markers: np.ndarray, points: np.ndarray, weight: np.ndarray, softness: float, reach: float) -> Pull:
    """The same with points in space (Q, 3) m of weights (Q,) instead of blobs, blobs' side only.

    Every point wants a marker; a marker without a point costs nothing, because it may be hidden.
    """
    between = points[None, None] - markers[:, :, None]
    square = np.einsum("bmqi,bmqi->bmq", between, between)
    chance = np.exp(square / (-2 * softness**2))
    of_point = chance.sum(axis=1) + np.exp(-0.5 * (reach / softness) ** 2)
    share = chance / of_point[:, None] * weight / softness**2
    total = share.sum(axis=2)
    gradient = -np.einsum("bmq,bmqi->bmi", share, between)
    return Pull(-2 * (np.log(of_point) * weight).sum(axis=1), gradient, total[..., None, None] * np.eye(3))


def point_pull(markers: np.ndarray, targets: np.ndarray, deviation: np.ndarray) -> Pull:
    """Named points in space: targets (B, M, 3) m, NaN where unknown, with standard deviations (B, M) m."""
    known = np.isfinite(targets[..., 0])
    offset = np.where(known[..., None], markers - np.where(known[..., None], targets, 0), 0)
    weight = known / deviation**2
    cost = (weight * np.einsum("bmi,bmi->bm", offset, offset)).sum(axis=1)
    return Pull(cost, weight[..., None] * offset, weight[..., None, None] * np.eye(3))


def ray_pull(markers: np.ndarray, image: np.ndarray, deviation: np.ndarray, sight: Sight) -> Pull:
    """Named blobs: normalised image points (B, C, M, 2) of standard deviation (B, C, M) m at the marker's depth.

    A deviation of infinity switches a pair off.
    """
    local = sight.local(markers)
    found = sight.image(local)
    weight = (np.maximum(local[..., 2], 0.1) / deviation) ** 2
    offset = np.where(weight[..., None] > 0, found - image, 0)
    slope = sight.derivatives(local, found)
    back = slope.swapaxes(-1, -2) * weight[..., None, None]
    cost = (weight * np.einsum("bcmi,bcmi->bcm", offset, offset)).sum(axis=(1, 2))
    return Pull(cost, (back @ offset[..., None])[..., 0].sum(axis=1), (back @ slope).sum(axis=1))


def add_pulls(first: Pull, second: Pull) -> Pull:
    """Both at once."""
    return Pull(first.cost + second.cost, first.gradient + second.gradient, first.hessian + second.hessian)
