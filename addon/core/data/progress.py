# SPDX-License-Identifier: GPL-3.0-or-later
"""What long work says while it goes on."""

from collections.abc import Generator
from dataclasses import dataclass
from typing import Any, TypeVar

Result = TypeVar("Result")


@dataclass(frozen=True)
class Progress:
    """How far the work is, 0 to 1, and what it is doing, for a person to read."""

    fraction: float
    note: str


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
