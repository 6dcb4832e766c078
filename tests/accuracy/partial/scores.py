# SPDX-License-Identifier: GPL-3.0-or-later
"""The partial-solvers paper's counts of what became of markers, and how many wrong labels a mirror explains."""

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

    @property
    def f1(self) -> float:
        """Twice the right labels over labels given and markers that are there."""
        return float(2 * (self.given - self.wrong).sum() / max((self.given + self.there).sum(), 1))


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


def sweep(named: np.ndarray, confidence: np.ndarray, clouds: Clouds, levels: np.ndarray) -> list[list[int]]:
    """Given, wrong, declared and missed, each for every level (L,) of confidence that a label must reach."""
    clear = named >= 0
    confident = np.sort(confidence[clear])
    wrong = np.sort(confidence[clear & (named != clouds.truth)])
    frame, point = np.nonzero(clear)
    present = (clouds.truth[frame] == named[frame, point][:, None]).any(axis=1)
    known = np.sort(confidence[clear][present])
    given, bad, named_there = (
        len(values) - np.searchsorted(values, levels, side="left") for values in (confident, wrong, known)
    )
    declared = clouds.truth.shape[0] * clouds.markers - given
    missed = int((clouds.truth >= 0).sum()) - named_there
    return [column.tolist() for column in (given, bad, declared, missed)]


def swaps(named: np.ndarray, clouds: Clouds, other: np.ndarray) -> list[int]:
    """Counts of what a mirror explains: frames with a sided label; of them, those in which all sided labels have the
    other side's name, and those in which only some have; wrong labels; of them, those with the other side's name.

    other (M,) as `clouds.other_side` gives it.
    """
    given = named >= 0
    sided = given & (other[named] != named)
    swapped = sided & (clouds.truth >= 0) & (other[clouds.truth] == named)
    any_sided, all_swapped = sided.any(axis=1), (swapped == sided).all(axis=1)
    some = swapped.any(axis=1)
    wrong = given & (named != clouds.truth)
    counted = (any_sided, any_sided & all_swapped & some, some & ~all_swapped, wrong, wrong & swapped)
    return [int(part.sum()) for part in counted]


def in_the_mirror(plain: np.ndarray, turned: np.ndarray, clouds: Clouds, other: np.ndarray) -> list[int]:
    """Counts of sided labels: given to plain clouds, given to the same clouds in a mirror; of the latter those right
    for the person whom the mirror shows, whose left is the other's right, and those that did not change."""
    before, after = ((named >= 0) & (other[named] != named) for named in (plain, turned))
    shown = np.where(clouds.truth >= 0, other[clouds.truth], -1)
    return [int(part.sum()) for part in (before, after, after & (turned == shown), after & (turned == plain))]
