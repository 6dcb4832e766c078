# SPDX-License-Identifier: GPL-3.0-or-later
"""Clouds with some markers hidden, in any order, and the partial-solvers paper's counts of what became of them."""

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, eq=False)
class Clouds:
    """N clouds to be named: points (N, P, 3) m, in any order, and truth (N, P), the marker of each point, -1 none."""

    points: np.ndarray
    truth: np.ndarray
    markers: int


def hidden(frames: np.ndarray, count: int, hide: int, generator: np.random.Generator, ghosts: int = 0) -> Clouds:
    """`count` of the frames (T, M, 3), each with `hide` markers taken away and `ghosts` points put in, shuffled.

    Ghosts lie anywhere in the frame's own bounding box, made a fifth of a metre larger all round.
    """
    markers = frames.shape[1]
    chosen = frames[generator.choice(len(frames), count, replace=count > len(frames))]
    kept = generator.random((count, markers)).argsort(axis=1)[:, hide:]
    points = np.take_along_axis(chosen, kept[..., None], axis=1)
    low, high = np.nanmin(chosen, axis=1) - 0.2, np.nanmax(chosen, axis=1) + 0.2
    strays = generator.uniform(low[:, None], high[:, None], (count, ghosts, 3))
    points = np.concatenate([points, strays], axis=1)
    truth = np.concatenate([kept, np.full((count, ghosts), -1)], axis=1)
    truth = np.where(np.isfinite(points).all(axis=2), truth, -1)
    order = generator.random(truth.shape).argsort(axis=1)
    return Clouds(
        np.take_along_axis(points, order[..., None], axis=1), np.take_along_axis(truth, order, axis=1), markers
    )


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
    given, wrong, there, missed = (np.zeros(clouds.markers, dtype=int) for _ in range(4))
    declared = np.zeros(clouds.markers, dtype=int)
    for marker in range(clouds.markers):
        mine, truly = named == marker, clouds.truth == marker
        given[marker], wrong[marker] = mine.sum(), (mine & ~truly).sum()
        there[marker] = truly.any(axis=1).sum()
        unnamed = ~mine.any(axis=1)
        declared[marker], missed[marker] = unnamed.sum(), (unnamed & truly.any(axis=1)).sum()
    return Score(given, wrong, there, declared, missed)
