# SPDX-License-Identifier: GPL-3.0-or-later
"""A model: a marker set, an ensemble of partial solvers for it, and what both were learned from."""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from ..points.partial_solvers.model import PartialSolvers
from .markersets import MarkerSet


@dataclass(frozen=True, eq=False)
class TrainingTake:
    """What a model keeps of a take, so that it can be trained on with others.

    subject  the subject's id; several takes may be of one
    takes    the take's name; several names where a model did not tell their frames apart
    frames   how many labelled frames it had
    points   (F, M, 3) m, the most different of those frames, NaN where a marker is missing
    """

    subject: str
    takes: tuple[str, ...]
    frames: int
    points: np.ndarray


@dataclass(frozen=True, eq=False)
class Model:
    """What a model file holds.

    markerset  names, skeleton, body, and the evidence for naming points
    partial_solvers   of partial solvers; None where it was not trained
    training_takes    what it was trained on, a take each; empty where that was left out
    """

    markerset: MarkerSet
    partial_solvers: PartialSolvers | None = None
    training_takes: tuple[TrainingTake, ...] = ()

    @property
    def subjects(self) -> dict[str, np.ndarray]:
        """What is kept of each subject, (F, M, 3) m."""
        return by_subject(self.training_takes)


def by_subject(training_takes: Iterable[TrainingTake]) -> dict[str, np.ndarray]:
    """The frames of each subject's takes after one another, (F, M, 3) m."""
    parts: dict[str, list[np.ndarray]] = {}
    for training_take in training_takes:
        parts.setdefault(training_take.subject, []).append(training_take.points.astype(float))
    return {subject: np.concatenate(own) for subject, own in parts.items()}
