# SPDX-License-Identifier: GPL-3.0-or-later
"""Clouds of recorded people with what can go wrong: hidden markers, ghosts, noise, a mirror, two people.

On purpose not made by `addon.core.points.likelihood.trials`, by which the tested method judges itself in training.
"""

from dataclasses import dataclass

import numpy as np

GHOSTS_BEYOND = 0.2  # m beyond the frame's own bounding box


@dataclass(frozen=True, eq=False)
class Clouds:
    """N clouds to be named: points (N, P, 3) m, in any order, and truth (N, P), the marker of each point, -1 none."""

    points: np.ndarray
    truth: np.ndarray
    markers: int


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
    return shuffled(points, truth, markers, generator)


def shuffled(points: np.ndarray, truth: np.ndarray, markers: int, generator: np.random.Generator) -> Clouds:
    """Points (N, P, 3) and their markers (N, P) in another order in every cloud."""
    truth = np.where(np.isfinite(points).all(axis=2), truth, -1)
    order = generator.random(truth.shape).argsort(axis=1)
    points, truth = np.take_along_axis(points, order[..., None], axis=1), np.take_along_axis(truth, order, axis=1)
    return Clouds(points, truth, markers)


def together(one: np.ndarray, other: np.ndarray, distance: float, generator: np.random.Generator) -> Clouds:
    """Two people in one cloud, both (N, M, 3), the other turned anyhow and `apart` m away.

    Truth M + m is the other's marker m; `markers` counts both people's.
    """
    count, markers = one.shape[:2]
    turn, bearing = generator.uniform(0, 2 * np.pi, (2, count))
    middle = np.nanmean(one[..., :2], axis=1)
    own = other - np.concatenate([np.nanmean(other[..., :2], axis=1), np.zeros((count, 1))], axis=1)[:, None]
    cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
    across, along = cos * own[..., 0] - sin * own[..., 1], sin * own[..., 0] + cos * own[..., 1]
    place = middle + distance * np.stack([np.cos(bearing), np.sin(bearing)], axis=1)
    moved = np.stack([across + place[:, :1], along + place[:, 1:], own[..., 2]], axis=2)
    truth = np.tile(np.arange(2 * markers), (count, 1))
    return shuffled(np.concatenate([one, moved], axis=1), truth, 2 * markers, generator)


def mirrored(points: np.ndarray) -> np.ndarray:
    """Points (…, 3) in an upright mirror."""
    return points * [1.0, -1.0, 1.0]


def other_side(names: tuple[str, ...]) -> np.ndarray:
    """(M,) the marker that a mirror turns each one into: L… into R… and the other way round."""
    swapped = [{"L": "R", "R": "L"}.get(name[0], name[0]) + name[1:] for name in names]
    return np.array([names.index(other) if other in names else at for at, other in enumerate(swapped)])


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
