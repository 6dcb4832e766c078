# SPDX-License-Identifier: GPL-3.0-or-later
"""The samples of a file of 3D points as they are read, and packed into lanes: of P columns most are empty."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Self

import numpy as np

from ..core.data.lanes import Lanes, blocks
from ..core.data.made import IN_MEMORY, MakeTable

if TYPE_CHECKING:
    from .c3d.file import TrialFile


@dataclass(frozen=True, eq=False)
class Samples:
    """N samples of a file that are there, as the numbers that stand there."""

    frame: np.ndarray  # (N,) 0-based, and
    column: np.ndarray  # (N,) of the file
    xyz: np.ndarray  # (N, 3), of the narrowest kind that holds them, and
    residual: np.ndarray  # (N,), NaN where not stated

    @classmethod
    def of(cls, xyz: np.ndarray, first: int = 0) -> Self:
        """Those of frames of points (F, P, 3), NaN where missing, the first of them the frame `first`."""
        frame, column = np.nonzero(np.isfinite(xyz).all(axis=2))
        frame, column = frame.astype(np.int32), column.astype(np.int32)
        return cls(frame + np.int32(first), column, xyz[frame, column], np.full(len(frame), np.nan))


Parts = Callable[[], Iterable[Samples]]  # all samples of a file, part by part, as often as it is called


@dataclass(frozen=True, eq=False)
class TextHead:
    """What the head of a text file says of its take, for the file that names are put into."""

    fields: Mapping[str, str]  # texts by what a TRC calls them
    # what of a Motive `.csv` or a `.tsv` is about the take and not about the export, by its names
    said: Mapping[str, str]
    begin: float | None = None  # s from zero to frame 0, of a TRC; None of others
    group: str = "MOTIVE"  # of a C3D in which that is said
    events: tuple[tuple[str, float], ...] = ()  # of a `.tsv`, each a name and a frame


@dataclass(frozen=True, eq=False)
class PointFile:
    """What a file of any format says of its points."""

    labels: Sequence[str]  # P names of the columns that are taken, empty where there is none
    columns: np.ndarray  # (P,) their indices among `count`
    count: int
    frames: int  # how many, from `first_frame` on, `rate` a second
    rate: float
    first_frame: int
    parts: Parts  # all samples
    # the unit and the axis that points up as the file names them; empty where it names none
    unit: str
    word: str = ""
    usual: str = "+Z"  # the axis that is up where it names none
    # what their places, and their residuals, are times to be in the file's units
    scale: tuple[float, float] = (1.0, 1.0)
    notes: tuple[str, ...] = ()  # what is otherwise than the file says, in sentences
    trial: "TrialFile | TextHead | None" = None  # for what else it holds


def packed(
    frames: int, chosen: np.ndarray, count: int, parts: Parts, make_table: MakeTable = IN_MEMORY
) -> tuple[np.ndarray, np.ndarray, Lanes]:
    """The chosen ones of a file's columns over so many frames; the file is gone through twice, and never held.

    Gives places (T, L, 3) and residuals (T, L), NaN where missing, and which of the chosen columns stands in which
    lane. Residuals are NaN everywhere where no sample of the file has one above zero; else zero says that a sample was
    filled. Hardly anything asks for them: they are in a table that `make_table` gives.
    """
    trajectory = np.full(count, -1)
    trajectory[chosen] = np.arange(len(chosen))
    first, last, stated, kind = np.full(count, frames), np.full(count, -1), False, np.dtype(np.float32)
    for part in parts():
        kind = part.xyz.dtype
        np.minimum.at(first, part.column, part.frame)
        np.maximum.at(last, part.column, part.frame)
        stated |= bool((part.residual > 0).any())
    lanes = Lanes.packed(first[chosen], last[chosen])
    shape = frames, lanes.count
    xyz, residual = np.full((*shape, 3), np.nan, kind), np.broadcast_to(np.float32(np.nan), shape)
    if stated:
        residual = make_table(shape, np.float32)
        for own in blocks(*shape):
            residual[own] = np.nan
    for part in parts():
        own = trajectory[part.column]
        kept = own >= 0
        at = part.frame[kept], lanes.lane[own[kept]]
        xyz[at] = part.xyz[kept]
        if stated:
            residual[at] = part.residual[kept]
    return xyz, residual, lanes
