# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming points with a trained ensemble: every solver's suggestions, frame by frame, put into the labelling matrix.

Frames are independent. They are worked on side by side for speed only; what one holds changes nothing in the next.
"""

from collections.abc import Iterable, Iterator

import numpy as np

from ...data.takes import NO_MARKER
from .features import tables
from .masks import Masks
from .matrix import resolve
from .model import PartialSolvers
from .solver import TreeSearch

# Of look-up tables, in one go; about two numbers and a few dozen bit masks for every pair of points.
TABLE_NUMBERS = 400_000


class Labeller:
    """An ensemble made ready to name points.

    every_vote: solvers also vote for markers for which they miss their target; the paper does not say. They then
    spoil right suggestions of better solvers, and give wrong ones where no better solver answers.
    """

    def __init__(self, partial_solvers: PartialSolvers, every_vote: bool = False):
        self.markers = len(partial_solvers.markers)
        self._solvers = []
        for solver in partial_solvers.solvers:
            voted = np.flatnonzero(solver.reached | every_vote)
            record = solver.record
            # Laplace's rule of succession: a rate of one from few answers is not yet a certainty.
            sure = ((record.hits + 1) / (record.answers + 2))[voted]
            search = TreeSearch(solver.markers, partial_solvers.classifiers[solver.strong.chosen])
            self._solvers.append((search, voted, solver.markers[voted], sure))

    def __call__(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Names a take: marker (T, P), NO_MARKER where unnamed, and confidence (T, P), 0 where unnamed.

        points (T, P, 3) m, z up, NaN where missing; in any order, also a new one each frame. The confidence is the
        measured hit rate of the best solver that suggested the name.
        """
        parts = list(self.chunks([points]))
        return np.concatenate([part[0] for part in parts]), np.concatenate([part[1] for part in parts])

    def chunks(self, takes: Iterable[np.ndarray]) -> Iterator[tuple[np.ndarray, np.ndarray]]:
        """The same for a take that comes in parts (T, P, 3); yields parts of its own size, in order."""
        for points in takes:
            there = np.isfinite(points).all(axis=-1)
            most = int(there.sum(axis=1).max(initial=0))
            step = max(TABLE_NUMBERS // max(most * most, 1), 1)
            for first in range(0, max(len(points), 1), step):
                part = slice(first, first + step)
                yield self._part(points[part], there[part], most)

    def _part(self, points: np.ndarray, there: np.ndarray, most: int) -> tuple[np.ndarray, np.ndarray]:
        # Trajectories are many and mostly missing when a take is in tracklets: only points that are there are tried.
        front = np.argsort(~there, axis=1, kind="stable")[:, :most]
        suggested, confidence = self._suggested(np.take_along_axis(points, front[..., None], axis=1))
        compact = resolve(suggested)
        sure = np.take_along_axis(confidence, np.maximum(compact, 0)[..., None], axis=2)[..., 0]
        marker = np.full(there.shape, NO_MARKER)
        certainty = np.zeros(there.shape)
        np.put_along_axis(marker, front, compact, axis=1)
        np.put_along_axis(certainty, front, np.where(compact >= 0, sure, 0.0), axis=1)
        return marker, certainty

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


def label_frames(
    partial_solvers: PartialSolvers, points: np.ndarray, every_vote: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Marker (T, P) and confidence (T, P) of points (T, P, 3) m, as `Labeller` gives them."""
    return Labeller(partial_solvers, every_vote)(points)
