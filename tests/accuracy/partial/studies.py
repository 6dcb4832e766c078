# SPDX-License-Identifier: GPL-3.0-or-later
"""What is asked of a learned method on frames of people: each study gives counts that add up over people.

A count for a condition is what `Score.lists` gives unless said otherwise. Keys are texts, because results are stored.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .clouds import Clouds, Trouble, drawn, mirrored, other_side, placed_differently, spoilt, together
from .methods import Faithful, Ours
from .scores import in_the_mirror, score, swaps, sweep

TARGETS = (0.99, 0.999, 0.9999, 0.99999)
ASKED = (0.9, 0.95, 0.98, 0.99, 0.995, 0.998, 0.999, 0.9995, 0.9998, 0.9999, 0.99999)  # for the calibration
HIDDEN = (1, 2, 3, 4, 5)
TABLE_2 = 4  # hidden markers in the paper's table 2
GHOSTS = range(11)
NOISE = (0.0, 0.001, 0.002, 0.005, 0.01, 0.02)  # m
DISTANCE_M = 1.5  # m between two people in one cloud
# Confidences to sweep: 1 - 10^-x.
LEVELS = 1.0 - 10.0 ** -np.linspace(0.0, 8.0, 161)
CHUNK = 4096  # clouds named in one go


@dataclass(frozen=True)
class Test:
    """What a method is tested on.

    frames   (T, M, 3) m of the people tested
    names    the M markers
    count    clouds for the paper's table 2; a quarter of it for each other cell of tables 4 and 5
    fewer    clouds for each condition of the other studies
    targets  rates of right labels to ask for in the paper's tables
    seed     of the people, so that each group gets other occlusions and all methods the same
    """

    frames: np.ndarray
    names: tuple[str, ...]
    count: int
    fewer: int
    targets: tuple[float, ...]
    seed: int

    def generator(self, *what: int) -> np.random.Generator:
        """The same for every method."""
        return np.random.default_rng([self.seed, *what])

    @property
    def middle(self) -> tuple[float, ...]:
        """The targets of all other studies: the paper's second and third."""
        return tuple(target for target in self.targets if 0.99 < target < 0.99999)

    def cell(self, hide: int, generator: np.random.Generator) -> Clouds:
        """The clouds for a row of the paper's tables."""
        count = self.count if hide == TABLE_2 else -(-self.count // 4)
        return spoilt(drawn(self.frames, count, generator), Trouble(hide), generator)

    def few(self) -> np.ndarray:
        """(fewer, M, 3) the frames of all studies but the paper's tables."""
        return drawn(self.frames, self.fewer, self.generator(0))


Learned = Faithful | Ours


def _targets(method: Learned, test: Test) -> tuple[float, ...]:
    """The targets of the studies that set what is asked beside what is got: all that cost nothing more."""
    return test.targets if isinstance(method, Ours) else test.middle


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


def curve(method: Ours, test: Test) -> dict:
    """Figure 5 in fine steps of the confidence: {hidden: given, wrong, declared, missed by level}."""
    found = {}
    for hide in HIDDEN:
        clouds = test.cell(hide, test.generator(1, hide))
        found[str(hide)] = sweep(*method.confident(clouds.points), clouds, LEVELS)
    return found


def ghosts(method: Learned, test: Test) -> dict:
    """Table 2's occlusions with points of no marker put in: {ghosts: {target: counts}}."""
    return {
        str(count): _scored(
            method, spoilt(test.few(), Trouble(TABLE_2, count), test.generator(2, count)), _targets(method, test)
        )
        for count in GHOSTS
    }


def noise(method: Learned, test: Test) -> dict:
    """Table 2's occlusions with every coordinate off at random: {sigma in m: {target: counts}}."""
    found = {}
    for at, sigma in enumerate(NOISE):
        clouds = spoilt(test.few(), Trouble(TABLE_2, noise=sigma), test.generator(3, at))
        found[str(sigma)] = _scored(method, clouds, test.middle)
    return found


def mirror(method: Learned, test: Test) -> dict:
    """Left and right: `scores.swaps` of plain clouds, and what becomes of clouds in a mirror.

    {"swaps": {hidden: {target: counts}}, "mirrored": {hidden: {target: labels of a side given plain, in the mirror, of
    these right for whom the mirror shows, and the same as in the plain cloud}}}
    """
    found: dict = {"swaps": {}, "mirrored": {}}
    other = other_side(test.names)
    # The paper's functions name next to no left and right at higher targets, so the lowest is asked for too.
    targets = (0.99, *test.middle)
    for hide in (0, 1, TABLE_2):
        clouds = spoilt(test.few(), Trouble(hide), test.generator(4, hide))
        plain = method.names(clouds.points, targets)
        turned = method.names(mirrored(clouds.points), targets)
        found["swaps"][str(hide)] = {str(target): swaps(named, clouds, other) for target, named in plain.items()}
        found["mirrored"][str(hide)] = {
            str(target): in_the_mirror(plain[target], named, clouds, other) for target, named in turned.items()
        }
    return found


def lab(method: Learned, test: Test) -> dict:
    """People who wear the tibia and heel markers differently from all that were learned: {hidden: {target: counts}}."""
    frames = placed_differently(test.few(), test.names)
    return {
        str(hide): _scored(method, spoilt(frames, Trouble(hide), test.generator(5, hide)), _targets(method, test))
        for hide in (0, 1, TABLE_2)
    }


def crowd(method: Learned, test: Test) -> dict:
    """Two people in one cloud: {target: labels given, those of a wrong marker of either, clouds with labels on both
    people, clouds}."""
    generator = test.generator(6)
    one = test.few()
    clouds = together(one, one[generator.permutation(len(one))], DISTANCE_M, generator)
    count = len(test.names)
    found = {}
    for target, named in method.names(clouds.points, test.middle).items():
        given = named >= 0
        wrong = given & (clouds.truth % count != named)
        first = (given & (clouds.truth < count)).any(axis=1)
        both = first & (given & (clouds.truth >= count)).any(axis=1)
        found[str(target)] = [int(given.sum()), int(wrong.sum()), int(both.sum()), len(named)]
    return found


def few_hidden(method: Learned, test: Test) -> dict:
    """Nothing hidden, and table 2's occlusions, in as many clouds as the tables have: {hidden: {target: counts}}."""
    return {
        str(hide): _scored(
            method,
            spoilt(drawn(test.frames, -(-test.count // 4), test.generator(8)), Trouble(hide), test.generator(8, hide)),
            test.targets,
        )
        for hide in (0, TABLE_2)
    }


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


def whole_body(method: Learned, test: Test) -> dict:
    """0 to 5 hidden and 0 to 3 ghosts in turn: {target: counts}."""
    frames, totals = drawn(test.frames, test.count, test.generator(0)), None
    cases = [(hide, ghost) for hide in range(6) for ghost in range(4)]
    for at, (hide, ghost) in enumerate(cases):
        clouds = spoilt(frames[at :: len(cases)], Trouble(hide, ghost), test.generator(7, at))
        scores = {target: score(named, clouds) for target, named in method.names(clouds.points, test.targets).items()}
        totals = {target: totals[target] + scores[target] for target in scores} if totals else scores
    return {str(target): found.lists for target, found in totals.items()}


STUDIES: dict[str, Callable[[Learned, Test], dict]] = {
    "grid": grid,
    "curve": curve,
    "ghosts": ghosts,
    "noise": noise,
    "mirror": mirror,
    "lab": lab,
    "crowd": crowd,
    "cover": cover,
}
