# SPDX-License-Identifier: GPL-3.0-or-later
"""`train TAKE… --out MODEL`: a model from labelled takes, or from words; trials are made side by side, in processes."""

import argparse
import os
from collections.abc import Iterator, Sequence
from functools import partial
from pathlib import Path

from threadpoolctl import threadpool_limits

from ..core.data.errors import InputError, JobError, UserError
from ..core.data.wording import count_of
from ..core.evaluation.comparing import difference_lines
from ..core.papers.partial_solvers.training import SEARCHES
from ..core.points.likelihood.learn import TrialOutcome, TrialWork, in_turn, tried
from ..io.markersets import SUFFIX
from ..jobs.models import system_user
from ..jobs.train import TrainJob, train_file
from ..jobs.training_takes import KnownBetter
from .arguments import Takes, a_model, add_options, job_of, names, number, whole
from .console import ProgressLine, print_results
from .models import SHOWN_DIGITS
from .workers import crew

# How many processes try, where nobody says.
MAX_JOBS = 4  # a core each; assumed: what goes before the trials is soon longer than they are
# of all trials, for which more than one process is worth its start: so many take 2 s; measured on 41 markers
WORTH_POINTS = 40_000


def _tried(work: TrialWork) -> TrialOutcome:
    """The outcome of a trial, as it would be in the process that handed it over."""
    with threadpool_limits(1, user_api="blas"):
        return tried(work)


def try_in(jobs: int | None, works: Sequence[TrialWork]) -> Iterator[TrialOutcome]:
    """Tries the trials in so many processes; None for as many as are worth it."""
    if jobs is None:
        points = sum(int((work.trial.truth >= 0).sum()) for work in works)
        jobs = min(os.cpu_count() or 1, MAX_JOBS) if points >= WORTH_POINTS else 1
    return in_turn(works) if min(jobs, len(works)) < 2 else _tried_side_by_side(works, jobs)


def _tried_side_by_side(works: Sequence[TrialWork], jobs: int) -> Iterator[TrialOutcome]:
    """The outcomes in the order of the trials, each as soon as all before it are there too."""
    found, given = {}, 0
    with crew(min(jobs, len(works))) as run:
        for number, answer in run(partial(_tried, work) for work in works):
            if isinstance(answer, UserError):
                raise type(answer)(f"a trial could not be made: {answer.message}")
            found[number] = answer
            while given in found:
                yield found.pop(given)
                given += 1


DESCRIPTION = """Makes a model from labelled takes (.c3d, .trc, .tsv, Motive or Vicon .csv) of people, animals or props:
its markers, a skeleton and a body, and what names them in takes without names. One take is enough to begin with, or a
single labelled frame; more takes of more subjects make it better. The model keeps some frames of every take, so that
--from MODEL trains it on with others."""


TRAIN_SWITCHES = {
    "paper": "partial solvers by the paper's four functions only, none of which tells left from right",
    "adopt": "with --from, replace the model that is there although known takes are named worse by the new one",
    "force": "learn from takes that cannot be as they are, such as mirrored ones",
}
SUBJECT_HELP = """whose takes are whose, such as ann='*/ann_*.c3d'; of a take whose markers are called ann:LASI and
bob:LASI it says which of them is learned; default: a subject is a folder, by its name"""
SEARCH_HELP = """find partial solvers at once, and how; default: top-down once --method ensemble asks for them, at once
with --lean; with --from MODEL and no take MODEL is given them, and all else stays as it is"""
SET_HELP = """make the model of this marker set in words, without a take: a file, or a published one that `models`
lists"""
CHECK_HELP = """labelled takes to keep out of training, whose names were looked at: whenever the model is trained on,
they are labelled again by it as it was and as it is then"""


def add_parser(verbs):
    """Adds the verb to the command line's grammar."""
    parser = verbs.add_parser("train", help="make a model from labelled takes", description=DESCRIPTION)
    add = parser.add_argument
    add("takes", metavar="TAKE", nargs="*", type=Path, action=Takes, help="a labelled take")
    add("--out", required=True, type=Path, metavar="MODEL", help=f"the file to write, NAME{SUFFIX}")
    add("--from", type=a_model, dest="base", metavar="MODEL", help="train this model on, with what it keeps")
    add("--set", dest="layout", metavar="LAYOUT", help=SET_HELP)
    add("--markers", type=names, metavar="A,B,…", help="default: those of --from, or that all takes have")
    add("--name", help="the model's name; default: that of --from, or the file's")
    several: dict = {"nargs": "+", "default": []}
    add("--subject", dest="subjects", type=subject, metavar="ID=GLOB", help=SUBJECT_HELP, action="extend", **several)
    hits = "asked of the ensemble's partial solvers (default 0.9999); finds them at once, as does --search"
    add("--hit-rate", type=number(0.5, 1, "rate"), metavar="P", help=hits)
    add("--search", choices=(*SEARCHES, "none"), help=SEARCH_HELP)
    add("--lean", dest="keep", action="store_false", help="keep no frames: the model cannot be trained on")
    trials = "trials side by side (default: one for each core, 4 at most; the model is the same)"
    add("--jobs", type=whole(1, 256, "number of jobs"), metavar="N", help=trials)
    add("--check", dest="kept", type=Path, metavar="TAKE", help=CHECK_HELP, action=Takes, **several)
    teacher = "who teaches the model, for its history (default: who is logged in; '' for nobody)"
    add("--by", metavar="NAME", help=teacher)
    add("--report", type=Path, metavar="FILE", help="also write what was learned, as JSON")
    for name, words in TRAIN_SWITCHES.items():
        add(f"--{name}", action="store_true", help=words)
    add_options(parser, "--up", "--rate", "--overwrite")
    parser.set_defaults(run=run)


def subject(text: str) -> tuple[str, str] | Path:
    """`ID=GLOB`, or a take that follows the subjects on the command line."""
    name, equals, glob = text.partition("=")
    if text and not equals and Path(text).exists():
        return Path(text)
    if not equals or not name.strip() or not glob:
        raise argparse.ArgumentTypeError(f"{text!r} is no subject; expected ID=GLOB, such as ann='*/ann_*.c3d'")
    return name.strip(), glob


def run(arguments) -> int:
    """Trains one model."""
    takes = [*arguments.takes, *(given for given in arguments.subjects if isinstance(given, Path))]
    if arguments.layout is not None:
        _refuse_beside_words(arguments, takes)
    elif not takes:
        _refuse_without_takes(arguments)
    if arguments.adopt and not arguments.base:
        raise InputError("--adopt is for training on; expected --from MODEL with it, or no --adopt")
    if not arguments.out.name.removesuffix(SUFFIX) or not arguments.out.name.endswith(SUFFIX):
        raise InputError(f"is no name for a model; expected one such as mine{SUFFIX}", arguments.out)
    job = job_of(
        TrainJob,
        arguments,
        takes=tuple(dict.fromkeys(takes)),
        subjects=tuple(given for given in arguments.subjects if not isinstance(given, Path)),
        known=dict.fromkeys([*takes, *arguments.kept], KnownBetter(arguments.up, arguments.rate)),
        kept=tuple(dict.fromkeys(arguments.kept)),
        by=system_user() if arguments.by is None else arguments.by,
    )
    work = train_file(job, partial(try_in, arguments.jobs))
    report = ProgressLine(arguments.progress).drain(work, arguments.out.name)
    print_results(as_lines(report), report, arguments.json)
    if report["not_adopted_for"]:
        first, *others = report["not_adopted_for"]
        why = f"{first}, and {len(others)} more" if others else first
        raise JobError(
            f"the model trained on does not take this place ({why}), and is kept as "
            f"{Path(report['written']).name}; expected nothing worse, or models --adopt with that file",
            arguments.out,
        )
    return 0


def _refuse_without_takes(arguments):
    """InputError where nothing is given to learn from, and more is asked than partial solvers for a model."""
    asked = arguments.search not in (None, "none") or arguments.hit_rate is not None or arguments.paper
    if not (asked and arguments.base):
        raise InputError("no take was given; expected one labelled take or more: train TAKE… --out MODEL")
    if arguments.markers or arguments.name or arguments.subjects or not arguments.keep or arguments.kept:
        raise InputError(
            "no take was given, so only partial solvers are found; expected a take, or no --markers, --name, "
            "--subject, --lean or --check"
        )


def _refuse_beside_words(arguments, takes: Sequence[Path]):
    """InputError where something is asked that a marker set in words has not: it learns from no take."""
    beside = {
        "take": takes, "--from": arguments.base, "--markers": arguments.markers, "--check": arguments.kept,
        "--subject": arguments.subjects, "--search": arguments.search, "--hit-rate": arguments.hit_rate,
        "--paper": arguments.paper, "--lean": not arguments.keep,
    }  # fmt: skip
    given = [name for name, value in beside.items() if value]
    if given:
        raise InputError(f"--set makes a model from words alone; expected no {' and no '.join(given)} with it")


def as_lines(report: dict) -> list[str]:
    """What was learned, for people."""
    frames = sum(row["frames"] for row in report["subjects"])
    seconds = sum(report["seconds"].values())
    segments = report["body"]["segments"]
    counts = f"{len(report['markers'])} markers, {count_of(len(report['subjects']), 'subject')}, "
    counts += count_of(frames, "frame")
    former = f"; the one before is kept as {Path(report['former']).name}" if report["former"] else ""
    lines = [
        f"{report['written']}: {counts}, {seconds:.0f} s",
        f"version             {report['model_version']}, {report['model_fingerprint'][:SHOWN_DIGITS]}{former}",
        f"body                {count_of(len(segments), 'segment')}, {report['body']['how']}",
    ]
    if report["ensemble"]:
        lines.append(f"ensemble            {count_of(report['ensemble']['partial_solvers'], 'partial solver')}")
    lines += [f"replaces            {row['take']} of {row['subject']} as it was" for row in report["replaced"]]
    if report["check"]:
        lines += [f"check               {line}" for line in difference_lines(report["check"])]
        lines += [f"worse               {line}" for line in report["check"]["worse"]]
    return [*lines, *(f"doubtful            {doubt}" for doubt in report["doubts"])]
