# SPDX-License-Identifier: GPL-3.0-or-later
"""Whether what a model file holds of its training can be used: a digest does not tell whether it is right."""

from collections.abc import Sequence

import numpy as np

from ..core.points.models import TrainingTake
from ..core.points.partial_solvers.model import DOMAIN, FUNCTIONS, NO_POINT, Classifiers, PartialSolvers, Record, Solver
from .names import can_be_written

FARTHEST_MARKER = 1e3  # m; no marker of a training take is farther away


def sound_partial_solvers(solvers: PartialSolvers) -> bool:
    """Whether every index has its place and every number is one, so that points can be named by it."""
    count = len(solvers.markers)
    return (
        _sound_classifiers(solvers.classifiers, count)
        and all(_sound_solver(solver, solvers.classifiers, count) for solver in solvers.solvers)
        and _are_numbers(solvers.targets, (count,), 0, 1)
        and can_be_written(solvers.search)
        and solvers.frames >= 0
    )


def sound_training_take(take: TrainingTake, markers: int) -> bool:
    """Whether a training take is about that many markers, so that it can be trained on with others."""
    points = take.points
    return (
        points.ndim == 3
        and points.dtype.kind == "f"
        and points.shape[1:] == (markers, 3)
        and not (np.abs(points) > FARTHEST_MARKER).any()
        and all(map(can_be_written, (take.subject, *take.takes)))
        and take.frames >= 0
    )


def _sound_classifiers(classifiers: Classifiers, markers: int) -> bool:
    count = len(classifiers.kind) if classifiers.kind.ndim else -1
    if not (
        _are_indices(classifiers.kind, (count,), len(FUNCTIONS))
        and _are_indices(classifiers.points, (count, max(DOMAIN)), markers, least=NO_POINT)
        and _are_numbers(classifiers.low, (count,))
        and _are_numbers(classifiers.high, (count,))
    ):
        return False
    points = classifiers.points
    inside = np.arange(max(DOMAIN)) < np.array(DOMAIN)[classifiers.kind][:, None]
    twice = (points[:, :, None] == points[:, None]) & inside[:, :, None] & inside[:, None] & ~np.eye(4, dtype=bool)
    return bool(((points != NO_POINT) == inside).all() and not twice.any())


def _sound_solver(solver: Solver, classifiers: Classifiers, markers: int) -> bool:
    own, chosen, record = solver.markers, solver.strong.chosen, solver.record
    count = len(own) if own.ndim else 0
    if not (
        count
        and _are_indices(own, (count,), markers)
        and (np.diff(own.astype(int)) > 0).all()
        and chosen.ndim == 1
        and _are_indices(chosen, chosen.shape, len(classifiers))
        and _are_numbers(solver.strong.weights, chosen.shape, 0, np.inf)
        and solver.reached.shape == (count,)
        and solver.reached.dtype == bool
    ):
        return False
    return bool(classifiers.within(own)[chosen].all()) and _sound_record(record, count)


def _sound_record(record: Record, markers: int) -> bool:
    columns = (record.hits, record.failures, record.answers)
    if not all(_are_numbers(column, (markers,), 0, 2**53) for column in columns):
        return False
    return bool((record.hits + record.failures <= record.answers).all()) and record.samples >= 0


def _are_indices(values: np.ndarray, shape: Sequence[int], end: int, least: int = 0) -> bool:
    whole = values.dtype.kind in "iu" and values.shape == tuple(shape)
    return whole and bool(((values >= least) & (values < end)).all())


def _are_numbers(values: np.ndarray, shape: Sequence[int], low: float = -np.inf, high: float = np.inf) -> bool:
    number = values.dtype.kind in "fiu" and values.shape == tuple(shape)
    return number and bool(((values >= low) & (values <= high)).all())
