# SPDX-License-Identifier: GPL-3.0-or-later
"""What long work says while it goes on."""

from collections.abc import Generator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

Result = TypeVar("Result")


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


def in_stages(
    work: Generator[Stage | float | tuple[float, str], None, Result], begins: Mapping[str, float]
) -> Generator[Progress, None, Result]:
    """Work that says which stage begins and then how far that is, as progress of the whole; gives its result.

    `begins` says how far along the whole is when each stage begins, in their order. Of a stage the share of it that is
    done is told, and with it what is being done where that is not always the stage's note.
    """
    ends = dict(zip(begins, [*begins.values(), 1.0][1:], strict=True))
    first = last = 0.0
    note = ""
    while True:
        try:
            told = next(work)
        except StopIteration as end:
            return end.value
        if isinstance(told, Stage):
            first, last, note, told = begins[told.name], ends[told.name], told.note, 0.0
        share, doing = told if isinstance(told, tuple) else (told, note)
        yield Progress(first + (last - first) * share, doing)


def within(
    work: Generator[float | tuple[float, str], None, Result], first: float, last: float, note: str = ""
) -> Generator[Progress, None, Result]:
    """Work as part of a whole, from `first` to `last` of it; gives its result.

    It yields the share of it that is done, and with it what it is doing where that is not always `note`.
    """
    while True:
        try:
            told = next(work)
        except StopIteration as end:
            return end.value
        share, doing = told if isinstance(told, tuple) else (told, note)
        yield Progress(first + (last - first) * share, doing)


def finished(work: Generator[Any, None, Result]) -> Result:
    """What a generator returns once it is stepped to its end."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            return end.value
