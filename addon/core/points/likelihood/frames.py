# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of anonymous points in, names and their confidence out; no frame knows of another."""

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ...data.errors import InputError
from ...data.takes import BY_LIKELIHOOD, Labels
from .assembling import assemble
from .model import Known, Likelihood, chance, features, kinds, log_odds
from .naming import is_crowded, put_rows, rows_of
from .solving import Solved, solve
from .starts import START_YAWS, Guesses, guess


class FRAME_NAMING:
    """How frames are worked on."""

    max_pairs: int = 40_000  # of the points of frames at once; memory: the processor's own
    # the same of sets on rigid bodies, of which less is worked out for each pair
    max_rigid_pairs: int = 270_000  # memory
    # of a frame's outcome, from which more guesses are followed; half or twice names people of other labs alike,
    # without it five of seven parts of a body are refused
    max_mean_square: float = 0.5  # measured


NAMED_AT_ONCE = 4, 64  # at least and at most
GUESSES, MORE_GUESSES = 3, 6  # of a frame that are followed to the end: more of many points, or of a doubtful outcome


@dataclass(frozen=True, eq=False)
class LikelihoodNamer:
    """Names points by what was learned of a marker set, each frame on its own; see `models.Namer`."""

    likelihood: Likelihood
    step: int = BY_LIKELIHOOD

    def name(self, points: np.ndarray, rate: float) -> Iterator[Labels]:  # noqa: ARG002 - as Namer has it
        """See `models.Namer`."""
        return label_frames(self.likelihood, points)


def label_frames(likelihood: Likelihood, points: np.ndarray) -> Iterator[Labels]:
    """Names frames of points (T, P, 3) m, z up, NaN where there is none, some frames at a time.

    Each frame is named on its own, and each label has the `rate` at which labels like it are right. What to accept is
    for the caller: see `Labels.sure`.
    Raises InputError when the array is not one of points.
    """
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(f"points have the shape {points.shape}; expected frames × points × 3")
    for frames in chunks(points, likelihood.rigid_bodies is not None):
        yield label_some(likelihood, points[frames])


def scores(likelihood: Likelihood, points: np.ndarray) -> np.ndarray:
    """(T,) nats, how likely the best naming of each of frames of points (T, P, 3) m is, as `Solved.score`."""
    parts = [points[frames] for frames in chunks(points, likelihood.rigid_bodies is not None)]
    return np.concatenate([solve_frames(likelihood.known, _packed(part)[0]).score for part in parts])


def chunks(points: np.ndarray, rigid: bool = False) -> Iterator[slice]:
    """The frames of points (T, P, 3) that are best worked on at once; `rigid` for sets on rigid bodies."""
    most = max(int(np.isfinite(points[..., 0]).sum(axis=1).max(initial=0)), 1)
    size = int(np.clip((FRAME_NAMING.max_rigid_pairs if rigid else FRAME_NAMING.max_pairs) // most**2, *NAMED_AT_ONCE))
    for first in range(0, len(points), size):
        yield slice(first, first + size)


def label_some(likelihood: Likelihood, points: np.ndarray) -> Labels:
    """The names of a few frames of points (F, P, 3) m at once."""
    packed, place = _packed(points)
    solved = solve_frames(likelihood.known, packed)
    labels = labels_given(solved, packed)
    odds = log_odds(likelihood.calibration.weights, labels.described)
    confidence, rate = chance(odds), likelihood.calibration.rate(odds, kinds(labels.described))
    found = Labels.none(*points.shape[:2])
    rates = np.zeros(points.shape[:2])
    at = labels.frame, place[labels.frame, labels.point]
    found.marker[at], found.step[at], found.confidence[at], rates[at] = labels.marker, BY_LIKELIHOOD, confidence, rate
    return replace(found, rate=rates)


def solve_frames(known: Known, points: np.ndarray) -> Solved:
    """The best naming of frames of points (F, P, 3) m, NaN where there is none; by rigid bodies if the set has them."""
    if known.rigid_bodies is not None:
        return assemble(known.rigid_bodies, points)
    crowded = is_crowded(known.fine, np.isfinite(points[..., 0]))
    solved = Solved.none(len(points), len(known.fine))
    # Apart, so that what is in other frames changes nothing in one.
    for rows, guesses, part in (
        (np.flatnonzero(~crowded), GUESSES, True),
        (np.flatnonzero(crowded), MORE_GUESSES, False),
    ):
        if not len(rows):
            continue
        put_rows(solved, _solved(known, points[rows], guesses), rows)
        doubtful = rows[solved.mean_square[rows] > FRAME_NAMING.max_mean_square]
        if len(doubtful):
            again = _solved(known, points[doubtful], MORE_GUESSES, np.pi / START_YAWS, part)
            better = again.score > solved.score[doubtful]
            put_rows(solved, rows_of(again, better), doubtful[better])
    return solved


def _solved(known: Known, points: np.ndarray, guesses: int, first: float = 0.0, part: bool = False) -> Solved:
    """The best naming that any of so many guesses leads to, the first of them looked for from the yaw `first`, rad.

    Where the points may be of a `part` of the subject, as many are followed of small and of large people each: a part
    of somebody tall is much like all of somebody short.
    """
    sizes = known.constraints.usual_sizes if part else (1.0,)
    found = [guess(known.coarse, known.fine, points / size, guesses, first, part).sized(size) for size in sizes]
    return solve(known.fine, known.constraints, known.exchanges, Guesses.join(found), np.isfinite(points[..., 0]))


@dataclass(frozen=True, eq=False)
class LabelsGiven:
    """N labels: frame, point and marker (N,) of each, and what its chance depends on.

    described (N, FEATURES) is as in `model.features`.
    """

    frame: np.ndarray
    point: np.ndarray
    marker: np.ndarray
    described: np.ndarray


def labels_given(solved: Solved, points: np.ndarray) -> LabelsGiven:
    """All names of solved frames of points (F, P, 3) m."""
    named = solved.naming >= 0
    ghosts = np.isfinite(points[..., 0]).sum(axis=1) - named.sum(axis=1)
    frame, marker = np.nonzero(named)
    part = named.mean(axis=1)[frame]
    described = features(solved.margin[frame, marker], ghosts[frame], part, solved.mean_square[frame])
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
