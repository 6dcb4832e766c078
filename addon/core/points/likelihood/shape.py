# SPDX-License-Identifier: GPL-3.0-or-later
"""What a whole upright cloud looks like: one Gaussian over all markers, in a frame that turns with the subject.

It is made of a mean and the main ways in which people and poses stray from it.
Learning it is principal-axis factor analysis with one noise variance a marker; the spread between subjects and the
spread of one subject's poses are estimated apart, because there are always few subjects and many frames.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.upright import upright_aligned

FRAMES = 400  # of each subject
MOST_MODES = 20
BETWEEN = 1.3  # a handful of subjects shows less than the true spread between people
POSES = 3.0  # times their variance: a few short takes show less than the poses that there are
SHRINKAGE = 0.25  # of the covariance between subjects towards its own diagonal
SIZES = 0.08  # standard deviation of subjects' size, and
BUILDS = 0.04  # radii, of where else a marker sits on another subject: taken for granted as if
GUESSED = 1.0  # so many more subjects had shown it
FLOOR = 0.016  # of the radius: what a marker does that no mode explains
ROUNDS = 4
FACTOR_ROUNDS = 12


@dataclass(frozen=True, eq=False)
class Shape:
    """Marker positions x = mean + modes · z + noise, z standard normal, up to yaw and translation.

    mean   (M, 3) m, centred
    modes  (M, 3, K) m for one standard deviation
    noise  (M,) variance along each axis, m²
    """

    mean: np.ndarray
    modes: np.ndarray
    noise: np.ndarray

    @property
    def radius(self) -> float:
        """Root mean square distance of the mean's markers from their middle, m: the model's own unit of length."""
        return float(np.sqrt((self.mean**2).sum(axis=1).mean()))


def learn_shape(subjects: Sequence[np.ndarray], seed: int = 0, images: Sequence[np.ndarray] = ()) -> Shape:
    """The shape of labelled clouds, one array (T, M, 3) m a subject, NaN where missing; of their mirror images too.

    At least one frame must show every marker that any frame shows.
    """
    rng = np.random.default_rng(seed)
    thinned = [points[np.sort(rng.permutation(len(points))[:FRAMES])] for points in (*subjects, *images)]
    owner = np.repeat(np.arange(len(thinned)), [len(points) for points in thinned])
    clouds = np.concatenate(thinned)
    best = clouds[np.isfinite(clouds[..., 0]).sum(axis=1).argmax()]
    template = np.where(np.isfinite(best), best, np.nanmean(best, axis=0))
    for _ in range(ROUNDS):
        aligned = upright_aligned(clouds, template)
        template = _mean_known(aligned, template)
    template = template - template.mean(axis=0)
    flat = upright_aligned(clouds, template).reshape(len(clouds), -1)
    floor = FLOOR * np.sqrt((template**2).sum(axis=1).mean())
    mean, covariance = _moments(np.where(np.isnan(flat), template.ravel(), flat), owner, len(subjects), floor)
    for _ in range(ROUNDS if np.isnan(flat).any() else 0):
        mean, covariance = _moments(_imputed(flat, mean, covariance), owner, len(subjects), floor)
    modes, noise = _factors(covariance, floor)
    return Shape(mean.reshape(-1, 3), modes, noise)


def as_strangers(shape: Shape, points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Labelled clouds (F, M, 3) m, each as if of a subject who differs as much as is taken for granted of others."""
    size = SIZES * rng.standard_normal((len(points), 1, 1))
    builds = BUILDS * shape.radius * rng.standard_normal(points.shape)
    return upright_aligned(points, shape.mean) + size * shape.mean + builds


def _mean_known(clouds: np.ndarray, fallback: np.ndarray) -> np.ndarray:
    count = np.isfinite(clouds).sum(axis=0)
    return np.where(count > 0, np.nansum(clouds, axis=0) / np.maximum(count, 1), fallback)


def _moments(filled: np.ndarray, owner: np.ndarray, subjects: int, floor: float) -> tuple[np.ndarray, np.ndarray]:
    """Mean (3M,) and covariance (3M, 3M), every owner counting the same; `subjects` is how many are no mirror image."""
    owners = owner.max() + 1
    centres = np.array([filled[owner == index].mean(axis=0) for index in range(owners)])
    mean = centres.mean(axis=0)
    within = filled - centres[owner]
    weight = 1 / (np.bincount(owner)[owner] * owners)
    covariance = POSES * (within * weight[:, None]).T @ within
    strays = (centres - mean) / np.sqrt(max(owners - 1, 1))
    between = strays.T @ strays
    between = BETWEEN**2 * ((1 - SHRINKAGE) * between + SHRINKAGE * np.diag(np.diag(between)))
    radius = np.sqrt((mean.reshape(-1, 3) ** 2).sum(axis=1).mean())
    guess = SIZES**2 * np.outer(mean, mean) + (BUILDS * radius) ** 2 * np.eye(len(mean))
    covariance += ((subjects - 1) * between + GUESSED * guess) / (subjects - 1 + GUESSED)
    return mean, covariance + floor**2 * np.eye(len(mean))


def _imputed(flat: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """`flat` (T, 3M) with NaN replaced by its conditional mean given the rest of the frame."""
    filled = flat.copy()
    missing = np.isnan(flat)
    patterns, which = np.unique(missing, axis=0, return_inverse=True)
    for index, gone in enumerate(patterns):
        rows = np.flatnonzero(which.ravel() == index)
        if gone.any():
            known = ~gone
            slope = np.linalg.solve(covariance[np.ix_(known, known)], covariance[np.ix_(known, gone)])
            filled[np.ix_(rows, np.flatnonzero(gone))] = mean[gone] + (flat[rows][:, known] - mean[known]) @ slope
    return filled


def _factors(covariance: np.ndarray, floor: float) -> tuple[np.ndarray, np.ndarray]:
    """Modes (M, 3, K) and noise (M,) whose sum comes closest to the covariance."""
    markers = len(covariance) // 3
    count = min(MOST_MODES, 3 * markers - 1)
    noise = np.full(markers, floor**2)
    for _ in range(FACTOR_ROUNDS):
        values, vectors = np.linalg.eigh(covariance - np.diag(np.repeat(noise, 3)))
        modes = vectors[:, ::-1][:, :count] * np.sqrt(np.maximum(values[::-1][:count], 0))
        left = np.diag(covariance - modes @ modes.T).reshape(markers, 3).mean(axis=1)
        noise = np.maximum(left, floor**2)
    return modes.reshape(markers, 3, count), noise
