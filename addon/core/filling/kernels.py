# SPDX-License-Identifier: GPL-3.0-or-later
"""How alike two frames are for a marker: the covariance of a Gaussian process over the pose around it and time.

A marker in the axes of its neighbours is the sum of what goes linearly with the pose around it, what goes otherwise
with it, what comes and goes over time (skin, and what the pose does not tell), jitter, and noise. How large each is, is
learned from the take by the marginal likelihood (Rasmussen and Williams, Gaussian Processes for Machine Learning, 2006,
equations 5.8 and 5.9), with a prior of what other takes have.
"""

from dataclasses import dataclass, field

import numpy as np

from ..data.physical import SIGMAS


@dataclass(frozen=True)
class KernelPrior:
    """What the parts are like before the take is asked: medians, and how many e-folds they may well be off.

    Medians of what was learned with a wide prior on three takes (`s02`, `ball` and `p1` of the recorded people).

    linear    learned: share of the marker's own variance
    curved    learned: share of the same
    reach     learned: of the curved part, in standard deviations of the pose
    slow_m    learned: standard deviation of what comes and goes, and
    slow_s    learned: over which time
    jitter_m  learned: standard deviation of jitter, and
    jitter_s  learned: over which time, as recordings are smoothed over a few frames
    noise_m   learned: standard deviation of noise that no other frame knows of
    folds     measured: one for all errs as one for each, within 2 %; without learning from the take errors grow by 9 %
    """

    linear: float = 1.5
    curved: float = 0.4
    reach: float = 1.0
    slow_m: float = 0.0013
    slow_s: float = 0.4
    jitter_m: float = 0.0006
    jitter_s: float = 0.02
    noise_m: float = 0.00012
    folds: float = 0.7

    @property
    def medians(self) -> np.ndarray:
        """(8,) logarithms."""
        values = (self.linear, self.curved, self.reach, self.slow_m, self.slow_s)
        return np.log([*values, self.jitter_m, self.jitter_s, self.noise_m])


PRIOR_SCALES = KernelPrior()


# Numbers of this precision: e to the -40 is less than rounding, which the diagonal is raised by, and what the search
# gets where a covariance is none.
NOTHING_LEFT, PRECISION, UNSOLVABLE = 40.0, 1e-10, 1e12
AXES = 3


@dataclass(frozen=True, eq=False)
class Alikeness:
    """What the covariance of frames A with frames B is made of.

    pose    (A, B) products of pose features
    square  (A, B) squares of their distances
    lag     (A, B) seconds
    variance of the marker in its neighbours' axes, m²
    """

    pose: np.ndarray
    square: np.ndarray
    lag: np.ndarray
    variance: float

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


@dataclass(eq=False)
class LearnedScales:
    """Scales (8,) that make samples of a marker likely: logarithms as in KernelPrior."""

    alike: Alikeness
    offsets: np.ndarray
    steps: int
    prior: KernelPrior = PRIOR_SCALES
    scales: np.ndarray = field(init=False)

    def __post_init__(self):
        from scipy.optimize import minimize

        start, reach = self.prior.medians, SIGMAS * self.prior.folds
        bounds, options = list(zip(start - reach, start + reach, strict=True)), {"maxiter": self.steps}
        found = minimize(self._unlikely, start, jac=True, method="L-BFGS-B", bounds=bounds, options=options)
        self.scales = found.x if found.fun < UNSOLVABLE else start

    def _unlikely(self, scales: np.ndarray) -> tuple[float, np.ndarray]:
        """Minus the logarithm of the posterior, and its derivatives."""
        from scipy.linalg import cho_factor, cho_solve

        away = (scales - self.prior.medians) / self.prior.folds
        covariance, slopes = self.alike.slopes(scales)
        noise = np.exp(2 * scales[7])
        size = len(covariance)
        covariance[np.diag_indices(size)] += noise + PRECISION * np.trace(covariance) / size
        try:
            factor = cho_factor(covariance, lower=True)
        except np.linalg.LinAlgError:  # the search went where rounding wins
            return UNSOLVABLE, np.zeros(len(scales))
        solved = cho_solve(factor, self.offsets)
        inner = AXES * cho_solve(factor, np.eye(size)) - solved @ solved.T
        fit = 0.5 * (self.offsets * solved).sum() + AXES * np.log(np.diag(factor[0])).sum()
        slope = [0.5 * np.einsum("ij,ij->", inner, part) for part in slopes] + [np.trace(inner) * noise]
        return fit + 0.5 * AXES * (away**2).sum(), np.array(slope) + AXES * away / self.prior.folds
