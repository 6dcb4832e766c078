# SPDX-License-Identifier: GPL-3.0-or-later
"""The motion of several subjects side by side: the markers and joints of one after those of the other."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ...data.takes import Motion, Suspect
from ..motion import LabelledPoints, TakeMotion
from .wearers import SetsWorn


@dataclass(frozen=True, eq=False)
class SubjectsMotion:
    """The motion of each subject of a take, as `TakeMotion` has that of one."""

    subjects: tuple[TakeMotion, ...]

    def __len__(self) -> int:
        return len(self.subjects[0])

    @property
    def frames(self) -> np.ndarray:
        """(T,) the source's frame numbers."""
        return self.subjects[0].frames

    @property
    def markers(self) -> "Beside":
        """(T, M, 3) m, where all markers are."""
        return Beside([one.markers for one in self.subjects])

    @property
    def residual(self) -> "Beside":
        """(T, M) m."""
        return Beside([one.residual for one in self.subjects])

    def part(self, frames: slice) -> Motion:
        """The motion of all in the frames from start to stop: and where anybody is found at all."""
        return beside(self.each(frames))

    def each(self, frames: slice) -> list[Motion]:
        """The motion of each subject in the frames from start to stop."""
        return [one.part(frames) for one in self.subjects]

    def parts(self) -> Iterator[slice]:
        """The take part by part."""
        return self.subjects[0].parts()

    def suspects(self, names: tuple[str, ...], rate: float) -> tuple[Suspect, ...]:
        """What each body shows that is doubtful, by the names of all markers in a row."""
        found, first = [], 0
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


class Beside:
    """Tables (T, M, …) of several subjects as one, of any frames as an array."""

    def __init__(self, tables: list):
        self.tables = tables
        first = tables[0].shape
        self.shape = (first[0], sum(one.shape[1] for one in tables), *first[2:])

    def __len__(self) -> int:
        return self.shape[0]

    def __getitem__(self, frames) -> np.ndarray:
        return np.concatenate([one[frames] for one in self.tables], axis=1)


@dataclass(frozen=True, eq=False)
class LabelledSubjects(LabelledPoints):
    """What the labelling says of a take of several; labels count the markers of all subjects in a row, by `worn`."""

    motion: SubjectsMotion
    worn: SetsWorn
