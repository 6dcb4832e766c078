# SPDX-License-Identifier: GPL-3.0-or-later
"""Takes of 3D points, of every format that is read and the two that are written, in metres with z up."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar, cast

import numpy as np

from ..core.data.errors import InputError
from ..core.data.lanes import blocks
from ..core.data.made import IN_MEMORY, MakeTable, Scaled
from ..core.data.markersets import MarkerSet
from ..core.data.takes import Points
from ..core.data.wording import count_of, listed, words_of_range
from .c3d.file import TrialFile
from .c3d.reading import open_c3d
from .c3d.writing import names_in_c3d, write_c3d_file
from .qtm.capture import USE_POINTS, held_in, is_qtm
from .qtm.records import read_qtm_points
from .samples import PointFile, TextHead, packed
from .textpoints import is_csv_of_points, read_csv, read_trc, read_tsv, write_trc_file
from .world import UNITS, Upright, find_up, guess_unit, turns_from, up_rotation

EXPECTED = "expected a take of 3D points: .c3d, .trc, Motive or Vicon .csv, Qualisys .tsv or .qtm"
TEXT_READERS = {".trc": read_trc, ".tsv": read_tsv, ".csv": read_csv}

# How the points of a file are kept; memory.
# of a table (T, L) beyond which they stay as narrow as in the file, and are lengths where they are asked
MAX_WIDE_CELLS = 2_000_000


# Of Vicon, Motive, and QTM, which calls a label New 0001 until somebody names it; format.
_UNLABELLED = re.compile(r"\*\d*|(?:unlabell?ed|unidentified)[ :_-]?\d*|new \d{4,}|u(?:name)?\*\d+|", re.IGNORECASE)


@dataclass(frozen=True, eq=False)
class FilePoints(Points):
    """Points out of a file: `columns` are there, and trajectories that are not there at a time may share a lane."""

    assumed: str = ""  # the unit that they were taken to be in, where the file names none that is known; else empty
    up: str = "+Z"  # the axis of the file that points up
    notes: tuple[str, ...] = ()  # what was taken to be otherwise than the file says, in sentences
    # where it is not mirrored: what `write_c3d` and `write_trc` need to keep what else its file holds
    trial: TrialFile | TextHead | None = None

    @property
    def turns(self) -> dict[str, np.ndarray]:
        """The rotations (3, 3) of the points by the axis of the file that would then point up."""
        return turns_from(self.up)


def holds_points(path: Path, use: str | None = None) -> bool:
    """Whether a file is a take of 3D points and not of blobs, known by its suffix and a `.csv` by its first words.

    A `.qtm` may hold both: then `use`, "blobs" or "points", says which are meant; without it, these are blobs where
    their cameras are calibrated. InputError where a file does not hold what is meant.
    """
    if is_qtm(path):
        return held_in(path).choice(use, path) == USE_POINTS
    suffix = Path(path).suffix.lower()
    points = suffix in (".c3d", ".trc", ".tsv") or (suffix == ".csv" and is_csv_of_points(path))
    if use is not None and points != (use == USE_POINTS):
        raise InputError(f"holds {'3D points' if points else 'blobs'}; expected a take of {use}, or no --use", path)
    return points


Taken = TypeVar("Taken", bound=Points)
Frames = tuple[int | None, int | None] | None  # first and last, both included; None for the take's own


def read_points(
    path: Path,
    everything: bool = False,
    frames: Frames = None,
    up: str | None = None,
    rate: float | None = None,
    make_table: MakeTable = IN_MEMORY,
    mirror: bool = False,
) -> FilePoints:
    """A take of 3D points, known by its suffix: markers only, unless `everything` is asked for.

    Left out are the model outputs, axes of segments and joint centres that Vicon mixes among the markers.
    `up` is the axis that points up in the file, one of x y z -x -y -z, where that is known better than from the file;
    `rate` is used where a file says none; `make_table` says where residuals are kept; `mirror` reverses an axis,
    of a take whose axes are left-handed.

    Raises InputError for whatever cannot be used, and where no point is in the frames asked for.
    """
    path = Path(path)
    take = _read(path, everything, up, rate, make_table)
    if mirror:
        numbers = take.xyz.numbers if isinstance(take.xyz, Scaled) else take.xyz
        for part in blocks(*take.xyz.shape[:2]):
            numbers[part, :, 1] *= -1
        take = replace(take, notes=(*take.notes, "its points are mirrored, as was asked for"), trial=None)
    return of_frames(take, frames or (None, None), path)


def of_frames(take: Taken, frames: tuple[int | None, int | None], path: Path | str = "") -> Taken:
    """The take's frames from A to B, both included; InputError where it has no point in them."""
    first, last = frames
    start = 0 if first is None else max(first - take.first_frame, 0)
    stop = len(take.xyz) if last is None else max(last - take.first_frame + 1, 0)
    part = slice(start, min(stop, len(take.xyz)))
    here = blocks(part.stop - part.start, take.xyz.shape[1])
    if not any(np.isfinite(take.xyz[part.start + own.start : part.start + own.stop, :, 0]).any() for own in here):
        own = f"{take.first_frame} to {take.first_frame + len(take.xyz) - 1}"
        asked = own if frames == (None, None) else words_of_range(frames)
        words = f"has no point that is present in frames {asked}"
        raise InputError(f"{words}; expected frames with markers, of its own {own}", path)
    if part == slice(0, len(take.xyz)):
        return take
    lanes = None if take.lanes is None else take.lanes.between(part.start, part.stop)
    xyz, residual = (one.part(part) if isinstance(one, Scaled) else one[part] for one in (take.xyz, take.residual))
    return replace(take, xyz=xyz, residual=residual, lanes=lanes, first_frame=take.first_frame + start)


def _read(path: Path, everything: bool, up: str | None, rate: float | None, make_table: MakeTable) -> FilePoints:
    suffix = path.suffix.lower()
    if suffix == ".c3d":
        with open_c3d(path, rate, everything) as content:
            return _file_points(content, up, path, make_table)
    if is_qtm(path):
        return _file_points(read_qtm_points(path), up, path)
    if suffix not in TEXT_READERS:
        if not path.exists():
            raise InputError("there is no such file; expected the path of a take", path)
        raise InputError(f"is of a kind that is not known ({suffix or 'no suffix'}); {EXPECTED}", path)
    return _file_points(TEXT_READERS[suffix](path, rate), up, path)


def _file_points(content: PointFile, up: str | None, path: Path, make_table: MakeTable = IN_MEMORY) -> FilePoints:
    """The take in a file, in metres and turned upright; `up` is the axis that somebody named, such as "z" or "-y"."""
    places, residuals, lanes = packed(content.frames, content.columns, content.count, content.parts, make_table)
    if not (lanes.last >= lanes.first).any():
        raise InputError("has no point that is present in any frame; expected a take with markers", path)
    assumed = "" if content.unit in UNITS else guess_unit(Scaled(places, content.scale[:1]))
    metre = UNITS[assumed or content.unit]
    xyz, residual = (Scaled(one, (scale, metre)) for one, scale in zip((places, residuals), content.scale, strict=True))
    names = _named(content.labels)
    if up:
        upright = Upright(f"{'-' if up[0] == '-' else '+'}{up[-1].upper()}")
    else:
        upright = find_up(content.word, xyz, names, content.usual, lanes)
    turn = up_rotation(upright.axis)
    axis, sign = np.abs(turn).argmax(axis=1), turn.sum(axis=1).astype(places.dtype)
    for part in blocks(*residuals.shape):
        places[part] = places[part][..., axis] * sign
    small = residuals.size <= MAX_WIDE_CELLS
    return FilePoints(
        names,
        # What gives parts of an array serves as one.
        np.asarray(xyz) if small else cast("np.ndarray", xyz),
        np.asarray(residual) if small else cast("np.ndarray", residual),
        content.rate,
        content.first_frame,
        content.columns,
        # Whoever goes by columns finds each trajectory in its own where none has to share.
        None if lanes.count == len(content.columns) else lanes,
        assumed,
        upright.axis,
        content.notes + upright.notes,
        replace(content.trial, metre=metre, turn=turn) if isinstance(content.trial, TrialFile) else content.trial,
    )


def _named(labels: Sequence[str]) -> tuple[str, ...]:
    """Names as in the file; empty for what a file calls `*12` or `Unlabeled 1036`."""
    return tuple("" if _UNLABELLED.fullmatch(label) else label for label in labels)


def _bare(label: str) -> str:
    return label.rpartition(":")[2]


def marker_columns(names: Sequence[str], wanted: Sequence[str], path: Path | str = "") -> np.ndarray:
    """For each of `wanted`, its index in the take's `names`; -1 where the take has none.

    A name is also found behind a subject's: `LASI` is `Name:LASI` where there is one subject.

    Raises InputError when a name is there twice: the same label, or the same marker of two subjects.
    """
    full, bare = Counter(names), Counter(_bare(name) for name in names)
    found = []
    for name in wanted:
        if full[name] > 1 or (not full[name] and bare[_bare(name)] > 1 and ":" not in name):
            owners = sorted({other for other in names if _bare(other) == _bare(name)})
            what = count_of(len(owners), "subject") if len(owners) > 1 else "the label twice"
            raise InputError(f"has {what} for marker {name} ({listed(owners)}); expected every marker once", str(path))
        match = next((i for i, other in enumerate(names) if other == name), None)
        if match is None and ":" not in name:
            match = next((i for i, other in enumerate(names) if _bare(other) == name), None)
        found.append(-1 if match is None else match)
    return np.array(found, dtype=int)


def columns_of_set(names: Sequence[str], markerset: MarkerSet, path: Path | str = "") -> np.ndarray:
    """(M,) which of a take's `names` is each marker of a set: its own, an alias, or the beginning that a C3D holds.

    -1 where the take has none, or what begins alike is several markers'.
    """
    found, others = marker_columns(names, markerset.markers, path), dict(markerset.aliases)
    owners = {name.rpartition(":")[0] for name in names}
    before = f"{owners.pop()}:" if len(owners) == 1 and owners != {""} else ""
    whole = [before + name for name in markerset.markers]
    others |= {
        cut: marker
        for cut, name, marker in zip(names_in_c3d(whole), whole, markerset.markers, strict=True)
        if cut != name and [one for one in whole if one.startswith(cut)] == [name]
    }
    for other, column in zip(others, marker_columns(names, list(others), path), strict=True):
        index = markerset.index(others[other])
        found[index] = column if found[index] < 0 else found[index]
    return found


def write_c3d(
    path: Path, points: Points, trial: TrialFile | TextHead | None = None, subjects: Sequence[str] = ()
) -> list[str]:
    """Writes the contract's labelled take: names in their order, and unlabelled trajectories as *1, *2 and so on.

    Without the `trial` that it came from it is written alone, in mm, z up; else with all else of that C3D file, in its
    unit and axes, or with what a text's head says. Samples whose residual is 0 were filled, measured ones get one above
    zero. `subjects` are those whose names stand before markers. Gives what there was no room for, in sentences.
    """
    of_take = points.xyz, points.residual, points.rate, points.first_frame
    return write_c3d_file(path, _numbered(points.names), *of_take, trial, subjects)


def write_trc(path: Path, points: Points, trial: TrialFile | TextHead | None = None):
    """Writes the same take as `.trc`, in mm, z up, with the head of a text file that it came from."""
    head = trial if isinstance(trial, TextHead) else None
    write_trc_file(path, _numbered(points.names), points.xyz, points.rate, points.first_frame, head)


def _numbered(names: Sequence[str]) -> list[str]:
    numbers = iter(range(1, len(names) + 1))
    return [name or f"*{next(numbers)}" for name in names]
