# SPDX-License-Identifier: GPL-3.0-or-later
"""From nothing to a few good guesses a frame: expectation maximisation from yaws all around, softly and then sharply.

Every point is shared among the markers in proportion to their likelihoods (a marker takes no more than one point in
all), the shape is fitted to the shares, and so on while the softness falls. No frame knows of another.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Self

import numpy as np

from ...geometry.upright import best_yaw, turned
from ...kernels import point_calls, stands_for
from .naming import crowd_density, is_crowded
from .shape import FIRST_MODE, Latent, yaw_absorbed

TWIN = 1e6  # what takes a solution out of the choice


@dataclass(frozen=True)
class StartOptions:
    """How guesses are sought."""

    # radii², of the first step and of the last, which fall by even ratios
    softness: tuple[float, float] = (0.08, 0.001)  # physical: from half a limb to as far as a marker may sit elsewhere
    # part of the modes' spread that counts as noise, of the first step and of the last but two, by even ratios, too;
    # none at the end; where it falls as the softness does `clouds-p1` is refused, without it who wears two sets loses a
    # third
    loose: tuple[float, float] = (0.5, 0.003)  # measured
    # solutions that face less far from each other are one; half or twice names people of other labs, and crowds, alike,
    # with 0.393 names of 1.6 % of crowds are wrong
    max_same_yaw_rad: float = 0.4  # measured
    # points that are no marker, 1/radius³, more than there are, as no marker is in its place yet; half or twice names
    # them alike, two fifths refuse `clouds-p1`
    ghost_density: float = 0.025  # measured

    @cached_property
    def schedule(self) -> tuple[tuple[float, float], ...]:
        """Of each step how loose and how soft it is."""
        loose = [*np.geomspace(*self.loose, COARSE_STEPS + FINE_STEPS - 2).tolist(), 0.0, 0.0]
        return tuple(zip(loose, np.geomspace(*self.softness, len(loose)).tolist(), strict=True))

    @property
    def coarse(self) -> tuple[tuple[float, float], ...]:
        """The steps with the coarse shape."""
        return self.schedule[:COARSE_STEPS]

    @property
    def fine(self) -> tuple[tuple[float, float], ...]:
        """The steps with the whole shape."""
        return self.schedule[COARSE_STEPS:]


START_YAWS = 8  # all around from which the search starts
COARSE_MODES = 6  # of the shape that the coarse steps use; by time
COARSE_STEPS, FINE_STEPS = 4, 5
STARTS = StartOptions()


@dataclass(frozen=True, eq=False)
class Guesses:
    """C soft solutions of each of F frames, the best first by their own likelihood."""

    points: np.ndarray  # (F, C, P, 3) m, the frame's points turned and moved as the guess has it, 0 where there is none
    share: np.ndarray  # (F, C, M, P) how far each point is each marker

    @classmethod
    def join(cls, parts: Sequence[Self]) -> Self:
        """The solutions of several searches of the same frames as one's."""
        return cls(*(np.concatenate([getattr(part, name) for part in parts], axis=1) for name in cls.__annotations__))

    def sized(self, size: float) -> Self:
        """The same with points so many times as large."""
        return replace(self, points=self.points * size)


def guess(
    coarse: Latent, fine: Latent, points: np.ndarray, kept: int, first: float = 0.0, part: bool = False
) -> Guesses:
    """Soft solutions for frames of points (F, P, 3) m, NaN where there is none.

    `kept` are followed to the end, of those that start from yaws all around, the first of them as given, rad. The
    points may be of a `part` of the subject alone, such as the legs.
    """
    frames, count = points.shape[:2]
    present = np.isfinite(points[..., 0])
    middle = _middles(coarse, points, present, part)
    places = middle.shape[1]
    centred = np.where(present[:, None, :, None], points[:, None] - middle[:, :, None], 0)
    yaws = np.tile(first + 2 * np.pi / START_YAWS * np.arange(START_YAWS), places)
    starts = len(yaws)
    around = turned(np.repeat(centred, START_YAWS, axis=1), np.broadcast_to(yaws, (frames, starts)))
    around = around.reshape(-1, count, 3)
    latent = np.zeros((len(around), coarse.size))
    there, ghost = np.repeat(present, starts, axis=0), ghost_density(coarse, present)
    ended, latent, _, fitness = softly(coarse, around, there, np.repeat(ghost, starts), latent, STARTS.coarse)
    turn = best_yaw(around, ended).reshape(frames, starts) + yaws
    best = _distinct(fitness.reshape(frames, starts), turn, np.repeat(np.arange(places), START_YAWS), kept)
    rows = (np.arange(frames)[:, None] * starts + best).ravel()
    wide = np.zeros((len(rows), fine.size))
    wide[:, : coarse.size] = latent[rows]
    there, ghost = np.repeat(present, kept, axis=0), ghost_density(fine, present)
    around, _, share, fitness = softly(fine, ended[rows], there, np.repeat(ghost, kept), wide, STARTS.fine)
    order = np.argsort(-fitness.reshape(frames, -1), axis=1)
    rows = np.arange(frames)[:, None] * order.shape[1] + order
    return Guesses(around[rows], share[rows])


def _middles(model: Latent, points: np.ndarray, present: np.ndarray, part: bool) -> np.ndarray:
    """(F, S, 3) m where the subject's middle may be.

    That of all points. Of those that may be a `part` of the subject also where it is if they are its lower or its upper
    half; of many more than the markers also that of the lowest and of the highest part as high as the subject.
    """
    middle, height = _mean(points, present), model.mean[:, 2]
    if part:
        halves = [height[height < 0].mean(), 0.0, height[height > 0].mean()]
        return np.stack([middle - np.array([0.0, 0.0, half]) for half in halves], axis=1)
    if not is_crowded(model, present).any():
        return middle[:, None]
    low, high = height.min(), height.max()
    height = np.where(present, points[..., 2], np.nan)
    floor, top = np.nanmin(height, axis=1, keepdims=True), np.nanmax(height, axis=1, keepdims=True)
    below = _mean(points, present & (height <= floor + (high - low)))
    above = _mean(points, present & (height >= top - (high - low)))
    below[:, 2], above[:, 2] = floor[:, 0] - low, top[:, 0] - high
    return np.stack([middle, below, above], axis=1)


def _mean(points: np.ndarray, which: np.ndarray) -> np.ndarray:
    """(F, 3) of the points (F, P, 3) that are meant (F, P)."""
    return np.where(which[..., None], points, 0).sum(axis=1) / np.maximum(which.sum(axis=1), 1)[:, None]


def _distinct(fitness: np.ndarray, turn: np.ndarray, place: np.ndarray, count: int) -> np.ndarray:
    """(F, count) the fittest of solutions (F, Y), one of those that face nearly the same way from a `place` (Y,)."""
    left = fitness.copy()
    best = np.empty((len(left), count), dtype=int)
    rows = np.arange(len(left))
    for rank in range(count):
        best[:, rank] = left.argmax(axis=1)
        between = np.abs((turn - turn[rows, best[:, rank], None] + np.pi) % (2 * np.pi) - np.pi)
        left[(between < STARTS.max_same_yaw_rad) & (place == place[best[:, rank], None])] -= TWIN
        left[rows, best[:, rank]] = -np.inf
    return best


def ghost_density(model: Latent, present: np.ndarray) -> np.ndarray:
    """(N,) of ghosts in frames of points present (N, P), in what `_closeness` gives markers in."""
    return (STARTS.ghost_density + crowd_density(model, present)) * (2 * np.pi) ** 1.5 / model.radius**3


@stands_for(point_calls.softly)
def softly(
    model: Latent, points: np.ndarray, present: np.ndarray, ghost: np.ndarray, latent: np.ndarray, schedule
) -> tuple[np.ndarray, ...]:
    """Points (N, P, 3) m turned into the model's frame, latent vectors, shares (N, M, P) and fitness (N,) at the end.

    From points that are present (N, P), among ghosts of such a density (N,), and latent vectors (N, L); the schedule
    has steps as `StartOptions`.
    """
    for loose, softness in schedule:
        variance = model.noise + loose * model.by_modes + softness * model.radius**2
        share = _closeness(model.positions(latent), points, variance)
        share *= present[:, None]
        likelihood = share.sum(axis=1) + ghost[:, None]
        share /= likelihood[:, None]
        total = share.sum(axis=2)
        fair = 1 / np.maximum(total, 1)
        share *= fair[..., None]
        total *= fair
        pull = (share @ points - total[..., None] * model.mean) / variance[:, None]
        normal = model.normal(total / variance)
        latent = np.linalg.solve(normal, model.right_side(pull)[..., None])[..., 0]
        points, latent = yaw_absorbed(points, latent, model.yaw_sd)
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
