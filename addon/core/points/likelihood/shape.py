# SPDX-License-Identifier: GPL-3.0-or-later
"""What a whole upright cloud looks like: one Gaussian over all markers, in a frame that turns with the subject.

It is made of a mean and the main ways in which people and poses differ from it.
Learning it is principal-axis factor analysis with one noise variance a marker; the spread between subjects and the
spread of one subject's poses are estimated one by one, because there are always few subjects and many frames. `Latent`
is its linear algebra with place and yaw added: weighted marker positions in, best latent vector out.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...geometry.upright import turned, upright_aligned


class SUBJECT_PRIOR:
    """How much subjects are taken to differ, whatever a few of them show: it counts as one subject more."""

    # times the spread between the subjects seen, of which a handful shows less than there is
    between: float = 1.3  # measured on people left out of training
    size_sd: float = 0.08  # standard deviation of size, in parts of it; learned: as recorded people differ
    marker_sd_radii: float = 0.04  # of where a marker sits besides; learned: as recorded people differ
    length_sd: float = 0.03  # of a distance between markers besides, in parts of it; physical: people's proportions


class SHAPE:
    """How a shape is learned."""

    # times the variance of the poses seen: a few short takes show less than there are
    pose_variance: float = 3.0  # measured on people left out of training
    # of the covariance between subjects towards its own diagonal
    shrinkage: float = 0.25  # measured: without it walks learned from a still trial or a frame lose 4 %
    min_sd_radii: float = 0.016  # what a marker does that no mode explains; physical: 1.3 cm, skin and placement


SHAPE_FRAMES = 400  # of each subject, drawn; by time
MAX_MODES = 20  # what is beyond is noise; by time
ALIGNING_ROUNDS, FACTOR_ROUNDS = 4, 12  # of aligning and of filling gaps in, and of factor analysis; all settle sooner


@dataclass(frozen=True, eq=False)
class Shape:
    """Marker positions x = mean + modes · z + noise, z standard normal, up to yaw and translation."""

    mean: np.ndarray  # (M, 3) m, centred
    modes: np.ndarray  # (M, 3, K) m for one standard deviation
    noise: np.ndarray  # (M,) variance along each axis, m²

    @property
    def radius(self) -> float:
        """Root mean square distance of the mean's markers from their middle, m: the model's own unit of length."""
        return float(np.sqrt((self.mean**2).sum(axis=1).mean()))

    @property
    def covariance(self) -> np.ndarray:
        """(3M, 3M) m², of all markers' coordinates."""
        flat = self.modes.reshape(3 * len(self.mean), -1)
        return flat @ flat.T + np.diag(np.repeat(self.noise, 3))


def cloud_radius(clouds: np.ndarray) -> float:
    """Root mean square distance of clouds' markers (T, M, 3) m, NaN where missing, from their middles; m."""
    return float(np.sqrt(np.nanmean(np.nanvar(clouds, axis=1).sum(axis=1))))


def learn_shape(subjects: Sequence[np.ndarray], seed: int = 0, images: Sequence[np.ndarray] = ()) -> Shape:
    """The shape of labelled clouds, one array (T, M, 3) m a subject, NaN where missing; of their mirror images too.

    At least one frame must show every marker that any frame shows.
    """
    rng = np.random.default_rng(seed)
    thinned = [points[np.sort(rng.permutation(len(points))[:SHAPE_FRAMES])] for points in (*subjects, *images)]
    owner = np.repeat(np.arange(len(thinned)), [len(points) for points in thinned])
    clouds = np.concatenate(thinned)
    best = clouds[np.isfinite(clouds[..., 0]).sum(axis=1).argmax()]
    template = np.where(np.isfinite(best), best, np.nanmean(best, axis=0))
    for _ in range(ALIGNING_ROUNDS):
        aligned = upright_aligned(clouds, template)
        template = _mean_known(aligned, template)
    template = template - template.mean(axis=0)
    flat = upright_aligned(clouds, template).reshape(len(clouds), -1)
    floor = SHAPE.min_sd_radii * np.sqrt((template**2).sum(axis=1).mean())
    mean, covariance = _moments(np.where(np.isnan(flat), template.ravel(), flat), owner, len(subjects), floor)
    for _ in range(ALIGNING_ROUNDS if np.isnan(flat).any() else 0):
        mean, covariance = _moments(completed(flat, mean, covariance)[0], owner, len(subjects), floor)
    modes, noise = factors(covariance, floor)
    return Shape(mean.reshape(-1, 3), modes, noise)


def as_other_subjects(shape: Shape, points: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Labelled clouds (F, M, 3) m, each as if of a subject who differs as much as is taken for granted of others."""
    size = SUBJECT_PRIOR.size_sd * rng.standard_normal((len(points), 1, 1))
    placed = SUBJECT_PRIOR.marker_sd_radii * shape.radius * rng.standard_normal(points.shape)
    return upright_aligned(points, shape.mean) + size * shape.mean + placed


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
    covariance = SHAPE.pose_variance * (within * weight[:, None]).T @ within
    offsets = (centres - mean) / np.sqrt(max(owners - 1, 1))
    between = offsets.T @ offsets
    between = (1 - SHAPE.shrinkage) * between + SHAPE.shrinkage * np.diag(np.diag(between))
    between = SUBJECT_PRIOR.between**2 * between
    radius = np.sqrt((mean.reshape(-1, 3) ** 2).sum(axis=1).mean())
    prior = SUBJECT_PRIOR
    guess = prior.size_sd**2 * np.outer(mean, mean) + (prior.marker_sd_radii * radius) ** 2 * np.eye(len(mean))
    covariance += ((subjects - 1) * between + guess) / subjects
    return mean, covariance + floor**2 * np.eye(len(mean))


def completed(flat: np.ndarray, mean: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """`flat` (T, 3M) with NaN replaced by its conditional mean given the rest of the frame.

    Also the covariance (3M, 3M) that the replaced ones have about it, added up over the frames: the first step of
    expectation maximisation.
    """
    filled, unsure = flat.copy(), np.zeros_like(covariance)
    missing = np.isnan(flat)
    patterns, which = np.unique(missing, axis=0, return_inverse=True)
    for index, gone in enumerate(patterns):
        rows = np.flatnonzero(which.ravel() == index)
        if gone.any():
            known = ~gone
            slope = np.linalg.solve(covariance[np.ix_(known, known)], covariance[np.ix_(known, gone)])
            filled[np.ix_(rows, np.flatnonzero(gone))] = mean[gone] + (flat[rows][:, known] - mean[known]) @ slope
            left = covariance[np.ix_(gone, gone)] - covariance[np.ix_(gone, known)] @ slope
            unsure[np.ix_(gone, gone)] += len(rows) * left
    return filled, unsure


def factors(covariance: np.ndarray, floor: float) -> tuple[np.ndarray, np.ndarray]:
    """Modes (M, 3, K) and noise (M,) whose sum comes closest to the covariance."""
    markers = len(covariance) // 3
    count = min(MAX_MODES, 3 * markers - 1)
    noise = np.full(markers, floor**2)
    for _ in range(FACTOR_ROUNDS):
        values, vectors = np.linalg.eigh(covariance - np.diag(np.repeat(noise, 3)))
        modes = vectors[:, ::-1][:, :count] * np.sqrt(np.maximum(values[::-1][:count], 0))
        left = np.diag(covariance - modes @ modes.T).reshape(markers, 3).mean(axis=1)
        noise = np.maximum(left, floor**2)
    return modes.reshape(markers, 3, count), noise


PLACE, YAW, FIRST_MODE = slice(0, 3), 3, 4  # columns of a latent vector


class LATENT:
    """How freely a shape is placed."""

    # where the subject stands is as good as unknown
    place_sd_radii: float = 6.0  # physical: a room is six times as wide as a person
    yaw_sd_rad: float = 0.5  # of one step; physical: the linear yaw is good for no larger one


class Latent:
    """Positions of M markers as a linear function of L latent numbers: translation, a small yaw, then K modes.

    columns (M, 3, L) m for one standard deviation of each; mean (M, 3) m; noise (M,) m²; by_modes (M,) m², the
    variance that the modes make.
    With `modes` given, only so many are kept and the rest counts as noise.
    """

    def __init__(self, shape: Shape, modes: int | None = None):
        kept, left = shape.modes[..., :modes], shape.modes[..., modes:] if modes is not None else shape.modes[..., :0]
        self.mean, self.radius = shape.mean, shape.radius
        self.noise = shape.noise + (left**2).sum(axis=(1, 2)) / 3
        self.by_modes = (kept**2).sum(axis=(1, 2)) / 3
        place = np.broadcast_to(np.eye(3) * LATENT.place_sd_radii * shape.radius, (len(shape.mean), 3, 3))
        turn = np.stack([-shape.mean[:, 1], shape.mean[:, 0], np.zeros(len(shape.mean))], axis=-1) * LATENT.yaw_sd_rad
        self.columns = np.concatenate([place, turn[..., None], kept], axis=2)
        self.size = self.columns.shape[2]
        self.flat = np.ascontiguousarray(self.columns.reshape(-1, self.size))
        self.products = np.einsum("mil,mik->mlk", self.columns, self.columns).reshape(len(shape.mean), -1)
        self.yaw_sd = LATENT.yaw_sd_rad

    def __len__(self) -> int:
        return len(self.mean)

    def normal(self, weight: np.ndarray) -> np.ndarray:
        """(N, L, L) precision of the latent vectors when markers are known with weights (N, M), 1/m²."""
        normal = (weight @ self.products).reshape(-1, self.size, self.size)
        diagonal = np.arange(self.size)
        normal[:, diagonal, diagonal] += 1
        return normal

    def right_side(self, weighted: np.ndarray) -> np.ndarray:
        """(N, L) of weighted offsets from the mean (N, M, 3), 1/m."""
        return weighted.reshape(len(weighted), -1) @ self.flat

    def positions(self, latent: np.ndarray) -> np.ndarray:
        """(N, M, 3) m."""
        return self.mean + (latent @ self.flat.T).reshape(len(latent), -1, 3)


def yaw_absorbed(points: np.ndarray, latent: np.ndarray, sd: float) -> tuple[np.ndarray, np.ndarray]:
    """The yaw of latent vectors (N, L) put into the points (N, P, 3) instead: both turned back, the latent yaw at 0.

    A latent yaw of one is `sd` rad, and no more is taken at once.
    """
    back = -np.clip(latent[:, YAW] * sd, -sd, sd)
    place = turned(latent[:, None, PLACE], back)[:, 0]
    still = np.zeros((len(latent), 1))
    return turned(points, back), np.concatenate([place, still, latent[:, FIRST_MODE:]], axis=1)
