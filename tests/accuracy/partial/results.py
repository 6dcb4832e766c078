# SPDX-License-Identifier: GPL-3.0-or-later
"""Results as they were kept, put together over the people that were left out."""

from dataclasses import dataclass
from pathlib import Path

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
