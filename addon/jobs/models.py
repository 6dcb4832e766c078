# SPDX-License-Identifier: GPL-3.0-or-later
"""A model as the wanted method needs it: partial solvers are found when they are first asked for."""

from collections.abc import Generator
from dataclasses import replace
from weakref import WeakKeyDictionary

from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.progress import Progress
from ..core.papers.partial_solvers.model import PartialSolvers
from ..core.points.models import Model
from ..io.markersets import builtin_markersets, open_markerset
from ..io.models import open_model

USUAL_SEARCH = "top-down"  # of the searches for partial solvers
# Those that were found of models that are still open: who labels many takes with one finds them once.
_found: WeakKeyDictionary[Model, PartialSolvers] = WeakKeyDictionary()


def model_for(name: str, method: str) -> Generator[Progress, None, Model]:
    """The model of a file, with partial solvers where the method needs them and the model keeps what they are found in.

    Raises InputError where there is no such model, or finding them takes so long that it must be asked for.
    """
    model = open_model(name)
    if method != "ensemble" or model.partial_solvers is not None or not model.training_takes:
        return model
    if model not in _found:
        _found[model] = yield from _solvers(model, name)
    return replace(model, partial_solvers=_found[model])


def _solvers(model: Model, name: str) -> Generator[Progress, None, PartialSolvers]:
    from ..core.training.pipeline import TrainingOptions, train_solvers

    options = TrainingOptions(model.markerset.name, search=USUAL_SEARCH)
    count = len(model.markerset)
    if count > options.max_markers:
        raise InputError(
            f"has no partial solvers, and for {count} markers finding them takes long; expected a model that has them: "
            f"train --from {name} --search {options.search} --out MODEL makes one",
            name,
        )
    work = train_solvers(model, options, known_bodies())
    while True:
        try:
            share, words = next(work)
        except StopIteration as end:
            return end.value.partial_solvers
        yield Progress(0.0, f"{words}, once for this model: {share:.0%}")


def known_bodies() -> list[MarkerSet]:
    """The built-in marker sets, whose bodies and poses are known."""
    return [open_markerset(name) for name in builtin_markersets()]
