# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of anonymous points in, names and their confidence out; no frame knows of another."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ...data.errors import InputError
from ..rigid_bodies.assembling import assemble
from .calibration import chance, features, kinds, log_odds
from .model import Known, Likelihood
from .naming import FEW
from .rows import put_rows, rows_of
from .solving import Solved, solve
from .starts import YAWS, guess

# Frames that are worked on at once, and pairs of their points: small enough for the processor's own memory.
CHUNK, FEWEST, PAIRS = 64, 4, 40_000
TARGET = 0.999
LOOK = 3  # guesses a frame that are followed to the end, and
LONG_LOOK = 6  # where there are many more points than markers, or the outcome is strange
STRANGE = 0.5  # misfit from which it is


@dataclass(frozen=True, eq=False)
class Named:
    """The names of F frames of P points.

    marker      (F, P) the most likely marker, -1 where the point is more likely a ghost
    confidence  (F, P) the chance that it is right; 0 where unnamed
    rate        (F, P) of all labels at least so confident in frames as hard, the part that is right
    misfit      (F,) how strange the named points are for the model: about 1 or less for subjects like those learned
    """

    marker: np.ndarray
    confidence: np.ndarray
    rate: np.ndarray
    misfit: np.ndarray

    def sure(self, target: float) -> np.ndarray:
        """(F, P) the markers to accept so that a part `target` of them is right, -1 elsewhere."""
        return np.where(self.rate >= target, self.marker, -1)


def label_frames(likelihood: Likelihood, points: np.ndarray) -> Iterator[Named]:
    """Names frames of points (T, P, 3) m, z up, NaN where there is none, some frames at a time.

    Each frame is named on its own. What to accept is for the caller: see `Named.sure`.
    Raises InputError when the array is not one of points.
    """
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(f"points have the shape {points.shape}; expected frames × points × 3")
    for frames in chunks(points):
        yield label_some(likelihood, points[frames])


def chunks(points: np.ndarray) -> Iterator[slice]:
    """The frames of points (T, P, 3) that are best worked on at once."""
    most = max(int(np.isfinite(points[..., 0]).sum(axis=1).max(initial=0)), 1)
    size = int(np.clip(PAIRS // most**2, FEWEST, CHUNK))
    for first in range(0, len(points), size):
        yield slice(first, first + size)


def label_some(likelihood: Likelihood, points: np.ndarray) -> Named:
    """The names of a few frames of points (F, P, 3) m at once."""
    packed, place = _packed(points)
    solved = solve_frames(likelihood.known, packed)
    labels = labels_given(solved, packed)
    odds = log_odds(likelihood.calibration.weights, labels.described)
    confidence, rate = chance(odds), likelihood.calibration.rate(odds, kinds(labels.described))
    marker = np.full(points.shape[:2], -1)
    sure, rates = np.zeros(points.shape[:2]), np.zeros(points.shape[:2])
    at = labels.frame, place[labels.frame, labels.point]
    marker[at], sure[at], rates[at] = labels.marker, confidence, rate
    return Named(marker, sure, rates, solved.misfit)


def solve_frames(known: Known, points: np.ndarray) -> Solved:
    """The best naming of frames of points (F, P, 3) m, NaN where there is none; by rigid bodies where the set has them."""
    if known.rigid_bodies is not None:
        return assemble(known.rigid_bodies, points)
    present = np.isfinite(points[..., 0])
    crowded = (present.sum(axis=1) > len(known.fine) + FEW).any()
    solved = _solved(known, points, LONG_LOOK if crowded else LOOK)
    strange = np.flatnonzero(solved.misfit > STRANGE)
    if len(strange):
        again = _solved(known, points[strange], LONG_LOOK, np.pi / YAWS)
        better = again.score > solved.score[strange]
        put_rows(solved, rows_of(again, better), strange[better])
    return solved


def _solved(known: Known, points: np.ndarray, guesses: int, first: float = 0.0) -> Solved:
    """The best naming that any of so many guesses leads to, the first of them looked for from the yaw `first`, rad."""
    found = guess(known.coarse, known.fine, points, guesses, first)
    return solve(known.fine, known.constraints, known.exchanges, found, np.isfinite(points[..., 0]))


@dataclass(frozen=True, eq=False)
class LabelsGiven:
    """N labels: frame, point and marker (N,) of each, and what its chance depends on.

    described (N, FEATURES) is as in `trust.features`.
    """

    frame: np.ndarray
    point: np.ndarray
    marker: np.ndarray
    described: np.ndarray


def labels_given(solved: Solved, points: np.ndarray) -> LabelsGiven:
    """All names of solved frames of points (F, P, 3) m."""
    named = solved.naming >= 0
    strays = np.isfinite(points[..., 0]).sum(axis=1) - named.sum(axis=1)
    frame, marker = np.nonzero(named)
    part = named.mean(axis=1)[frame]
    described = features(solved.margin[frame, marker], strays[frame], part, solved.misfit[frame])
    return LabelsGiven(frame, solved.naming[frame, marker], marker, described)


def _packed(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points of each frame moved together (F, Q, 3), and where they came from (F, Q).

    Most trajectories of a long take are empty most of the time.
    """
    present = np.isfinite(points).all(axis=2)
    width = max(int(present.sum(axis=1).max(initial=0)), 1)
    if points.shape[1] < width or points.shape[1] == 0:
        raise InputError("frames have no points; expected at least one trajectory")
    place = np.argsort(~present, axis=1, kind="stable")[:, :width]
    packed = np.take_along_axis(points, place[..., None], axis=1)
    return np.where(np.take_along_axis(present, place, axis=1)[..., None], packed, np.nan), place
