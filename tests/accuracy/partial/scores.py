# SPDX-License-Identifier: GPL-3.0-or-later
"""The partial-solvers paper's counts of what became of markers."""

from dataclasses import dataclass

import numpy as np

from .clouds import Clouds


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
