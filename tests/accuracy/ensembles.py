# SPDX-License-Identifier: GPL-3.0-or-later
"""Prints tables 2 to 5 and figure 5 of the partial-solvers paper, measured on the recorded people, and its claims.

python -m tests.accuracy.ensembles --quick              the paper's functions, two targets, one group left out
python -m tests.accuracy.ensembles                      all of it
python -m tests.accuracy.ensembles --plot figure5.png   also draws figure 5

"the paper's": the four functions of table 1. "and turn": with the one function more that a mirror changes.
"same": people both learned from and tested, as the paper did; "left out": tested people are in no training.
"""

import argparse
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from threadpoolctl import threadpool_limits

from addon.core.ensemble import search as searches
from addon.core.ensemble.features import tables
from addon.core.ensemble.label import Labeller
from addon.core.ensemble.masks import Masks
from addon.core.ensemble.model import FUNCTIONS, PAPER_FUNCTIONS, Ensemble
from addon.core.ensemble.search import Genetics
from addon.core.ensemble.solver import TreeSearch
from addon.core.ensemble.training import SEARCHES, Ground, Study, Training

from . import people
from .hidden import Score, hidden, score
from .tables import table

TARGETS = (0.99, 0.999, 0.9999, 0.99999)
HIDDEN = (1, 2, 3, 4, 5)
FRAMES = 16_384  # the paper's table 2
KINDS = {"the paper's": PAPER_FUNCTIONS, "and turn": FUNCTIONS}
NOTHING = Score(*np.zeros((5, len(people.GAIT15)), dtype=int))


@dataclass(frozen=True)
class Plan:
    """What to measure."""

    targets: tuple[float, ...]
    groups: int
    frames: int
    options: Training


def frames_of(persons=None) -> np.ndarray:
    """(T, 15, 3) all frames of some people, or of all."""
    return np.concatenate([take.pick(people.GAIT15) for take in people.takes(persons)])


def studied(frames: np.ndarray, options: Training) -> Study:
    """A study with its survey done."""
    study = Study(frames, options)
    for _ in study.survey():
        pass
    return study


def ensemble_of(study: Study, target: float) -> Ensemble:
    """The ensemble for one target."""
    steps = study.ensemble(people.GAIT15, target)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return end.value


def splits(plan: Plan, kind: str) -> Iterator[tuple[np.ndarray, np.ndarray]]:
    """Frames to learn from and frames to test on."""
    if kind == "same":
        yield frames_of(), frames_of()
        return
    for left_out in people.folds()[: plan.groups]:
        yield frames_of([person for person in people.everyone() if person not in left_out]), frames_of(left_out)


def grid(plan: Plan, kind: str) -> tuple[dict[tuple[float, int], Score], list[str]]:
    """Scores by target and number of hidden markers, and a word on each ensemble."""
    scores = {(target, hide): NOTHING for target in plan.targets for hide in HIDDEN}
    words = []
    for learned, tested in splits(plan, kind):
        began = time.process_time()
        study = studied(learned, plan.options)
        surveyed = time.process_time() - began
        for target in plan.targets:
            began = time.process_time()
            ensemble = ensemble_of(study, target)
            took = time.process_time() - began
            labeller = Labeller(ensemble)
            count = plan.frames // (1 if kind == "same" else plan.groups)
            for hide in HIDDEN:
                clouds = hidden(tested, count, hide, np.random.default_rng([hide, count]))
                scores[target, hide] += score(labeller(clouds.points)[0], clouds)
            words.append(
                f"{target:.3%}: {len(ensemble)} solvers, {int((ensemble.covered > 0).sum())} of 15 markers covered, "
                f"{surveyed:.0f} + {took:.0f} s"
            )
            print(f"    {kind}, {words[-1]}", file=sys.stderr, flush=True)
    return scores, words


def print_grids(plan: Plan, plot: str | None):
    """Tables 4 and 5, with the recall beside them, and table 3."""
    curves = {}
    for kind in ("same", "left out"):
        for name, functions in KINDS.items():
            scores, words = grid(replace(plan, options=replace(plan.options, functions=functions)), kind)
            curves[name, kind] = scores
            print(f"\n## Functions: {name}; people: {kind}\n\n" + "; ".join(words) + "\n")
            for title, figure in (
                ("Table 4, false assignments", lambda found: f"{found.false_assignments:.3%}"),
                ("Table 5, false occlusions", lambda found: f"{found.false_occlusions:.2%}"),
                ("Recall", lambda found: f"{found.recall:.2%}"),
            ):
                rows = [[hide, *(figure(scores[target, hide]) for target in plan.targets)] for hide in HIDDEN]
                print(f"{title}\n\n" + table(["hidden", *(f"{target:.3%}" for target in plan.targets)], rows) + "\n")
            if 0.9999 in plan.targets:
                print_markers(scores[0.9999, 4])
            sys.stdout.flush()
    if plot:
        draw(curves, plan, plot)


def print_markers(found: Score):
    """Table 3."""
    rows = [
        [
            name,
            found.wrong[at],
            _share(found.wrong[at], found.given[at]),
            found.missed[at],
            _share(found.missed[at], found.declared[at]),
            _share(found.given[at] - found.wrong[at], found.there[at]),
        ]
        for at, name in enumerate(people.GAIT15)
    ]
    pooled = [f"{part:.2%}" for part in (found.false_assignments, found.false_occlusions, found.recall)]
    rows.append(["pooled", found.wrong.sum(), pooled[0], found.missed.sum(), *pooled[1:]])
    print("Table 3 (99.99 %, 4 hidden)\n\n" + table(["marker", "FA #", "FA", "FO #", "FO", "recall"], rows) + "\n")


def _share(part, whole) -> str:
    return f"{part / whole:.2%}" if whole else "none"


def draw(curves: dict, plan: Plan, path: str):
    """Figure 5: a line for each number of hidden markers, a dot for each target."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, len(curves), figsize=(5 * len(curves), 4), sharey=True)
    for axis, ((name, kind), scores) in zip(np.atleast_1d(axes), curves.items(), strict=True):
        for hide in HIDDEN:
            dots = [scores[target, hide] for target in plan.targets]
            across = [max(100 * dot.false_assignments, 1e-3) for dot in dots]
            axis.plot(across, [100 * dot.false_occlusions for dot in dots], "o-", label=f"{hide} hidden")
        axis.set(xscale="log", xlabel="false assignments, %", title=f"{name}; {kind}")
    np.atleast_1d(axes)[0].set_ylabel("false occlusions, %")
    np.atleast_1d(axes)[0].legend()
    figure.tight_layout()
    figure.savefig(path, dpi=110)


def print_claims(plan: Plan):
    """What the paper says of partial solvers, asked of all 2^15 - 1 of them."""
    frames = frames_of()
    for name, functions in KINDS.items():
        study = studied(frames, replace(plan.options, functions=functions))
        rates = np.nan_to_num(study.surveyed[None].everything.rates)
        size = np.array([subset.bit_count() for subset in range(len(rates))])
        print(f"\n## Claims; functions: {name}\n")
        print_growth(rates)
        print_sizes(rates, size)
        print_full(study, frames)
        print_votes(study)
        print_searches(study, plan)


def print_full(study: Study, frames: np.ndarray):
    """B15: in how many whole frames the solver of all markers, with all weak classifiers, finds one labelling only."""
    cloud, chosen = TreeSearch(range(study.markers), study.pool)(Masks(tables(frames)))
    doubled = np.unique(cloud[(chosen != np.arange(study.markers)).any(axis=1)])
    print(f"B15, the solver of all markers: one labelling, the right one, in {len(frames) - len(doubled)} of "
          f"{len(frames)} frames ({1 - len(doubled) / len(frames):.3%})\n")  # fmt: skip


def print_growth(rates: np.ndarray):
    """B13: is a marker's rate in a subset never above that in the subset with one marker more?"""
    compared = violated = 0
    worst = 0.0
    subsets = np.arange(len(rates))
    for added in range(rates.shape[1]):
        without = subsets[(subsets >> added & 1) == 0]
        for marker in range(rates.shape[1]):
            own = without[(without >> marker & 1) == 1]
            fall = rates[own, marker] - rates[own | 1 << added, marker]
            compared += len(own)
            violated += int((fall > 0).sum())
            worst = max(worst, float(fall.max(initial=0.0)))
    print(f"B13, rates that fall when a marker is added: {violated} of {compared} ({violated / compared:.2%}), "
          f"by {worst:.2%} at most\n")  # fmt: skip


def print_sizes(rates: np.ndarray, size: np.ndarray):
    """B14: how many solvers of each size reach a target for some marker, and for all but SACR."""
    rows = [
        [count, int((size == count).sum())]
        + [int((rates[size == count].max(axis=1) >= target).sum()) for target in TARGETS[:3]]
        + [int((rates[size == count][:, 1:].max(axis=1) >= target).sum()) for target in TARGETS[:3]]
        for count in range(2, 16)
    ]
    columns = [f"{target:.2%}" for target in TARGETS[:3]]
    print("B14, solvers that reach a target for any marker; the same without SACR, which alone is in the middle\n")
    print(table(["markers", "solvers", *columns, *(f"{column}, not SACR" for column in columns)], rows) + "\n")


def print_votes(study: Study):
    """B30: how many weak classifiers can vote when markers are hidden."""
    rows = []
    for hide in range(11):
        seen = range(study.markers - hide)
        rows.append([hide, int(study.pool.within(seen).sum()), f"{study.pool.within(seen).mean():.1%}"])
    print("B30, weak classifiers that can vote\n\n" + table(["hidden", "voters", "of all"], rows) + "\n")


def searched(study: Study, reached: np.ndarray, way: str, genetics: Genetics, own: int, asked: set[int]) -> set[int]:
    """What one search finds for one marker; adds the solvers that it assessed to `asked`."""

    def good(subset: int) -> bool:
        asked.add(subset)
        return bool(reached[subset])

    def fitness(subset: int) -> float:
        asked.add(subset)
        return float(np.nan_to_num(study.record(subset).rates)[searches.members(subset).index(own)])

    if way == "genetic":
        *_, (_, population) = searches.genetic(study.markers, fitness, genetics, np.random.default_rng([1, own]), own)
        return {subset for subset in population if good(subset)}
    run = searches.bottom_up if way == "bottom-up" else searches.top_down
    *_, (_, found) = run(study.markers, good, own)
    return found


def locally_smallest(reached: np.ndarray, own: int) -> set[int]:
    """Good subsets that are good no more when any marker but `own` is taken away, out of all there are."""
    subsets = np.flatnonzero(reached)
    smaller = np.zeros(len(subsets), dtype=bool)
    for place in range(len(reached).bit_length() - 1):
        has = (subsets >> place & 1).astype(bool)
        smaller |= has & (place != own) & reached[subsets & ~(1 << place)]
    return {int(subset) for subset in subsets[~smaller]}


def print_searches(study: Study, plan: Plan):
    """B17 to B20: the three searches and the genetic one's meta-parameters, against all subsets."""
    flags = study.surveyed[None].everything.reaches(np.full(study.markers, 0.999))
    rows = []
    ways = {name: (name, study.options.genetics) for name in SEARCHES}
    usual = study.options.genetics
    for words, change in {
        "population 24": {"population": 24},
        "population 96": {"population": 96},
        "crossover 0.1": {"crossover": 0.1},
        "crossover 0.9": {"crossover": 0.9},
        "die-out 10 %": {"die_out": 0.1},
        "die-out 50 %": {"die_out": 0.5},
    }.items():
        ways[f"genetic, {words}"] = ("genetic", replace(usual, **change))
    for words, (way, genetics) in ways.items():
        began = time.process_time()
        asked: set[int] = set()
        kept = smallest = 0
        answered = []
        for own in range(study.markers):
            minimal = searches.without_supersets(searched(study, flags[:, own], way, genetics, own, asked))
            kept += len(minimal)
            smallest += len(minimal & locally_smallest(flags[:, own], own))
            hides = study.hidden(Ground(list(range(study.markers)), own))[:300]
            answered.append(np.mean([any(hide & subset == 0 for subset in minimal) for hide in hides]))
        spent = time.process_time() - began
        rows.append([words, len(asked), kept, smallest, f"{np.mean(answered):.1%}", f"{spent:.1f}"])
    columns = ["search", "solvers assessed", "kept", "locally smallest", "occlusions answered", "s"]
    print("B17 to B20, at 99.9 %, one run a marker; occlusions in which some solver of a marker is whole\n")
    print(table(columns, rows) + "\n")


def main() -> int:
    """Runs it."""
    parser = argparse.ArgumentParser(prog="python -m tests.accuracy.ensembles", description=__doc__.splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="two targets, one group of people left out, few frames")
    parser.add_argument("--groups", type=int, default=5, help="how many of the five groups of left-out people")
    parser.add_argument("--frames", type=int, default=FRAMES, help="test frames for each cell")
    parser.add_argument("--only", choices=["grids", "claims"])
    parser.add_argument("--plot", help="file for figure 5")
    given = parser.parse_args()
    if not people.available():
        print("the recorded people are not here; expected them in ../shared/data/people", file=sys.stderr)
        return 1
    plan = Plan(TARGETS, given.groups, given.frames, Training())
    if given.quick:
        plan = Plan((0.99, 0.9999), 1, 2048, replace(plan.options, survey_frames=64))
    with threadpool_limits(1, user_api="blas"):
        if given.only != "claims":
            print_grids(plan, given.plot)
        if given.only != "grids":
            print_claims(plan)
    return 0


if __name__ == "__main__":
    sys.exit(main())
