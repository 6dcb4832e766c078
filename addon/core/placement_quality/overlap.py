# SPDX-License-Identifier: GPL-3.0-or-later
"""How much two namings of the same points look alike: the overlap of the bell curves that they put the points under.

A shape says that points truly named lie under a Gaussian. Another naming says that they lie under the same Gaussian
with its markers exchanged. The part that the two share, ∫ √(p q), is Bhattacharyya's coefficient (A. Bhattacharyya: On
a measure of divergence between two multinomial populations, Sankhyā 7, 1946): 1 where they cannot be distinguished,
and half of it bounds how often the better guess is wrong. Hiding a marker or adding noise can only raise it.
"""

from dataclasses import replace

import numpy as np

from ..geometry.upright import turned
from ..points.likelihood.latent import Latent
from ..points.likelihood.shape import Shape


def covariance_of(shape: Shape) -> np.ndarray:
    """(3M, 3M) m², of all markers together, with the subject's place and a turn about the vertical unknown."""
    mean = shape.mean - shape.mean.mean(axis=0)
    columns = Latent(replace(shape, mean=mean)).flat
    columns = columns.reshape(3 * len(mean), -1)
    return columns @ columns.T + np.diag(np.repeat(shape.noise, 3))


def pair_overlaps(shape: Shape, covariance: np.ndarray, seen: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Overlaps (M, M) of the true naming with two others, where the markers `seen` (M,) are there.

    The first: the two markers exchange their points. The second, [i, j]: j is hidden, and i's point is named j.
    0 where a marker of the pair is not seen, and on the diagonal.
    """
    here = np.flatnonzero(seen)
    rows = (3 * here[:, None] + np.arange(3)).ravel()
    precision = np.linalg.inv(covariance[np.ix_(rows, rows)]).reshape(len(here), 3, len(here), 3)
    one, two = np.triu_indices(len(here), 1)
    within = np.linalg.inv(_blocks(precision, one, two))
    a, b, cross = within[:, :3, :3], within[:, 3:, 3:], within[:, :3, 3:]
    cloud = covariance.reshape(len(shape.mean), 3, -1, 3)
    first, second = here[one], here[two]
    offset = (shape.mean[first] - shape.mean[second])[..., None]
    # Where the two are expected from each other, given the others, varies as far as the others say it.
    between = cloud[first, :, first] + cloud[second, :, second]
    between = between - cloud[first, :, second] - cloud[second, :, first]
    varies = between - (a + b - cross - cross.swapaxes(1, 2))
    swap, move = np.zeros((2, len(shape.mean), len(shape.mean)))
    swap[first, second] = swap[second, first] = _exchanged(within, a + b, cross, offset, varies)
    half = (a + b) / 2
    scale = (np.linalg.det(a) * np.linalg.det(b)) ** 0.25 / np.sqrt(np.linalg.det(half))
    passed = scale * _expected(np.linalg.inv(half) / 4, offset, varies)
    move[first, second] = move[second, first] = np.clip(passed, 0, 1)
    return swap, move


def _blocks(precision: np.ndarray, one: np.ndarray, two: np.ndarray) -> np.ndarray:
    """(N, 6, 6) the parts of a precision (n, 3, n, 3) that belong to pairs."""
    top = np.concatenate([precision[one, :, one], precision[one, :, two]], axis=2)
    bottom = np.concatenate([precision[two, :, one], precision[two, :, two]], axis=2)
    return np.concatenate([top, bottom], axis=1)


def _exchanged(within: np.ndarray, both: np.ndarray, cross: np.ndarray, offset: np.ndarray, varies: np.ndarray):
    """Overlaps (N,) of pairs that exchange their points."""
    same, cross = both / 2, (cross + cross.swapaxes(1, 2)) / 2
    # The mean of the pair's covariance and the same exchanged splits into the sum and the difference of the two.
    difference_curve = np.linalg.inv(same - cross) / 2
    scale = np.linalg.det(within) / (np.linalg.det(same + cross) * np.linalg.det(same - cross))
    return np.sqrt(np.clip(scale, 0, 1)) * _expected(difference_curve, offset, varies)


def _expected(curve: np.ndarray, offset: np.ndarray, varies: np.ndarray) -> np.ndarray:
    """(N,) mean of exp(-½ δᵀ curve δ) over δ of mean `offset` (N, 3, 1) and covariance `varies` (N, 3, 3)."""
    spread = np.eye(3) + varies @ curve
    square = (offset.swapaxes(1, 2) @ curve @ np.linalg.solve(spread, offset))[:, 0, 0]
    return np.exp(-0.5 * square) / np.sqrt(np.linalg.det(spread))


def renaming_overlap(
    shape: Shape, covariance: np.ndarray, order: np.ndarray, seen: np.ndarray, yaw: float = 0.0
) -> float:
    """The overlap of the true naming with one in which m takes the point of `order[m]` and the subject has turned.

    order (M,) a permutation; `yaw` rad. Only markers `seen` (M,) whose point in the other naming is seen too are
    looked at; NaN where these are all the same in both.
    """
    here = np.flatnonzero(seen & seen[order])
    if not (order[here] != here).any():
        return np.nan
    middle = shape.mean.mean(axis=0)
    mean = turned(shape.mean[order][here] - middle, np.array(yaw)) + middle
    cosine, sine = np.cos(yaw), np.sin(yaw)
    turn = np.array([[cosine, -sine, 0], [sine, cosine, 0], [0, 0, 1]])
    cloud = covariance.reshape(len(shape.mean), 3, -1, 3)
    own = cloud[here][:, :, here]
    image = turn @ cloud[order[here]][:, :, order[here]].swapaxes(1, 2) @ turn.T
    image = image.swapaxes(1, 2)
    own, image = (part.reshape(3 * len(here), -1) for part in (own, image))
    half = (own + image) / 2
    away = (mean - shape.mean[here]).ravel()
    logs = [np.linalg.slogdet(part)[1] for part in (own, image, half)]
    return float(np.exp(-away @ np.linalg.solve(half, away) / 8 + (logs[0] + logs[1]) / 4 - logs[2] / 2))
