# SPDX-License-Identifier: GPL-3.0-or-later
"""Training from end to end: labelled takes in; a model, and what is doubtful of it, out.

The counterpart of the pipelines that label: compare the takes, find the body, learn the likelihood, train the partial
solvers.

Where nobody knows the marker names, a person's known body is laid into a frame by where the markers sit (`laying`) and
posed on all of the takes; every marker goes to the segment that carries it. What no person's body explains is none.
"""

import warnings
from collections.abc import Generator, Sequence
from dataclasses import dataclass, replace
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ..body.bodies import BodyModel
from ..body.prior import Prior
from ..data.errors import InputError
from ..data.markersets import MarkerSet
from ..data.progress import Progress, within
from ..data.wording import count_of
from ..papers.partial_solvers.boosting import Boosting
from ..papers.partial_solvers.model import FUNCTIONS, PartialSolvers
from ..papers.partial_solvers.training import Training, training
from ..points.likelihood.learn import Trying, in_turn, learning
from ..points.models import Model, TrainingTake, by_subject
from ..points.rigid_bodies.model import learn_rigid_bodies
from ..posing.posing import fit_points
from .imagining import IMAGINING, bent, imagined, moves, shows_poses, size_of, strangers
from .laying import laid_into, marker_sides
from .poses import known_poses
from .segments import segment_markerset
from .spread import some_of
from .takes import LabelledTake, contradicted, gathered, of_markers, subject_rows, training_takes_of, without_replaced
from .transfer import known_body, settled, transferred


class PEOPLE:
    """When a take is a person's."""

    # heights, how far markers may be from where the body has them, in the mean of their medians; 0.0002 to 0.006 for
    # walkers, actors and players whose names nobody knew, 0.010 to 0.020 for nine of ten bodies laid over plates
    max_off: float = 0.008  # measured
    # how far poses and shape may be from those of people, in squares of standard deviations; of people who fence, dance
    # and crawl up to 150 were seen, of left taken for right 400
    max_unusual: float = 200.0  # measured


def person_in(
    subjects: Sequence[np.ndarray], markers: Sequence[str], name: str, bodies: Sequence[MarkerSet]
) -> tuple[MarkerSet, str] | None:
    """The person whom labelled frames of each subject (T, M, 3) m show moving: their markers on a known body, its name.

    None where no body suits: a thing, an animal, a hand, plates, or too little of a person.
    """
    laid = laid_into(subjects, markers, bodies)
    if laid is None:
        return None
    try:
        body = settled(transferred(laid.body, subjects, markers, name, laid.place), subjects)
    except ValueError:  # the takes do not show them together enough
        return None
    model, away, unusual = BodyModel(body), [], []
    for points in subjects:
        some = some_of(points)
        bodies_posed = fit_points(model, some)
        gaps = np.linalg.norm(model.pose(bodies_posed).markers - some, axis=2)
        away.append(gaps / bodies_posed.scale.mean(axis=1)[:, None])
        there = np.isfinite(bodies_posed.translation).all(axis=1)
        unusual.append(float(Prior(model).terms(bodies_posed.pick(there))[0].mean()))
    off = np.nanmean(np.nanmedian(np.concatenate(away), axis=0))
    suits = off <= PEOPLE.max_off and np.mean(unusual) <= PEOPLE.max_unusual
    return (body, laid.body.name) if suits and _sides_agree(body, marker_sides(markers)) else None


def _sides_agree(body: MarkerSet, sides: np.ndarray) -> bool:
    """Whether most of the markers whose names have sides (M,) sit on limbs of that side."""
    own = np.array([{".L": 1, ".R": -1}.get(name[-2:], 0) for name in body.skeleton.segments])[body.attachment]
    return bool((own * sides).sum() >= 0)


# How far along the work is when each part begins.
TRAINING_SHARES = {"compare": 0.04, "body": 0.05, "likelihood": 0.1, "partial_solvers": 0.5, "end": 0.98}


@dataclass(frozen=True)
class TrainingOptions:
    """What a model is to be."""

    name: str  # its marker set's
    hit_rate: float = Boosting.accuracy  # asked of the partial solvers
    # how those are found, "none" for none: `train_solvers` finds them later, in what the model keeps
    search: str = "none"
    functions: tuple[str, ...] = FUNCTIONS  # the geometric functions that they are made of
    keep: bool = True  # keep frames of the takes in the model, so that it can be trained on
    # beyond, partial solvers are found only when a search is asked for; 15 take 63 s of a core
    # (results/partial_training.json), and many more there are of twice as many
    max_markers: int = 40  # measured
    solver_frames: int = 6000  # that partial solvers are trained on, of all subjects together; memory


MAX_RESIDUAL_M = 0.03  # of a marker on a posed body: bones and skin move by less, so it is off the body or is two


@dataclass(frozen=True, eq=False)
class Trained:
    """What came of a training."""

    model: Model  # trained; its `source` says which takes
    training_takes: tuple[TrainingTake, ...]  # what it was trained on, also where the model does not keep them
    replaced: tuple[TrainingTake, ...]  # what an earlier model kept of takes that were given again with other labels
    body: str  # how the body was found, for people to read
    residual: np.ndarray  # (M,) m, how far each marker is from where the posed body has it; NaN where not known
    doubts: tuple[str, ...]  # what a person should know of takes and model, in sentences
    seconds: dict[str, float]  # that each part took


@dataclass(frozen=True, eq=False)
class _Body:
    """The body of a model, how it was found, and what is doubtful of it.

    learned_on is the one that people and poses are made up on: what a take is labelled by does not depend on how the
    subject is drawn.
    """

    markerset: MarkerSet
    learned_on: MarkerSet
    how: str
    doubts: tuple[str, ...] = ()


def train(
    takes: Sequence[LabelledTake],
    markers: Sequence[str],
    options: TrainingOptions,
    base: Model | None = None,
    bodies: Sequence[MarkerSet] = (),
    try_all: Trying = in_turn,
) -> Generator[Progress, None, Trained]:
    """Learns a model of these markers, trained on from what `base` keeps; `bodies` are the marker sets that are known.

    `try_all` makes the trials that the model is calibrated by, here or elsewhere.
    Raises InputError where the takes do not show enough.
    """
    marks = [perf_counter()]
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        yield Progress(TRAINING_SHARES["compare"], "compare the takes")
        before = of_markers(base.training_takes, base.markerset.markers, markers) if base else []
        before, replaced, notes = without_replaced(before, takes)
        everyone = _everyone(takes, markers, before)
        notes += [doubt for take in takes for doubt in take.doubts] + contradicted(takes, markers, before)
        marks.append(perf_counter())
        yield Progress(TRAINING_SHARES["body"], "find the body")
        found = _body(everyone, markers, options.name, bodies)
        how, residual = found.how, _residual(found.markerset, everyone)
        subjects, doubts = _subjects(everyone, found.learned_on, bodies)
        others = _others(everyone, found.learned_on)
        marks.append(perf_counter())
        shown = [(points, subject) for subject, points in (subjects | others).items()]
        work = learning(shown, markers, try_all=try_all)
        likelihood = yield from within(work, TRAINING_SHARES["likelihood"], TRAINING_SHARES["partial_solvers"])
        likelihood = replace(likelihood, subjects=len(everyone))
        marks.append(perf_counter())
        solvers = None
        if options.search != "none":
            searching = _partial_solvers(subjects, markers, options)
            solvers = yield from within(searching, TRAINING_SHARES["partial_solvers"], TRAINING_SHARES["end"])
        marks.append(perf_counter())
    training_takes = (*before, *training_takes_of(takes, markers))
    source = _source(training_takes)
    if doubts:
        source["poses"] = f"made up on {how}, by {_known_moves(known_poses(found.learned_on, bodies))}"
    if others:
        source["others"] = f"{len(others)} made up on {how}, by how its people differ"
    model = Model(replace(found.markerset, source=source), likelihood, solvers, training_takes if options.keep else ())
    notes = [*notes, *doubts, *found.doubts, *_doubts(model, len(everyone), residual)]
    seconds = dict(zip(("compare", "body", "evidence", "ensemble"), np.diff(marks).tolist(), strict=True))
    return Trained(model, training_takes, tuple(replaced), how, residual, tuple(notes), seconds)


def _everyone(
    takes: Sequence[LabelledTake], markers: Sequence[str], before: Sequence[TrainingTake]
) -> dict[str, np.ndarray]:
    """All frames of each subject (T, M, 3) m, of the takes and of what is kept of those before them."""
    everyone = by_subject(before)
    for subject, points in gathered(takes, markers).items():
        everyone[subject] = np.concatenate([everyone[subject], points]) if subject in everyone else points
    return everyone


def _body(everyone: dict[str, np.ndarray], markers: Sequence[str], name: str, bodies: Sequence[MarkerSet]) -> _Body:
    """Skeleton and body, and how they were found.

    By the markers' names where a known body has them; where no pose but one is shown by how they lie in it; else by how
    they move, as a person's if they move as one. Raises InputError where the takes do not show enough of that.
    """
    known, subjects = known_body(markers, bodies), list(everyone.values())
    try:
        if known is not None:
            markerset = transferred(known, subjects, markers, name)
            return _Body(markerset, markerset, f"the body of {known.name}")
        moving = any(map(shows_poses, subjects))
        if not moving and (laid := laid_into(subjects, markers, bodies)) is not None:
            markerset = transferred(laid.body, subjects, markers, name, laid.place)
            return _Body(markerset, markerset, f"the body of {laid.body.name}, laid into a frame")
        shown = [made for points in subjects for made in ([points] if moves(points) else bent(points))]
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # of markers that a subject lacks
            groups = segment_markerset(shown, markers, name)
        person = person_in(subjects, markers, name, bodies) if moving else None
    except ValueError as error:
        raise InputError(f"{error}; expected takes that show the markers together") from None
    if person is not None:
        markerset, known_name = person
        return _Body(markerset, groups, f"the body of {known_name}, by how the markers move")
    figure = count_of(len(groups.skeleton), "group")
    doubt = f"no person's body was found in how the markers move: the figure is {figure} of them"
    return _Body(groups, groups, "found from how the markers move", (doubt,))


def _subjects(
    everyone: dict[str, np.ndarray], markerset: MarkerSet, bodies: Sequence[MarkerSet]
) -> tuple[dict[str, np.ndarray], list[str]]:
    """What is learned from, by subject, and what is doubtful of it.

    Of who is shown in one pose only the other poses are made up, as such bodies are known to move, or bending between
    neighbours. What moves without bending is rigid.
    """
    poses, subjects, doubts = known_poses(markerset, bodies), {}, []
    for subject, points in everyone.items():
        if shows_poses(points) or (not len(poses) and moves(points)):
            subjects[subject] = points
            continue
        made = imagined(markerset, points, poses) if len(poses) else bent(points)
        subjects |= {f"{subject}, made up {number}": guess for number, guess in enumerate(made, 1)}
        few = "1 frame" if len(points) == 1 else f"{len(points)} frames in one pose"
        doubts.append(
            f"learned from {few} of {subject}: its other poses are made up by {_known_moves(poses)}, so unusual "
            "ones will be named less surely; a take that shows more of them makes the model better"
        )
        seen = np.isfinite(points[..., 0]).any(axis=0)
        unseen = [name for name, there in zip(markerset.markers, seen, strict=True) if not there]
        doubts += [f"{name} is not seen of {subject}: where it sits is taken from the known body" for name in unseen]
    return subjects, doubts


def _known_moves(poses: np.ndarray) -> str:
    return "how recorded people move" if len(poses) else "bending it between neighbours"


def _others(everyone: dict[str, np.ndarray], markerset: MarkerSet) -> dict[str, np.ndarray]:
    """Made-up people who move as those do who were recorded, where few were and it is known how bodies differ.

    Also where nobody who was recorded shows a marker: they show it where the body has it. None for markers on rigid
    bodies: nothing is known of how those differ.
    """
    moving = {subject: points for subject, points in everyone.items() if shows_poses(points)}
    unseen = not np.isfinite(np.concatenate(list(everyone.values()))[..., 0]).any(axis=0).all()
    few = 2 * len(everyone) <= IMAGINING.people or unseen
    known = len(markerset.spread.modes) and moving and few
    if not known or learn_rigid_bodies(list(everyone.values()), size_of(next(iter(moving.values())))) is not None:
        return {}
    each = max(IMAGINING.people // len(moving), 1)
    made = {}
    for seed, (subject, points) in enumerate(moving.items()):
        for number, frames in enumerate(strangers(markerset, points, each, seed), 1):
            made[f"somebody who moves as {subject}, {number}"] = frames
    return made


def _residual(markerset: MarkerSet, everyone: dict[str, np.ndarray]) -> np.ndarray:
    """(M,) m, how far each marker is from where the posed body has it, in the middle."""
    model, away = BodyModel(markerset), []
    for points in everyone.values():
        some = some_of(points)
        try:
            posed = model.pose(fit_points(model, some))
        except ValueError:
            continue
        away.append(np.linalg.norm(posed.markers - some, axis=2))
    if not away:
        return np.full(len(markerset), np.nan)
    with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # of a marker that nobody shows
        return np.nanmedian(np.concatenate(away), axis=0)


def train_solvers(
    model: Model, options: TrainingOptions, bodies: Sequence[MarkerSet] = ()
) -> Generator[Progress, None, Model]:
    """The model with partial solvers, found in what it keeps of its training takes; all else stays as it is.

    `options` says how, as for `train`. Raises InputError where the model keeps no takes.
    """
    if not model.training_takes:
        raise InputError(
            f"model {model.markerset.name} keeps nothing of the takes that it was trained on, so no partial solvers "
            "can be found in them; expected a model trained without --lean, or with --search"
        )
    with threadpool_limits(1, user_api="blas"):
        subjects, _ = _subjects(model.subjects, model.markerset, bodies)
        solvers = yield from _partial_solvers(subjects, model.markerset.markers, options)
    return replace(model, partial_solvers=solvers)


def _partial_solvers(
    everyone: dict[str, np.ndarray], markers: Sequence[str], options: TrainingOptions
) -> Generator[Progress, None, PartialSolvers]:
    each = max(options.solver_frames // len(everyone), 1)
    points = np.concatenate([own[:: max(-(-len(own) // each), 1)] for own in everyone.values()])
    how = Training(search=options.search, functions=options.functions)
    return (yield from training(points, markers, options.hit_rate, how))


def _source(training_takes: Sequence[TrainingTake]) -> dict[str, str]:
    """Where the numbers come from, for people to read."""
    rows = subject_rows(training_takes)
    frames, takes = sum(row["frames"] for row in rows), sum(len(row["takes"]) for row in rows)
    counts = f"subjects: {len(rows)}, takes: {takes}, frames: {frames}"
    return {"takes": counts, **{f"subject {row['subject']}": ", ".join(row["takes"]) for row in rows}}


def _doubts(model: Model, subjects: int, residual: np.ndarray) -> list[str]:
    """What a person should know of the model, in sentences."""
    doubts, markers = [], model.markerset.markers
    if subjects == 1:
        doubts.append("learned from one subject: how others differ is a guess; labels of others will be fewer")
    doubts += [
        f"{name} does not keep to the body ({1000 * value:.0f} mm off): is it a marker, and one only?"
        for name, value in zip(markers, residual, strict=True)
        if value > MAX_RESIDUAL_M
    ]
    return [*doubts, *never_named(model)]


def never_named(model: Model) -> list[str]:
    """The markers that no partial solver of a model may speak about, a sentence each."""
    if model.partial_solvers is None:
        return []
    return [
        f"no partial solver reaches the hit rate for {name}: the ensemble never names it"
        for name, count in zip(model.markerset.markers, model.partial_solvers.covered, strict=True)
        if not count
    ]
