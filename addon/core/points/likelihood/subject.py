# SPDX-License-Identifier: GPL-3.0-or-later
"""What was learned of people made into what is known of one subject, by frames of that subject named for sure.

The training says how people and poses differ together; a subject has one size, one layout of the markers and a way of
moving. Frames need no order: their place in time says nothing here. Left and right, front and back stay what the
training says, as the frames are laid on its mean by a turn about the vertical only.
"""

from dataclasses import dataclass, replace

import numpy as np

from ...geometry.upright import upright_aligned
from .distances import CONSTRAINING, MAX_OF_MARKER, DistanceConstraints, surest
from .model import Likelihood
from .shape import SHAPE, Shape, completed, factors


@dataclass(frozen=True)
class SubjectLearningOptions:
    """How much the evidence of a subject's own frames counts against the training.

    frames   that the training's spread counts for; measured: of the cloud 80 are as good on people left out, of a
             distance 8 name six labels fewer of 20,900 of frames in no order
    size_sd  of the logarithm of the size that is left once the subject's own distances are known; physical: 1 %
    """

    frames: float = 20.0
    size_sd: float = 0.01


SUBJECT_LEARNING = SubjectLearningOptions()
SUBJECT_ROUNDS = 6  # of expectation maximisation; it settles sooner


def of_subject(likelihood: Likelihood, clouds: np.ndarray) -> Likelihood:
    """The likelihood for a subject of whom such clouds (F, M, 3) m are named, NaN where a marker is not.

    What margins are worth stays as it is: they are log odds of a better likelihood.
    """
    shape = _subject_shape(likelihood.shape, clouds)
    constraints = _subject_constraints(likelihood.constraints, clouds, shape.radius)
    return replace(likelihood, shape=shape, constraints=constraints)


def loosened(likelihood: Likelihood, markers: np.ndarray, sd_radii: float) -> Likelihood:
    """The likelihood with some markers (M,) sitting anywhere so far from where they are expected."""
    shape, constraints = likelihood.shape, likelihood.constraints
    noise = shape.noise + markers * (sd_radii * shape.radius) ** 2
    kept = ~markers[constraints.pair].any(axis=1)
    known = DistanceConstraints(
        constraints.pair[kept], constraints.length[kept], constraints.sd[kept], constraints.size_sd
    )
    return replace(likelihood, shape=replace(shape, noise=noise), constraints=known)


def off_expected(shape: Shape, clouds: np.ndarray, marker: int) -> np.ndarray:
    """(F, 3) m, how far a marker of clouds (F, M, 3) m is from where the frame's others expect it; NaN where missing.

    In the axes of the shape.
    """
    others = clouds.copy()
    others[:, marker] = np.nan
    filled, _ = completed(_flat(upright_aligned(others, shape.mean)), shape.mean.ravel(), shape.covariance)
    expected = filled.reshape(clouds.shape)
    # The marker itself goes along with the others, as one that is none of the shape's.
    along = upright_aligned(np.concatenate([others, clouds[:, marker : marker + 1]], axis=1), shape.mean)
    return along[:, -1] - expected[:, marker]


def _subject_shape(shape: Shape, clouds: np.ndarray) -> Shape:
    """Mean and covariance by expectation maximisation, the training's covariance counting for some frames."""
    known, spread, frames = shape.mean.ravel(), shape.covariance, len(clouds)
    mean, covariance = known, spread
    seen = np.isfinite(clouds[..., :1])
    aligned = upright_aligned(clouds, shape.mean)
    for _ in range(SUBJECT_ROUNDS):
        filled, unsure = completed(_flat(aligned), mean, covariance)
        # Whole clouds are laid on the mean, not what happens to be seen of them.
        whole = upright_aligned(filled.reshape(clouds.shape), mean.reshape(-1, 3))
        aligned = np.where(seen, whole, np.nan)
        own = _flat(whole).mean(axis=0)
        away = _flat(whole) - own
        total = SUBJECT_LEARNING.frames * spread + away.T @ away + unsure
        covariance = total / (SUBJECT_LEARNING.frames + frames)
        mean = known + spread @ np.linalg.solve(spread + covariance / frames, own - known)
    modes, noise = factors(covariance, SHAPE.min_sd_radii * shape.radius)
    placed = mean.reshape(-1, 3)
    return Shape(placed - placed.mean(axis=0), modes, noise)


def _subject_constraints(trained: DistanceConstraints, clouds: np.ndarray, radius: float) -> DistanceConstraints:
    """The subject's own distances and how much they vary; where none is seen, the training's in the subject's size."""
    pair = np.array(np.triu_indices(clouds.shape[1], 1)).T
    distance = np.linalg.norm(clouds[:, pair[:, 0]] - clouds[:, pair[:, 1]], axis=2)
    frames = np.isfinite(distance).sum(axis=0)
    often = frames >= CONSTRAINING.min_frames
    length, variance = np.zeros(len(pair)), np.zeros(len(pair))
    length[often] = np.nanmedian(distance[:, often], axis=0)
    variance[often] = np.nanmean((distance[:, often] - length[often]) ** 2, axis=0)
    place = np.full((clouds.shape[1],) * 2, -1)
    place[tuple(pair.T)] = place[tuple(pair[:, ::-1].T)] = np.arange(len(pair))
    mine = place[tuple(trained.pair.T)]
    both = often[mine]
    size = np.exp(np.median(np.log(length[mine[both]] / trained.length[both]))) if both.any() else 1.0
    # A distance that no training keeps may be kept by this subject, as far as its frames show.
    loose = np.full(len(pair), CONSTRAINING.max_sd_radii * radius)
    loose[mine] = size * trained.sd
    weight, least = SUBJECT_LEARNING.frames, CONSTRAINING.min_sd_radii * radius
    sd = np.sqrt((weight * loose**2 + frames * variance) / (weight + frames) + least**2)
    unseen = mine[~both]
    length[unseen], sd[unseen] = size * trained.length[~both], loose[unseen]
    kept = often & (sd < CONSTRAINING.max_sd_radii * radius)
    kept[mine] = True
    pair, length, sd = pair[kept], length[kept], sd[kept]
    few = surest(pair, sd, MAX_OF_MARKER)
    return DistanceConstraints(pair[few], length[few], sd[few], SUBJECT_LEARNING.size_sd)


def _flat(clouds: np.ndarray) -> np.ndarray:
    return clouds.reshape(len(clouds), -1)
