# SPDX-License-Identifier: GPL-3.0-or-later
"""Who is in a take of several subjects, and what the markers of all of them are called."""

import re
import unicodedata
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import accumulate

from ...data.markersets import MarkerSet
from ...posing.finer import finer
from ..models import Model

AUTO = 0  # how many subjects there are is for the take to say
MAX_SUBJECTS = 8  # that are asked for, or found
SUBJECT_NAME = re.compile(r"[^\s:,=|*\"]{1,40}")
NAME_RULE = 'expected up to 40 letters and signs that can be printed, without spaces or : , = | * "'


def is_subject_name(text: str) -> bool:
    """Whether somebody can be called so (NAME_RULE): what separates markers, files and lists is in no name.

    Nor is what nobody sees or no file holds: control signs, marks of direction, halves of surrogate pairs.
    """
    return SUBJECT_NAME.fullmatch(text) is not None and text.isprintable()


def as_compared(name: str) -> str:
    """What two names that people take for one have in common."""
    return unicodedata.normalize("NFC", name).casefold()


@dataclass(frozen=True, eq=False)
class Wearer:
    """Who is in a take: the name, the model of what is worn, and whether they were asked for or only are there."""

    name: str
    model: Model
    asked: bool = True

    @property
    def markers(self) -> tuple[str, ...]:
        """The subject's markers as labels have them, NAME:MARKER."""
        return tuple(f"{self.name}:{marker}" for marker in self.model.markerset.markers)


@dataclass(frozen=True, eq=False)
class SeveralOptions:
    """Who is asked for."""

    model: Model | None = None  # what all of them wear, who have no names: `count` of them, or AUTO
    count: int = AUTO
    subjects: tuple[Wearer, ...] = ()  # those who have, each with a model of their own; then `model` is None
    # whether people whom nobody asked for are found, too, after those who were: for who must know what is theirs, as
    # they are in the way
    others: bool = False
    # whether those whom nothing tells apart are in the order of where they stand, as blobs come in no order; else who
    # comes first in the file is first
    in_room: bool = False

    @cached_property
    def models(self) -> tuple[Model, ...]:
        """The models of those who are asked for, each once; of those without names, the one."""
        if self.model is not None:
            return (self.model,)
        return tuple(one.model for one, kind in zip(self.subjects, kinds(self.subjects), strict=True) if kind is one)

    def numbered(self, count: int) -> tuple[Wearer, ...]:
        """So many without names, who are called 1, 2 and so on."""
        return tuple(Wearer(str(number), self.models[0]) for number in range(1, count + 1))

    @property
    def at_least(self) -> "SetsWorn":
        """The sets of all who must be in the take."""
        return SetsWorn(self.subjects or self.numbered(self.count or 1))

    @property
    def possible(self) -> "SetsWorn":
        """The sets of all who may be in the take, as far as is known before it is looked at."""
        return SetsWorn(self.subjects or self.numbered(self.count or MAX_SUBJECTS))


def kinds(subjects: tuple[Wearer, ...]) -> tuple[Wearer, ...]:
    """For each subject the first one of the same model, whom nothing that is known tells them from."""
    return tuple(next(other for other in subjects if is_same(other.model, one.model)) for one in subjects)


def is_same(one: Model, other: Model) -> bool:
    """Whether two models are one, read twice or not."""
    return one is other or (bool(one.fingerprint) and one.fingerprint == other.fingerprint)


@dataclass(frozen=True, eq=False)
class SetsWorn:
    """The marker sets of all subjects of a take as one list of markers, those of one after those of the other."""

    subjects: tuple[Wearer, ...]

    def __len__(self) -> int:
        return len(self.markers)

    @cached_property
    def asked(self) -> "SetsWorn":
        """Those of the subjects who were asked for; the others come after them."""
        return SetsWorn(tuple(one for one in self.subjects if one.asked))

    @cached_property
    def finer(self) -> "SetsWorn":
        """The same with what joints their markers can show beside those that they are named by."""
        models = {one.model: replace(one.model, markerset=finer(one.model.markerset)) for one in self.subjects}
        return SetsWorn(tuple(replace(one, model=models[one.model]) for one in self.subjects))

    @cached_property
    def markers(self) -> tuple[str, ...]:
        """NAME:MARKER of all."""
        return tuple(marker for one in self.subjects for marker in one.markers)

    @cached_property
    def firsts(self) -> tuple[int, ...]:
        """(S,) where the markers of each subject begin."""
        sizes = [len(one.model.markerset) for one in self.subjects]
        return tuple(accumulate(sizes[:-1], initial=0))

    @property
    def name(self) -> str:
        """The names of the sets, each once."""
        return ", ".join(dict.fromkeys(one.model.markerset.name for one in self.subjects))

    @property
    def worn(self) -> tuple[tuple[str, MarkerSet], ...]:
        """Who is there by name, and what each wears, as of a single marker set (`MarkerSet.worn`)."""
        return tuple((one.name, one.model.markerset) for one in self.subjects)

    @cached_property
    def by_name(self) -> dict[str, int]:
        """The index of each marker by its name, and by its aliases."""
        found = {name: index for index, name in enumerate(self.markers)}
        for one, first in zip(self.subjects, self.firsts, strict=True):
            own = one.model.markerset.by_name
            found |= {f"{one.name}:{name}": first + index for name, index in own.items()}
        return found
