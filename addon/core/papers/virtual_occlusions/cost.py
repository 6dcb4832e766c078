# SPDX-License-Identifier: GPL-3.0-or-later
"""How badly a body explains the blobs: the paper's equation 7, made smooth, truncated and two-sided.

Equation 7 adds, over cameras and visible markers, the distance to the nearest blob. Its inner minimum jumps and it
never asks whether the blobs are explained, so here

    F = Σ_markers ρ(blobs seen from the marker) + Σ_blobs ρ(visible markers seen from the blob)
    ρ = -2 s² log( e^(-r²/2s²) + Σ e^(-d²/2s²) )

with d the distance in metres at the body's depth. ρ tends to min(d², r²) of the nearest as s shrinks: the paper's
"only small values are considered" is the truncation r; a hidden marker costs as much as one that finds nothing.
Squares, because Levenberg-Marquardt minimises squares.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...geometry.views import Sight, View
from ...kernels import calls, in_use


@dataclass(frozen=True, eq=False)
class Pull:
    """What the data says to B bodies' markers."""

    cost: np.ndarray  # (B,) half of F, in units of s²
    gradient: np.ndarray  # (B, M, 3) half of its derivative by the marker
    hessian: np.ndarray  # (B, M, 3, 3) its Gauss-Newton second derivative


class DataPull(ABC):
    """What some data says to markers, by the compiled library where there is one; `arrays_of` makes it ready."""

    arrays_of: ClassVar[Callable[..., calls.PullOfData]]

    def __call__(self, markers: np.ndarray) -> Pull:
        """Of markers (B, M, 3) m."""
        return Pull(*calls.pull(markers, self.compiled(*markers.shape[:2]))) if in_use() else self._by_numpy(markers)

    @abstractmethod
    def _by_numpy(self, markers: np.ndarray) -> Pull:
        """The same by NumPy."""

    def compiled(self, bodies: int, markers: int) -> calls.PullOfData:
        """As the compiled library takes it, for so many bodies of so many markers."""
        return self.arrays_of(self, bodies, markers)


@dataclass(frozen=True, eq=False)
class BlobPull(DataPull):
    """F and its derivatives for markers that are visible (B, C, M) in a frame's view.

    `softness` is s and `reach` is r, m.
    """

    visible: np.ndarray
    view: View
    sight: Sight
    softness: float
    reach: float

    def _by_numpy(self, markers: np.ndarray) -> Pull:
        image, slope, depth = self.sight.looked_at(markers)
        image, depth = image.swapaxes(1, 2), depth.mean(axis=1)
        chance = _closeness(self.view, image, depth / self.softness, self.visible)
        outside = np.exp(-0.5 * (self.reach / self.softness) ** 2)
        of_marker, of_blob = chance.sum(axis=3) + outside, chance.sum(axis=2) + outside
        cost = -np.log(of_marker).sum(axis=(1, 2)) - (np.log(of_blob) * self.view.real).sum(axis=(1, 2))
        chance *= (1 / of_marker)[..., None] + (1 / of_blob)[:, :, None]
        chance *= (0.5 * (depth / self.softness) ** 2)[:, :, None, None]
        total = chance.sum(axis=3)
        toward = chance @ self.view.image - image * total[..., None]
        return Pull(cost, *_over_cameras(slope, toward.swapaxes(1, 2), total.swapaxes(1, 2)))

    arrays_of = staticmethod(calls.blob_arrays)


@dataclass(frozen=True, eq=False)
class CloudPull(DataPull):
    """The same with points in space (Q, 3) m of weights (Q,) instead of blobs, blobs' side only.

    Every point wants a marker; a marker without a point costs nothing, because it may be hidden.
    """

    points: np.ndarray
    weight: np.ndarray
    softness: float
    reach: float

    def _by_numpy(self, markers: np.ndarray) -> Pull:
        between = self.points[None, None] - markers[:, :, None]
        square = np.einsum("bmqi,bmqi->bmq", between, between)
        chance = np.exp(square / (-2 * self.softness**2))
        of_point = chance.sum(axis=1) + np.exp(-0.5 * (self.reach / self.softness) ** 2)
        share = chance / of_point[:, None] * self.weight / self.softness**2
        total = share.sum(axis=2)
        gradient = -np.einsum("bmq,bmqi->bmi", share, between)
        return Pull(-2 * (np.log(of_point) * self.weight).sum(axis=1), gradient, total[..., None, None] * np.eye(3))

    arrays_of = staticmethod(calls.cloud_arrays)


@dataclass(frozen=True, eq=False)
class RayPull(DataPull):
    """Named blobs: normalised image points (B, C, M, 2) of standard deviation (B, C, M) m at the marker's depth.

    A deviation of infinity switches a pair off.
    """

    image: np.ndarray
    deviation: np.ndarray
    sight: Sight

    def _by_numpy(self, markers: np.ndarray) -> Pull:
        found, slope, depth = self.sight.looked_at(markers)
        weight = (depth / self.deviation.swapaxes(1, 2)) ** 2
        toward = np.where(weight[..., None] > 0, self.image.swapaxes(1, 2) - found, 0) * weight[..., None]
        cost = np.einsum("bmci,bmci,bmc->b", toward, toward, 1 / np.where(weight > 0, weight, 1))
        return Pull(cost, *_over_cameras(slope, toward, weight))

    arrays_of = staticmethod(calls.ray_arrays)


@dataclass(frozen=True, eq=False)
class PointPull(DataPull):
    """Labelled points (B, M, 3) m, NaN where missing: Cauchy's loss of the distances.

    `noise` m is their standard deviation, and what is farther off than `reach` m counts less and less.
    """

    points: np.ndarray
    noise: float
    reach: float

    def _by_numpy(self, markers: np.ndarray) -> Pull:
        seen = np.isfinite(self.points).all(axis=2)
        away = np.where(seen[..., None], markers - np.where(seen[..., None], self.points, 0.0), 0.0)
        square = np.einsum("bmi,bmi->bm", away, away) / self.reach**2
        weight = seen / (1 + square) / self.noise**2
        cost = (self.reach / self.noise) ** 2 * np.log1p(square).sum(axis=1)
        return Pull(cost, away * weight[..., None], weight[..., None, None] * np.eye(3))

    arrays_of = staticmethod(calls.point_arrays)


def _closeness(view: View, image: np.ndarray, per_softness: np.ndarray, visible: np.ndarray) -> np.ndarray:
    """(B, C, M, K) e^(-d²/2s²) of the blobs that a visible marker at `image` (B, C, M, 2) may claim."""
    square = image @ (-2 * view.across)
    square += view.square
    square += np.einsum("bcmi,bcmi->bcm", image, image)[..., None]
    square *= (-0.5 * per_softness**2)[:, :, None, None]
    chance = np.exp(square, out=square)
    chance *= visible[..., None]
    return chance


def _over_cameras(slope: np.ndarray, toward: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gradient (B, M, 3) and Hessian (B, M, 3, 3) of image pulls `toward` (B, M, C, 2) of `weight` (B, M, C)."""
    shape = (*slope.shape[:2], -1, 3)
    rows = slope.reshape(shape)
    gradient = -(toward.reshape(*shape[:2], 1, -1) @ rows)[..., 0, :]
    weighted = (slope * weight[..., None, None]).reshape(shape)
    return gradient, weighted.swapaxes(-1, -2) @ rows
