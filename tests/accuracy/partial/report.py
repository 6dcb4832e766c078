# SPDX-License-Identifier: GPL-3.0-or-later
"""The results as Markdown, one block for each part of the replication page."""

from collections.abc import Callable

import numpy as np

from .. import people
from ..tables import table
from .results import COLUMNS, Results, over
from .scores import Score
from .studies import HIDDEN, TABLE_2, TARGETS

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
        ["people", "14, of diverse ages and body shapes", f"{len(people.everyone())}, children to adults"],
        ["sequences", "70, about 3 s, walking", f"{len(takes)}: {', '.join(people.KINDS)}, one each a person"],
        ["frames, rate", "more than 20,000 at 100 Hz", f"{sum(len(take.xyz) for take in takes)} at 100 Hz"],
        ["markers", "15, Helen Hayes lower body", f"{len(people.GAIT15)}, the same set (`gait15`)"],
        ["cameras", "6 of 800 × 800 px", "those of the recordings"],
        ["tested people", "the same as trained on", "both: the same, and people left out"],
        ["target hit rate, target failure rate", "99.99 %, 0.01 %", "99.99 %, 0.01 %"],
        ["occlusions a frame", "4", str(TABLE_2)],
        ["test frames", "16,384", "; ".join(f"{column.title}: {count}" for column, count in clouds.items())],
    ]
    words = [f"- {column.title}: {results.people(column, 'grid')}" for column, _ in tested]
    return table(["condition", "the paper (table 2, section 5)", "here"], rows) + "\n\n" + "\n".join(words)


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
    return table(["marker", *(f"{title}: {part}" for title in titles for part in ("FA", "FO"))], [*rows, pooled])


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
    return table(["hidden", "method, people", *map(rate, TARGETS)], rows)


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
    return table([*names, "markers for which one reaches the target", "solvers that do, a marker"], rows)


def asked(results: Results) -> str:
    """The rate asked for and the share of wrong labels that one gets."""
    rows = []
    for column, counts in results.with_study("grid"):
        for target in sorted(next(iter(counts.values())), key=float):
            found = [Score.of(by_target[target]) for by_target in counts.values()]
            pooled = over(counts, float(target))
            wrong = [score.false_assignments for score in found]
            rows.append(
                [column.title, rate(target), percent(1 - float(target), 3), percent(pooled.false_assignments, 3),
                 f"{percent(min(wrong), 3)} to {percent(max(wrong), 3)}", percent(pooled.recall)]
            )  # fmt: skip
    names = [
        "method, people",
        "asked",
        "wrong allowed",
        "wrong measured, 0 to 5 hidden",
        "least to most hidden",
        "recall",
    ]
    return table(names, rows)


def _of(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100 * part / whole:.2f} %)" if whole else "none"


def training(results: Results) -> str:
    """How long training took."""
    rows = []
    for column in COLUMNS:
        facts = list(results.parts(column, "facts").values())
        if not facts:
            continue
        if column.method == "ours":
            seconds = [fact["training"] for fact in facts]
            rows.append([column.title, "all", len(facts), _seconds(seconds), ""])
            continue
        for target in TARGETS:
            mine = [(fact["survey"], fact["ensembles"].get(str(target))) for fact in facts if "survey" in fact]
            mine = [(survey, partial_solvers) for survey, partial_solvers in mine if partial_solvers]
            if mine:
                sizes = [len(partial_solvers["sizes"]) for _, partial_solvers in mine]
                covered = [sum(partial_solvers["covered"]) for _, partial_solvers in mine]
                seconds = [survey + partial_solvers["seconds"] for survey, partial_solvers in mine]
                words = f"{_range(sizes)} solvers; {_range(covered)} of 15 markers reach the target"
                rows.append([column.title, rate(target), len(mine), _seconds(seconds), words])
    return table(["method, people", "target", "trainings", "processor time", "ensemble"], rows)


def _seconds(seconds: list[float]) -> str:
    return f"{np.median(seconds):.0f} s ({min(seconds):.0f} to {max(seconds):.0f})"


def _range(values: list[int]) -> str:
    return str(min(values)) if min(values) == max(values) else f"{min(values)} to {max(values)}"


def speed(results: Results) -> str:
    """Frames a second and delays."""
    if not results.speed:
        return "not measured"
    rows = [
        [method, markers, hide, ghost, f"{rate_:.0f}", f"{middle:.2f} ms", f"{late:.2f} ms"]
        for method, markers, hide, ghost, rate_, middle, late in results.speed["rows"]
    ]
    names = ["method", "markers", "hidden", "ghosts", "frames a second", "one frame alone, median", "99th percentile"]
    return f"Load {results.speed['load']:.1f} when done.\n\n" + table(names, rows)


def solvers(results: Results) -> str:
    """Hit rates of all solvers: growth with size, and small solvers."""
    parts = []
    for column, found in results.with_study("solvers"):
        grown, fallen, worst = found["growth"]
        parts.append(
            f"**{column.title}.** Adding a marker to a solver, {grown:,} comparisons of a hit rate before and after: "
            f"it falls in {fallen:,} ({percent(fallen / grown)}), by {percent(worst)} at most."
        )
        rows = [[size, count, percent(mean), *reached] for size, count, mean, *reached in found["sizes"]]
        names = [f"any marker at {rate(target)}" for target in (0.99, 0.999, 0.9999)]
        columns = ["markers in the solver", "solvers", "mean hit rate", *names]
        parts.append(table([*columns, *(f"{name}, SACR aside" for name in names)], rows))
        rows = [[name, size or "none", members, percent(best)] for name, size, members, best in found["smallest"]]
        parts.append(
            table(["marker", "fewest markers at 99.99 %", "which", "hit rate there, or the best of all"], rows)
        )
    return "\n\n".join(parts)


def optimal(results: Results) -> str:
    """Whether the marker sets are what the paper calls optimally designed."""
    rows = [
        [column.title, name, _of(right, frames)]
        for column, found in results.with_study("optimal")
        for name, (frames, right) in found.items()
    ]
    return table(["functions", "markers", "whole frames with one labelling, the right one"], rows)


def voters(results: Results) -> str:
    """What is left to vote when markers are hidden."""
    found = results.with_study("solvers")
    if not found:
        return "not measured"
    titles, series = [], []
    for column, claims in found:
        titles.append(f"weak classifiers, {column.title}")
        series.append([f"{count} ({percent(share, 1)})" for _, count, share in claims["voters"]])
        alive = results.pooled(column, "facts")["ensembles"]["0.9999"]["alive"]
        titles += [f"whole solvers of the ensemble, {column.title}", f"markers still named, {column.title}"]
        series += [[percent(row[place], 1) for row in alive] for place in (0, 1)]
    rows = [[hide, *(one[hide] for one in series)] for hide in range(len(series[0]))]
    return table(["hidden", *titles], rows)


BLOCKS: dict[str, Callable[[Results], str]] = {
    "conditions": conditions,
    "table3": table3,
    "table4": table4,
    "table5": table5,
    "recall": recall,
    "asked": asked,
    "training": training,
    "speed": speed,
    "solvers": solvers,
    "optimal": optimal,
    "voters": voters,
    "cover": cover,
}
