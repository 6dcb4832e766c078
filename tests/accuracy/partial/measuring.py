# SPDX-License-Identifier: GPL-3.0-or-later
"""Goes through methods and people, and keeps what is measured in a file each, so that a run can be gone on with.

Counts add up over people. Those of a condition are what `Score.lists` gives; keys are texts, because they are stored.
"""

import json
import sys
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from addon.core.data.progress import finished
from addon.core.data.takes import Labels
from addon.core.papers.partial_solvers.frames import SolversNamer
from addon.core.papers.partial_solvers.model import FUNCTIONS, PAPER_FUNCTIONS, PartialSolvers, Solver
from addon.core.papers.partial_solvers.training import SolverStudy, Training
from addon.core.points.likelihood.frames import label_frames
from addon.core.points.likelihood.learn import learn_likelihood

from .. import people
from .clouds import Clouds, Trouble, drawn, score, spoilt

Takes = Sequence[tuple[np.ndarray, str]]  # frames (T, M, 3) m, and whose they are
FAITHFUL = {"paper": PAPER_FUNCTIONS, "turn": FUNCTIONS}
METHODS = (*FAITHFUL, "ours")
ANY_RATE = 100.0  # frames a second; to both methods each frame is alone


class Remembering(SolverStudy):
    """A study that boosts each solver once, though ensembles for several targets take it."""

    def __init__(self, points: np.ndarray, options: Training):
        super().__init__(points, options)
        self._made: dict[int, Solver] = {}

    def solver(self, subset: int) -> Solver:
        """The partial solver of a subset; which targets it reaches depends on the targets now asked for."""
        if subset not in self._made:
            self._made[subset] = super().solver(subset)
        made = self._made[subset]
        reached = made.record.reaches(self.targets[made.markers])
        return replace(made, reached=reached)


class Faithful:
    """The paper's method: one ensemble of partial solvers for each target, made when it is first asked for."""

    def __init__(self, takes: Takes, names: tuple[str, ...], options: Training):
        self._names = names
        self.study = Remembering(np.concatenate([frames for frames, _ in takes]), options)
        for _ in self.study.survey():
            pass
        self._ensembles: dict[float, PartialSolvers] = {}

    def names(self, points: np.ndarray, targets: Sequence[float]) -> dict[float, np.ndarray]:
        """The markers (N, P) of points (N, P, 3) m for each target, -1 where unnamed."""
        namers = {target: SolversNamer(self.ensemble(target)) for target in targets}
        return {target: Labels.join(namer.name(points, ANY_RATE)).marker for target, namer in namers.items()}

    def ensemble(self, target: float) -> PartialSolvers:
        """The partial solvers for a target."""
        if target not in self._ensembles:
            self._ensembles[target] = finished(self.study.partial_solvers(self._names, target))
        return self._ensembles[target]


class Ours:
    """Our own method: names are given once, with the rate at which labels as confident are right."""

    def __init__(self, takes: Takes, names: tuple[str, ...]):
        self._likelihood = learn_likelihood(takes, names)

    def names(self, points: np.ndarray, targets: Sequence[float]) -> dict[float, np.ndarray]:
        """The markers (N, P) of points (N, P, 3) m for each target, -1 where unnamed."""
        found = Labels.join(label_frames(self._likelihood, points))
        return {target: found.sure(target) for target in targets}


def learn(method: str, takes: Takes, names: tuple[str, ...], options: Training) -> Faithful | Ours:
    """The method, one of METHODS, learned from takes."""
    if method == "ours":
        return Ours(takes, names)
    return Faithful(takes, names, replace(options, functions=FAITHFUL[method]))


NAMES = people.GAIT15
TARGETS = (0.99, 0.999, 0.9999, 0.99999)
ASKED = (0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9995, 0.9998, 0.9999, 0.99999)  # for the calibration
HIDDEN = (1, 2, 3, 4, 5)
TABLE_2 = 4  # hidden markers in the paper's table 2
FRAMES = 16_384  # of the paper's table 2; a quarter of it for each other cell of tables 4 and 5
CHUNK = 4096  # clouds named in one go
GROUPS = {"paper": 5, "turn": 5, "ours": 10}  # an ensemble takes minutes to train, so two people are left out together
SAME = "same"


@dataclass(frozen=True)
class Test:
    """Frames (T, M, 3) m of the people that are tested, clouds for table 2, and a seed of theirs for all methods."""

    frames: np.ndarray
    count: int
    seed: int

    def cell(self, hide: int) -> Clouds:
        """The clouds for a row of the paper's tables: each group gets other occlusions, and all methods the same."""
        generator = np.random.default_rng([self.seed, 1, hide])
        count = self.count if hide == TABLE_2 else -(-self.count // 4)
        return spoilt(drawn(self.frames, count, generator), Trouble(hide), generator)


def grid(method: Faithful | Ours, test: Test) -> dict:
    """Tables 3 to 5 and the calibration: {hidden: {target: counts}}."""
    asked = tuple(sorted({*TARGETS, *ASKED})) if isinstance(method, Ours) else TARGETS
    return {str(hide): _scored(method, test.cell(hide), asked) for hide in (0, *HIDDEN)}


def _scored(method: Faithful | Ours, clouds: Clouds, targets) -> dict:
    """Scores by target, named in parts so that memory stays small."""
    totals = None
    for first in range(0, len(clouds.points), CHUNK):
        part = slice(first, first + CHUNK)
        some = Clouds(clouds.points[part], clouds.truth[part], clouds.markers)
        scores = {target: score(found, some) for target, found in method.names(some.points, targets).items()}
        totals = {target: totals[target] + scores[target] for target in scores} if totals else scores
    return {str(target): found.lists for target, found in totals.items()}


def cover(method: Faithful, test: Test) -> dict:
    """B16: {target: the ensemble's solvers that have each marker, and those of them that reach the target for it}."""
    found = {}
    for target in TARGETS:
        counts = np.zeros((2, len(NAMES)), dtype=int)
        for solver in method.ensemble(target).solvers:
            counts[0, solver.markers] += 1
            counts[1, solver.markers[solver.reached]] += 1
        found[str(target)] = counts.tolist()
    return found


def splits(method: str) -> Iterator[tuple[str, list[str], list[str]]]:
    """Of each training its name, whom it learns from and who is tested."""
    everyone = list(people.WALKERS)
    yield SAME, everyone, everyone
    for group in people.folds(GROUPS[method]):
        yield "+".join(group), [person for person in everyone if person not in group], list(group)


def run(results: Path, methods: tuple[str, ...]):
    """Measures everything that is not there yet: all methods' first training, then all their second."""
    results.mkdir(parents=True, exist_ok=True)
    order = [(at, method, split) for method in methods for at, split in enumerate(splits(method))]
    for _, method, split in sorted(order, key=lambda item: item[0]):
        measure(results, method, *split)


def measure(results: Path, method: str, split: str, learned: list[str], tested: list[str]):
    """What is not there yet of a method on some people; trains at most once."""
    path = results / f"{method}.{split}.json"
    found, trained = read(path), None
    studies = {"grid": grid, **({"cover": cover} if split == SAME and method != "ours" else {})}
    for study, ask in studies.items():
        if study not in found:
            trained = trained or learn(method, takes_of(learned), NAMES, Training())
            found[study] = ask(trained, _test(tested))
            beside = path.with_suffix(".part")
            beside.write_text(json.dumps(found), encoding="utf-8")
            beside.replace(path)
            print(f"{method}, {split}: {study}", file=sys.stderr, flush=True)


def takes_of(persons: list[str]) -> Takes:
    """Frames and owner of every take of some people."""
    return [(take.pick(NAMES), take.subject) for take in people.takes(persons)]


def _test(tested: list[str]) -> Test:
    everyone = people.WALKERS
    frames = np.concatenate([frames for frames, _ in takes_of(tested)])
    return Test(frames, int(np.ceil(FRAMES * len(tested) / len(everyone))), everyone.index(tested[0]))


def read(path: Path) -> dict:
    """The results in a file; none when it is not there."""
    return json.loads(path.read_text(encoding="utf-8")) if path.exists() else {}
