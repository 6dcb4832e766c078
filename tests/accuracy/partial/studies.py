# SPDX-License-Identifier: GPL-3.0-or-later
"""What is asked of a learned method on frames of people: each study gives counts that add up over people.

A count for a condition is what `Score.lists` gives unless said otherwise. Keys are texts, because results are stored.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .clouds import Clouds, Trouble, drawn, spoilt
from .methods import Faithful, Ours
from .scores import score

TARGETS = (0.99, 0.999, 0.9999, 0.99999)
ASKED = (0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9995, 0.9998, 0.9999, 0.99999)  # for the calibration
HIDDEN = (1, 2, 3, 4, 5)
TABLE_2 = 4  # hidden markers in the paper's table 2
CHUNK = 4096  # clouds named in one go


@dataclass(frozen=True)
class Test:
    """What a method is tested on.

    frames   (T, M, 3) m of the people tested
    names    the M markers
    count    clouds for the paper's table 2; a quarter of it for each other cell of tables 4 and 5
    targets  rates of right labels to ask for in the paper's tables
    seed     of the people, so that each group gets other occlusions and all methods the same
    """

    frames: np.ndarray
    names: tuple[str, ...]
    count: int
    targets: tuple[float, ...]
    seed: int

    def generator(self, *what: int) -> np.random.Generator:
        """The same for every method."""
        return np.random.default_rng([self.seed, *what])

    def cell(self, hide: int, generator: np.random.Generator) -> Clouds:
        """The clouds for a row of the paper's tables."""
        count = self.count if hide == TABLE_2 else -(-self.count // 4)
        return spoilt(drawn(self.frames, count, generator), Trouble(hide), generator)


Learned = Faithful | Ours


def _scored(method: Learned, clouds: Clouds, targets) -> dict:
    """Scores by target, named in parts so that memory stays small."""
    totals = None
    for first in range(0, len(clouds.points), CHUNK):
        part = slice(first, first + CHUNK)
        some = Clouds(clouds.points[part], clouds.truth[part], clouds.markers)
        named = method.names(some.points, targets)
        scores = {target: score(found, some) for target, found in named.items()}
        totals = {target: totals[target] + scores[target] for target in scores} if totals else scores
    return {str(target): found.lists for target, found in totals.items()}


def grid(method: Learned, test: Test) -> dict:
    """Tables 3 to 5 and the calibration: {hidden: {target: counts}}."""
    asked = tuple(sorted({*test.targets, *ASKED})) if isinstance(method, Ours) else test.targets
    found = {}
    for hide in (0, *HIDDEN):
        found[str(hide)] = _scored(method, test.cell(hide, test.generator(1, hide)), asked)
    return found


def cover(method: Faithful, test: Test) -> dict:
    """B16: {target: for each marker the solvers of the ensemble that have it, and those of them that reach the target
    for it}."""
    found = {}
    for target in test.targets:
        ensemble = method.ensemble(target)
        counts = np.zeros((2, len(test.names)), dtype=int)
        for solver in ensemble.solvers:
            counts[0, solver.markers] += 1
            counts[1, solver.markers[solver.reached]] += 1
        found[str(target)] = counts.tolist()
    return found


STUDIES: dict[str, Callable[[Learned, Test], dict]] = {
    "grid": grid,
    "cover": cover,
}
