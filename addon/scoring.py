# SPDX-License-Identifier: GPL-3.0-or-later
"""Labels against the truth, file against file, a few frames at a time."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, groupby
from pathlib import Path

from .core.data.errors import InputError
from .core.evaluation.figures import Figures
from .io.labels import BLOB_KEYS, LabelFile, LabelRow

SCORED_ROWS = 50_000


@dataclass
class Agreement:
    """The figures of a comparison, of what (in words), how many rows of labels and how many of them without truth."""

    figures: Figures
    things: str
    rows: int = 0
    unknown: int = 0


def compare(
    labels: Path, truth: Path, figures: Figures, frames: tuple[int | None, int | None] | None = None
) -> Agreement:
    """Adds up the figures of the labels file against the truth file, both in ascending order of frames.

    A row of truth that the labels lack is an InputError: a labelling cannot win by leaving rows out. So are files of
    different kinds and whatever is no such file.
    """
    with LabelFile(labels) as ours, LabelFile(truth, "truth") as known:
        agreement = Agreement(figures, ours.kind)
        if ours.keys != known.keys:
            raise InputError(
                f"has truth of {known.kind}, but the labels are of {ours.kind}; expected the same kind", truth, 1
            )
        batch: list[tuple[LabelRow, str]] = []
        for row, name in _matched(ours, known, agreement, frames):
            if len(batch) >= SCORED_ROWS and row.frame != batch[-1][0].frame:
                _count(figures, batch, ours.keys)
                batch = []
            batch.append((row, name))
        _count(figures, batch, ours.keys)
    if not agreement.rows:
        raise InputError("has no rows in these frames; expected labels to compare", labels)
    if agreement.unknown == agreement.rows:
        raise InputError("has the truth of none of the labels' rows; expected the truth of the same take", truth)
    return agreement


def _matched(
    ours: LabelFile, known: LabelFile, agreement: Agreement, frames: tuple[int | None, int | None] | None
) -> Iterator[tuple[LabelRow, str]]:
    """Every row of labels that has a known truth, with it."""
    truths = groupby(_within(known.rows(), frames), key=lambda row: row.frame)
    frame, group = next(truths, (None, iter(())))
    for label_frame, labels in groupby(_within(ours.rows(), frames), key=lambda row: row.frame):
        if frame is not None and frame < label_frame:
            raise _left_out(ours, next(group))
        there: dict[tuple, list[LabelRow]] = {}
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


def _within(rows: Iterator[LabelRow], frames: tuple[int | None, int | None] | None) -> Iterator[LabelRow]:
    first, last = frames or (None, None)
    return (r for r in rows if (first is None or r.frame >= first) and (last is None or r.frame <= last))


def _left_out(ours: LabelFile, row: LabelRow) -> InputError:
    what = " ".join(str(part) for part in row.key)
    return InputError(
        f"has no row for frame {row.frame}, {what} (line {row.line} of the truth); expected all its rows, or --frames",
        ours.path,
    )


def _count(figures: Figures, batch: list[tuple[LabelRow, str]], keys: tuple[str, ...]):
    if batch:
        rows = [row for row, _ in batch]
        cameras = [row.key[0] for row in rows] if keys == BLOB_KEYS else None
        truth = [name for _, name in batch]
        figures.add([row.frame for row in rows], cameras, [r.marker for r in rows], truth, [r.step for r in rows])
