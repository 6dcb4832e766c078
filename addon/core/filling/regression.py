# SPDX-License-Identifier: GPL-3.0-or-later
"""A marker out of its neighbours, learned from the frames of the take that have both: a Gaussian process.

The neighbours that keep their distances to the marker best make axes that move with its segment. In these axes the
marker's place is the sum of what goes linearly with the pose around it, what goes otherwise with it, what comes and
goes over time (skin, and what the pose does not tell), jitter, and noise. Time carries what is off at the ends of a gap
into it, for as long as such things last in this take. What comes with it is how sure each frame is.

How large each part is, is learned from the take by the marginal likelihood (Rasmussen and Williams, Gaussian Processes
for Machine Learning, 2006, equations 5.8 and 5.9), with a prior of what other takes have.
"""

from dataclasses import dataclass

import numpy as np

from ..data.lanes import PACKING
from ..data.physical import MARKER_LIMITS, SIGMAS
from ..data.takes import evenly_spread
from ..geometry.rigid import MIN_POINTS, in_axes, laid_on, mean_form
from .gaps import LEARNED_BY, Gap, KnownMarkers


@dataclass(frozen=True)
class KernelPrior:
    """What the parts are like before the take is asked: medians, and how many e-folds they may well be off.

    Medians of what was learned with a wide prior on three takes (`s02`, `ball` and `p1` of the recorded people).
    """

    linear: float = 1.5  # learned: share of the marker's own variance
    curved: float = 0.4  # learned: share of the same
    reach: float = 1.0  # learned: of the curved part, in standard deviations of the pose
    slow_m: float = 0.0013  # learned: standard deviation of what comes and goes, and
    slow_s: float = 0.4  # learned: over which time
    jitter_m: float = 0.0006  # learned: standard deviation of jitter, and
    jitter_s: float = 0.02  # learned: over which time, as recordings are smoothed over a few frames
    noise_m: float = 0.00012  # learned: standard deviation of noise that no other frame knows of
    # one for all errs as one for each, within 2 %; without learning from the take errors grow by 9 %
    folds: float = 0.7  # measured

    @property
    def medians(self) -> np.ndarray:
        """(8,) logarithms."""
        values = (self.linear, self.curved, self.reach, self.slow_m, self.slow_s)
        return np.log([*values, self.jitter_m, self.jitter_s, self.noise_m])


PRIOR_SCALES = KernelPrior()


class REGRESSION:
    """How a marker is learned from its neighbours."""

    features: int = 20  # measured: neighbours whose places count; 10 err as much, within 3 %
    rows: int = 400  # measured: frames learned from; 200 and 900 err as much
    near: int = 100  # measured: of them, the nearest to the gap; 200 err by 5 % more
    # of the marker's frames that must have all features; rarer ones are none; 0.7 errs as much
    keep_share: float = 0.3  # measured
    sharpness: float = 2.0  # measured: power of how near a feature is, as its weight; 1 errs by 7 % more
    blocks: int = 40  # memory: of frames that scales are learned from, spread over the take
    # frames of each, by their distance from its first: 0, 1, 2, 4 and 8; with 16 errors grow by 5 %
    doublings: int = 4  # measured


MEAN_OF_DISTANCE = np.sqrt(8 / np.pi)  # of a place whose three coordinates are off by one standard deviation
SEARCH_STEPS = 10  # of the search for scales: 5 and 25 come as far
# Numbers of this precision: e to the -40 is less than rounding, which the diagonal is raised by, and what the search
# gets where a covariance is none.
NOTHING_LEFT, PRECISION, UNSOLVABLE = 40.0, 1e-10, 1e12
AXES = 3


@dataclass(frozen=True, eq=False)
class Alikeness:
    """What the covariance of frames A with frames B is made of."""

    pose: np.ndarray  # (A, B) products of pose features
    square: np.ndarray  # (A, B) squares of their distances
    lag: np.ndarray  # (A, B) seconds
    variance: float  # of the marker in its neighbours' axes, m²

    @classmethod
    def of(cls, features: tuple[np.ndarray, np.ndarray], seconds: tuple[np.ndarray, np.ndarray], variance: float):
        """Of frames with features (A, D) and (B, D) at so many seconds (A,) and (B,)."""
        one, two = features
        pose = one @ two.T
        square = (one**2).sum(axis=1)[:, None] + (two**2).sum(axis=1) - 2 * pose
        return cls(pose, np.maximum(square, 0), np.abs(seconds[0][:, None] - seconds[1]), variance)

    def covariance(self, scales: np.ndarray) -> np.ndarray:
        """(A, B) m² with scales (8,), logarithms as in KernelPrior; without noise."""
        return self.slopes(scales, wanted=False)[0]

    def slopes(self, scales: np.ndarray, wanted: bool = True) -> tuple[np.ndarray, list[np.ndarray]]:
        """The covariance and, where they are wanted, its derivatives by all scales but the noise."""
        linear, curved, reach, slow, slow_s, jitter, jitter_s = np.exp(scales[:7])
        alike = (self.variance * linear) * self.pose
        over = 1 / (1 + self.square * (0.5 / reach**2))
        bent = (self.variance * curved) * over  # rational quadratic
        way = self.lag * (np.sqrt(3) / slow_s)
        fall = np.exp(-way)
        fall *= slow**2
        lasting = (1 + way) * fall  # Matérn 3/2
        # Few frames are so near to each other that jitter lasts from one to the other: only these are worked out.
        near = np.flatnonzero(self.lag.ravel() < NOTHING_LEFT * jitter_s / np.sqrt(5))
        short = self.lag.ravel()[near] * (np.sqrt(5) / jitter_s)
        drop = jitter**2 * np.exp(-short)
        brief = (1 + short + short * short / 3) * drop  # Matérn 5/2
        total = alike + bent
        total += lasting
        total.ravel()[near] += brief
        if not wanted:
            return total, []
        by_slow_s = way * way * fall
        by_jitter, by_jitter_s = np.zeros((2, *total.shape))
        by_jitter.ravel()[near], by_jitter_s.ravel()[near] = 2 * brief, short * short * (1 + short) / 3 * drop
        return total, [alike, bent, 2 * bent * (1 - over), 2 * lasting, by_slow_s, by_jitter, by_jitter_s]


@dataclass(frozen=True, eq=False)
class MarkerModel:
    """A marker as its neighbours tell it."""

    neighbours: np.ndarray  # (N,) indices, those of the axes first
    form: np.ndarray  # (K, 3) m, of the neighbours that the axes are made of
    mean: np.ndarray  # (3 N,), and
    weight: np.ndarray  # (3 N,): features are (place − mean) · weight
    middle: np.ndarray  # (3,) m, the marker's mean place in the axes
    variance: float  # m² of it, for an axis
    scales: np.ndarray  # (8,) of the covariance, logarithms as in KernelPrior

    def seen_from(self, xyz: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Features (F, 3 N) of frames (F, M, 3) m, and the turns (F, 3, 3) and places (F, 3) of the axes."""
        turn, place, inner = _axes(self.form, xyz[:, self.neighbours])
        return (inner - self.mean) * self.weight, turn, place


def neighbours_of(take: KnownMarkers, gap: Gap, own: np.ndarray) -> np.ndarray:
    """(N,) the markers that tell of a gap: of those helping in it, the first that are also known in enough frames."""
    rows, chosen, total = own, [], own.sum()
    for marker in take.helping(gap):
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
    some = take.xyz[rows[evenly_spread(len(rows), PACKING.spread_out)]][:, neighbours[: LEARNED_BY.of_axes]]
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
        scales = _learned_scales(alike, own_places - middle)
    return MarkerModel(neighbours, form, mean, weight, middle, variance, scales)


def _learned_scales(alike: Alikeness, offsets: np.ndarray) -> np.ndarray:
    """(8,) logarithms as in KernelPrior that make samples of a marker about their middle (F, 3), m, likely."""
    from scipy.linalg import cho_factor, cho_solve
    from scipy.optimize import minimize

    start, reach = PRIOR_SCALES.medians, SIGMAS * PRIOR_SCALES.folds

    def unlikely(scales: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus the logarithm of the posterior, and its derivatives."""
        away = (scales - start) / PRIOR_SCALES.folds
        covariance, slopes = alike.slopes(scales)
        noise = np.exp(2 * scales[7])
        size = len(covariance)
        covariance[np.diag_indices(size)] += noise + PRECISION * np.trace(covariance) / size
        try:
            factor = cho_factor(covariance, lower=True)
        except np.linalg.LinAlgError:  # the search went where rounding wins
            return UNSOLVABLE, np.zeros(len(scales))
        solved = cho_solve(factor, offsets)
        inner = AXES * cho_solve(factor, np.eye(size)) - solved @ solved.T
        fit = 0.5 * (offsets * solved).sum() + AXES * np.log(np.diag(factor[0])).sum()
        slope = [0.5 * np.einsum("ij,ij->", inner, part) for part in slopes] + [np.trace(inner) * noise]
        return fit + 0.5 * AXES * (away**2).sum(), np.array(slope) + AXES * away / PRIOR_SCALES.folds

    bounds, options = list(zip(start - reach, start + reach, strict=True)), {"maxiter": SEARCH_STEPS}
    found = minimize(unlikely, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
    return found.x if found.fun < UNSOLVABLE else start


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
    zero = np.zeros(len(across))
    # What each frame may vary by before any other is looked at.
    before = Alikeness((features[count:] ** 2).sum(axis=1), zero, zero, model.variance).covariance(model.scales)
    positions = np.einsum("fij,fj->fi", turn[count:], there) + place[count:]
    return positions, np.sqrt(np.maximum(before - explained, 0) + np.exp(2 * model.scales[7]))


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
