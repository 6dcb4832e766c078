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
    work: Generator[tuple[float, str], None, Result], first: float, last: float
) -> Generator[Progress, None, Result]:
    """Work that yields (share done, what it is doing), as part of a whole from `first` to `last`; gives its result."""
    while True:
        try:
            share, note = next(work)
        except StopIteration as end:
            return end.value
        yield Progress(first + (last - first) * share, note)


def finished(work: Generator[Any, None, Result]) -> Result:
    """What a generator returns once it is stepped to its end."""
    while True:
        try:
            next(work)
        except StopIteration as end:
            return end.value
