# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels against the truth, file against file, a few frames at a time."""

import csv
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, groupby
from pathlib import Path
from typing import Self

from .core.errors import InputError
from .core.figures import Figures
from .io.source import open_binary

BLOB_KEYS, POINT_KEYS = ("camera", "x", "y"), ("point",)
CHUNK_ROWS = 50_000


@dataclass(frozen=True)
class Row:
    """One row of a labels or truth file: its line, its frame, what tells it from others in the frame, and its names."""

    line: int
    frame: int
    key: tuple
    marker: str
    step: str


@dataclass
class Agreement:
    """The figures of a comparison, how many rows of labels there were and how many of them have no known truth."""

    figures: Figures
    rows: int = 0
    unknown: int = 0


def compare(
    labels: Path, truth: Path, figures: Figures, frames: tuple[int | None, int | None] | None = None
) -> Agreement:
    """Adds up the figures of the labels file against the truth file, both in ascending order of frames.

    A row of truth that the labels lack is an InputError: a labelling cannot win by leaving rows out. So are files of
    different kinds and whatever is no such file.
    """
    agreement = Agreement(figures)
    with _Table(labels, "labels") as ours, _Table(truth, "truth") as known:
        if ours.keys != known.keys:
            raise InputError(
                f"has truth of {known.kind}, but the labels are of {ours.kind}; expected the same kind", truth, 1
            )
        batch: list[tuple[Row, str]] = []
        for row, name in _matched(ours, known, agreement, frames):
            if len(batch) >= CHUNK_ROWS and row.frame != batch[-1][0].frame:
                _count(figures, batch, ours.keys)
                batch = []
            batch.append((row, name))
        _count(figures, batch, ours.keys)
    if not agreement.rows:
        raise InputError("has no rows in these frames; expected labels to compare", labels)
    if agreement.unknown == agreement.rows:
        raise InputError("has the truth of none of the labels' rows; expected the truth of the same take", truth)
    return agreement


class _Table:
    """A labels or truth file, open, frame by frame."""

    def __init__(self, path: Path, what: str):
        self.path, self.what = path, what
        self.file = open_binary(path)
        self.lines = enumerate(csv.reader(_text(self.file, path, what)), 1)

    def __enter__(self) -> Self:
        try:
            header = [name.strip().lower() for name in self._next_fields()]
        except BaseException:
            self.file.close()
            raise
        self.keys = BLOB_KEYS if "camera" in header else POINT_KEYS
        missing = [name for name in ("frame", *self.keys, "marker") if name not in header]
        if missing:
            self.file.close()
            raise InputError(
                f"has no column {' or '.join(missing)}; expected {self.what} with the header frame,camera,x,y,marker "
                "or frame,point,marker",
                self.path,
                1,
            )
        self.columns = [header.index(name) for name in ("frame", *self.keys, "marker")]
        self.step = header.index("step") if "step" in header else None
        self.width = len(header)
        return self

    def __exit__(self, *_):
        self.file.close()

    @property
    def kind(self) -> str:
        return "blobs" if self.keys == BLOB_KEYS else "3D points"

    def _next_fields(self) -> list[str]:
        try:
            return next(self.lines)[1]
        except StopIteration:
            raise InputError(f"is empty; expected {self.what}", self.path) from None
        except csv.Error as error:
            raise InputError(f"is no CSV file ({error}); expected {self.what}", self.path) from None

    def rows(self) -> Iterator[Row]:
        previous = None
        while True:
            try:
                line, fields = next(self.lines)
            except StopIteration:
                return
            except csv.Error as error:
                raise InputError(f"is no CSV file ({error}); expected {self.what}", self.path) from None
            if not fields:
                continue
            row = self._row(line, fields)
            if previous is not None and row.frame < previous:
                raise InputError(
                    f"goes back from frame {previous} to {row.frame}; expected ascending frames", self.path, line
                )
            previous = row.frame
            yield row

    def _row(self, line: int, fields: list[str]) -> Row:
        if len(fields) != self.width:
            raise InputError(
                f"has {len(fields)} fields; expected {self.width} as in the header (is the file cut off?)",
                self.path,
                line,
            )
        frame, *key, marker = (fields[column].strip() for column in self.columns)
        try:
            # Equal numbers are the same place, however many digits each file writes.
            key = [key[0], *(float(number) for number in key[1:])] if len(key) > 1 else [int(key[0])]
            return Row(line, int(float(frame)), tuple(key), marker, "" if self.step is None else fields[self.step])
        except (ValueError, OverflowError):
            raise InputError(f"has a key that is no number; expected {self.what} as frame,…", self.path, line) from None


def _text(file, path: Path, what: str) -> Iterator[str]:
    for number, line in enumerate(file, 1):
        if b"\0" in line:
            raise InputError(f"is a binary file; expected {what}", path, number)
        yield line.decode("utf-8-sig" if number == 1 else "utf-8", "surrogateescape")


def _matched(
    ours: _Table, known: _Table, agreement: Agreement, frames: tuple[int | None, int | None] | None
) -> Iterator[tuple[Row, str]]:
    """Every row of labels that has a known truth, with it."""
    truths = groupby(_within(known.rows(), frames), key=lambda row: row.frame)
    frame, group = next(truths, (None, iter(())))
    for label_frame, labels in groupby(_within(ours.rows(), frames), key=lambda row: row.frame):
        if frame is not None and frame < label_frame:
            raise _left_out(ours, next(group))
        there: dict[tuple, list[Row]] = {}
        if frame == label_frame:
            for row in group:
                there.setdefault(row.key, []).append(row)
            frame, group = next(truths, (None, iter(())))
        for row in labels:
            agreement.rows += 1
            if there.get(row.key):
                yield row, there[row.key].pop(0).marker
            else:
                agreement.unknown += 1
        for row in chain.from_iterable(there.values()):
            raise _left_out(ours, row)
    if frame is not None:
        raise _left_out(ours, next(group))


def _within(rows: Iterator[Row], frames: tuple[int | None, int | None] | None) -> Iterator[Row]:
    first, last = frames or (None, None)
    return (r for r in rows if (first is None or r.frame >= first) and (last is None or r.frame <= last))


def _left_out(ours: _Table, row: Row) -> InputError:
    what = " ".join(str(part) for part in row.key)
    return InputError(
        f"has no row for frame {row.frame}, {what} (line {row.line} of the truth); expected all its rows, or --frames",
        ours.path,
    )


def _count(figures: Figures, batch: list[tuple[Row, str]], keys: tuple[str, ...]):
    if batch:
        rows = [row for row, _ in batch]
        cameras = [row.key[0] for row in rows] if keys == BLOB_KEYS else None
        truth = [name for _, name in batch]
        figures.add([row.frame for row in rows], cameras, [r.marker for r in rows], truth, [r.step for r in rows])
