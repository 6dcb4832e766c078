# SPDX-License-Identifier: GPL-3.0-or-later
"""Whatever names points: by likelihood or by partial solvers, behind one small interface."""

from collections.abc import Iterator
from typing import Protocol

import numpy as np

from ..data.errors import InputError
from ..data.takes import Labels
from .models import Model

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
