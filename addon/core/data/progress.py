# SPDX-License-Identifier: GPL-3.0-or-later
"""What long work says while it goes on."""

from collections.abc import Callable, Generator, Mapping
from contextlib import closing
from dataclasses import dataclass
from itertools import pairwise
from types import MappingProxyType
from typing import Any, TypeVar

Result = TypeVar("Result")
Item = TypeVar("Item")
NO_SPANS: Mapping[str, tuple[float, float]] = MappingProxyType({})


@dataclass(frozen=True)
class Progress:
    """How far the work is, 0 to 1, and what it is doing, for a person to read."""

    fraction: float
    note: str


@dataclass(frozen=True)
class Stage:
    """A part of long work that begins: its name, and what is done in it, for a person to read."""

    name: str
    note: str


# Work that tells how far it is: as a share, with what it is doing, or the stage that begins.
Steps = Generator[Progress | Stage | float | tuple[float, str], None, Result]


def within(
    work: Steps[Result], first: float, last: float, note: str = "", spans: Mapping[str, tuple[float, float]] = NO_SPANS
) -> Generator[Progress, None, Result]:
    """Work as part of a whole, from `first` to `last` of it; gives its result.

    It yields the share of it that is done, and with it what it is doing where that is not always `note`. Where a stage
    of it begins it yields that: from there on the share is of the stage, whose part of the whole is in `spans`.
    """
    while True:
        try:
            item = next(work)
        except StopIteration as end:
            return end.value
        if isinstance(item, Stage):
            (first, last), note, item = spans[item.name], item.note, 0.0
        if isinstance(item, Progress):
            item = item.fraction, item.note
        share, doing = item if isinstance(item, tuple) else (item, note)
        yield Progress(first + (last - first) * share, doing)


def in_stages(work: Steps[Result], begins: Mapping[str, float]) -> Generator[Progress, None, Result]:
    """All of the work, by how far along it is when each of its stages begins, in their order; gives its result."""
    return within(work, 0.0, 0.0, spans=dict(zip(begins, pairwise((*begins.values(), 1.0)), strict=True)))


def rising(work: Generator[Progress, None, Result]) -> Generator[Progress, None, Result]:
    """The same work, whose progress never falls: what begins again has what is left of the whole."""
    said = told = 0.0  # how far it says that it is, and what is told of that
    again = then = 0.0  # the same where it began again
    while True:
        try:
            step = next(work)
        except StopIteration as end:
            return end.value
        if step.fraction < said:
            again, then = step.fraction, told
        said = step.fraction
        told = then + (1 - then) * (said - again) / (1 - again)
        yield Progress(told, step.note)


def finished(work: Generator[Item, Any, Result], tell: Callable[[Item], None] | None = None) -> Result:
    """What work returns once it is stepped to its end; `tell` hears all that it yields, and ends it by raising.

    Work that cannot yield in the middle of what it does gets `tell` by its first `yield`.
    """
    with closing(work):
        told = None  # what a generator that has not begun takes
        while True:
            try:
                item = work.send(told)
            except StopIteration as end:
                return end.value
            told = tell
            if tell is not None:
                tell(item)
