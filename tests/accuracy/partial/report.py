# SPDX-License-Identifier: GPL-3.0-or-later
"""The results as Markdown, one block for each part of the page, put together over the people that were left out."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from scripts.results import markdown

from .. import people
from .clouds import Score
from .measuring import HIDDEN, SAME, TABLE_2, TARGETS, read

LEFT_OUT = "left out"
# The paper's tables 3, 4 and 5, per cent.
PAPER_FA = ((8.13, 1.12, 0.09, 0.04), (8.89, 0.94, 0.09, 0.05), (7.04, 0.58, 0.07, 0.02), (4.28, 0.34, 0.02, 0.01),
            (2.35, 0.16, 0.01, 0.00))  # fmt: skip
PAPER_FO = ((0.25, 0.52, 12.10, 16.40), (5.74, 14.30, 19.96, 21.76), (9.56, 19.76, 25.18, 26.20),
            (13.16, 24.35, 30.90, 32.17), (18.25, 33.39, 39.65, 40.67))  # fmt: skip
PAPER_MARKERS = {
    "SACR": (0.00, 6.11), "RASI": (0.02, 6.38), "LASI": (0.02, 5.55), "RTHI": (0.00, 45.03), "LTHI": (0.01, 4.85),
    "RKNE": (0.00, 30.03), "LKNE": (0.01, 44.58), "RTIB": (0.01, 4.20), "LTIB": (0.03, 4.71), "RANK": (0.03, 34.02),
    "LANK": (0.01, 49.30), "RHEE": (0.05, 42.14), "LHEE": (0.01, 45.06), "RTOE": (0.04, 34.67), "LTOE": (0.05, 45.13),
}  # fmt: skip
PAPER_POOLED = (0.02, 31.16)
PAPER = "the paper, as printed"


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

    def parts(self, column: Column, study: str) -> dict[str, dict]:
        """What a study found, by the people who were tested."""
        mine = self._found.get(column.method, {})
        return {
            split: found[study]
            for split, found in mine.items()
            if study in found and (split == SAME) == (column.people == SAME)
        }

    def with_study(self, study: str) -> list[tuple[Column, dict]]:
        """The columns in which the study was run, with what it found, counts added up over people."""
        parts = [(column, list(self.parts(column, study).values())) for column in COLUMNS]
        return [(column, added(found)) for column, found in parts if found]

    def people(self, column: Column) -> str:
        """How many people were tested in how many groups."""
        groups = list(self.parts(column, "grid"))
        if column.people == SAME:
            return "all people in both"
        count = sum(len(group.split("+")) for group in groups)
        return f"{count} people left out, {len(groups)} trainings"


def added(parts: list):
    """Results of a study together: numbers added wherever they stand."""
    if isinstance(parts[0], dict):
        return {key: added([part[key] for part in parts]) for key in parts[0] if all(key in part for part in parts)}
    if isinstance(parts[0], list):
        return [added(list(some)) for some in zip(*parts, strict=True)]
    return sum(parts)


def over(counts: dict, target: str) -> Score:
    """The score at one target, added up over all conditions of {condition: {target: counts}}."""
    return Score.of(added([by_target[target] for by_target in counts.values()]))


def percent(share: float, digits: int = 2) -> str:
    """A share in per cent."""
    return f"{100 * share:.{digits}f} %"


def rate(target: float | str) -> str:
    """A target rate in per cent without trailing zeros."""
    return f"{100 * float(target):.4f}".rstrip("0").rstrip(".") + " %"


def conditions(results: Results) -> str:
    """Table 2, and whose frames they are."""
    takes = people.takes()
    tested = [(column, counts) for column, counts in results.with_study("grid")]
    clouds = {column: _clouds(counts[str(TABLE_2)]) for column, counts in tested}
    rows = [
        ["people", "14, of diverse ages and body shapes", f"{len(people.WALKERS)}, children to adults"],
        ["sequences", "70, about 3 s, walking", f"{len(takes)}: {', '.join(people.KINDS)}, one each a person"],
        ["frames, rate", "more than 20,000 at 100 Hz", f"{sum(len(take.xyz) for take in takes)} at 100 Hz"],
        ["markers", "15, Helen Hayes lower body", f"{len(people.GAIT15)}, the same set (`gait15`)"],
        ["cameras", "6 of 800 × 800 px", "those of the recordings"],
        ["tested people", "the same as trained on", "both: the same, and people left out"],
        ["target hit rate, target failure rate", "99.99 %, 0.01 %", "99.99 %, 0.01 %"],
        ["occlusions a frame", "4", str(TABLE_2)],
        ["test frames", "16,384", "; ".join(f"{column.title}: {count}" for column, count in clouds.items())],
    ]
    words = [f"- {column.title}: {results.people(column)}" for column, _ in tested]
    return markdown(["condition", "the paper (table 2, section 5)", "here"], rows) + "\n\n" + "\n".join(words)


def _clouds(by_target: dict) -> int:
    found = Score.of(next(iter(by_target.values())))
    return int((found.given + found.declared).max())


def table3(results: Results) -> str:
    """FA and FO by marker at 99.99 % and four hidden."""
    columns = [(column, Score.of(counts[str(TABLE_2)]["0.9999"])) for column, counts in results.with_study("grid")]
    rows = []
    for at, name in enumerate(people.GAIT15):
        row = [name, *(f"{value:.2f} %" for value in PAPER_MARKERS[name])]
        for _, found in columns:
            row += [_share(found.wrong[at], found.given[at]), _share(found.missed[at], found.declared[at])]
        rows.append(row)
    pooled = ["all", *(f"{value:.2f} %" for value in PAPER_POOLED)]
    for _, found in columns:
        pooled += [percent(found.false_assignments, 3), percent(found.false_occlusions)]
    titles = [PAPER, *(column.title for column, _ in columns)]
    return markdown(["marker", *(f"{title}: {part}" for title in titles for part in ("FA", "FO"))], [*rows, pooled])


def _share(part, whole) -> str:
    return percent(part / whole) if whole else "no label"


def _grid(results: Results, printed, figure: Callable[[Score], str]) -> str:
    rows = []
    for at, hide in enumerate(HIDDEN):
        if printed:
            rows.append([hide, PAPER, *(f"{value:.2f} %" for value in printed[at])])
        for column, counts in results.with_study("grid"):
            found = counts[str(hide)]
            cells = [figure(Score.of(found[str(target)])) if str(target) in found else "" for target in TARGETS]
            rows.append([hide, column.title, *cells])
    return markdown(["hidden", "method, people", *map(rate, TARGETS)], rows)


def table4(results: Results) -> str:
    """False assignments by hidden markers and target."""
    return _grid(results, PAPER_FA, lambda found: percent(found.false_assignments, 3))


def table5(results: Results) -> str:
    """False occlusions by hidden markers and target."""
    return _grid(results, PAPER_FO, lambda found: percent(found.false_occlusions))


def recall(results: Results) -> str:
    """Recall, which the paper does not print, by hidden markers and target."""
    return _grid(results, None, lambda found: percent(found.recall))


def cover(results: Results) -> str:
    """B16: whether the ensembles' solvers have all markers between them, and for which they reach the target."""
    rows = []
    for column, counts in results.with_study("cover"):
        for target, (members, reached) in counts.items():
            alone = [name for name, count in zip(people.GAIT15, reached, strict=True) if count]
            words = f"{len(alone)} of {len(reached)}"
            named = words if len(alone) in (0, len(reached)) else f"{words}: {' '.join(alone)}"
            joined = f"{np.count_nonzero(members)} of {len(members)}"
            rows.append([column.title, rate(target), joined, _range(members), named, _range(reached)])
    names = ["functions", "target", "markers in any solver", "solvers a marker is in"]
    return markdown([*names, "markers for which one reaches the target", "solvers that do, a marker"], rows)


def asked(results: Results) -> str:
    """The rate asked for and the share of wrong labels that one gets."""
    rows = []
    for column, counts in results.with_study("grid"):
        for target in sorted(next(iter(counts.values())), key=float):
            found = [Score.of(by_target[target]) for by_target in counts.values()]
            pooled = over(counts, target)
            wrong = [score.false_assignments for score in found]
            rows.append(
                [column.title, rate(target), percent(1 - float(target), 3), percent(pooled.false_assignments, 3),
                 f"{percent(min(wrong), 3)} to {percent(max(wrong), 3)}", percent(pooled.recall)]
            )  # fmt: skip
    names = ["method, people", "asked", "wrong allowed", "wrong measured, 0 to 5 hidden"]
    names += ["least to most hidden", "recall"]
    return markdown(names, rows)


def _range(values: list[int]) -> str:
    return str(min(values)) if min(values) == max(values) else f"{min(values)} to {max(values)}"


BLOCKS: dict[str, Callable[[Results], str]] = {
    "conditions": conditions, "table3": table3, "table4": table4, "table5": table5,
    "recall": recall, "asked": asked, "cover": cover,
}  # fmt: skip
