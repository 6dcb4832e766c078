# SPDX-License-Identifier: GPL-3.0-or-later
"""The contract's labels and truth: written piece by piece beside the labelling, read whole."""

import csv
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Self

import numpy as np

from ..core.errors import InputError
from ..core.takes import STEPS, Labels
from .blobs import csv_field
from .source import open_binary

BLOB_KEYS = ("frame", "camera", "x", "y")
POINT_KEYS = ("frame", "point")
KIND = "labels or truth with the header frame,camera,x,y,marker or frame,point,marker"

# Confidences are written to this many digits; a table of them is faster than printing each.
_CONFIDENCE = tuple(f"{value / 1000:.3f}".rstrip("0").rstrip(".") for value in range(1001))


class _RowWriter:
    """Rows behind a header; a context manager."""

    def __init__(self, path: Path, header: str):
        self.file = Path(path).open("w", encoding="utf-8", errors="surrogateescape", newline="\n")  # noqa: SIM115
        self.file.write(header + "\n")

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object):
        self.file.close()


class LabelWriter(_RowWriter):
    """Writes `STEM.labels.csv` chunk by chunk; `keys` are the names of the columns that tell one row from another."""

    def __init__(self, path: Path, markers: Sequence[str], keys: Sequence[str] = BLOB_KEYS):
        super().__init__(path, ",".join([*keys, "marker,step,confidence"]))
        # The last name is that of NO_MARKER, -1.
        self.markers = [*map(csv_field, markers), ""]

    def write(self, keys: Sequence[str], labels: Labels, steps: Sequence[str] = STEPS):
        """Appends a row for each of `keys`, each the text of its own row, and what `labels` says of it."""
        markers = self.markers
        thousandths = np.clip(np.rint(np.nan_to_num(labels.confidence) * 1000), 0, 1000).astype(int).tolist()
        rows = zip(keys, labels.marker.tolist(), labels.step.tolist(), thousandths, strict=True)
        self.file.writelines(
            f"{key},{markers[marker]},{steps[step]},{_CONFIDENCE[confidence]}\n" if marker >= 0 else f"{key},,,0\n"
            for key, marker, step, confidence in rows
        )


class TruthWriter(_RowWriter):
    """Writes a truth file chunk by chunk."""

    def __init__(self, path: Path, keys: Sequence[str] = BLOB_KEYS):
        super().__init__(path, ",".join([*keys, "marker"]))

    def write(self, keys: Sequence[str], markers: Iterable[str]):
        """Appends a row for each of `keys`: the marker's name, several joined with | where blobs merged, or empty."""
        self.file.writelines(f"{key},{csv_field(marker)}\n" for key, marker in zip(keys, markers, strict=True))


@dataclass(frozen=True, eq=False)
class LabelTable:
    """N rows of a labels or truth file.

    columns     the key columns, BLOB_KEYS or POINT_KEYS
    keys        each row's own text of them
    frame       (N,) frame numbers
    names       what stands in the marker column, each text once; the first is empty, merged names keep their |
    marker      (N,) index into `names`
    steps       the words of the step column, each once; the first is empty
    step        (N,) index into `steps`
    confidence  (N,) 0 to 1, NaN where the file has none
    """

    columns: tuple[str, ...]
    keys: list[str]
    frame: np.ndarray
    names: tuple[str, ...]
    marker: np.ndarray
    steps: tuple[str, ...]
    step: np.ndarray
    confidence: np.ndarray

    def __len__(self) -> int:
        return len(self.keys)


def read_labels(path: Path) -> LabelTable:
    """A labels or truth file, of blobs or of 3D points as its header says; further columns are let be.

    Raises InputError with the line where it is not as the contract says.
    """
    path = Path(path)
    names, steps = {"": 0}, {"": 0}
    keys, frame, marker, step, confidence = [], [], [], [], []
    with open_binary(path) as file:
        rows = _rows(file, path)
        header = [name.strip().lower() for name in next(rows, (1, []))[1]]
        columns = BLOB_KEYS if "camera" in header else POINT_KEYS
        missing = [name for name in (*columns, "marker") if name not in header]
        if missing:
            raise InputError(f"has no column {' or '.join(missing)}; expected {KIND}", path, 1)
        at = [header.index(name) for name in columns]
        marker_at = header.index("marker")
        step_at, confidence_at = (header.index(n) if n in header else None for n in ("step", "confidence"))
        for line, fields in rows:
            if len(fields) != len(header):
                raise InputError(f"has {len(fields)} fields; expected {len(header)} (cut off?)", path, line)
            keys.append(",".join(csv_field(fields[column]) for column in at))
            frame.append(_whole(fields[at[0]], path, line))
            marker.append(names.setdefault(fields[marker_at].strip(), len(names)))
            step.append(steps.setdefault(fields[step_at].strip(), len(steps)) if step_at is not None else 0)
            confidence.append(_share(fields[confidence_at], path, line) if confidence_at is not None else np.nan)
    if not keys:
        raise InputError("has no rows; expected at least one", path)
    arrays = (np.array(marker), tuple(steps), np.array(step), np.array(confidence, dtype=float))
    return LabelTable(columns, keys, np.array(frame), tuple(names), *arrays)


def _rows(file: Iterable[bytes], path: Path) -> Iterator[tuple[int, list[str]]]:
    """The lines that are not empty, with their numbers, as fields."""
    reader = csv.reader(_texts(file, path))
    while True:
        try:
            fields = next(reader, None)
        except csv.Error as error:
            raise InputError(f"is no CSV file ({error}); expected {KIND}", path, reader.line_num) from None
        if fields is None:
            return
        if fields:
            yield reader.line_num, fields


def _texts(file: Iterable[bytes], path: Path) -> Iterator[str]:
    for number, line in enumerate(file, 1):
        if b"\0" in line:
            raise InputError(f"is a binary file; expected {KIND}", path, number)
        yield line.decode("utf-8-sig" if number == 1 else "utf-8", "surrogateescape")


def _whole(text: str, path: Path, line: int) -> int:
    try:
        value = float(text)
    except ValueError:
        value = np.nan
    if not abs(value) < 2**53 or value % 1:
        raise InputError(f"has the frame {text.strip()[:40]!r}; expected a whole number", path, line)
    return int(value)


def _share(text: str, path: Path, line: int) -> float:
    try:
        value = float(text) if text.strip() else np.nan
    except ValueError:
        value = -1.0
    if value < 0 or value > 1:
        raise InputError(f"has the confidence {text.strip()[:40]!r}; expected 0 to 1", path, line)
    return value
