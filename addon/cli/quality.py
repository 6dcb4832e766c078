# SPDX-License-Identifier: GPL-3.0-or-later
"""`quality MODEL`: which markers of a marker set are easily taken for each other, and where one should sit instead."""

from pathlib import Path

from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.wording import count_of
from ..core.placement_quality import ADVICE
from ..core.placement_quality.judging import TURNED_ROUND
from ..io.markersets import markerset_file
from ..io.models import open_model
from ..io.text import write_json
from ..io.whole import whole_files
from ..jobs.quality import judge_placement
from .arguments import a_model, add_options, names, number, whole
from .console import ProgressLine, print_results

DESCRIPTION = """Judges where the markers of a model sit, before anybody wears them. How far two names are separated is
given in standard deviations, with a quarter of the markers hidden: at 2 the likelier of the two is wrong in up to 16 %
of the frames, at 4 in 2.3 %, at 6 in 0.1 %. For the worst pairs it says which marker to move where."""
MOST = 10  # changes that can be asked for
SHOWN = 8  # pairs


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("quality", help="judge where a model's markers sit", description=DESCRIPTION)
    parser.add_argument("model", type=a_model, metavar="MODEL", help="a built-in model or the path of one")
    parser.add_argument(
        "--goal",
        type=number(0.5, 20, "separation"),
        default=ADVICE.goal,
        metavar="SD",
        help=f"pairs nearer than this are ambiguous (default {ADVICE.goal:g})",
    )
    parser.add_argument(
        "--advice",
        type=whole(0, MOST, "number of changes"),
        default=ADVICE.steps,
        metavar="N",
        help=f"how many changes to look for, each on top of the last (default {ADVICE.steps})",
    )
    parser.add_argument("--keep", type=names, default=(), metavar="A,B,…", help="markers that must stay where they are")
    parser.add_argument("--report", type=Path, metavar="FILE", help="also write everything as JSON")
    add_options(parser, "--overwrite")
    parser.set_defaults(run=run)


def run(arguments) -> int:
    """Judges one model."""
    model = open_model(arguments.model)
    markerset = model.markerset
    keep = [_marker(markerset, name, arguments.model) for name in arguments.keep]
    steps = judge_placement(markerset, learned=model.likelihood, goal=arguments.goal, steps=arguments.advice, keep=keep)
    written = [] if arguments.report is None else [arguments.report]
    with whole_files(written, arguments.overwrite, [markerset_file(arguments.model)]) as files:
        report = ProgressLine(arguments.progress).drain(steps, markerset.name)
        for file in files:
            write_json(file, report)
    print_results(as_lines(report), report, arguments.json)
    return 0


def _marker(markerset: MarkerSet, name: str, model: str) -> str:
    try:
        return markerset.markers[markerset.index(name)]
    except KeyError:
        raise InputError(f"{model} has no marker {name}; expected some of {' '.join(markerset.markers)}") from None


def as_lines(report: dict) -> list[str]:
    """The report for people."""
    known = f"learned from {count_of(report['subjects'], 'subject')}" if report["subjects"] else "drawn from its spread"
    poor = [pair for pair in report["pairs"] if pair["separation"] < report["goal"]]
    lines = [f"{report['model']}: {count_of(len(report['markers']), 'marker')}, {known}"]
    worst = {row["kind"]: row for row in reversed(report["whole"])}
    lines += [f"{'whole':<20}{_whole(row)}" for row in worst.values()]
    lines.append(f"{'ambiguous':<20}{count_of(len(poor), 'pair')} nearer than {report['goal']:g}")
    lines += [f"{' and '.join(pair['markers']):<20}{pair['separation']:.1f}, {_seen(pair)}" for pair in poor[:SHOWN]]
    for row in report["advice"]:
        gain = f"{' and '.join(row['for'])} from {row['before']:.1f} to {row['after']:.1f}"
        lines.append(f"{'advice':<20}{row['words']}; {gain}")
    return lines


def _whole(row: dict) -> str:
    if row["kind"] == TURNED_ROUND:
        return f"{row['separation']:.1f}, turned round by {row['turn_deg']}°"
    return f"{row['separation']:.1f}, sides exchanged: {' '.join(row['markers'])}"


def _seen(pair: dict) -> str:
    return f"{pair['all_seen']:.1f} with all markers seen"
