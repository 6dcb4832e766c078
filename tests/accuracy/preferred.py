# SPDX-License-Identifier: GPL-3.0-or-later
"""How often the objective prefers the truth to what the search found: python -m tests.accuracy.preferred CASE …

The search has missed what it looks for there; where the truth is worth less, the objective is what is wrong. What is
otherwise is judged at once and part by part: a ghost that has a marker's name pays for more than a shifted arm costs.
Cases are those of the ablation that are solved as a whole, one subject each. Prints the rows of results/preferred.json.
"""

import argparse
from collections.abc import Callable, Iterator
from pathlib import Path
from unittest import mock

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from addon.core.points.whole_take.search import SEARCH, Search
from scripts.results import markdown

from . import registry

USUAL = (
    *(f"points {name}" for name in ("as recorded", "own", "others", "frame", "lab-1", "lab-3")),
    "points pieces-gait15",
    "points pieces-body26",
    "short own",
    "short others",
    *(f"strangers {name}" for name in ("plugin_gait", "in part", "still", "plates", "animal_hand")),
)


def truth_of(search: Search, truth: np.ndarray) -> np.ndarray:
    """(N,) the true names of tracklets of points whose markers are truth (T, L); unmodelled markers as they were found.

    Where a tracklet is two markers' one after the other it is the longer one's.
    """
    objective, found = search.objective, search.best.marker
    row, lane = np.nonzero(objective.tracklets.table >= 0)
    count = np.zeros((len(found), objective.markers + 1), int)
    np.add.at(count, (objective.tracklets.table[row, lane], truth[row, lane]), 1)
    true = np.where(count[:, -1] == count.max(axis=1), -1, count.argmax(axis=1))
    return np.where((true < 0) & (found >= objective.markers), found, true)


def parts_of(true: np.ndarray, found: np.ndarray) -> Iterator[np.ndarray]:
    """The names found (N,) with some of them as they are in truth (N,): all of them, and each that hang together."""
    other = np.flatnonzero(true != found)
    one, two = (np.where(own[other] < 0, away[other], own[other]) for own, away in ((true, found), (found, true)))
    count = int(max(one.max(initial=-1), two.max(initial=-1))) + 1
    part = connected_components(coo_array((np.ones(len(other)), (one, two)), (count, count)), directed=False)[1][one]
    for some in (other, *(other[part == each] for each in np.unique(part))):
        named = found.copy()
        named[some] = true[some]
        yield named


def preferred(label: Callable[[], registry.Outcome]) -> tuple[int, float] | None:
    """Of a take's labelling: how many names are not the true ones', and nats in all of it that the truth is worth more.

    Or that a part of the truth is. None where it was not searched.
    """
    searches, truths, climb, outcome = [], [], Search.climb, registry.of_points

    def watched(search, *moves):
        climb(search, *moves)
        searches.append(search)

    def judged(marker, truth, *more):
        truths.append(truth)
        return outcome(marker, truth, *more)

    with mock.patch.object(Search, "climb", watched), mock.patch.object(registry, "of_points", judged):
        label()
    if not searches or not truths:
        return None
    search, objective = searches[0], searches[0].objective
    true, best = truth_of(search, truths[0]), search.best
    gains = [objective.gain(objective.of(named), best) for named in parts_of(true, best.marker)]
    return int((true != best.marker).sum()), max(gains) * objective.length


def main():
    """Prints how often, case by case."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("cases", nargs="*", default=USUAL, metavar="CASE")
    parser.add_argument("--keep", type=Path, required=True, help="where models and cases are kept")
    given, rows = parser.parse_args(), []
    cases = registry.registry(given.keep)
    for name in given.cases:
        found = [(trial.take, preferred(trial.label)) for trial in cases[name]()]
        solved = [(take, one) for take, one in found if one is not None]
        missed = [(take, gain) for take, (_, gain) in solved if gain > SEARCH.least]
        worst = max(missed, key=lambda one: one[1], default=("", 0.0))
        other = sum(other > 0 for _, (other, _) in solved)
        rows.append([name, len(found), len(solved), other, len(missed), worst[0], round(worst[1])])
        print(name, rows[-1], flush=True)
    rows.append(["all", *(sum(row[at] for row in rows) for at in range(1, 5)), "", ""])
    head = ["case", "takes", "searched", "other than the truth", "truth worth more", "most in", "nats"]
    print(markdown(head, [list(map(str, row)) for row in rows]))


if __name__ == "__main__":
    main()
