# SPDX-License-Identifier: GPL-3.0-or-later
"""A model from labelled takes: marker set, skeleton, body, likelihood and partial solvers, in one file."""

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError
from ..core.data.progress import Progress
from ..core.points.models import Model
from ..core.points.partial_solvers.model import FUNCTIONS, PAPER_FUNCTIONS
from ..core.training.looked_at import listed
from ..core.training.pipeline import TRAINING_SHARES, Trained, TrainingOptions, train
from ..core.training.takes import subject_rows
from ..io.markersets import SUFFIX, builtin_markersets, markerset_file, open_markerset
from ..io.models import open_model, write_model
from ..io.names import written
from ..io.report import compact
from ..io.whole import keep_apart, whole_files
from ..version import version
from .job import timed
from .training_takes import KnownBetter, TakeFile, chosen_markers, read_takes, unseen_markers


@dataclass(frozen=True)
class TrainJob:
    """What to train.

    takes     files of labelled points
    out       the model's file
    markers   their names, None for those that all takes have
    name      the model's, None for that of `base`, or of the file
    hit_rate  asked of the ensemble's partial solvers
    search    how those are found, "none" for no ensemble; None for what suits the number of markers
    paper     give them the paper's four functions only, none of which distinguishes left from right
    subjects  (id, glob) pairs that say whose takes are whose
    base      a model to train on, with what it keeps of its own takes; None for a new one
    keep      keep frames of the takes in the model, so that it can be trained on
    report    a file for what the training has to say, None for none
    known     of takes by their path, what is known better than from the file
    shown     labelled takes that are at hand, beside those of the files
    body      a marker set whose body may be that of the takes, beside the built-in ones; None for no other
    """

    takes: tuple[Path, ...]
    out: Path
    markers: tuple[str, ...] | None = None
    name: str | None = None
    hit_rate: float = 0.9999
    search: str | None = None
    paper: bool = False
    subjects: tuple[tuple[str, str], ...] = ()
    base: str | None = None
    keep: bool = True
    report: Path | None = None
    overwrite: bool = False
    known: Mapping[Path, KnownBetter] = field(default_factory=dict)
    shown: tuple[TakeFile, ...] = ()
    body: str | None = None


def train_file(job: TrainJob) -> Generator[Progress, None, dict]:
    """Trains and writes the model; gives the report.

    Raises UserError, with the file where that is known.
    """
    clock: dict[str, float] = {}
    targets = [job.out, *([job.report] if job.report else [])]
    # A model may be trained on in its own place; all else that is read stays.
    if job.base and job.report:
        keep_apart([markerset_file(job.base)], [job.report])
    with whole_files(targets, job.overwrite, job.takes) as files:
        yield Progress(0.0, "read the takes")
        with timed(clock, "read"):
            base = _base(job)
            takes = [*read_takes(job.takes, job.subjects, job.known), *job.shown]
            bodies = [open_markerset(name) for name in (*builtin_markersets(), *([job.body] if job.body else []))]
            kept, lost = unseen_markers(takes, bodies)
            markers = chosen_markers(takes, job.markers, base.markerset.markers if base else (), kept)
        trained = yield from train(takes, markers, _options(job, base), base, bodies)
        yield Progress(TRAINING_SHARES["end"], "write the model")
        write_model(files[0], _with_source(trained.model))
        report = _report(job, takes, trained, clock | trained.seconds)
        said = " ".join(trained.doubts)
        new = {name for name in kept if name in markers and name not in said}
        report["doubts"] += told_of_unseen(new, set(lost) - set(markers))
        if job.report:
            write_training_report(files[1], report)
    return report


def told_of_unseen(kept: set[str], lost: set[str]) -> list[str]:
    """What is said of markers that the takes name and never show: those that stay in the set, and those that do not."""
    said = []
    if kept:
        words = "are" if len(kept) > 1 else "is"
        said.append(f"{listed(sorted(kept))} {words} not seen in any take: where it sits is taken from the known body")
    if lost:
        words = "are" if len(lost) > 1 else "is"
        said.append(f"{listed(sorted(lost))} {words} not seen in any take, and no body that is known has it: left out")
    return said


def _base(job: TrainJob) -> Model | None:
    """The model to train on; InputError where it does not keep what it learned from."""
    if job.base is None:
        return None
    base = open_model(job.base)
    if not base.training_takes:
        raise InputError(
            f"model {base.markerset.name} keeps nothing of the takes that it was trained on, so training on would "
            "forget them; expected a model trained without --lean, or all takes together and no --from"
        )
    return base


def _options(job: TrainJob, base: Model | None) -> TrainingOptions:
    name = job.name or (base.markerset.name if base else job.out.name.removesuffix(SUFFIX).partition(".")[0])
    functions = PAPER_FUNCTIONS if job.paper else FUNCTIONS
    # Such that its file can be read: never blank, and of letters that files hold.
    name = written(name).strip() or "model"
    return TrainingOptions(name, job.hit_rate, job.search, functions, job.keep)


def _with_source(model: Model) -> Model:
    """The model, which says what has made it."""
    source = {"learned": f"by mocap-autolabel train {version()}", **model.markerset.source}
    return replace(model, markerset=replace(model.markerset, source=source))


def _report(job: TrainJob, takes: Sequence[TakeFile], trained: Trained, clock: dict[str, float]) -> dict:
    model = trained.model
    markerset, likelihood, partial_solvers = model.markerset, model.likelihood, model.partial_solvers
    segments = markerset.skeleton.segments
    on = {name: [] for name in segments}
    for name, segment in zip(markerset.markers, markerset.attachment, strict=True):
        on[segments[segment]].append(name)
    solvers = None
    if partial_solvers is not None:
        solvers = {
            "search": partial_solvers.search,
            "partial_solvers": len(partial_solvers),
            "frames": partial_solvers.frames,
            "hit_rate": job.hit_rate,
            "of_marker": dict(zip(markerset.markers, partial_solvers.covered.tolist(), strict=True)),
        }
    return {
        "model": markerset.name,
        "out": str(job.out),
        "version": version(),
        "markers": list(markerset.markers),
        "takes": [{"take": t.name, "subject": t.subject, "frames": len(t.xyz)} for t in takes],
        "trained_on": job.base,
        "subjects": subject_rows(trained.training_takes),
        "body": {"how": trained.body, "height": round(markerset.spread.height, 3), "segments": on},
        "residual_mm": {
            name: None if np.isnan(value) else round(1000 * float(value), 2)
            for name, value in zip(markerset.markers, trained.residual, strict=True)
        },
        "doubts": list(trained.doubts),
        "evidence": {
            "subjects": likelihood.subjects,
            "plates": likelihood.rigid_bodies is not None,
        },
        "ensemble": solvers,
        "seconds": {part: round(seconds, 2) for part, seconds in clock.items()},
        "replaced": [{"take": " ".join(gone.takes), "subject": gone.subject} for gone in trained.replaced],
    }


def write_training_report(path: Path, report: dict):
    """Writes the report as JSON, a part a line."""
    rows = ",\n".join(f"  {compact(key)}: {compact(value)}" for key, value in report.items())
    Path(path).write_text(f"{{\n{rows}\n}}\n", encoding="utf-8", newline="\n")
