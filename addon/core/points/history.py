# SPDX-License-Identifier: GPL-3.0-or-later
"""What a model says of how it came about: its versions, who taught it what, and the takes that it is checked on."""

from dataclasses import dataclass, replace
from typing import Self


@dataclass(frozen=True)
class TaughtTake:
    """A file of a labelled take that a model was taught, or is checked on.

    name    of the file
    subject whose it is
    frames  how many labelled frames it had
    sha256  of what the file held; empty for a take that was taught from no file
    path    of the file as seen from the model's, with /; empty where it is not known
    up      the axis that points up in it, where that is known better than from the file; else empty
    rate    format: frames a second, where the file says none; else 0
    """

    name: str
    subject: str
    frames: int
    sha256: str = ""
    path: str = ""
    up: str = ""
    rate: float = 0.0


@dataclass(frozen=True)
class CheckedTake:
    """How a take was named before a training on and after it: shares of the points of its markers.

    name           of its file
    recall         named right, before and after
    wrong          named wrong, before and after
    """

    name: str
    recall: tuple[float, float]
    wrong: tuple[float, float]


@dataclass(frozen=True)
class ModelVersion:
    """One training of a model.

    version  counts the trainings, from 1
    date     the day, by the world's clock, as 2026-11-23; empty where not known
    by       who taught it; empty where not known
    program  the version of Mocap Autolabel
    origin   the fingerprint of the model that was trained on; empty for a new one
    takes    what it was taught; none where it was given its partial solvers
    checked  the takes that were named by the model before and by this one
    told     it was taken although some of these were named worse
    """

    version: int
    date: str = ""
    by: str = ""
    program: str = ""
    origin: str = ""
    takes: tuple[TaughtTake, ...] = ()
    checked: tuple[CheckedTake, ...] = ()
    told: bool = False


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
