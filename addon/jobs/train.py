# SPDX-License-Identifier: GPL-3.0-or-later
"""A model from labelled takes: marker set, skeleton, body, evidence and ensemble, in one file."""

import json
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ..core.body.bodies import BodyModel
from ..core.body.posing import fit_points
from ..core.data.errors import InputError
from ..core.data.markersets import MarkerSet
from ..core.data.models import Model, TrainingTake, by_subject
from ..core.data.progress import Progress
from ..core.points.likelihood import Likelihood, learn_likelihood
from ..core.points.partial_solvers.model import FUNCTIONS, PAPER_FUNCTIONS, PartialSolvers
from ..core.points.partial_solvers.training import SEARCHES, Training, training
from ..core.training.segments import segment_markerset
from ..core.training.transfer import transferred, known_body
from ..io.markersets import SUFFIX, builtin_markersets, open_markerset
from ..io.models import open_model, write_model
from ..io.whole import whole_files
from ..version import version
from .background import in_background
from .job import timed
from .training_takes import (
    Take,
    chosen_markers,
    contradicted,
    gathered,
    of_markers,
    read_takes,
    training_takes_of,
    without_replaced,
)

MOST_FOR_ENSEMBLE = 40  # markers; beyond, partial solvers are trained only when a search is asked for
ENSEMBLE_FRAMES = 6000
STRANGE, LOOSE = 4.0, 0.03  # times the usual residual, and m, beyond which a marker is pointed out
CHECKED = 60  # frames of each subject that the body is tried on

# How far along the work is when each part begins.
SHARES = {"read": 0.0, "body": 0.05, "evidence": 0.1, "ensemble": 0.5, "write": 0.98}


@dataclass(frozen=True)
class TrainJob:
    """What to train.

    takes     files of labelled points
    out       the model's file
    markers   their names, None for those that all takes have
    name      the model's, None for that of `base`, or of the file
    hit_rate  asked of the ensemble's partial solvers
    search    how those are found, "none" for no ensemble; None for what suits the number of markers
    paper     give them the paper's four functions only, none of which tells left from right
    subjects  (id, glob) pairs that say whose takes are whose
    base      a model to train on, with what it keeps of its own takes; None for a new one
    keep      keep frames of the takes in the model, so that it can be trained on
    report    a file for what the training has to say, None for none
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


def train_file(job: TrainJob) -> Generator[Progress, None, dict]:
    """Trains and writes the model; gives the report.

    Raises UserError with the file where it can be told.
    """
    clock: dict[str, float] = {}
    targets = [job.out, *([job.report] if job.report else [])]
    with whole_files(targets, job.overwrite) as files, threadpool_limits(1, user_api="blas"):
        yield Progress(SHARES["read"], "read the takes")
        with timed(clock, "read"):
            base = _base(job)
            takes = read_takes(job.takes, job.subjects)
            markers = chosen_markers(takes, job.markers, base.markerset.markers if base else ())
            subjects = gathered(takes, markers)
            before = of_markers(base.training_takes, base.markerset.markers, markers) if base else []
            before, replaced, doubts = without_replaced(before, takes)
            training_takes = (*before, *training_takes_of(takes, markers))
            everyone = _everyone(before, subjects)
            doubts += [doubt for take in takes for doubt in take.doubts]
            doubts += contradicted(takes, markers, before)
        yield Progress(SHARES["body"], "find the body")
        with timed(clock, "body"):
            name = job.name or (base.markerset.name if base else job.out.name.removesuffix(SUFFIX).partition(".")[0])
            markerset, kind = _body(everyone, markers, name)
            residual = _body_residual(markerset, everyone)
        likelihood = yield from _likelihood(everyone, markers, clock)
        partial_solvers = yield from _partial_solvers(job, everyone, markers, clock)
        yield Progress(SHARES["write"], "write the model")
        markerset = replace(markerset, source=_source(training_takes))
        model = Model(markerset, likelihood, partial_solvers, training_takes if job.keep else ())
        write_model(files[0], model)
        doubts += _doubts(markerset, training_takes, residual, partial_solvers)
        report = _report(job, takes, model, training_takes, kind, residual, clock, doubts)
        report["replaced"] = [{"take": " ".join(gone.takes), "subject": gone.subject} for gone in replaced]
        if job.report:
            write_training_report(files[1], report)
    return report


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


def _everyone(before: Sequence[TrainingTake], subjects: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
    """All frames of the new takes, with what is kept of those `before`."""
    whole = by_subject(before)
    for subject, points in subjects.items():
        whole[subject] = np.concatenate([whole[subject], points]) if subject in whole else points
    return whole


def _body(everyone: dict[str, np.ndarray], markers: Sequence[str], name: str) -> tuple[MarkerSet, str]:
    """Skeleton and body, and how they were found."""
    known = known_body(markers, [open_markerset(name) for name in builtin_markersets()])
    try:
        if known is not None:
            return transferred(known, list(everyone.values()), markers, name), f"the body of {known.name}"
        return segment_markerset(list(everyone.values()), markers, name), "found from how the markers move"
    except ValueError as error:
        raise InputError(f"{error}; expected takes that show the markers together") from None


def _body_residual(markerset: MarkerSet, everyone: dict[str, np.ndarray]) -> np.ndarray:
    """(M,) m, how far each marker is from where the posed body has it, in the middle."""
    model, away = BodyModel(markerset), []
    for points in everyone.values():
        some = points[:: max(len(points) // CHECKED, 1)]
        try:
            posed = model.pose(fit_points(model, some))
        except ValueError:
            continue
        away.append(np.linalg.norm(posed.markers - some, axis=2))
    if not away:
        return np.full(len(markerset), np.nan)
    away = np.concatenate(away)
    seen = np.isfinite(away).any(axis=0)
    middle = np.full(len(markerset), np.nan)
    middle[seen] = np.nanmedian(away[:, seen], axis=0)
    return middle


def _likelihood(everyone, markers, clock) -> Generator[Progress, None, Likelihood]:
    begin = perf_counter()
    takes = [(points, subject) for subject, points in everyone.items()]
    span = SHARES["ensemble"] - SHARES["evidence"]
    work = in_background(lambda tell: learn_likelihood(takes, markers, progress=tell))
    while True:
        try:
            share = next(work)
        except StopIteration as end:
            clock["evidence"] = perf_counter() - begin
            return end.value
        yield Progress(SHARES["evidence"] + span * share, "learn the evidence")


def _partial_solvers(job: TrainJob, everyone, markers, clock) -> Generator[Progress, None, PartialSolvers | None]:
    if job.search == "none" or (job.search is None and len(markers) > MOST_FOR_ENSEMBLE):
        return None
    begin = perf_counter()
    each = max(ENSEMBLE_FRAMES // len(everyone), 1)
    points = np.concatenate([own[:: max(-(-len(own) // each), 1)] for own in everyone.values()])
    functions = PAPER_FUNCTIONS if job.paper else FUNCTIONS
    work = training(points, markers, job.hit_rate, Training(search=job.search or SEARCHES[1], functions=functions))
    span = SHARES["write"] - SHARES["ensemble"]
    while True:
        try:
            share, words = next(work)
        except StopIteration as end:
            clock["ensemble"] = perf_counter() - begin
            return end.value
        yield Progress(SHARES["ensemble"] + span * share, words)


def _source(training_takes: Sequence[TrainingTake]) -> dict[str, str]:
    """Where the numbers come from, for people to read."""
    frames = sum(training_take.frames for training_take in training_takes)
    takes = sum(len(training_take.takes) for training_take in training_takes)
    known = _subjects(training_takes)
    counts = f"subjects: {len(known)}, takes: {takes}, frames: {frames}"
    whose = {f"subject {row['subject']}": ", ".join(row["takes"]) for row in known}
    return {"learned": f"by mocap-autolabel train {version()}", "takes": counts, **whose}


def _subjects(training_takes: Sequence[TrainingTake]) -> list[dict]:
    """What a model was trained on, a row a subject."""
    rows: dict[str, dict] = {}
    for training_take in training_takes:
        row = rows.setdefault(training_take.subject, {"subject": training_take.subject, "takes": [], "frames": 0})
        row["takes"] += training_take.takes
        row["frames"] += training_take.frames
    return list(rows.values())


def _report(job, takes: Sequence[Take], model: Model, training_takes, kind: str, residual, clock, doubts) -> dict:
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
        "takes": [{"take": t.path.name, "subject": t.subject, "frames": len(t.xyz)} for t in takes],
        "trained_on": job.base,
        "subjects": _subjects(training_takes),
        "body": {"how": kind, "height": round(markerset.spread.height, 3), "segments": on},
        "residual_mm": {
            name: None if np.isnan(value) else round(1000 * float(value), 2)
            for name, value in zip(markerset.markers, residual, strict=True)
        },
        "doubts": doubts,
        "evidence": {
            "subjects": likelihood.subjects,
            "plates": likelihood.rigid_bodies is not None,
        },
        "ensemble": solvers,
        "seconds": {part: round(seconds, 2) for part, seconds in clock.items()},
    }


def _doubts(
    markerset: MarkerSet, training_takes: Sequence[TrainingTake], residual: np.ndarray, partial_solvers
) -> list[str]:
    """What a person should know of the model, in sentences."""
    doubts = []
    if len({training_take.subject for training_take in training_takes}) == 1:
        doubts.append("learned from one subject: how others differ is a guess; labels of others will be fewer")
    usual = np.nanmedian(residual)
    for name, value in zip(markerset.markers, residual, strict=True):
        if value > max(STRANGE * usual, LOOSE):
            doubts.append(
                f"{name} does not keep to the body ({1000 * value:.0f} mm off): is it a marker, and one only?"
            )
    for name, count in zip(markerset.markers, [] if partial_solvers is None else partial_solvers.covered, strict=False):
        if not count:
            doubts.append(f"no partial solver reaches the hit rate for {name}: the ensemble never names it")
    return doubts


def write_training_report(path: Path, report: dict):
    """Writes the report as JSON, a part a line."""
    rows = ",\n".join(f"  {json.dumps(key)}: {json.dumps(value, ensure_ascii=False)}" for key, value in report.items())
    Path(path).write_text(f"{{\n{rows}\n}}\n", encoding="utf-8", newline="\n")
