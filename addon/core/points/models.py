# SPDX-License-Identifier: GPL-3.0-or-later
"""A model: a marker set, what was learned to name its markers by, and the takes that it was learned from."""

from collections.abc import Iterable
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from ..data.markersets import MarkerSet
from ..papers.partial_solvers.model import PartialSolvers
from .history import NO_HISTORY, ModelHistory
from .likelihood.model import Likelihood
from .rigid_bodies.model import RigidBodies

if TYPE_CHECKING:  # most sets are on no rigid bodies
    from .rigid_bodies.structure import Structure


@dataclass(frozen=True, eq=False)
class TrainingTake:
    """What a model keeps of a take, so that it can be trained on with others.

    subject  the subject's id; several takes may be of one
    takes    the take's name; several names where a model did not keep their frames by take
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

    markerset        names, skeleton, body
    likelihood       what was learned to name points by; None where nothing was
    partial_solvers  the same as an ensemble of partial solvers; None where they were not trained
    training_takes   what it was trained on, a take each; empty where that was left out
    history          who taught it what, and when
    fingerprint      of the file that it was read from, whatever its history; empty for one that was not
    """

    markerset: MarkerSet
    likelihood: Likelihood | None = None
    partial_solvers: PartialSolvers | None = None
    training_takes: tuple[TrainingTake, ...] = ()
    history: ModelHistory = NO_HISTORY
    fingerprint: str = ""

    @property
    def has_learned(self) -> bool:
        """Whether it has learned to name points; a set that was only drawn has not."""
        return self.likelihood is not None or self.partial_solvers is not None

    @property
    def learned_likelihood(self) -> Likelihood:
        """What was learned to name points by; ValueError where nothing was."""
        if self.likelihood is None:
            raise ValueError(f"model {self.markerset.name} has no likelihood")
        return self.likelihood

    @property
    def rigid_bodies(self) -> RigidBodies | None:
        """The rigid bodies that most of the markers are on; None for other sets."""
        return None if self.likelihood is None else self.likelihood.rigid_bodies

    @cached_property
    def structure(self) -> "Structure | None":
        """How the rigid bodies lie on the subjects that the model keeps; None without either."""
        if self.rigid_bodies is None or not self.training_takes:
            return None
        from .rigid_bodies.structure import learn_structure

        return learn_structure(self.rigid_bodies, list(self.subjects.values()))

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
