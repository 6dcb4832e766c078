# SPDX-License-Identifier: GPL-3.0-or-later
"""A model from labelled takes: marker set, skeleton, body, likelihood and partial solvers, in one file."""

from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from ..core.data.errors import InputError, of_file
from ..core.data.progress import Progress, within
from ..core.data.wording import listed
from ..core.evaluation.comparing import Comparison
from ..core.papers.partial_solvers.model import FUNCTIONS, PAPER_FUNCTIONS
from ..core.points.likelihood.learn import Trying, in_turn
from ..core.points.models import NO_HISTORY, Model, ModelHistory, ModelVersion, TrainingTake
from ..core.posing.posing import POSING
from ..core.training.described import described
from ..core.training.described import learned as learned_from_words
from ..core.training.laying import lying_beside
from ..core.training.pipeline import TRAINING_SHARES, Trained, TrainingOptions, never_named, train, train_solvers
from ..core.training.takes import standing_apart, subject_rows
from ..io.layouts import open_layout
from ..io.markersets import SUFFIX, markerset_file, open_markerset
from ..io.model_history import moved, seen_at, seen_from
from ..io.models import open_model, read_model, write_model
from ..io.source import digest, read_bytes
from ..io.text import write_json, written
from ..io.whole import keep_apart, whole_files
from ..version import version
from .checking import KeptFile, as_taught, checking, files_of, kept_file, takes_to_check
from .job import timed
from .models import USUAL_SEARCH, VersionPlaces, known_bodies
from .pages import today
from .training_takes import KnownBetter, TakeFile, chosen_markers, read_takes, refuse_labels, unseen_markers

CHECK_FROM = 0.75  # of the work where a model is trained on, when what got worse begins to be looked for


@dataclass(frozen=True)
class TrainJob:
    """What to train."""

    # files of labelled points; none to give `base` its partial solvers and leave all else as it is
    takes: tuple[Path, ...]
    out: Path  # the model's file
    # a marker set in words, or the name of a published one, to learn from instead of takes; None for takes
    layout: str | None = None
    markers: tuple[str, ...] | None = None  # their names, None for those that all takes have
    name: str | None = None  # the model's, None for that of `base`, or of the file
    hit_rate: float | None = None  # asked of the ensemble's partial solvers, None for the usual one
    # how those are found, "none" for no ensemble; None to find them at once only where something else is asked of them
    # or the model keeps nothing to find them in later
    search: str | None = None
    paper: bool = False  # give them the paper's four functions only, none of which distinguishes left from right
    subjects: tuple[tuple[str, str], ...] = ()  # (id, glob) pairs that say whose takes are whose
    base: str | None = None  # a model to train on, with what it keeps of its own takes; None for a new one
    keep: bool = True  # keep frames of the takes in the model, so that it can be trained on
    report: Path | None = None  # a file for what the training has to say, None for none
    overwrite: bool = False
    # of takes by their path, what is known better than from the file
    known: Mapping[Path, KnownBetter] = field(default_factory=dict)
    shown: tuple[TakeFile, ...] = ()  # labelled takes that are at hand, beside those of the files
    # a marker set whose body may be that of the takes, beside the built-in ones; None for no other
    body: str | None = None
    # labelled takes that the model is checked on whenever it is trained on, beside those that it knows already
    kept: tuple[Path, ...] = ()
    by: str = ""  # who teaches it, for its history; empty where nobody knows
    adopt: bool = False  # take the model although something got worse
    force: bool = False  # learn from takes although something of them cannot be as it is


@dataclass(frozen=True, eq=False)
class _Taught:
    """What a training made."""

    model: Model  # the new one, without its history
    base: Model | None  # the one before; None for a new one
    # what it was taught, each with the digest of its file, which is empty for one of no file
    takes: tuple[tuple[TakeFile, str], ...]
    report: dict  # what people read of it
    check: Comparison | None = None  # how takes are named by both models; None where there is nothing to compare


def train_file(job: TrainJob, try_all: Trying = in_turn) -> Generator[Progress, None, dict]:
    """Trains and writes the model; gives the report. `try_all` makes the trials that the model is calibrated by.

    Raises UserError, with the file where that is known.
    """
    if job.base and job.report:
        keep_apart([markerset_file(job.base)], [job.report])
    clock: dict[str, float] = {}
    base = _base(job)
    # A model may be trained on in its own place: what was there stays beside it. All else that is read stays.
    places = VersionPlaces.of(job.out, base.history.version + 1 if base else 1)
    former = places.former if base else None
    targets = [path for path in (former, job.out, places.candidate if base else None, job.report) if path]
    words = [Path(job.layout)] if job.layout else []
    with whole_files(targets, job.overwrite, [*job.takes, *job.kept, *words]) as files:
        parts = dict(zip(targets, files, strict=True))
        yield Progress(0.0, "read the takes")
        kept = _kept(job, base)
        made = yield from _made(job, base, kept, clock, try_all)
        yield Progress(TRAINING_SHARES["end"], "write the model")
        doubts = _doubts_of(job, places, made)
        if former and not doubts:
            parts[former].write_bytes(read_bytes(job.out))
        written_to = places.candidate if doubts else job.out
        model = replace(made.model, history=_history(job, made, kept, adopted=not doubts))
        write_model(parts[written_to], model)
        report = made.report | {
            "written": str(written_to),
            "model_version": model.history.version,
            "model_fingerprint": read_model(parts[written_to]).fingerprint,
            "former": str(former) if former and not doubts else None,
            "not_adopted_for": doubts,
            "check": made.check.as_dict() if made.check else None,
        }
        if job.report:
            write_json(parts[job.report], report)
    return report


def _kept(job: TrainJob, base: Model | None) -> list[KeptFile]:
    """The takes that the model is checked on, those that are given and those that it knows.

    Raises InputError where one is no labelled take, or is learned from.
    """
    both = next((path for path in job.kept if path.resolve() in {take.resolve() for take in job.takes}), None)
    if both is not None:
        raise InputError("is learned from, so it cannot check what was learned; expected other takes to check on", both)
    given = [kept_file(path, job.out, job.known.get(path, KnownBetter()), job.subjects) for path in job.kept]
    known = [] if base is None else files_of(base.history.kept_takes, markerset_file(job.base))
    own = {one.path.resolve() for one in given}
    return [*given, *(one for one in known if one.path.resolve() not in own)]


def _doubts_of(job: TrainJob, places: VersionPlaces, made: _Taught) -> list[str]:
    """Why the model does not take its place; empty where it does, as in a place where no model is: none goes there."""
    doubts = made.check.worse if made.check and places.former and not job.adopt else []
    if made.base and not places.is_as_it_was:
        doubts = [*doubts, f"{job.out.name} was changed meanwhile by somebody else"]
    return doubts


def _history(job: TrainJob, made: _Taught, kept: Sequence[KeptFile], adopted: bool) -> ModelHistory:
    """The history of a model with what it was taught now."""
    history, origin = NO_HISTORY, ""
    if made.base is not None:
        history = moved(made.base.history, markerset_file(job.base), job.out)
        origin = made.base.fingerprint
    learned = {take.path.resolve() for take, sha256 in made.takes if sha256}
    rows = [take for take in history.kept_takes if seen_at(take.path, job.out) is None]
    rows += [replace(one.take, path=seen_from(job.out, one.path)) for one in kept if one.path.resolve() not in learned]
    takes = tuple(
        as_taught(take, sha256, job.out, job.known.get(take.path, KnownBetter())) for take, sha256 in made.takes
    )
    checked = tuple(take.checked for take in made.check.takes) if made.check else ()
    accepted = bool(adopted and made.check and made.check.worse)
    number = history.version + 1 if made.base else 1
    new = ModelVersion(number, today(), written(job.by.strip()), version(), origin, takes, checked, accepted)
    return replace(history.with_version(new), kept_takes=tuple(rows))


def _made(
    job: TrainJob, base: Model | None, kept: Sequence[KeptFile], clock: dict[str, float], try_all: Trying
) -> Generator[Progress, None, _Taught]:
    """What the job makes; where a model is taught more, how it names takes that are known."""
    if job.layout is not None:
        return (yield from _from_words(job, clock, try_all))
    if not (job.takes or job.shown):
        return (yield from _given_solvers(job, base, clock))
    end = TRAINING_SHARES["end"] if base is None else CHECK_FROM
    made, replaced = yield from within(_learned(job, base, clock, try_all), 0.0, end / TRAINING_SHARES["end"])
    if base is None:
        return made
    with timed(clock, "check"):
        given = [take for take, _ in made.takes]
        check = takes_to_check(base, markerset_file(job.base), kept, given, replaced)
        found = yield from within(checking(base, made.model, check), CHECK_FROM, TRAINING_SHARES["end"])
    made.report["seconds"]["check"] = round(clock["check"], 2)
    return replace(made, check=found)


def _learned(
    job: TrainJob, base: Model | None, clock: dict[str, float], try_all: Trying
) -> Generator[Progress, None, tuple[_Taught, tuple[TrainingTake, ...]]]:
    """What the takes teach, and what it replaces of what was known."""
    with timed(clock, "read"):
        bodies = known_bodies() + ([open_markerset(job.body)] if job.body else [])
        digests = [digest(path) for path in job.takes]  # before they are read
        takes = [*read_takes(job.takes, job.subjects, job.known), *job.shown]
        if not job.force:
            refuse_labels(takes, [*([base.markerset] if base else []), *bodies])
        kept, lost = unseen_markers(takes, bodies)
        markers = chosen_markers(takes, job.markers, base.markerset.markers if base else (), kept)
        # Of what was asked for, or learned before, nothing is left out.
        apart = () if job.markers or base else standing_apart(takes, markers)
        markers = tuple(name for name in markers if name not in apart)
        if len(markers) < POSING.min_markers:
            [why] = _not_shown(set(), set(), apart, ())
            raise InputError(f"{why}; expected {POSING.min_markers} markers or more", takes[0].path)
        beside = () if job.markers or base else lying_beside(takes, markers, bodies)
        markers = tuple(name for name in markers if name not in beside)
    options = _options(job, base, len(markers))
    with of_file(takes[0].path, InputError):
        trained = yield from train(takes, markers, options, base, bodies, try_all)
    report = _report(job, takes, trained, options.hit_rate, clock | trained.seconds)
    doubts = " ".join(trained.doubts)
    new = {name for name in kept if name in markers and name not in doubts}
    report["doubts"] += _not_shown(new, {*kept, *lost} - {*markers}, apart, beside)
    taught = tuple(zip(takes, [*digests, *[""] * len(job.shown)], strict=True))
    return _Taught(_with_source(trained.model), base, taught, report), trained.replaced


def _from_words(job: TrainJob, clock: dict[str, float], try_all: Trying) -> Generator[Progress, None, _Taught]:
    """The model of a marker set that words alone describe."""
    layout, bodies = open_layout(job.layout), known_bodies()
    with of_file(job.layout):
        markerset = described(layout, bodies)
    markerset = replace(markerset, name=written(job.name or layout.name).strip() or "model")
    work = learned_from_words(markerset, bodies, try_all)
    model, seconds = yield from within(work, 0.0, TRAINING_SHARES["end"])
    doubt = "learned from words alone: how its wearers differ and move is taken from recorded people"
    unidentified = np.full(len(markerset), np.nan)
    how = f"the body of {markerset.source['body']}, markers by their description"
    trained = Trained(model, (), (), how, unidentified, (doubt,), {})
    return _Taught(_with_source(model), None, (), _report(job, (), trained, 0.0, clock | seconds))


def _given_solvers(job: TrainJob, base: Model, clock: dict[str, float]) -> Generator[Progress, None, _Taught]:
    """The model `base` with the partial solvers that are asked for, found in what it keeps."""
    with timed(clock, "read"):
        bodies = known_bodies() + ([open_markerset(job.body)] if job.body else [])
    options = replace(_options(job, base, len(base.markerset)), search=job.search or USUAL_SEARCH)
    with timed(clock, "ensemble"):
        work = train_solvers(base, options, bodies)
        model = yield from within(work, TRAINING_SHARES["compare"], TRAINING_SHARES["end"])
    unidentified = np.full(len(model.markerset), np.nan)
    doubts = tuple(never_named(model))
    trained = Trained(model, model.training_takes, (), "as it was", unidentified, doubts, {})
    return _Taught(model, base, (), _report(job, (), trained, options.hit_rate, clock))


def _not_shown(kept: set[str], lost: set[str], apart: Sequence[str], beside: Sequence[str]) -> list[str]:
    """Sentences on names that are no markers in the takes: those that stay in the set, and those that do not."""
    rows = (
        (sorted(kept), "not seen in any take: where it sits is taken from the known body"),
        (sorted(lost), "not seen in any take: left out"),
        (apart, "no marker on the subject: two of three axes are zero throughout, or far from all others, left out"),
        (beside, "no marker on the subject: on the floor, away from the feet, left out"),
    )
    return [f"{listed(names)} {'are' if len(names) > 1 else 'is'} {what}" for names, what in rows if names]


def _base(job: TrainJob) -> Model | None:
    """The model to train on; InputError where it does not keep what it learned from."""
    if job.base is None:
        return None
    base = open_model(job.base)
    if not base.training_takes:
        raise InputError(
            f"model {base.markerset.name} keeps nothing of the takes that it was trained on, so training on would "
            "forget them; expected one that keeps them, or all takes together to train anew"
        )
    return base


def _options(job: TrainJob, base: Model | None, markers: int) -> TrainingOptions:
    name = job.name or (base.markerset.name if base else job.out.name.removesuffix(SUFFIX).partition(".")[0])
    functions = PAPER_FUNCTIONS if job.paper else FUNCTIONS
    # Such that its file can be read: never blank, and of letters that files hold.
    name = written(name).strip() or "model"
    options = TrainingOptions(name, functions=functions, keep=job.keep)
    if job.hit_rate is not None:
        options = replace(options, hit_rate=job.hit_rate)
    asked = job.paper or job.hit_rate is not None or not job.keep
    at_once = USUAL_SEARCH if asked and markers <= options.max_markers else "none"
    return replace(options, search=job.search or at_once)


def _with_source(model: Model) -> Model:
    """The model, which says what has made it."""
    source = {"learned": f"by mocap-autolabel train {version()}", **model.markerset.source}
    return replace(model, markerset=replace(model.markerset, source=source))


def _report(
    job: TrainJob, takes: Sequence[TakeFile], trained: Trained, hit_rate: float, clock: dict[str, float]
) -> dict:
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
            "hit_rate": hit_rate,
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
        "evidence": {"subjects": likelihood.subjects, "plates": likelihood.rigid_bodies is not None},
        "ensemble": solvers,
        "seconds": {part: round(seconds, 2) for part, seconds in clock.items()},
        "replaced": [{"take": " ".join(gone.takes), "subject": gone.subject} for gone in trained.replaced],
    }
