# SPDX-License-Identifier: GPL-3.0-or-later
"""The results as Markdown, one block for each part of the replication page."""

from collections.abc import Callable

import numpy as np

from .. import people
from ..tables import table
from .results import COLUMNS, LEFT_OUT, Column, Results, best_at, chosen_on_others, over
from .running import SAME
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
MOST_WRONG = 0.0005
PRINTED_NONE = 0.00005
ASKED_ELSEWHERE = ("0.99", "0.999", "0.9999")
OURS = Column("ours", LEFT_OUT, "ours, left out")
MIDDLE = ("0.999", "0.9999")
ASKED = "0.999"


def percent(share: float, digits: int = 2) -> str:
    """A share in per cent."""
    return f"{100 * share:.{digits}f} %"


def rate(target: float | str) -> str:
    """A target rate in per cent without trailing zeros."""
    return f"{100 * float(target):.4f}".rstrip("0").rstrip(".") + " %"


def _cells(found: Score) -> list[str]:
    return [percent(found.false_assignments, 3), percent(found.false_occlusions), percent(found.recall)]


def aims(results: Results) -> str:
    """The figures that the project set itself for 3D points, as measured; people left out, frames independent."""
    grid, swept = results.pooled(OURS, "grid"), results.pooled(OURS, "curve")
    body, elsewhere = results.pooled(OURS, "body26"), results.pooled(OURS, "lab")
    learned = [fact["training"] for fact in results.parts(OURS, "facts").values()]
    lines = [
        ("`gait15`, 4 of 15 hidden, no ghosts: FA / FO", "0.05 % / 6 %", "0.02 % / 1 %", "0.02 % / 31.16 %",
         grid and swept and f"{_asked(grid[str(TABLE_2)])}; {_swept(swept, TABLE_2)}"),
        ("`gait15`, 1 and 5 hidden: FO at FA ≤ 0.05 %", "2 %, 10 %", "0.5 %, 2 %", "12.1 %, 39.7 %",
         swept and f"1 hidden: {_swept(swept, 1)}; 5 hidden: {_swept(swept, 5)}"),
        ("`body26`, up to 5 hidden and 3 ghosts: F1, FA", "98.5 %, 0.3 %", "99.9 %, 0.05 %", "not tried",
         body and _f1_and_wrong(Score.of(body[ASKED]))),
        ("target rate asked 99.9 %: wrong labels on unseen people", "0.03–0.3 %", "0.07–0.13 %", "0.16–1.12 %",
         grid and _wrong_when_asked(grid)),
        ("the same people in a lab whose tibia and heel markers sit elsewhere, asked 99.9 %: FA, recall",
         "no collapse", "as above", "not tried", elsewhere and "; ".join(
             f"{hide} hidden: {percent(found.false_assignments, 3)}, {percent(found.recall)}"
             for hide, found in ((hide, Score.of(counts[ASKED])) for hide, counts in elsewhere.items()))),
        ("training `gait15` on all people but those left out, one core", "2 min", "20 s", '"several hours"',
         learned and _seconds(learned)),
        ("labelling, one core: `gait15` / `body26` with ghosts / 62 markers, frames a second", "1,000 / 300 / 100",
         "5,000 / 2,000 / 500", '"real time"', results.speed and _speeds(results.speed["rows"])),
    ]  # fmt: skip
    return table(["what", "floor", "aim", "the paper", "measured"], [[*line[:4], line[4] or ""] for line in lines])


def _asked(counts: dict) -> str:
    found = Score.of(counts[ASKED])
    return f"asked {rate(ASKED)}: {percent(found.false_assignments, 3)} / {percent(found.false_occlusions)}"


def _swept(swept: dict, hide: int) -> str:
    best = best_at(swept[str(hide)], MOST_WRONG)
    words = "with the confidence chosen on the tested people FO"
    return f"{words} {percent(best[1])} at FA {percent(best[0], 3)}" if best else "no confidence is so sure"


def _f1_and_wrong(found: Score) -> str:
    return f"asked {rate(ASKED)}: {percent(found.f1)}, {percent(found.false_assignments, 3)}"


def _wrong_when_asked(counts: dict) -> str:
    wrong = [Score.of(by_target[ASKED]).false_assignments for by_target in counts.values()]
    pooled = over(counts, float(ASKED)).false_assignments
    return f"{percent(pooled, 3)} over 0 to 5 hidden; {percent(min(wrong), 3)} to {percent(max(wrong), 3)} each"


def _speeds(rows: list[list]) -> str:
    rates = {(method, markers.split()[0], hide, ghost): one for method, markers, hide, ghost, one, *_ in rows}
    wanted = [("gait15", 0, 0), ("body26", 5, 3), ("62", 0, 0)]
    return " / ".join(f"{rates[key]:,.0f}" if (key := ("ours", *case)) in rates else "none" for case in wanted)


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


def sweep(results: Results) -> str:
    """Our false occlusions where the confidence is chosen so that false assignments stay under a limit."""
    parts, counts = results.parts(OURS, "curve"), results.pooled(OURS, "curve")
    if not counts:
        return "not measured"
    rows = []
    for hide in HIDDEN:
        pairs = best_at(counts[str(hide)], MOST_WRONG), chosen_on_others(parts, hide, MOST_WRONG)
        cheapest = min(zip(PAPER_FA[hide - 1], PAPER_FO[hide - 1], strict=True), key=lambda pair: pair[0])
        rows.append(
            [hide, *(cell for pair in pairs for cell in _pair(pair)), *(f"{value:.2f} %" for value in cheapest)]
        )
    columns = ["hidden", "chosen on the tested people: FA", "FO", "chosen on the other people: FA", "FO"]
    return table([*columns, "the paper's least FA", "the paper's FO there"], rows)


def _pair(rates: tuple[float, float] | None) -> list[str]:
    return [percent(rates[0], 3), percent(rates[1])] if rates else ["no confidence is so sure", ""]


def equal(results: Results) -> str:
    """B28: our false occlusions in each cell of tables 4 and 5, where the others' false assignments are the paper's."""
    parts = results.parts(OURS, "curve")
    if len(parts) < 2:
        return "not measured"
    rows = []
    for hide in HIDDEN:
        for target, wrong, missed in zip(TARGETS, PAPER_FA[hide - 1], PAPER_FO[hide - 1], strict=True):
            # Printed to a hundredth of a per cent: 0.00 is less than half of one.
            pair = chosen_on_others(parts, hide, wrong / 100 if wrong else PRINTED_NONE)
            rows.append([hide, rate(target), f"{wrong:.2f} %", f"{missed:.2f} %", *_pair(pair)])
    return table(["hidden", "target", "the paper: FA", "FO", "ours, left out: FA", "FO"], rows)


def elsewhere(results: Results) -> str:
    """The rate asked for and the rate got where clouds or people are not like those that were learned from."""
    cases = []
    for count in ("0", "1", "3", "5", "10"):
        words = "nothing else" if count == "0" else f"{count} ghost{'s' * (count != '1')}"
        cases.append((f"`gait15`, others' model, {TABLE_2} hidden, {words}", results.pooled(OURS, "ghosts"), count))
    for hide in ("0", str(TABLE_2)):
        words = f"`gait15`, tibia and heel markers moved, {hide} hidden"
        cases.append((words, results.pooled(OURS, "lab"), hide))
    serves = results.pooled(Column("ours", SAME, ""), "elsewhere") or {}
    for name, counts in serves.items():
        cases += [
            (f"`{name}`, a tennis serve of another lab without SACR, {hide} hidden", counts, hide) for hide in counts
        ]
    for learned, counts in (results.pooled(OURS, "few") or {}).items():
        whose = {"1": "one person in one take"}.get(learned, f"{learned} people")
        cases += [(f"`gait15`, learned from {whose}, {hide} hidden", counts, hide) for hide in counts]
    rows = []
    for words, counts, condition in cases:
        found = [Score.of(counts[condition][target]) for target in ASKED_ELSEWHERE] if counts else []
        rows.append(
            [words, *(cell for one in found for cell in (percent(one.false_assignments, 3), percent(one.recall)))]
        )
    names = [f"{100 - 100 * float(target):.2g} % wrong asked: got" for target in ASKED_ELSEWHERE]
    return table(
        ["clouds", *(cell for name in names for cell in (name, "recall"))], [row for row in rows if len(row) > 1]
    )


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


def _conditioned(results: Results, study: str, title: str, shown: Callable[[str], str]) -> str:
    rows = []
    for column, counts in results.with_study(study):
        if column.people == SAME:
            continue
        for condition, by_target in counts.items():
            row = [column.title, shown(condition)]
            for target in MIDDLE:
                row += _cells(Score.of(by_target[target])) if target in by_target else ["", "", ""]
            rows.append(row)
    parts = [f"{rate(target)}: {part}" for target in MIDDLE for part in ("FA", "FO", "recall")]
    return table(["method, people", title, *parts], rows)


def ghosts(results: Results) -> str:
    """Points of no marker."""
    return _conditioned(results, "ghosts", "ghosts", str)


def noise(results: Results) -> str:
    """Every coordinate off at random."""
    return _conditioned(results, "noise", "noise, mm", lambda sigma: f"{1000 * float(sigma):g}")


def lab(results: Results) -> str:
    """Markers that sit elsewhere than in training."""
    return _conditioned(results, "lab", "hidden", str)


def swaps(results: Results) -> str:
    """How often a whole frame or a part of it is named the wrong way round."""
    rows = []
    for column, counts in results.with_study("mirror"):
        for hide, by_target in counts["swaps"].items():
            for target in ("0.99", *MIDDLE):
                if target in by_target:
                    sided, whole, limb, wrong, mirrored = by_target[target]
                    cells = [_of(whole, sided), _of(limb, sided), _of(mirrored, wrong)]
                    rows.append([column.title, hide, rate(target), sided, *cells])
    names = ["method, people", "hidden", "target", "frames with a left or right label", "of them wholly swapped"]
    return table([*names, "partly swapped", "swaps among the wrong labels"], rows)


def _of(part: int, whole: int) -> str:
    return f"{part} of {whole} ({100 * part / whole:.2f} %)" if whole else "none"


def mirrored(results: Results) -> str:
    """What becomes of a cloud in a mirror."""
    rows = []
    for column, counts in results.with_study("mirror"):
        for hide, by_target in counts["mirrored"].items():
            for target in ("0.99", *MIDDLE):
                if target in by_target:
                    plain, given, right, same = by_target[target]
                    cells = [plain, given, _of(same, given), _of(right, given)]
                    rows.append([column.title, hide, rate(target), *cells])
    names = ["method, people", "hidden", "target", "labels, plain", "labels, in the mirror"]
    return table([*names, "the plain cloud's names", "right for the person in the mirror"], rows)


def crowd(results: Results) -> str:
    """Two people in one cloud."""
    rows = []
    for column, counts in results.with_study("crowd"):
        for target in MIDDLE:
            if target in counts:
                given, wrong, both, clouds = counts[target]
                cells = [f"{given / clouds:.2f}", _of(wrong, given), _of(both, clouds)]
                rows.append([column.title, rate(target), *cells])
    return table(["method, people", "target", "labels a frame", "wrong marker", "frames with labels on both"], rows)


def whole_body(results: Results) -> str:
    """body26 with up to five markers hidden and three ghosts."""
    counts = results.pooled(OURS, "body26")
    if not counts:
        return "not measured"
    rows = []
    for target, lists in counts.items():
        found = Score.of(lists)
        rows.append([rate(target), percent(found.f1), *_cells(found)])
    return table(["target", "F1", "FA", "FO", "recall"], rows)


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


def searches(results: Results) -> str:
    """The searches at equal cost."""
    rows = []
    for column, found in results.with_study("solvers"):
        for way, budget, *figures in found["searches"]:
            rows.append([column.title, budget or "no limit", way, *_search_cells(figures)])
    names = ["functions", "solvers that may be assessed for a marker", "search", "assessed", "kept", "mean size"]
    return table([*names, "occlusions answered", "s"], rows)


def genetics(results: Results) -> str:
    """The genetic search's meta-parameters."""
    rows = []
    for column, found in results.with_study("solvers"):
        rows += [[column.title, words, *_search_cells(figures)] for words, *figures in found["genetics"]]
    return table(["functions", "changed", "assessed", "kept", "mean size", "occlusions answered", "s"], rows)


def _search_cells(figures: list) -> list[str]:
    assessed, kept, size, answered, seconds = figures
    return [f"{assessed:,}", str(kept), f"{size:.1f}", percent(answered, 1), f"{seconds:.1f}"]


BLOCKS: dict[str, Callable[[Results], str]] = {
    "aims": aims,
    "conditions": conditions,
    "table3": table3,
    "table4": table4,
    "table5": table5,
    "recall": recall,
    "sweep": sweep,
    "equal": equal,
    "asked": asked,
    "whole-body": whole_body,
    "elsewhere": elsewhere,
    "lab": lab,
    "ghosts": ghosts,
    "noise": noise,
    "swaps": swaps,
    "mirrored": mirrored,
    "crowd": crowd,
    "training": training,
    "speed": speed,
    "solvers": solvers,
    "optimal": optimal,
    "voters": voters,
    "searches": searches,
    "genetics": genetics,
    "cover": cover,
}
