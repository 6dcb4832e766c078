# SPDX-License-Identifier: GPL-3.0-or-later
"""`evaluate LABELS TRUTH`: the contract's figures of a labelling whose truth is known."""

from pathlib import Path

from ..core.evaluation.figures import Figures
from ..io.markersets import open_markerset
from ..scoring import Agreement, compare
from .arguments import add_options
from .console import print_results

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
    given = f"{figures['right']} right of {figures['labels']} labels given"
    there = f"{figures['marker_blobs']} {agreement.things} of real markers"
    lines = [
        f"precision           {percent(figures['precision'])}   {given}",
        f"recall              {percent(figures['recall'])}   of {there}",
        f"f1                  {percent(figures['f1'])}",
        f"false assignments   {percent(figures['false_assignments'])}   {figures['wrong']} labels",
        f"false occlusions    {percent(figures['false_occlusions'])}",
        f"perfect frames      {percent(figures['perfect_frames'])}   of {figures['frames']}",
    ]
    lines += [
        f"step {step:<14} {percent(counts['precision'])}   {counts['right']} right of {counts['labels']}"
        for step, counts in figures["steps"].items()
        if step
    ]
    lines += [
        f"swapped             {' and '.join(swap['markers'])}, {swap['count']} times" for swap in figures["swaps"][:5]
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
