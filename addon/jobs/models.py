# SPDX-License-Identifier: GPL-3.0-or-later
"""A model as the wanted method needs it, and which version of a model takes a place."""

import getpass
from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from weakref import WeakKeyDictionary

from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.progress import Progress
from ..core.papers.partial_solvers.model import PartialSolvers
from ..core.points.models import Model
from ..io.markersets import SUFFIX, builtin_markersets, open_markerset
from ..io.model_history import beside, model_of
from ..io.models import open_model, read_model, write_model
from ..io.source import digest, read_bytes
from ..io.whole import whole_files

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
        from ..core.training.pipeline import TrainingOptions, train_solvers

        options = TrainingOptions(model.markerset.name, search=USUAL_SEARCH)
        count = len(model.markerset)
        if count > options.max_markers:
            raise InputError(
                f"has no partial solvers, and for {count} markers finding them takes long; expected a model that has "
                f"them: train --from {name} --search {options.search} --out MODEL makes one",
                name,
            )
        work = train_solvers(model, options, known_bodies())
        while model not in _found:
            try:
                step = next(work)
            except StopIteration as end:
                _found[model] = end.value.partial_solvers
            else:
                yield Progress(0.0, f"{step.note}, once for this model: {step.fraction:.0%}")
    return replace(model, partial_solvers=_found[model])


def known_bodies() -> list[MarkerSet]:
    """The built-in marker sets, whose bodies and poses are known."""
    return [open_markerset(name) for name in builtin_markersets()]


@dataclass(frozen=True)
class VersionPlaces:
    """Where the versions of a model lie."""

    out: Path  # the model
    # where the version that `out` holds goes when another takes its place; None where it holds none
    former: Path | None
    candidate: Path  # where the new one goes as long as it is doubted
    digest: str = ""  # of what `out` held; empty where there was nothing

    @classmethod
    def of(cls, out: Path, version: int) -> "VersionPlaces":
        """The places for a new version of a model; what is there already is left where it is.

        Raises InputError where `out` cannot be read.
        """
        candidate = beside(out, f"v{version}-candidate")
        if not out.is_file():
            return cls(out, None, candidate)
        held = digest(out)
        try:
            number = read_model(out).history.version
        except InputError:  # no model
            return cls(out, None, candidate, held)
        return cls(out, beside(out, f"v{number}"), candidate, held)

    @property
    def is_as_it_was(self) -> bool:
        """Whether nobody has put another model there meanwhile."""
        return (digest(self.out) if self.out.is_file() else "") == self.digest


def adopt(candidate: Path) -> Path:
    """Puts a candidate into the place of its model, whose former version is kept beside it; gives the place.

    Raises InputError where the file is none, or the model is not the one any more that was trained on.
    """
    out = model_of(candidate)
    if out is None:
        raise InputError(f"is no candidate by its name; expected one such as ours.v3-candidate{SUFFIX}", candidate)
    model = read_model(candidate)
    if not model.history.versions:
        raise InputError("does not say what it was trained on from; expected a candidate that train wrote", candidate)
    newest = model.history.versions[-1]
    if out.is_file() and read_model(out).fingerprint != newest.origin:
        raise InputError(
            "is another model than the one that the candidate was trained on from; expected that one, so train it on "
            "again",
            out,
        )
    history = replace(model.history, versions=(*model.history.versions[:-1], replace(newest, told=True)))
    former = VersionPlaces.of(out, newest.version).former
    with whole_files([path for path in (former, out) if path], overwrite=True) as files:
        if former:
            files[0].write_bytes(read_bytes(out))
        write_model(files[-1], replace(model, history=history))
    with suppress(OSError):
        candidate.unlink()  # it is there under the model's own name
    return out


def system_user() -> str:
    """Who is logged in; empty where the system does not tell."""
    try:
        return getpass.getuser()
    except (OSError, KeyError, ImportError):
        return ""
