# SPDX-License-Identifier: GPL-3.0-or-later
"""What the paper says of partial solvers, asked of all 2^15 - 1 of them, and its searches compared."""

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from addon.core.papers.partial_solvers import search as searches
from addon.core.papers.partial_solvers.features import tables
from addon.core.papers.partial_solvers.masks import Masks
from addon.core.papers.partial_solvers.search import Genetics
from addon.core.papers.partial_solvers.solver import TreeSearch
from addon.core.papers.partial_solvers.training import Ground, SolverStudy, Training
from tests.core.papers.partial_solvers.plain import exhaustive, without_supersets

from .methods import HIDES, Faithful
from .studies import Test

TARGETS = (0.99, 0.999, 0.9999)
SEARCHED = 0.999
BUDGETS = (250, 1000, 4000, None)  # solvers that a search may assess, of the 2^14 with one marker; all of them
PATTERNS = 300
GENETICS = {
    "as used (population 48, 40 die-outs, crossover 0.5, 25 % die)": {},
    "population 12": {"population": 12},
    "population 24": {"population": 24},
    "population 96": {"population": 96},
    "population 192": {"population": 192},
    "10 die-outs": {"generations": 10},
    "160 die-outs": {"generations": 160},
    "crossover 0": {"crossover": 0.0},
    "crossover 0.1": {"crossover": 0.1},
    "crossover 0.9": {"crossover": 0.9},
    "10 % die": {"die_out": 0.1},
    "50 % die": {"die_out": 0.5},
}


def claims(method: Faithful, test: Test) -> dict:
    """All that follows, by the name of its table."""
    study = method.study
    record = study.surveyed[None].everything
    rates = np.nan_to_num(record.rates)
    return {
        "growth": growth(rates),
        "sizes": sizes(rates),
        "smallest": smallest(rates, record.answers, test.names),
        "voters": voters(study),
        "searches": compared(study),
        "genetics": sensitivity(study),
    }


def growth(rates: np.ndarray) -> list:
    """B13: rates compared with those after one more marker, those of them that fall, and the greatest fall."""
    compared_rates = violated = 0
    worst = 0.0
    subsets = np.arange(len(rates))
    for added in range(rates.shape[1]):
        without = subsets[(subsets >> added & 1) == 0]
        for marker in range(rates.shape[1]):
            own = without[(without >> marker & 1) == 1]
            fall = rates[own, marker] - rates[own | 1 << added, marker]
            compared_rates += len(own)
            violated += int((fall > 0).sum())
            worst = max(worst, float(fall.max(initial=0.0)))
    return [compared_rates, violated, worst]


def sizes(rates: np.ndarray) -> list[list]:
    """B13, B14: of each size the solvers, the mean rate, how many reach a target for any marker, the same for any but
    the first, which alone is in the middle of the body."""
    size = np.array([subset.bit_count() for subset in range(len(rates))])
    inside = (np.arange(len(rates))[:, None] >> np.arange(rates.shape[1]) & 1).astype(bool)
    rows = []
    for count in range(1, rates.shape[1] + 1):
        mine = rates[size == count]
        row = [count, len(mine), float(mine[inside[size == count]].mean())]
        row += [int((mine.max(axis=1) >= target).sum()) for target in TARGETS]
        rows.append(row + [int((mine[:, 1:].max(axis=1) >= target).sum()) for target in TARGETS])
    return rows


def smallest(rates: np.ndarray, answers: np.ndarray, names: tuple[str, ...], least_answers: int = 100) -> list[list]:
    """B14: for each marker the smallest solver that reaches the paper's target, the one of them that answers most."""
    rows = []
    for marker, name in enumerate(names):
        good = np.flatnonzero((rates[:, marker] >= 0.9999) & (answers[:, marker] >= least_answers))
        if len(good):
            best = min((int(subset) for subset in good), key=lambda at: (at.bit_count(), -int(answers[at, marker])))
            members = [names[member] for member in searches.members(best)]
            rows.append([name, len(members), " ".join(members), float(rates[best, marker])])
        else:
            rows.append([name, 0, "", float(rates[:, marker].max())])
    return rows


def optimal(frames: np.ndarray, options: Training) -> list[int]:
    """B15: whole frames, and those in which the solver of all markers finds one labelling only, the right one."""
    study, whole = SolverStudy(frames, options), frames[np.isfinite(frames).all(axis=(1, 2))]
    cloud, chosen = TreeSearch(range(study.markers), study.pool)(Masks(tables(whole)))
    doubled = np.unique(cloud[(chosen != np.arange(study.markers)).any(axis=1)])
    return [len(whole), len(whole) - len(doubled)]


def voters(study: SolverStudy) -> list[list]:
    """B30: hidden markers, weak classifiers that can still vote, and their share."""
    rows = []
    for hide in HIDES:
        mine = study.pool.within(range(study.markers - hide))
        rows.append([hide, int(mine.sum()), float(mine.mean())])
    return rows


class Purse:
    """Answers what a search asks of a subset until its budget of different subsets is spent, then refuses."""

    def __init__(self, flags: np.ndarray, rates: np.ndarray, budget: int | None):
        self._flags, self._rates, self._budget = flags, rates, budget
        self.asked: set[int] = set()

    def _may(self, subset: int) -> bool:
        if subset in self.asked:
            return True
        if self._budget is not None and len(self.asked) >= self._budget:
            return False
        self.asked.add(subset)
        return True

    def good(self, subset: int) -> bool:
        """Whether the marker's target is reached; never once the budget is spent."""
        return self._may(subset) and bool(self._flags[subset])

    def fitness(self, subset: int) -> float:
        """The marker's hit rate; 0 once the budget is spent."""
        return float(self._rates[subset]) if self._may(subset) else 0.0


def by_greed(run: Callable) -> Callable:
    """A greedy search as `compared` asks for it."""

    def found(markers: int, own: int, purse: Purse, _: Genetics) -> set[int]:
        *_, (_, solvers) = run(markers, purse.good, own)
        return {solver for solver in solvers if purse.good(solver)}

    return found


def by_genetics(markers: int, own: int, purse: Purse, options: Genetics) -> set[int]:
    """The genetic search as `compared` asks for it."""
    *_, (_, population) = searches.genetic(markers, purse.fitness, options, np.random.default_rng([1, own]), own)
    return {solver for solver in population if purse.good(solver)}


def by_trying_all(markers: int, own: int, purse: Purse, _: Genetics) -> set[int]:
    """Every subset, the small ones first."""
    return exhaustive(markers, purse.good, own)


WAYS = {
    "bottom-up": by_greed(searches.bottom_up),
    "top-down": by_greed(searches.top_down),
    "genetic": by_genetics,
    "exhaustive": by_trying_all,
}


def compared(study: SolverStudy) -> list[list]:
    """B17 to B19, B34: search, budget, solvers assessed, kept, their mean size, occlusions answered, s; all markers."""
    rows = []
    for budget in BUDGETS:
        options = study.options.genetics
        if budget is not None:  # as long as the others may go on
            options = replace(options, generations=max(round(budget / options.population * 3), 1))
        rows += [[way, budget, *searched(study, run, budget, options)] for way, run in WAYS.items()]
    return rows


def sensitivity(study: SolverStudy) -> list[list]:
    """B20: the genetic search's meta-parameters, and the same columns as `compared`."""
    usual = study.options.genetics
    return [
        [words, *searched(study, by_genetics, None, replace(usual, **change))] for words, change in GENETICS.items()
    ]


def searched(study: SolverStudy, run: Callable, budget: int | None, genetics: Genetics) -> list:
    """Solvers assessed, kept, their mean size, share of occlusions in which one of a marker's is whole, seconds."""
    everything = study.surveyed[None].everything
    flags = everything.reaches(np.full(study.markers, SEARCHED))
    rates = np.nan_to_num(everything.rates)
    began = time.process_time()
    assessed, sized, answered = 0, [], []
    for own in range(study.markers):
        purse = Purse(flags[:, own], rates[:, own], budget)
        minimal = without_supersets(run(study.markers, own, purse, genetics))
        assessed += len(purse.asked)
        sized += [subset.bit_count() for subset in minimal]
        hides = study.hidden(Ground(list(range(study.markers)), own))[:PATTERNS]
        answered.append(np.mean([any(hide & subset == 0 for subset in minimal) for hide in hides]))
    mean = float(np.mean(sized)) if sized else 0.0
    return [assessed, len(sized), mean, float(np.mean(answered)), time.process_time() - began]
