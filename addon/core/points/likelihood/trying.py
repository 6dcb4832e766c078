# SPDX-License-Identifier: GPL-3.0-or-later
"""Trials of a training, each a piece of work that needs nothing else: whoever trains may try them side by side."""

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..rigid_bodies.model import RigidBodies
from .distances import DistanceConstraints
from .frames import chunks, labels_given, solve_frames
from .model import Known
from .shape import Shape
from .trials import Trial


@dataclass(frozen=True, eq=False)
class TrialWork:
    """A trial to be named by what was learned without its subjects.

    markers, shape, constraints, rigid_bodies  what was learned, as in `Likelihood`
    trial                                      the frames
    usual                                      whether they are as most takes' frames are, and no crowd
    """

    markers: tuple[str, ...]
    shape: Shape
    constraints: DistanceConstraints
    rigid_bodies: RigidBodies | None
    trial: Trial
    usual: bool


@dataclass(frozen=True, eq=False)
class TrialOutcome:
    """All N labels given in a trial: what their chances depend on (N, FEATURES), and whether each is right (N,)."""

    described: np.ndarray
    right: np.ndarray


# Tries all trials and gives the outcomes in the same order.
Trying = Callable[[Sequence[TrialWork]], Iterable[TrialOutcome]]


def tried(work: TrialWork) -> TrialOutcome:
    """The labels given in a trial."""
    # Sums hang in their last bit on how an array lies in memory, which nobody keeps who takes the work elsewhere.
    shape = Shape(*map(np.ascontiguousarray, (work.shape.mean, work.shape.modes, work.shape.noise)))
    known = Known.of(work.markers, shape, work.constraints, work.rigid_bodies)
    described, right = [], []
    for frames in chunks(work.trial.points, work.rigid_bodies is not None):
        points, truth = work.trial.points[frames], work.trial.truth[frames]
        given = labels_given(solve_frames(known, points), points)
        described.append(given.described)
        right.append(truth[given.frame, given.point] == given.marker)
    return TrialOutcome(np.concatenate(described), np.concatenate(right))


def in_turn(works: Sequence[TrialWork]) -> Iterator[TrialOutcome]:
    """The outcomes of trials, tried one after the other."""
    return map(tried, works)
