# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming points with a trained ensemble: every solver's suggestions, frame by frame, put into the labelling matrix.

Frames are independent. They are worked on side by side for speed only; what one holds changes nothing in the next.
"""

from collections.abc import Iterator

import numpy as np

from ...data.takes import BY_PARTIAL_SOLVERS, NO_MARKER, NO_STEP, Labels
from .features import tables
from .masks import Masks
from .model import PartialSolvers
from .solver import TreeSearch

# Worked on side by side, for memory: pairs of points in look-up tables, two numbers and a few dozen bit masks each; and
# frames.
TABLE_PAIRS, TABLE_FRAMES = 400_000, 256


class SolversNamer:
    """Partial solvers made ready to name points, each frame on its own; see `models.Namer`.

    A solver does not vote for markers for which it misses its target, of which the paper does not speak: it would spoil
    right suggestions of better solvers, and give wrong ones where no better solver answers.
    """

    step = BY_PARTIAL_SOLVERS

    def __init__(self, partial_solvers: PartialSolvers):
        self.markers = len(partial_solvers.markers)
        self._solvers = []
        for solver in partial_solvers.solvers:
            voted = np.flatnonzero(solver.reached)
            record = solver.record
            # Laplace's rule of succession: a rate of one from few answers is not yet a certainty.
            sure = ((record.hits + 1) / (record.answers + 2))[voted]
            search = TreeSearch(solver.markers, partial_solvers.classifiers[solver.strong.chosen])
            self._solvers.append((search, voted, solver.markers[voted], sure))

    def name(self, points: np.ndarray, rate: float = 0.0) -> Iterator[Labels]:  # noqa: ARG002 - as Namer has it
        """Names points (T, P, 3) m, z up, NaN where missing; in any order, also a new one each frame.

        The confidence of a label is the measured hit rate of the best solver that suggested the name.
        """
        there = np.isfinite(points).all(axis=-1)
        most = max(int(there.sum(axis=1).max(initial=0)), 1)
        step = int(np.clip(TABLE_PAIRS // most**2, 1, TABLE_FRAMES))
        for first in range(0, max(len(points), 1), step):
            yield self._part(points[first : first + step], there[first : first + step])

    def _part(self, points: np.ndarray, there: np.ndarray) -> Labels:
        # Trajectories are many and mostly missing when a take is in tracklets: only points that are there are tried.
        front = np.argsort(~there, axis=1, kind="stable")[:, : int(there.sum(axis=1).max(initial=0))]
        suggested, confidence = self._suggested(np.take_along_axis(points, front[..., None], axis=1))
        compact = resolve(suggested)
        sure = np.take_along_axis(confidence, np.maximum(compact, 0)[..., None], axis=2)[..., 0]
        found = Labels.none(*there.shape)
        np.put_along_axis(found.marker, front, compact, axis=1)
        np.put_along_axis(found.confidence, front, np.where(compact >= 0, sure, 0.0), axis=1)
        named = found.named
        return Labels(found.marker, np.where(named, self.step, NO_STEP), found.confidence, named * 1.0)

    def _suggested(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """(T, P, M) whether any solver gives the point that marker, and how sure the surest of them is."""
        masks = Masks(tables(points))
        suggested = np.zeros((*points.shape[:2], self.markers), dtype=bool)
        confidence = np.zeros(suggested.shape)
        for search, voted, markers, sure in self._solvers:
            for cloud, chosen in search.blocks(masks):
                at = (cloud[:, None], chosen[:, voted], markers)
                suggested[at] = True
                confidence[at] = np.maximum(confidence[at], sure)
        return suggested, confidence


def resolve(suggested: np.ndarray) -> np.ndarray:
    """The labelling matrix (the paper's section 4.3): what becomes of the suggestions of many solvers.

    The marker of each point (T, P), NO_MARKER where none, from suggestions (T, P, M): some solver says so.

    A column without a suggestion is an occluded marker. A column with several is ambiguous and counts as occluded. A
    point with several markers leaves all of them occluded. What is alone in its row and in its column is a label.
    """
    alone = (suggested.sum(axis=1, keepdims=True) == 1) & (suggested.sum(axis=2, keepdims=True) == 1) & suggested
    return np.where(alone.any(axis=2), alone.argmax(axis=2), NO_MARKER)
