# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether the predicted ambiguity of markers is the measured one: python -m tests.accuracy.ambiguity.

People are left out of the training in groups. What is predicted of each pair from the others' shape is set beside how
often the naming, made to name whatever it can, takes the one for the other in the people left out. With --advice the
markers of all people are moved as is advised from the others' shape, and the confusion before and after is counted.
"""

import argparse
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from addon.core.body.bodies import BodyModel
from addon.core.data.markersets import MarkerSet
from addon.core.placement_quality import ADVICE, Advice, advise, judge, marker_layout, separation
from addon.core.placement_quality.advice import ADD
from addon.core.points.likelihood.learn import learn_likelihood
from addon.core.points.likelihood.model import Likelihood
from addon.core.points.likelihood.trials import make_trial
from addon.core.posing.posing import fit_points
from addon.io.markersets import open_markerset

from . import people
from .points import SEED, named
from .tables import share, table

HIDDEN, GHOSTS = (4, 5), (0, 3)
SHOWN = 12  # pairs of the table


@dataclass(frozen=True, eq=False)
class Takes:
    """Everybody's clouds of a marker set: names, and for each person points (T, M, 3) m."""

    names: tuple[str, ...]
    clouds: dict[str, np.ndarray]

    def without(self, left_out: Sequence[str]) -> list[tuple[np.ndarray, str]]:
        """What to learn from when some people are left out."""
        return [(points, person) for person, points in self.clouds.items() if person not in left_out]


def recorded(markerset: MarkerSet) -> Takes:
    """The recorded people in a marker set."""
    takes = people.takes()
    clouds = {
        person: np.concatenate([take.pick(markerset.markers) for take in takes if take.person == person])
        for person in people.everyone()
    }
    return Takes(markerset.markers, clouds)


def confusion(likelihood: Likelihood, takes: Takes, tested: Sequence[str], frames: int) -> np.ndarray:
    """(M, M) how many points of each marker (row) were given each marker's name, in people left out."""
    counts = np.zeros((len(takes.names), len(takes.names)), dtype=int)
    for person in tested:
        rng = np.random.default_rng(SEED)
        clouds = takes.clouds[person]
        trial = make_trial(clouds[rng.integers(0, len(clouds), frames)], HIDDEN, GHOSTS, rng)
        marker, _ = named(likelihood, trial.points)
        both = (trial.truth >= 0) & (marker >= 0)
        np.add.at(counts, (trial.truth[both], marker[both]), 1)
    return counts


def rank_correlation(predicted: np.ndarray, measured: np.ndarray) -> tuple[float, float]:
    """Spearman's, and the most that any prediction without ties could reach, for most pairs are never confused."""
    from scipy.stats import spearmanr

    best = np.empty(len(measured))
    best[np.lexsort((predicted, measured))] = np.arange(len(measured))
    return float(spearmanr(predicted, measured)[0]), float(spearmanr(best, measured)[0])


def predicted_and_measured(markerset: MarkerSet, frames: int) -> tuple[str, str]:
    """A row of rank correlations, and the table of the pairs that were confused most."""
    takes, groups = recorded(markerset), people.folds()
    pairs, markers, counts = 0.0, 0.0, np.zeros((len(markerset), len(markerset)), dtype=int)
    for left_out in groups:
        likelihood = learn_likelihood(takes.without(left_out), takes.names)
        found = judge(marker_layout(markerset, learned=likelihood))
        pairs, markers = pairs + found.hidden / len(groups), markers + found.of_markers / len(groups)
        counts += confusion(likelihood, takes, left_out, frames)
    one, two = np.triu_indices(len(markerset), 1)
    either, distance = (counts + counts.T)[one, two], pairs[one, two]
    wrong = (counts.sum(axis=1) - np.diag(counts)) / counts.sum(axis=1)
    of_pairs, most = rank_correlation(distance, either)
    ever = rank_correlation(distance[either > 0], either[either > 0])[0]
    row = (
        markerset.name,
        share(int(either.sum()), int(counts.sum()), 2),
        f"{(either > 0).sum()} of {len(either)}",
        f"{of_pairs:.2f} (at most {most:.2f})",
        f"{ever:.2f}",
        f"{rank_correlation(markers, wrong)[0]:.2f}",
    )
    rows = [
        (
            f"{takes.names[one[at]]} and {takes.names[two[at]]}",
            either[at],
            f"{separation(distance[at]):.1f}",
            f"{1 + (distance > distance[at]).sum()}",
        )
        for at in np.argsort(-either, kind="stable")[:SHOWN]
    ]
    return row, table((f"{markerset.name}: pair", "times confused", "predicted separation", "predicted rank"), rows)


def taken(takes: Takes, markerset: MarkerSet, advice: Sequence[Advice]) -> Takes:
    """The recorded people with their markers moved, or one more, as is advised: each turned as its segment turns."""
    model, clouds = BodyModel(markerset), {}
    for person, points in takes.clouds.items():
        bodies = fit_points(model, points)
        turn, size = model.pose(bodies).rotations, bodies.scale.mean(axis=1)[:, None]
        names, changed = list(takes.names), points
        for one in advice:
            place = (turn[:, one.segment] @ (one.new - one.old)) * size + changed[:, names.index(one.anchor)]
            if one.kind == ADD:
                names.append(one.marker)
                changed = np.concatenate([changed, place[:, None]], axis=1)
            else:
                changed = changed.copy()
                changed[:, names.index(one.marker)] = place
        clouds[person] = changed
    return Takes(tuple(names), clouds)


def advice_taken(markerset: MarkerSet, frames: int, groups: int, goal: float, steps: int) -> str:
    """How often markers are confused before and after what was advised from the other people's shape."""
    takes, rows, total = recorded(markerset), [], [np.zeros(2), np.zeros(2)]
    for left_out in people.folds()[:groups]:
        likelihood = learn_likelihood(takes.without(left_out), takes.names)
        made = marker_layout(markerset, learned=likelihood)
        advice = [one for one, _ in advise(made, goal, steps)]
        new = taken(takes, markerset, advice)
        again = learn_likelihood(new.without(left_out), new.names)
        before = confusion(likelihood, takes, left_out, frames)
        after = confusion(again, new, left_out, frames)
        who = ", ".join(left_out)
        rows += [(who, one.in_words(markerset), *_of_pair(one.pair, takes, before, new, after)) for one in advice]
        rows.append((who, "all markers", _wrong(before), _wrong(after)))
        total = [sums + counts for sums, counts in zip(total, (_counted(before), _counted(after)), strict=True)]
    rows.append(("all", "all markers", *(share(int(wrong), int(given), 2) for wrong, given in total)))
    return table((f"{markerset.name}: people left out", "advice", "confused before", "after"), rows)


def _of_pair(pair: tuple[str, str], takes: Takes, before: np.ndarray, new: Takes, after: np.ndarray) -> list[str]:
    cells = []
    for names, counts in ((takes.names, before), (new.names, after)):
        one, two = (names.index(name) for name in pair)
        cells.append(f"{' and '.join(pair)}: {counts[one, two] + counts[two, one]}")
    return cells


def _counted(counts: np.ndarray) -> np.ndarray:
    return np.array([counts.sum() - np.trace(counts), counts.sum()])


def _wrong(counts: np.ndarray) -> str:
    return share(*map(int, _counted(counts)), 2)


def main(arguments: list[str] | None = None):
    """Measures what was asked for and prints it."""
    parser = argparse.ArgumentParser(description="Sets predicted ambiguity beside measured confusion.")
    parser.add_argument("--set", nargs="*", choices=("gait15", "body26"), default=["gait15", "body26"])
    parser.add_argument("--frames", type=int, default=1500, help="frames of each person")
    parser.add_argument("--advice", action="store_true", help="move markers as advised instead, and measure again")
    parser.add_argument("--groups", type=int, default=5, help="groups of people that advice is tried on")
    parser.add_argument("--goal", type=float, default=ADVICE.goal, help="separation that advice is to reach")
    parser.add_argument("--steps", type=int, default=3, help="how much advice is taken")
    given = parser.parse_args(arguments)
    sets = [open_markerset(name) for name in given.set]
    counts = f"{HIDDEN[0]} or {HIDDEN[1]} hidden, {GHOSTS[0]} to {GHOSTS[1]} ghosts"
    tested = sum(map(len, people.folds()[: given.groups if given.advice else None]))
    print(f"{tested} left-out people, {given.frames} frames each, {counts}, seed {SEED}\n")
    if given.advice:
        for markerset in sets:
            print(advice_taken(markerset, given.frames, given.groups, given.goal, given.steps), flush=True)
        return
    found = [predicted_and_measured(markerset, given.frames) for markerset in sets]
    columns = ("set", "wrong names", "pairs ever confused", "rank correlation, pairs", "of those confused", "markers")
    print(table(columns, [row for row, _ in found]), end="\n\n")
    print("\n\n".join(pairs for _, pairs in found))


if __name__ == "__main__":
    main()
