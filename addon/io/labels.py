# SPDX-License-Identifier: GPL-3.0-or-later
"""The contract's labels and truth: written piece by piece beside the labelling, read row by row, and compared."""

import csv
from array import array
from collections.abc import Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from itertools import dropwhile, groupby, takewhile, zip_longest
from math import isfinite
from operator import attrgetter
from pathlib import Path
from typing import NamedTuple, Self

import numpy as np

from ..core.data.errors import InputError
from ..core.data.takes import NO_MARKER, STEPS, Labels, PointRows
from ..core.review.changes import Change, changes, summary_of_changes
from .blobs import MAX_LINE_BYTES, RowWriter, csv_field
from .source import open_binary
from .text import in_cell

BLOB_KEYS = ("frame", "camera", "x", "y")
POINT_KEYS = ("frame", "point")

# Confidences are written to this many digits; a table of them is faster than printing each.
_CONFIDENCE = tuple(f"{value / 1000:.3f}".rstrip("0").rstrip(".") for value in range(1001))


class LabelWriter(RowWriter):
    """Writes `STEM.labels.csv` chunk by chunk; `keys` are the names of the columns that tell one row from another."""

    def __init__(self, path: Path, markers: Sequence[str], keys: Sequence[str] = BLOB_KEYS):
        super().__init__(path, ",".join([*keys, "marker,step,confidence"]))
        # The last name is that of NO_MARKER, -1.
        self.markers = [*map(csv_field, markers), ""]

    def write(self, keys: Sequence[str], labels: Labels):
        """Appends a row for each of `keys`, each the text of its own row, and what `labels` says of it."""
        markers = self.markers
        thousandths = np.clip(np.rint(np.nan_to_num(labels.confidence) * 1000), 0, 1000).astype(int).tolist()
        rows = zip(keys, labels.marker.tolist(), labels.step.tolist(), thousandths, strict=True)
        self.file.writelines(
            f"{key},{markers[marker]},{STEPS[step]},{_CONFIDENCE[confidence]}\n" if marker >= 0 else f"{key},,,0\n"
            for key, marker, step, confidence in rows
        )


def point_keys(rows: PointRows) -> list[str]:
    """What tells the row of each point from the others: its frame and its trajectory."""
    frames, trajectories = rows.frames[rows.frame].tolist(), rows.trajectory.tolist()
    return [f"{frame},{point}" for frame, point in zip(frames, trajectories, strict=True)]


class TruthWriter(RowWriter):
    """Writes a truth file chunk by chunk."""

    def __init__(self, path: Path, keys: Sequence[str] = BLOB_KEYS):
        super().__init__(path, ",".join([*keys, "marker"]))

    def write(self, keys: Sequence[str], markers: Iterable[str]):
        """Appends a row for each of `keys`: the marker's name, several joined with | where blobs merged, or empty."""
        self.file.writelines(f"{key},{csv_field(marker)}\n" for key, marker in zip(keys, markers, strict=True))


@dataclass(frozen=True)
class LabelRow:
    """One row of a labels or truth file."""

    line: int  # where it stands in the file
    frame: int  # the frame
    key: tuple  # what tells it from others in the frame: camera, x and y of a blob, the index of a point
    marker: str  # the name as it stands, merged ones joined with `|`; empty for none
    step: str  # how the label came about; empty where the file does not say
    confidence: float  # 0 to 1; NaN where the file does not say


class UnreadRow(NamedTuple):
    """One row as it stands in its file, of which only the frame was read."""

    line: int  # where it stands in the file
    frame: int  # the frame
    text: bytes  # the whole line


class LabelFile:
    """A labels or truth file of blobs or of 3D points, open and read row by row; a context manager.

    `what` names the file in errors. Further columns are let be. Raises InputError with the line where the file is not
    as the contract says.
    """

    def __init__(self, path: Path, what: str = "labels"):
        self.path, self.what = Path(path), what
        self.file = open_binary(path)
        self._line = 0  # that an error would name
        self._numbered = enumerate(iter(lambda: self.file.readline(MAX_LINE_BYTES + 1), b""), 1)

    def __enter__(self) -> Self:
        try:
            self._read_header()
        except BaseException:
            self.file.close()
            raise
        return self

    def __exit__(self, *_: object):
        self.file.close()

    @property
    def kind(self) -> str:
        """What the rows are of, in words."""
        return "blobs" if self.keys == BLOB_KEYS else "3D points"

    def rows(self) -> Iterator[LabelRow]:
        """All rows in their order, frames ascending."""
        return map(self.read, self.unread_rows())

    def unread_rows(self) -> Iterator[UnreadRow]:
        """All rows in their order, each unread: for whoever can mostly tell by its text what it says."""
        previous = beginning = None
        for line, text in self._numbered:
            if not text.strip(b"\r\n"):
                continue
            begins = text.partition(b",")[0]
            # Rows of a frame mostly begin alike.
            if begins != beginning or self._columns[0]:
                beginning, frame = begins, self.read(UnreadRow(line, 0, text)).frame
                if previous is not None and frame < previous:
                    raise self._error(f"goes back from frame {previous} to {frame}; expected ascending frames")
                previous = frame
            yield UnreadRow(line, previous or 0, text)

    def read(self, row: UnreadRow) -> LabelRow:
        """What a row says."""
        return self._row(self._fields(row.line, row.text))

    def _fields(self, line: int, content: bytes) -> list[str]:
        """The fields of a line, which is a row: no name has a line's end in it."""
        self._line = line
        if b"\0" in content:
            raise self._error(f"is a binary file; expected {self.what}")
        if len(content) > MAX_LINE_BYTES:
            raise self._error(f"has a line of over {MAX_LINE_BYTES >> 20} MB; expected {self.what}")
        text = content.decode("utf-8-sig" if line == 1 else "utf-8", "surrogateescape")
        plain = text.rstrip("\r\n")
        # As nearly every one of millions; a longer line may have a field that is too long.
        if 0 < len(plain) <= csv.field_size_limit() and '"' not in plain and "\r" not in plain:
            return plain.split(",")
        try:
            return next(csv.reader([text], strict=True), [])
        except csv.Error as error:
            quote = str(error) == "unexpected end of data"
            words = "has a quote that is not closed" if quote else f"is no CSV file ({error})"
            raise self._error(f"{words}; expected {self.what}") from None

    def _read_header(self):
        line, content = next(self._numbered, (0, b""))
        if not content:
            raise InputError(f"is empty; expected {self.what}", self.path)
        self.header = header = [name.strip().lower() for name in self._fields(line, content)]
        self.keys = BLOB_KEYS if "camera" in header else POINT_KEYS
        missing = [name for name in (*self.keys, "marker") if name not in header]
        if missing:
            forms = "frame,camera,x,y,marker or frame,point,marker"
            words = f"has no column {' or '.join(missing)}; expected {self.what} with the header {forms}"
            raise InputError(words, self.path, 1)
        self._columns = [header.index(name) for name in (*self.keys, "marker")]
        self._step, self._confidence = (header.index(one) if one in header else None for one in ("step", "confidence"))
        self._width = len(header)

    def _row(self, fields: list[str]) -> LabelRow:
        if len(fields) != self._width:
            raise self._error(f"has {len(fields)} fields; expected {self._width} as in the header (is it cut off?)")
        frame, *key, marker = [fields[column].strip() for column in self._columns]
        try:
            number = _number(frame, whole=True)
        except ValueError:
            raise self._error(f"has the frame {frame[:40]!r}; expected a whole number") from None
        try:
            # Equal numbers are the same place, however many digits each file writes.
            blob = len(key) > 1
            where = (in_cell(key[0]), *map(_number, key[1:])) if blob else (int(_number(key[0], whole=True)),)
        except ValueError:
            raise self._error(f"has a key that is no number; expected {self.what} as frame,…") from None
        step = "" if self._step is None else fields[self._step].strip()
        share, given = np.nan, "" if self._confidence is None else fields[self._confidence].strip()
        if given:
            with suppress(ValueError):
                share = _number(given)
            if not 0 <= share <= 1:
                raise self._error(f"has the confidence {given[:40]!r}; expected 0 to 1")
        return LabelRow(self._line, int(number), where, in_cell(marker), step, share)

    def _error(self, words: str) -> InputError:
        return InputError(words, self.path, self._line)


def _number(text: str, whole: bool = False) -> float:
    """A number that equals itself; ValueError for any other."""
    value = float(text)
    if not isfinite(value) or (whole and (value % 1 or abs(value) >= 2**53)):
        raise ValueError(text)
    return value


MAX_LISTED = 200  # changes that a report lists, the longest first: a list that a person reads


def facts_of_changes(before: Path, after: Path, markers: Sequence[str]) -> dict:
    """What a report says of what is otherwise than in an earlier label file; nothing where that is of other rows."""
    if not before.exists():
        return {}
    try:
        with LabelFile(before) as old, LabelFile(after) as new:
            found = _changes(old, new, markers)
    except InputError:  # whatever lies there, it is about to be replaced
        return {}
    return {"changed": [asdict(one) for one in found[:MAX_LISTED]], "changed_in_all": summary_of_changes(found)}


def changes_of_part(
    whole: Path, part: Path, markers: Sequence[str], frames: tuple[int, int]
) -> tuple[Change, ...] | None:
    """What is otherwise in the label file of a part of a take, its first to last frame, than in that of all of it.

    None where nobody can tell: the one of the whole take is not there, or is of other rows.
    """
    try:
        with LabelFile(whole) as old, LabelFile(part) as new:
            return _changes(old, new, markers, frames)
    except InputError:
        return None


def _changes(
    old: LabelFile, new: LabelFile, markers: Sequence[str], frames: tuple[int, int] | None = None
) -> tuple[Change, ...]:
    """All changes, in some `frames` of the old file; InputError where the rows are not of the same blobs or points."""
    index = {name: number for number, name in enumerate(markers)}
    numbers, table = array("q"), array("q")
    alike = old.header == new.header
    for frame, pairs in _frame_by_frame(old, new, frames):
        # Most of a take is as it was: those frames are counted, and only the others read.
        if not alike or any(one.text != other.text for one, other in pairs):
            for pair in pairs:
                one, other = old.read(pair[0]), new.read(pair[1])
                if one.key != other.key:
                    raise _others(old)
                # A name that the model does not have is of another model: as good as none.
                table.extend((len(numbers), index.get(one.marker, NO_MARKER), index.get(other.marker, NO_MARKER)))
        numbers.append(frame)
    at, before, after = np.array(table, dtype=np.int64).reshape(-1, 3).T
    return changes(at, before, after, markers, np.array(numbers, dtype=np.int64))


def _frame_by_frame(
    old: LabelFile, new: LabelFile, frames: tuple[int, int] | None
) -> Iterator[tuple[int, list[tuple[UnreadRow, UnreadRow]]]]:
    """Each frame, and its rows in pairs; InputError where the frames have other rows."""
    before, of_frame = old.unread_rows(), attrgetter("frame")
    if frames is not None:
        begun = dropwhile(lambda row: row.frame < frames[0], before)
        before = takewhile(lambda row: row.frame <= frames[1], begun)
    both = (groupby(rows, of_frame) for rows in (before, new.unread_rows()))
    for (frame, rows), (other, news) in zip_longest(*both, fillvalue=(None, ())):
        pairs = list(zip_longest(rows, news))
        if frame != other or None in pairs[-1]:
            raise _others(old)
        yield frame, pairs


def _others(old: LabelFile) -> InputError:
    return InputError("holds other rows than now; expected the labels of the same blobs or points", old.path)
