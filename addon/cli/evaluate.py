# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate LABELS TRUTH`: compares a label file with the truth."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain, groupby
from pathlib import Path

from ..core.data.errors import InputError
from ..core.data.wording import count_of
from ..core.evaluation.figures import Figures
from ..io.labels import BLOB_KEYS, LabelFile, LabelRow
from ..io.markersets import open_markerset
from .arguments import add_options
from .console import print_results

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


DESCRIPTION = """Compares labels with the truth, row by row in any order within a frame, and prints precision, recall
and the other figures. Rows of LABELS that TRUTH does not have are left out: their truth is not known."""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("evaluate", help="compare labels with the truth", description=DESCRIPTION)
    parser.add_argument("labels", metavar="LABELS", type=Path, help="a *.labels.csv")
    parser.add_argument("truth", metavar="TRUTH", type=Path, help="a file with the same keys and the column marker")
    add_options(parser, "--model", help="the marker set: names in the truth that it does not have count as no marker")
    add_options(parser, "--frames")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Compares the two files and prints the figures."""
    agreement = compare(arguments.labels, arguments.truth, start(arguments.model), arguments.frames)
    print_results(as_lines(agreement), as_result(agreement), arguments.json)
    return 0


def start(model: str | None) -> Figures:
    """Figures that know the markers of a model, or that take every name there is."""
    if model is None:
        return Figures()
    markerset = open_markerset(model)
    return Figures(markerset.markers, markerset.aliases)


def as_result(agreement: Agreement) -> dict:
    """The figures for JSON."""
    return {**agreement.figures.as_dict(), "rows": agreement.rows, "rows_without_truth": agreement.unknown}


def as_lines(agreement: Agreement) -> list[str]:
    """The figures as a short table for people."""
    figures = agreement.figures.as_dict()
    given = f"{figures['right']:,} right of {count_of(figures['labels'], 'label')} given"
    there = f"{figures['marker_blobs']:,} {agreement.things} of real markers"
    lines = [
        f"precision           {percent(figures['precision'])}   {given}",
        f"recall              {percent(figures['recall'])}   of {there}",
        f"f1                  {percent(figures['f1'])}",
        f"false assignments   {percent(figures['false_assignments'])}   {count_of(figures['wrong'], 'label')}",
        f"false occlusions    {percent(figures['false_occlusions'])}",
        f"perfect frames      {percent(figures['perfect_frames'])}   of {figures['frames']:,}",
    ]
    lines += [
        f"step {step:<14} {percent(counts['precision'])}   {counts['right']} right of {counts['labels']}"
        for step, counts in figures["steps"].items()
        if step
    ]
    lines += [
        f"swapped             {' and '.join(swap['markers'])}, {count_of(swap['count'], 'time')}"
        for swap in figures["swaps"][:5]
    ]
    lines += [f"weakest             {row}" for row in weakest(figures["per_marker"])]
    if agreement.unknown:
        lines.append(f"without truth       {agreement.unknown} of {agreement.rows} rows, left out")
    return lines


def weakest(per_marker: dict) -> list[str]:
    """The five markers with the most blobs that did not get their name."""
    flawed = [(name, of) for name, of in per_marker.items() if of["recall"] is not None and of["recall"] < 1]
    flawed.sort(key=lambda row: row[1]["marker_blobs"] * (row[1]["recall"] - 1))
    return [f"{name}: recall {percent(of['recall'])}, precision {percent(of['precision'])}" for name, of in flawed[:5]]


def percent(value: float | None) -> str:
    """A share as a percentage that is 100 % only when nothing is wrong."""
    if value is None:
        return "     none"
    return f"{value:9.3%}" if value in (0.0, 1.0) else f"{min(max(value, 0.00001), 0.99999):9.3%}"
