# SPDX-License-Identifier: GPL-3.0-or-later
"""The versions of a model beside each other: the former one is kept, a doubted one waits until somebody adopts it."""

import getpass
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path

from ..core.data.errors import InputError
from ..io.markersets import SUFFIX
from ..io.model_history import beside, model_of
from ..io.models import read_model, write_model
from ..io.source import digest, read_bytes
from ..io.whole import whole_files


@dataclass(frozen=True)
class VersionPlaces:
    """Where the versions of a model lie.

    out        the model
    former     where the version that `out` holds goes when another takes its place; None where it holds none
    candidate  where the new one goes as long as it is doubted
    digest     of what `out` held; empty where there was nothing
    """

    out: Path
    former: Path | None
    candidate: Path
    digest: str = ""

    @classmethod
    def of(cls, out: Path, version: int) -> "VersionPlaces":
        """The places for a new version of a model; what is there already is left where it is.

        Raises InputError where `out` cannot be read.
        """
        candidate = beside(out, f"v{version}-candidate")
        if not out.is_file():
            return cls(out, None, candidate)
        held = digest([out])
        try:
            number = read_model(out).history.version
        except InputError:  # no model
            return cls(out, None, candidate, held)
        return cls(out, beside(out, f"v{number}"), candidate, held)

    @property
    def is_as_it_was(self) -> bool:
        """Whether nobody has put another model there meanwhile."""
        return (digest([self.out]) if self.out.is_file() else "") == self.digest


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
