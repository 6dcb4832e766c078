# SPDX-License-Identifier: GPL-3.0-or-later
"""A model: a marker set, an ensemble of partial solvers for it, and what both were learned from."""

from dataclasses import dataclass

import numpy as np

from .ensemble.model import Ensemble
from .markersets import MarkerSet


@dataclass(frozen=True, eq=False)
class Lessons:
    """What a model keeps of the takes of one subject, so that it can be trained on with others.

    subject  the subject's id
    takes    names of the takes, and frames how many labelled frames they had together
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
    ensemble   of partial solvers; None where it was not trained
    lessons    what it was trained on, a subject each; empty where that was left out
    """

    markerset: MarkerSet
    ensemble: Ensemble | None = None
    lessons: tuple[Lessons, ...] = ()
