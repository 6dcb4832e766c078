# SPDX-License-Identifier: GPL-3.0-or-later
"""`train TAKE… --out MODEL`: a model from labelled takes."""

import argparse
from pathlib import Path

from ..core.data.errors import InputError
from ..core.points.partial_solvers.training import SEARCHES
from ..io.markersets import SUFFIX
from ..jobs.train import TrainJob, train_file
from ..jobs.training_takes import KnownBetter
from .arguments import add_overwrite, add_point_rate, add_up, names, number
from .console import ProgressLine, print_results

DESCRIPTION = """Makes a model from labelled takes (.c3d, .trc, Motive .csv) of people, animals or props: its markers, a
skeleton and a body, and what names them in takes without names. One take is enough to begin with, of a person a single
labelled frame; more takes of more subjects make it better. The model keeps some frames of every take, so that --from
MODEL trains it on with others."""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("train", help="make a model from labelled takes", description=DESCRIPTION)
    parser.add_argument("takes", metavar="TAKE", nargs="*", type=Path, help="a labelled take")
    parser.add_argument("--out", required=True, type=Path, metavar="MODEL", help=f"the file to write, NAME{SUFFIX}")
    parser.add_argument("--from", dest="base", metavar="MODEL", help="train this model on, with what it keeps")
    parser.add_argument(
        "--markers", type=names, metavar="A,B,…", help="default: those of --from, or that all takes have"
    )
    parser.add_argument("--name", help="the model's name; default: that of --from, or the file's")
    parser.add_argument(
        "--subject",
        dest="subjects",
        action="extend",
        nargs="+",
        default=[],
        type=subject_or_take,
        metavar="ID=GLOB",
        help="whose takes are whose, such as ann='*/ann_*.c3d'; default: a subject is a folder, by its name",
    )
    parser.add_argument(
        "--hit-rate",
        type=number(0.5, 1, "rate"),
        default=0.9999,
        metavar="P",
        help="asked of the ensemble's partial solvers (default 0.9999)",
    )
    parser.add_argument(
        "--search",
        choices=(*SEARCHES, "none"),
        help="how partial solvers are found; default: top-down, and none for large marker sets",
    )
    parser.add_argument(
        "--paper",
        action="store_true",
        help="partial solvers by the paper's four functions only, none of which tells left from right",
    )
    parser.add_argument("--lean", action="store_true", help="keep no frames: the model cannot be trained on")
    add_up(parser)
    add_point_rate(parser)
    parser.add_argument("--report", type=Path, metavar="FILE", help="also write what was learned, as JSON")
    add_overwrite(parser)
    parser.set_defaults(run=run)


def subject(text: str) -> tuple[str, str]:
    """`ID=GLOB`."""
    name, equals, glob = text.partition("=")
    if not equals or not name.strip() or not glob:
        raise argparse.ArgumentTypeError(f"{text!r} is no subject; expected ID=GLOB, such as ann='*/ann_*.c3d'")
    return name.strip(), glob


def subject_or_take(text: str) -> tuple[str, str] | Path:
    """`ID=GLOB`, or a take that follows the subjects on the command line."""
    return Path(text) if "=" not in text and Path(text).exists() else subject(text)


def run(arguments) -> int:
    """Trains one model."""
    takes = [*arguments.takes, *(given for given in arguments.subjects if isinstance(given, Path))]
    if not takes:
        raise InputError("no take was given; expected one labelled take or more: train TAKE… --out MODEL")
    if not arguments.out.name.endswith(SUFFIX):
        raise InputError(f"is no name for a model; expected one that ends in {SUFFIX}", arguments.out)
    job = TrainJob(
        takes=tuple(dict.fromkeys(takes)),
        out=arguments.out,
        markers=tuple(arguments.markers) if arguments.markers else None,
        name=arguments.name,
        hit_rate=arguments.hit_rate,
        search=arguments.search,
        paper=arguments.paper,
        subjects=tuple(given for given in arguments.subjects if not isinstance(given, Path)),
        base=arguments.base,
        keep=not arguments.lean,
        report=arguments.report,
        overwrite=arguments.overwrite,
        known=dict.fromkeys(takes, KnownBetter(arguments.up, arguments.rate)),
    )
    report = ProgressLine(arguments.progress).drain(train_file(job), arguments.out.name)
    print_results(as_lines(report), report, arguments.json)
    return 0


def as_lines(report: dict) -> list[str]:
    """What was learned, for people."""
    frames = sum(row["frames"] for row in report["subjects"])
    seconds = sum(report["seconds"].values())
    segments = report["body"]["segments"]
    many = len(report["subjects"])
    counts = f"{len(report['markers'])} markers, {many} {'subject' if many == 1 else 'subjects'}, "
    counts += f"{frames} {'frame' if frames == 1 else 'frames'}"
    lines = [
        f"{report['out']}: {counts}, {seconds:.0f} s",
        f"body                {len(segments)} segments, {report['body']['how']}",
    ]
    if report["ensemble"]:
        lines.append(f"ensemble            {report['ensemble']['partial_solvers']} partial solvers")
    lines += [f"replaces            {row['take']} of {row['subject']} as it was" for row in report["replaced"]]
    return [*lines, *(f"doubtful            {doubt}" for doubt in report["doubts"])]
