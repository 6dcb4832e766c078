# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker out of its neighbours, learned from the frames of the take that have both: a Gaussian process.

The neighbours that keep their distances to the marker best make axes that move with its segment. In these axes the
marker's place is a function of the other neighbours' places and of time. Time carries what is off at the ends of a gap
into it, for as long as such things last in this take. What comes with it is how sure each frame is.
"""

from dataclasses import dataclass

import numpy as np

from ..data.physical import MARKER_LIMITS
from ..data.takes import evenly_spread
from ..geometry.rigid import MIN_POINTS, in_axes, laid_on, mean_form
from .gaps import LEARNED_BY, Gap, KnownMarkers
from .kernels import PRECISION, PRIOR_SCALES, Alikeness, LearnedScales


@dataclass(frozen=True)
class RegressionOptions:
    """How a marker is learned from its neighbours.

    features    measured: neighbours whose places count; 10 err as much, within 3 %
    rows        measured: frames learned from; 200 and 900 err as much
    near        measured: of them, the nearest to the gap; 200 err by 5 % more
    keep_share  measured: of the marker's frames that must have all features; rarer ones are none; 0.7 errs as much
    sharpness   measured: power of how near a feature is, as its weight; 1 errs by 7 % more
    blocks      memory: of frames that scales are learned from, spread over the take
    doublings   measured: frames of each, by their distance from its first: 0, 1, 2, 4 and 8; with 16 errors grow by 5 %
    """

    features: int = 20
    rows: int = 400
    near: int = 100
    keep_share: float = 0.3
    sharpness: float = 2.0
    blocks: int = 40
    doublings: int = 4


REGRESSION = RegressionOptions()
MEAN_OF_DISTANCE = np.sqrt(8 / np.pi)  # of a place whose three coordinates are off by one standard deviation
SEARCH_STEPS = 10  # of the search for scales: 5 and 25 come as far


@dataclass(frozen=True, eq=False)
class MarkerModel:
    """A marker as its neighbours tell it.

    neighbours (N,) indices, those of the axes first
    form       (K, 3) m, of the neighbours that the axes are made of
    mean       (3 N,) and weight (3 N,): features are (place − mean) · weight
    middle     (3,) m, the marker's mean place in the axes
    variance   m² of it, for an axis
    scales     (8,) of the covariance, logarithms as in KernelPrior
    """

    neighbours: np.ndarray
    form: np.ndarray
    mean: np.ndarray
    weight: np.ndarray
    middle: np.ndarray
    variance: float
    scales: np.ndarray

    def seen_from(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Features (F, 3 N) of frames (F, M, 3) m, and the turns (F, 3, 3) and places (F, 3) of the axes."""
        turn, place, inner = _axes(self.form, xyz[:, self.neighbours])
        return (inner - self.mean) * self.weight, turn, place


def neighbours_of(take: KnownMarkers, helping: np.ndarray, own: np.ndarray) -> np.ndarray:
    """(N,) the markers that tell of a gap: of those `helping` in it, the first that are also known in enough frames."""
    rows, chosen, total = own, [], own.sum()
    for marker in helping:
        both = rows & np.isfinite(take.xyz[:, marker, 0])
        if both.sum() >= REGRESSION.keep_share * total:
            chosen.append(marker)
            rows = both
        if len(chosen) == REGRESSION.features:
            break
    return np.array(chosen, dtype=int)


def learned(
    take: KnownMarkers, marker: int, neighbours: np.ndarray, own: np.ndarray, rate: float, scales: np.ndarray | None
) -> MarkerModel | None:
    """The model of a marker; scales are learned where none are given. None where there is too little to learn from."""
    rows = np.flatnonzero(own & np.isfinite(take.xyz[:, neighbours, 0]).all(axis=1))
    if len(rows) < LEARNED_BY.min_frames or len(neighbours) < MIN_POINTS:
        return None
    some = take.xyz[rows[evenly_spread(len(rows), LEARNED_BY.frames)]][:, neighbours[: LEARNED_BY.of_axes]]
    form = mean_form(some[len(some) // 2], some)
    block = np.r_[0, 2 ** np.arange(REGRESSION.doublings)]
    starts = evenly_spread(max(len(rows) - block[-1], 1), REGRESSION.blocks)
    learning = np.unique(np.minimum(starts[:, None] + block, len(rows) - 1))
    rows = rows[learning]
    turn, place, inner = _axes(form, take.xyz[rows][:, neighbours])
    spread = take.spread[marker, neighbours]
    near = (MARKER_LIMITS.noise_m + spread.min()) / (MARKER_LIMITS.noise_m + spread)
    weight = np.repeat(near**REGRESSION.sharpness, 3)
    mean = inner.mean(axis=0)
    length = np.sqrt((((inner - mean) * weight) ** 2).sum(axis=1).mean())
    if not length > 0:  # neighbours that never move to one another tell nothing by how they lie
        length = 1.0
    own_places = in_axes(turn, place, take.xyz[rows, marker][:, None])[:, 0]
    middle = own_places.mean(axis=0)
    variance = max(((own_places - middle) ** 2).sum(axis=1).mean() / 3, PRIOR_SCALES.noise_m**2)
    weight = weight / length
    if scales is None:
        features, seconds = (inner - mean) * weight, rows / rate
        alike = Alikeness.of((features, features), (seconds, seconds), variance)
        scales = LearnedScales(alike, own_places - middle, SEARCH_STEPS).scales
    return MarkerModel(neighbours, form, mean, weight, middle, variance, scales)


def regress(
    take: KnownMarkers, gap: Gap, model: MarkerModel, own: np.ndarray, rate: float
) -> tuple[np.ndarray, np.ndarray] | None:
    """Positions (L, 3) m of the marker in a gap, and the standard deviation (L,) m of each of their coordinates."""
    from scipy.linalg import cho_factor, cho_solve, solve_triangular

    rows = _rows(take, gap, model.neighbours, own)
    if len(rows) < LEARNED_BY.min_frames:
        return None
    count, frames = len(rows), np.r_[rows, gap.frames]
    features, turn, place = model.seen_from(take.xyz[frames])
    known, seconds = features[:count], frames / rate
    alike = Alikeness.of((features, known), (seconds, seconds[:count]), model.variance)
    covariance = alike.covariance(model.scales)
    inner, across = covariance[:count].copy(), covariance[count:]
    inner[np.diag_indices(count)] += np.exp(2 * model.scales[7]) + PRECISION * np.trace(inner) / count
    try:
        factor = cho_factor(inner, lower=True)
    except np.linalg.LinAlgError:  # frames so much alike that rounding wins
        return None
    off = in_axes(turn[:count], place[:count], take.xyz[rows, gap.marker][:, None])[:, 0] - model.middle
    there = model.middle + across @ cho_solve(factor, off)
    explained = (solve_triangular(factor[0], across.T, lower=True) ** 2).sum(axis=0)
    before = _variance_alone(features[count:], model)
    positions = np.einsum("fij,fj->fi", turn[count:], there) + place[count:]
    return positions, np.sqrt(np.maximum(before - explained, 0) + np.exp(2 * model.scales[7]))


def _variance_alone(features: np.ndarray, model: MarkerModel) -> np.ndarray:
    """(L,) m², what each frame may vary by before any other is looked at."""
    zero = np.zeros(len(features))
    alike = Alikeness((features**2).sum(axis=1), zero, zero, model.variance)
    return alike.covariance(model.scales)


def _axes(form: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Turns and places of the axes of the first neighbours in frames (F, N, 3), and all places in them (F, 3 N)."""
    turn, place = laid_on(form, points[:, : len(form)])
    return turn, place, in_axes(turn, place, points).reshape(len(points), -1)


def _rows(take: KnownMarkers, gap: Gap, neighbours: np.ndarray, own: np.ndarray) -> np.ndarray:
    """Frames to learn from: some the nearest to the gap, and the rest spread over the take."""
    rows = np.flatnonzero(own & np.isfinite(take.xyz[:, neighbours, 0]).all(axis=1))
    away = np.maximum(gap.start - 1 - rows, rows - gap.stop)
    near = np.argsort(away, kind="stable")[: REGRESSION.near]
    return np.union1d(rows[near], rows[evenly_spread(len(rows), REGRESSION.rows - len(near))])
