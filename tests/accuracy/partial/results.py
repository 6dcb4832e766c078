# SPDX-License-Identifier: GPL-3.0-or-later
"""Results as they were kept, put together over the people that were left out."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from .running import SAME, SPEED, read
from .scores import Score

LEFT_OUT = "left out"


@dataclass(frozen=True)
class Column:
    """One of the things compared: a method, and whether it had seen the people that it was tested on."""

    method: str
    people: str
    title: str


COLUMNS = (
    Column("paper", SAME, "faithful, same people"),
    Column("paper", LEFT_OUT, "faithful, left out"),
    Column("turn", SAME, "faithful + turn, same people"),
    Column("turn", LEFT_OUT, "faithful + turn, left out"),
    Column("ours", SAME, "ours, same people"),
    Column("ours", LEFT_OUT, "ours, left out"),
)


class Results:
    """All results in a folder."""

    def __init__(self, folder: Path):
        self._found: dict[str, dict[str, dict]] = {}
        for path in sorted(folder.glob("*.*.json")):
            method, split = path.stem.split(".")
            self._found.setdefault(method, {})[split] = read(path)
        self.speed: dict = read(folder / SPEED)

    def parts(self, column: Column, study: str) -> dict[str, dict]:
        """What a study found, by the people who were tested."""
        mine = self._found.get(column.method, {})
        return {
            split: found[study]
            for split, found in mine.items()
            if study in found and (split == SAME) == (column.people == SAME)
        }

    def pooled(self, column: Column, study: str) -> dict | None:
        """What a study found, counts added up over people; None where it was not run."""
        total = None
        for found in self.parts(column, study).values():
            total = found if total is None else added(total, found)
        return total

    def with_study(self, study: str) -> list[tuple[Column, dict]]:
        """The columns in which the study was run, with what it found."""
        found = [(column, self.pooled(column, study)) for column in COLUMNS]
        return [(column, counts) for column, counts in found if counts]

    def people(self, column: Column, study: str) -> str:
        """How many people were tested in how many groups."""
        groups = list(self.parts(column, study))
        if column.people == SAME:
            return "all people in both"
        count = sum(len(group.split("+")) for group in groups)
        return f"{count} people left out, {len(groups)} trainings"


def added(one, other):
    """Two results of a study together: numbers added wherever they stand."""
    if isinstance(one, dict):
        return {key: added(one[key], other[key]) for key in one if key in other}
    if isinstance(one, list):
        return [added(mine, theirs) for mine, theirs in zip(one, other, strict=True)]
    return one + other


def over(counts: dict, target: float) -> Score:
    """The score at one target, added up over all conditions of {condition: {target: counts}}."""
    scores = [Score.of(by_target[str(target)]) for by_target in counts.values()]
    return sum(scores[1:], scores[0])


def best_at(swept: list[list[int]], most_wrong: float) -> tuple[float, float] | None:
    """Of the levels of `scores.sweep` the one with the fewest false occlusions at no more than a rate of false
    assignments: both rates. None when no level has so few."""
    level = best_level(swept, most_wrong)
    return None if level is None else _rates(np.array(swept)[:, level])


def best_level(swept: list[list[int]], most_wrong: float) -> int | None:
    """The same level's number."""
    given, wrong, declared, missed = (np.array(row, dtype=float) for row in swept)
    assigned, occluded = wrong / np.maximum(given, 1), missed / np.maximum(declared, 1)
    allowed = np.flatnonzero((assigned <= most_wrong) & (given > 0))
    return int(allowed[occluded[allowed].argmin()]) if len(allowed) else None


def chosen_on_others(parts: dict[str, dict], hide: int, most_wrong: float) -> tuple[float, float] | None:
    """The rates of `best_at` over all parts, in each of them at the level that is best for the other parts.

    None when for some no level has so few false assignments.
    """
    total = np.zeros(4, dtype=int)
    for split, found in parts.items():
        others = np.sum([other[str(hide)] for name, other in parts.items() if name != split], axis=0)
        level = best_level(others, most_wrong)
        if level is None:
            return None
        total += np.array(found[str(hide)])[:, level]
    return _rates(total)


def _rates(counts: np.ndarray) -> tuple[float, float]:
    """False assignments and false occlusions of given, wrong, declared and missed."""
    given, wrong, declared, missed = (int(count) for count in counts)
    return wrong / max(given, 1), missed / max(declared, 1)
