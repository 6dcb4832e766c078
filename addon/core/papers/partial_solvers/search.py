# SPDX-License-Identifier: GPL-3.0-or-later
"""Which partial solvers make an ensemble: the paper's two greedy searches and its genetic search.

A subset of the markers is a whole number with one bit a marker. What is "good" is asked of a function, so that each
search can run once for the ensemble or once for every marker's own target: by the letter of algorithm 1 a solver is
done when any of its markers reaches its target, and then the one marker that is easiest to tell stops the search for
all others.
"""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass

import numpy as np

Good = Callable[[int], bool]


def members(subset: int) -> list[int]:
    """The markers of a subset, ascending."""
    return [marker for marker in range(subset.bit_length()) if subset >> marker & 1]


def subset_of(markers) -> int:
    """The subset of some markers."""
    return sum(1 << int(marker) for marker in set(markers))


def bottom_up(markers: int, good: Good, own: int | None = None) -> Iterator[tuple[int, set[int]]]:
    """Algorithm 1. Yields the size reached and the solvers found so far, after every size.

    own: start with this marker's solver only, instead of one a marker. What contains a solver already found is left
    out: by the paper's second property it answers less often and nothing else; the algorithm to the letter finds it
    again through its other parents.
    """
    waiting = {1 << own} if own is not None else {1 << marker for marker in range(markers)}
    found: set[int] = set()
    for size in range(1, markers + 1):
        reached = {solver for solver in waiting if good(solver)}
        found |= reached
        yield size, found
        grown = {solver | 1 << new for solver in waiting - reached for new in range(markers) if not solver >> new & 1}
        waiting = {solver for solver in grown if not any(other & solver == other for other in found)}


def top_down(markers: int, good: Good, own: int | None = None) -> Iterator[tuple[int, set[int]]]:
    """Algorithm 2. Yields the size reached and the solvers found so far, after every size.

    own: never remove this marker. A solver none of whose children is good joins the result, also when it has none.
    Nothing is found when the solver of all markers is not good itself.
    """
    waiting, found = {(1 << markers) - 1}, set()
    if not good((1 << markers) - 1):
        waiting = set()
    known: dict[int, bool] = {}
    for size in range(markers, 0, -1):
        below: set[int] = set()
        for solver in waiting:
            children = [solver & ~(1 << marker) for marker in members(solver) if marker != own]
            kept = [child for child in children if child and known.setdefault(child, good(child))]
            if not kept:
                found.add(solver)
            below.update(kept)
        waiting = below
        yield size, found


def covering(
    found: Iterable[int],
    holds: Good,
    heirs: Callable[[int], Iterable[int]],
    hidden: np.ndarray,
    most: int,
    min_gain: float,
) -> Iterator[set[int]]:
    """Of the solvers found, few that are enough: between them they answer in most of the occlusions `hidden` (N,).

    Takes what answers in the most occlusions that are still without an answer, the smaller of equals, until one more
    would gain less than the share `min_gain`, or there are `most`. A solver that does not hold when it is its turn
    makes room for its heirs. Yields those taken so far, after every step.
    """
    waiting = {subset: (hidden & subset) == 0 for subset in found}
    without = np.ones(len(hidden), dtype=bool)
    taken: set[int] = set()
    while waiting and len(taken) < most:
        gains = {subset: int((answers & without).sum()) for subset, answers in waiting.items()}
        best = min(waiting, key=lambda subset: (-gains[subset], subset.bit_count(), subset))
        if gains[best] < max(min_gain * len(hidden), 1):
            break
        answers = waiting.pop(best)
        if holds(best):
            taken.add(best)
            without &= ~answers
        else:
            waiting.update({heir: (hidden & heir) == 0 for heir in heirs(best) if heir not in waiting})
        yield taken
    yield taken


@dataclass(frozen=True)
class Genetics:
    """The genetic search's meta-parameters."""

    # chromosomes after each die-out; `results/partial_genetics.json` has eleven other settings of these four
    population: int = 48  # measured
    generations: int = 40  # measured: die-outs
    # share of the operations that are crossovers; the others are mutations, of each kind as many
    crossover: float = 0.5  # measured
    # share of the population that each die-out removes; as many operations come between two
    die_out: float = 0.25  # paper, 4.2


def crossover(one: np.ndarray, other: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """A child with every gene (M,) from either of its parents."""
    return np.where(generator.random(len(one)) < 0.5, one, other)


def permutation(parent: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """A child in which two genes of different values have changed places: as many markers, one of them another."""
    ones, zeros = np.flatnonzero(parent), np.flatnonzero(~parent)
    child = parent.copy()
    if len(ones) and len(zeros):
        child[generator.choice(ones)] = False
        child[generator.choice(zeros)] = True
    return child


def addition(parent: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """A child with one marker more; the parent itself when it has them all."""
    return _flipped(parent, np.flatnonzero(~parent), generator)


def subtraction(parent: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    """A child with one marker less; the parent itself when nothing would be left."""
    return _flipped(parent, np.flatnonzero(parent) if parent.sum() > 1 else np.empty(0, dtype=int), generator)


def _flipped(parent: np.ndarray, places: np.ndarray, generator: np.random.Generator) -> np.ndarray:
    child = parent.copy()
    if len(places):
        place = generator.choice(places)
        child[place] = not child[place]
    return child


MUTATIONS = (permutation, addition, subtraction)


def genetic(
    markers: int,
    fitness: Callable[[int], float],
    options: Genetics,
    generator: np.random.Generator,
    own: int | None = None,
) -> Iterator[tuple[float, list[int]]]:
    """The genetic search. Yields the mean fitness and the population, best first, after every die-out.

    fitness of a subset: its greatest hit rate, or that of its marker `own`, 0 to 1. Of equally fit ones the smaller is
    better. Two equal chromosomes are one solver, so the population is a set; the answer is all of the last one.
    """
    population: dict[int, float] = {}

    def born(genes: np.ndarray):
        genes = genes.copy()
        if own is not None:
            genes[own] = True
        subset = subset_of(np.flatnonzero(genes))
        if subset and subset not in population:
            population[subset] = fitness(subset)

    for _ in range(options.population):
        born(generator.random(markers) < 0.5)
    for _ in range(options.generations):
        for _ in range(round(options.population * options.die_out / (1.0 - options.die_out))):
            alive = list(population)
            if generator.random() < options.crossover:
                one, other = (_genes(alive[generator.integers(len(alive))], markers) for _ in range(2))
                born(crossover(one, other, generator))
            else:
                mutation = MUTATIONS[generator.integers(len(MUTATIONS))]
                born(mutation(_genes(alive[generator.integers(len(alive))], markers), generator))
        ranked = sorted(population, key=lambda subset: (-population[subset], subset.bit_count(), subset))
        survivors = ranked[: max(min(options.population, round(len(ranked) * (1.0 - options.die_out))), 1)]
        population = {subset: population[subset] for subset in survivors}
        yield float(np.mean(list(population.values()))), survivors


def _genes(subset: int, markers: int) -> np.ndarray:
    return np.array([bool(subset >> marker & 1) for marker in range(markers)])
