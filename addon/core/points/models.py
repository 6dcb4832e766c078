# SPDX-License-Identifier: GPL-3.0-or-later
"""A model: a marker set, what was learned to name its markers by, how it came about, and how it names points.

Whatever names points, by likelihood or by partial solvers, is behind one small interface.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, Self

import numpy as np

from ..data.errors import InputError
from ..data.markersets import MarkerSet
from ..data.takes import Labels
from ..papers.partial_solvers.model import PartialSolvers
from .likelihood.model import Likelihood
from .rigid_bodies.model import RigidBodies

if TYPE_CHECKING:
    from .rigid_bodies.structure import Structure


@dataclass(frozen=True)
class TaughtTake:
    """A file of a labelled take that a model was taught, or is checked on."""

    name: str  # of the file
    subject: str  # whose it is
    frames: int  # how many labelled frames it had
    sha256: str = ""  # of what the file held; empty for a take that was taught from no file
    path: str = ""  # of the file as seen from the model's, with /; empty where it is not known
    up: str = ""  # the axis that points up in it, where that is known better than from the file; else empty
    rate: float = 0.0  # format: frames a second, where the file says none; else 0


@dataclass(frozen=True)
class CheckedTake:
    """How a take was named before a training on and after it: shares of the points of its markers."""

    name: str  # of its file
    recall: tuple[float, float]  # named right, before and after
    wrong: tuple[float, float]  # named wrong, before and after


@dataclass(frozen=True)
class ModelVersion:
    """One training of a model."""

    version: int  # counts the trainings, from 1
    date: str = ""  # the day, by the world's clock, as 2026-11-23; empty where not known
    by: str = ""  # who taught it; empty where not known
    program: str = ""  # the version of Mocap Autolabel
    origin: str = ""  # the fingerprint of the model that was trained on; empty for a new one
    takes: tuple[TaughtTake, ...] = ()  # what it was taught; none where it was given its partial solvers
    checked: tuple[CheckedTake, ...] = ()  # the takes that were named by the model before and by this one
    told: bool = False  # it was taken although some of these were named worse


@dataclass(frozen=True)
class ModelHistory:
    """The versions of a model, the first one first, and labelled takes that it is checked on when it is trained on.

    A model of which nobody kept a history has none, and is its own version 1.
    """

    versions: tuple[ModelVersion, ...] = ()
    kept_takes: tuple[TaughtTake, ...] = ()

    @property
    def version(self) -> int:
        """The number of the last one."""
        return self.versions[-1].version if self.versions else 1

    @property
    def taught(self) -> list[TaughtTake]:
        """The files of all trainings, each once: of one that was taught again with other labels, as it was last."""
        found = {(take.name, take.subject, take.path): take for one in self.versions for take in one.takes}
        return list(found.values())

    def with_version(self, new: ModelVersion) -> Self:
        """The history with one more."""
        return replace(self, versions=(*self.versions, new))


NO_HISTORY = ModelHistory()


@dataclass(frozen=True, eq=False)
class TrainingTake:
    """What a model keeps of a take, so that it can be trained on with others."""

    subject: str  # the subject's id; several takes may be of one
    takes: tuple[str, ...]  # the take's name; several names where a model did not keep their frames by take
    frames: int  # how many labelled frames it had
    points: np.ndarray  # (F, M, 3) m, the most different of those frames, NaN where a marker is missing


@dataclass(frozen=True, eq=False)
class Model:
    """What a model file holds."""

    markerset: MarkerSet  # names, skeleton, body
    likelihood: Likelihood | None = None  # what was learned to name points by; None where nothing was
    # the same as an ensemble of partial solvers; None where they were not trained
    partial_solvers: PartialSolvers | None = None
    training_takes: tuple[TrainingTake, ...] = ()  # what it was trained on, a take each; empty where that was left out
    history: ModelHistory = NO_HISTORY  # who taught it what, and when
    fingerprint: str = ""  # of the file that it was read from, whatever its history; empty for one that was not
    # a likelihood of some of those it learned from, who are more alike: for takes of one subject of which single frames
    # are not sure by the first; most models have none
    second: Likelihood | None = None

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

    @property
    def of_one_subject(self) -> bool:
        """Whether a single subject taught it to name points: nothing tells how the next one differs."""
        return self.likelihood is not None and self.likelihood.subjects == 1

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


METHODS = ("auto", "fit", "ensemble", "likelihood", "evidence")  # what the user may ask for
USUAL_TARGET = 0.999  # the part of the labels that must be right, unless another is asked for


class Namer(Protocol):
    """What names points."""

    def name(self, points: np.ndarray, rate: float) -> Iterator[Labels]:
        """The labels of points (T, P, 3) m, z up, NaN where missing, `rate` frames a second; some frames at a time."""


def plain_method(wanted: str) -> str:
    """The name that a method goes by: "evidence" was likelihood at first, "both" a fit and a check of it."""
    return {"evidence": "likelihood", "both": "fit"}.get(wanted, wanted)


def chosen_method(model: Model, wanted: str) -> str:
    """The method by which points are named: what "auto" stands for, or the one that was wanted.

    InputError where the model cannot do it.
    """
    wanted, name = plain_method(wanted), model.markerset.name
    if wanted == "fit":
        raise InputError("the method fit names blobs; expected auto, likelihood or ensemble for 3D points")
    if wanted == "ensemble" and model.partial_solvers is None:
        raise InputError(f"model {name} has no partial solvers; expected one that was trained by train")
    if (wanted == "likelihood" and model.likelihood is None) or not model.has_learned:
        raise _nothing_learned(model)
    return wanted if wanted != "auto" else "ensemble" if model.likelihood is None else "likelihood"


def namer_of(model: Model, method: str) -> Namer:
    """What names points by a method that `chosen_method` gave."""
    if method == "likelihood" and model.likelihood is not None:
        from .likelihood.frames import LikelihoodNamer

        return LikelihoodNamer(model.likelihood)
    if model.partial_solvers is None:
        raise _nothing_learned(model)
    from ..papers.partial_solvers.frames import SolversNamer

    return SolversNamer(model.partial_solvers)


def _nothing_learned(model: Model) -> InputError:
    name = model.markerset.name
    return InputError(f"model {name} has learned nothing to name points by; expected one made by train")
