# SPDX-License-Identifier: GPL-3.0-or-later
"""Clouds of recorded people with what can go wrong: hidden markers, ghosts, noise.

On purpose not made by `addon.core.points.likelihood.learn`, by which the tested method judges itself in training.
"""

from dataclasses import dataclass

import numpy as np

GHOSTS_BEYOND = 0.2  # m beyond the frame's own bounding box


@dataclass(frozen=True, eq=False)
class Clouds:
    """N clouds to be named: points (N, P, 3) m, in any order, and truth (N, P), the marker of each point, -1 none."""

    points: np.ndarray
    truth: np.ndarray


@dataclass(frozen=True)
class Trouble:
    """What goes wrong in a cloud: markers hidden, ghosts (points of no marker), noise (m, one sigma a coordinate)."""

    hide: int = 0
    ghosts: int = 0
    noise: float = 0.0


def drawn(frames: np.ndarray, count: int, generator: np.random.Generator) -> np.ndarray:
    """(count, M, 3) of the frames (T, M, 3), each once as long as there are enough."""
    times = -(-count // len(frames))
    order = np.concatenate([generator.permutation(len(frames)) for _ in range(times)])
    return frames[order[:count]]


def spoilt(frames: np.ndarray, trouble: Trouble, generator: np.random.Generator) -> Clouds:
    """The frames (N, M, 3) with some markers taken away, ghosts put in anywhere around, noise added, and shuffled."""
    count, markers = frames.shape[:2]
    kept = generator.random((count, markers)).argsort(axis=1)[:, trouble.hide :]
    points = np.take_along_axis(frames, kept[..., None], axis=1)
    points = points + trouble.noise * generator.normal(size=points.shape)
    low, high = np.nanmin(frames, axis=1) - GHOSTS_BEYOND, np.nanmax(frames, axis=1) + GHOSTS_BEYOND
    strays = generator.uniform(low[:, None], high[:, None], (count, trouble.ghosts, 3))
    points = np.concatenate([points, strays], axis=1)
    truth = np.concatenate([kept, np.full((count, trouble.ghosts), -1)], axis=1)
    truth = np.where(np.isfinite(points).all(axis=2), truth, -1)
    order = generator.random(truth.shape).argsort(axis=1)
    points, truth = np.take_along_axis(points, order[..., None], axis=1), np.take_along_axis(truth, order, axis=1)
    return Clouds(points, truth)


def placed_differently(frames: np.ndarray, names: tuple[str, ...]) -> np.ndarray:
    """The same people in a lab that puts the tibia marker 6 % of the leg lower and the heel 2 % nearer to the toe."""
    moved = frames.copy()
    for side in "LR":
        knee, ankle, heel, toe = (frames[:, names.index(side + part)] for part in ("KNE", "ANK", "HEE", "TOE"))
        leg = 2 * np.linalg.norm(knee - ankle, axis=1, keepdims=True)
        if side + "TIB" in names:
            moved[:, names.index(side + "TIB")] += 0.06 * leg * (ankle - knee) / (leg / 2)
        forward = (toe - heel) / np.linalg.norm(toe - heel, axis=1, keepdims=True)
        moved[:, names.index(side + "HEE")] += 0.02 * leg * forward
    return moved
