# SPDX-License-Identifier: GPL-3.0-or-later
"""The methods that are compared, each learned from some people's frames and asked for names at several target rates."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from addon.core.data.progress import finished
from addon.core.data.takes import Labels
from addon.core.papers.partial_solvers.frames import SolversNamer
from addon.core.papers.partial_solvers.model import FUNCTIONS, PAPER_FUNCTIONS, PartialSolvers, Solver
from addon.core.papers.partial_solvers.training import SolverStudy, Training
from addon.core.points.likelihood.frames import label_frames
from addon.core.points.likelihood.learn import learn_likelihood

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
