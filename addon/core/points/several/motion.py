# SPDX-License-Identifier: GPL-3.0-or-later
"""The motion of several subjects side by side: the markers and joints of one after those of the other."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from typing import Self

import numpy as np

from ...data.made import Made, Table
from ...data.markersets import MarkerSet, Worn
from ...data.takes import Labels, Motion, Suspect
from ..motion import LabelledPoints, MotionInParts, TakeMotion
from .wearers import SetsWorn


@dataclass(frozen=True, eq=False)
class SubjectsMotion(MotionInParts):
    """The motion of each subject of a take."""

    subjects: tuple[TakeMotion, ...]

    @classmethod
    def of(cls, subjects: Sequence[TakeMotion]) -> Self:
        """That of subjects in the same frames."""
        markers = _tables_beside([one.markers for one in subjects])
        residual = _tables_beside([one.residual for one in subjects])
        return cls(markers, residual, subjects[0].frames, tuple(subjects))

    def part(self, frames: slice) -> Motion:
        """The motion of all in the frames from start to stop: and where anybody is found at all."""
        return beside(self.each(frames))

    def each(self, frames: slice) -> list[Motion]:
        """The motion of each subject in the frames from start to stop."""
        return [one.part(frames) for one in self.subjects]

    def suspects(self, names: tuple[str, ...], rate: float) -> tuple[Suspect, ...]:
        """What each body shows that is doubtful, by the names of all markers in a row."""
        found: list[Suspect] = []
        first = 0
        for one in self.subjects:
            size = one.markers.shape[1]
            found += one.suspects(names[first : first + size], rate)
            first += size
        return tuple(found)


def beside(each: Sequence[Motion]) -> Motion:
    """The motion of several subjects in the same frames as one, as `SubjectsMotion.part` has it."""
    tables = {
        name: np.concatenate([getattr(one, name) for one in each], axis=1)
        for name in ("markers", "residual", "residual_px", "conflicts", "expected", "joints", "rotations", "scale")
    }
    confidence = np.max([one.confidence for one in each], axis=0)
    return Motion(frames=each[0].frames, confidence=confidence, **tables)


def measured_of_first(motion: Motion, each: Sequence[Motion]) -> Motion:
    """That of some subjects, with their markers as they were measured in that of all, of whom they are the first."""
    own = beside(each)
    measured = ("markers", "residual", "residual_px", "conflicts")
    return replace(own, **{name: getattr(motion, name)[:, : own.markers.shape[1]] for name in measured})


def with_bodies_of(motion: Motion, frame: np.ndarray, before: Labels, after: Labels, worn: Worn) -> Motion:
    """The motion with the bodies of two exchanged in the frames in which their markers are, or most of them.

    frame (N,) is that of each row, and before and after (N,) are the labels that the bodies were fitted to and those
    that edits gave. Only bodies of one skeleton can be exchanged; of a single set nothing changes.
    """
    sets = [markerset for _, markerset in worn.worn]
    if len(sets) < 2 or (before.marker == after.marker).all():
        return motion
    count, frames = len(sets), len(motion.frames)
    whose = np.repeat(np.arange(count), [len(one) for one in sets])
    rows = before.named & after.named
    moved = np.zeros((frames, count, count), int)
    np.add.at(moved, (frame[rows], whose[before.marker[rows]], whose[after.marker[rows]]), 1)
    every = moved.sum(axis=2)
    most = 2 * moved > every[..., None]
    tables = {name: getattr(motion, name).copy() for name in ("expected", "joints", "rotations", "scale")}
    for one, other in combinations(range(count), 2):
        # Of whom nothing is there the markers cannot go to anybody.
        to, back = most[:, one, other] | (every[:, one] == 0), most[:, other, one] | (every[:, other] == 0)
        at = np.flatnonzero(to & back & (every[:, one] + every[:, other] > 0))
        if not len(at) or sets[one].skeleton.parents.tolist() != sets[other].skeleton.parents.tolist():
            continue
        for name, table in tables.items():
            first, second = (_columns(name, sets, number) for number in (one, other))
            if first.stop - first.start == second.stop - second.start:
                table[at, first], table[at, second] = table[at, second], table[at, first]
    return replace(motion, **tables)


def _columns(name: str, sets: Sequence[MarkerSet], number: int) -> slice:
    """Where a subject's columns of a table of `beside` are."""
    size = {"expected": len, "scale": lambda _: 3}.get(name, lambda one: len(one.skeleton))
    first = sum(size(one) for one in sets[:number])
    return slice(first, first + size(sets[number]))


def _tables_beside(tables: Sequence[Table]) -> Made:
    """Tables (T, M, …) of several subjects as one, of any frames as an array."""
    first, width = tables[0].shape, sum(one.shape[1] for one in tables)
    shape = (first[0], width, *first[2:])
    return Made(shape, lambda frames: np.concatenate([one[frames] for one in tables], axis=1))


@dataclass(frozen=True, eq=False)
class LabelledSubjects(LabelledPoints):
    """What the labelling says of a take of several; labels count the markers of all subjects in a row, by `worn`."""

    motion: SubjectsMotion
    worn: SetsWorn
