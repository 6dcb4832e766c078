# SPDX-License-Identifier: GPL-3.0-or-later
"""The paper's functions and classifiers written plainly, to check the fast code by, and clouds that move."""

from collections.abc import Callable
from math import comb

import numpy as np

from addon.core.data.progress import finished
from addon.core.data.takes import Labels
from addon.core.geometry.upright import turned
from addon.core.papers.partial_solvers import features
from addon.core.papers.partial_solvers.boosting import learn_intervals
from addon.core.papers.partial_solvers.features import UP, Tables, all_features, tables
from addon.core.papers.partial_solvers.frames import SolversNamer
from addon.core.papers.partial_solvers.masks import TOLERANCE
from addon.core.papers.partial_solvers.model import DOMAIN, FUNCTIONS, Classifiers, PartialSolvers
from addon.core.papers.partial_solvers.training import training


def angle(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """g1: the angle at `a` between the directions to `b` and `c`, rad, of points (..., 3).

    The table prints a minus sign where the dot product of AB and AC belongs.
    """
    ab, ac = b - a, c - a
    lengths = np.linalg.norm(ab, axis=-1) * np.linalg.norm(ac, axis=-1)
    return np.arccos(np.clip((ab * ac).sum(axis=-1) / lengths, -1.0, 1.0))


def distance(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """g2: how far `a` is from `b`, m. Points (..., 3)."""
    return np.linalg.norm(b - a, axis=-1)


def ratio(a: np.ndarray, b: np.ndarray, c: np.ndarray, d: np.ndarray) -> np.ndarray:
    """g3: how much longer AB is than CD, over their mean; -2 to 2, whatever the size of the body. Points (..., 3)."""
    first, second = distance(a, b), distance(c, d)
    return 2.0 * (first - second) / (first + second)


def height(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """g4: how much higher `a` is than `b`, m. Points (..., 3), z up (the table's axis for up is y)."""
    return a[..., UP] - b[..., UP]


def turn(a: np.ndarray, b: np.ndarray, c: np.ndarray) -> np.ndarray:
    """Not in the table: the turn from AB to AC seen from above, over their lengths; -1 to 1, positive to the left.

    Its sign changes in a mirror, where all of the table's functions stay the same.
    """
    ab, ac = b - a, c - a
    across = ab[..., 0] * ac[..., 1] - ab[..., 1] * ac[..., 0]
    return across / (np.linalg.norm(ab, axis=-1) * np.linalg.norm(ac, axis=-1))


def count_features(markers: int) -> dict[str, int]:
    """How many features each function gives over all combinations of `markers` points."""
    triples, pairs = markers * comb(max(markers - 1, 0), 2), comb(markers, 2)
    return {"angle": triples, "distance": pairs, "ratio": 3 * comb(markers, 4), "height": pairs, "turn": triples}


def accepts(classifiers: Classifiers, frame: int, labelling: np.ndarray, clouds: Tables) -> bool:
    """Whether all weak classifiers accept one labelling (M,) of a frame, by φ = 1 (equation 2): every vote counts.

    A marker without a point is -1; a classifier with such a point, or one that is missing, has no vote.
    """
    for kind, points, low, high in zip(*vars(classifiers).values(), strict=True):
        chosen = labelling[points[: DOMAIN[kind]]]
        value = features.values(int(kind), np.array(frame), chosen, clouds) if (chosen >= 0).all() else np.nan
        if value < low - TOLERANCE or value > high + TOLERANCE:
            return False
    return True


def exhaustive(markers: int, good: Callable[[int], bool], own: int | None = None) -> set[int]:
    """Every good subset that contains no smaller good one; for few markers only."""
    return without_supersets({one for one in range(1, 1 << markers) if (own is None or one >> own & 1) and good(one)})


def without_supersets(found: set[int]) -> set[int]:
    """Those that contain no other."""
    return {one for one in found if not any(other != one and other & one == other for other in found)}


def moving(markers: int = 6, frames: int = 200, sway: float = 0.04, seed: int = 0) -> np.ndarray:
    """(T, M, 3) m: one shape that turns about the vertical, walks about and wobbles."""
    generator = np.random.default_rng(seed)
    shape = generator.uniform(-0.5, 0.5, (markers, 3))
    wobble = shape + generator.normal(scale=sway, size=(frames, markers, 3))
    yaw = generator.uniform(0, 2 * np.pi, frames)
    return turned(wobble, yaw) + generator.uniform(-2, 2, (frames, 1, 3)) * [1, 1, 0]


def pool_of(points: np.ndarray, functions=FUNCTIONS):
    """All weak classifiers of labelled frames."""
    return learn_intervals(tables(points), *all_features(points.shape[1], functions))


def trained(*given) -> PartialSolvers:
    """The ensemble that `training` makes."""
    return finished(training(*given))


def named_by(partial_solvers: PartialSolvers, points: np.ndarray) -> Labels:
    """The labels (T, P) of points (T, P, 3) m."""
    return Labels.join(SolversNamer(partial_solvers).name(points))
