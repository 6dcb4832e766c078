# SPDX-License-Identifier: GPL-3.0-or-later
"""From nothing to a few good guesses a frame: expectation maximisation from yaws all around, softly and then sharply.

Every point is shared among the markers in proportion to their likelihoods (a marker takes no more than one point in
all), the shape is fitted to the shares, and so on while the softness falls. No frame knows of another.
"""

from dataclasses import dataclass

import numpy as np

from .latent import FIRST_MODE, Latent, yaw_absorbed
from .upright import turned

YAWS = 8
COARSE_MODES = 6
KEPT = 3  # guesses a frame that are followed to the end
# Per step: the part of the modes' spread that still counts as noise, and the softness, radii².
COARSE = ((0.5, 0.08), (0.3, 0.04), (0.15, 0.04), (0.08, 0.02))
FINE = ((0.03, 0.012), (0.01, 0.006), (0.003, 0.003), (0.0, 0.0015), (0.0, 0.001))
SAME_YAW = 0.4  # rad; solutions that face less far apart are taken for one
TWIN = 1e6
STRAY = 0.4  # density of points that are no marker, 1/radius³ (and (2π)^-3/2)


@dataclass(frozen=True, eq=False)
class Guesses:
    """C soft solutions of each of F frames, the best first by their own reckoning.

    points  (F, C, P, 3) m, the frame's points turned and moved as the guess has it, 0 where there is none
    share   (F, C, M, P) how far each point is each marker
    latent  (F, C, L)
    """

    points: np.ndarray
    share: np.ndarray
    latent: np.ndarray


def guess(coarse: Latent, fine: Latent, points: np.ndarray) -> Guesses:
    """Soft solutions for frames of points (F, P, 3) m, NaN where there is none."""
    frames, count = points.shape[:2]
    present = np.isfinite(points[..., 0])
    middle = np.where(present[..., None], points, 0).sum(axis=1) / np.maximum(present.sum(axis=1), 1)[:, None]
    centred = np.where(present[..., None], points - middle[:, None], 0).astype(np.float32)
    yaws = (2 * np.pi / YAWS * np.arange(YAWS)).astype(np.float32)
    around = turned(np.repeat(centred[:, None], YAWS, axis=1), np.broadcast_to(yaws, (frames, YAWS)))
    around = around.reshape(-1, count, 3)
    latent = np.zeros((len(around), coarse.size))
    ended, latent, _, fitness = _softly(coarse, around, np.repeat(present, YAWS, axis=0), latent, COARSE)
    turn = _turn(around, ended).reshape(frames, YAWS) + yaws
    kept = _distinct(fitness.reshape(frames, YAWS), turn)
    rows = (np.arange(frames)[:, None] * YAWS + kept).ravel()
    around = ended
    wide = np.zeros((len(rows), fine.size))
    wide[:, : coarse.size] = latent[rows]
    followed = np.repeat(present, kept.shape[1], axis=0)
    around, latent, share, fitness = _softly(fine, around[rows], followed, wide, FINE)
    order = np.argsort(-fitness.reshape(frames, -1), axis=1)
    rows = np.arange(frames)[:, None] * order.shape[1] + order
    return Guesses(around[rows], share[rows], latent[rows])


def _turn(before: np.ndarray, after: np.ndarray) -> np.ndarray:
    """(N,) the yaw that turned the points (N, P, 3) of before into those of after, rad."""
    along = (before[..., 0] * after[..., 0] + before[..., 1] * after[..., 1]).sum(axis=1)
    across = (before[..., 0] * after[..., 1] - before[..., 1] * after[..., 0]).sum(axis=1)
    return np.arctan2(across, along)


def _distinct(fitness: np.ndarray, turn: np.ndarray) -> np.ndarray:
    """(F, KEPT) the fittest of solutions (F, Y), one of those that face nearly the same way."""
    left = fitness.copy()
    kept = np.empty((len(left), KEPT), dtype=int)
    rows = np.arange(len(left))
    for place in range(KEPT):
        kept[:, place] = left.argmax(axis=1)
        apart = np.abs((turn - turn[rows, kept[:, place], None] + np.pi) % (2 * np.pi) - np.pi)
        left[apart < SAME_YAW] -= TWIN
        left[rows, kept[:, place]] = -np.inf
    return kept


def _softly(model: Latent, points, present, latent, schedule):
    """Points turned into the model's frame, latent vectors, shares (N, M, P) and fitness (N,) after all steps."""
    mean, flat = model.mean.astype(np.float32), model.flat.T.astype(np.float32)
    spread = ((model.columns[..., FIRST_MODE:] ** 2).sum(axis=(1, 2)) / 3).astype(np.float32)
    there = present.astype(np.float32)[:, None]
    stray = np.float32(STRAY / model.radius**3)
    for loose, softness in schedule:
        variance = (model.noise + loose * spread + softness * model.radius**2).astype(np.float32)
        expected = mean + (latent.astype(np.float32) @ flat).reshape(len(latent), -1, 3)
        share = _closeness(expected, points, variance)
        share *= there
        likelihood = share.sum(axis=1) + stray
        share /= likelihood[:, None]
        total = share.sum(axis=2)
        fair = 1 / np.maximum(total, 1)
        share *= fair[..., None]
        total *= fair
        pull = (share @ points - total[..., None] * mean) / variance[:, None]
        normal = model.normal((total / variance).astype(float))
        latent = np.linalg.solve(normal, model.right_side(pull.astype(float))[..., None])[..., 0]
        points, latent = yaw_absorbed(points, latent)
        points = points.astype(np.float32)
    fitness = (np.log(likelihood) * present).sum(axis=1) - 0.5 * (latent[:, FIRST_MODE:] ** 2).sum(axis=1)
    return points, latent, share, fitness


def _closeness(expected: np.ndarray, points: np.ndarray, variance: np.ndarray) -> np.ndarray:
    """(N, M, P) normal densities, without their (2π)^-3/2."""
    square = (expected**2).sum(axis=2)[:, :, None] + (points**2).sum(axis=2)[:, None]
    square -= 2 * (expected @ points.transpose(0, 2, 1))
    square *= (-0.5 / variance)[:, None]
    np.exp(square, out=square)
    square *= (variance**-1.5)[:, None]
    return square
