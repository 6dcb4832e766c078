# SPDX-License-Identifier: GPL-3.0-or-later
"""How what many parts tell is put into words."""

from collections.abc import Iterable

LISTED = 8  # names that a sentence lists: more is not read


def listed(names: Iterable[str], between: str = ", ") -> str:
    """Names one after the other, not more than a person reads."""
    names = list(names)
    more = len(names) - LISTED
    some = between.join(names[:LISTED])
    return f"{some} and {more} more" if more > 0 else some


def count_of(number: int, what: str) -> str:
    """A number of things, such as `1 gap`, `2,000 gaps` or `2 trajectories`."""
    several = f"{what[:-1]}ies" if what.endswith("y") else f"{what}s"
    return f"{number:,} {what if number == 1 else several}"


def words_of_frames(first: int, last: int) -> str:
    """The frames from the first to the last, in a sentence."""
    return f"frame {first}" if first == last else f"frames {first}–{last}"


def words_of_range(frames: tuple[int | None, int | None] | None) -> str:
    """The frames from the first to the last as they are asked for, A:B, either left out; empty where none are."""
    return ":".join("" if end is None else str(end) for end in frames or ())
