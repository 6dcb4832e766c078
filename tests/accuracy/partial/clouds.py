# SPDX-License-Identifier: GPL-3.0-or-later
"""Clouds of recorded people with what can go wrong: hidden markers, ghosts, noise; and the paper's counts of markers.

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
    truth = np.where(np.isfinite(points).all(axis=2), truth, -1)
    order = generator.random(truth.shape).argsort(axis=1)
    points, truth = np.take_along_axis(points, order[..., None], axis=1), np.take_along_axis(truth, order, axis=1)
    return Clouds(points, truth, markers)


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


@dataclass(frozen=True, eq=False)
class Score:
    """Counts by marker (M,): labels given, wrong ones, markers that were there, markers declared occluded (there or
    not), and those of them that were there."""

    given: np.ndarray
    wrong: np.ndarray
    there: np.ndarray
    declared: np.ndarray
    missed: np.ndarray

    def __add__(self, other: "Score") -> "Score":
        return Score(*(mine + theirs for mine, theirs in zip(vars(self).values(), vars(other).values(), strict=True)))

    @classmethod
    def of(cls, lists: list[list[int]]) -> "Score":
        """From what `lists` gave."""
        return cls(*np.array(lists, dtype=np.int64))

    @property
    def lists(self) -> list[list[int]]:
        """As plain lists, to be stored."""
        return [column.tolist() for column in vars(self).values()]

    @property
    def false_assignments(self) -> float:
        """Wrong labels over labels given."""
        return float(self.wrong.sum() / max(self.given.sum(), 1))

    @property
    def false_occlusions(self) -> float:
        """Markers wrongly declared occluded over all declared occluded."""
        return float(self.missed.sum() / max(self.declared.sum(), 1))

    @property
    def recall(self) -> float:
        """Right labels over markers that are there."""
        return float((self.given - self.wrong).sum() / max(self.there.sum(), 1))


def score(named: np.ndarray, clouds: Clouds) -> Score:
    """Counts the names (N, P) given to clouds."""
    given, wrong, there, missed = (np.zeros(clouds.markers, dtype=np.int64) for _ in range(4))
    declared = np.zeros(clouds.markers, dtype=np.int64)
    for marker in range(clouds.markers):
        mine, truly = named == marker, clouds.truth == marker
        given[marker], wrong[marker] = mine.sum(), (mine & ~truly).sum()
        there[marker] = truly.any(axis=1).sum()
        unnamed = ~mine.any(axis=1)
        declared[marker], missed[marker] = unnamed.sum(), (unnamed & truly.any(axis=1)).sum()
    return Score(given, wrong, there, declared, missed)
