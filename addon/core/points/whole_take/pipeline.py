# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points from end to end: name each frame on its own, solve the take as a whole, pose the body.

The counterpart of `blobs.pipeline` for points. What the take shows of its subject is learned first; takes that the
model is not for are refused, before the work and after it. Edits are constraints, and they hold in the end: the labels
without them tell what edits such as an exchange mean; the take is solved again with what they say of its points, and
they are applied to what comes of it.
"""

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from time import perf_counter
from typing import TypeVar

import numpy as np
from threadpoolctl import threadpool_limits

from ...blobs.pipeline import Options
from ...data.background import in_background
from ...data.progress import Progress, Stage, in_stages
from ...data.takes import BY_FIT, LabelledChunk, Labels, Motion, Points, Verdict
from ...edits.applying import AppliedEdits, PointCells, apply_to_points
from ...edits.kinds import NO_EDITS, Edits
from ...review.answering import unanswered, without_accepted
from ...review.suspects import called_by, find_suspects, summarised
from ..adaptation import Adaptation, adapt, borne_out
from ..models import Model
from ..motion import motion_of
from ..naming import Namer, namer_of
from ..refusals import Sample, refuse_floods, refuse_others, refuse_unlike, refuse_unrecognised
from ..tracklets import are_lasting, cut, renamed
from ..unordered import UNORDERED, is_unordered, learn_subject
from .deciding import BELIEVING, can_be_solved, solution_of, verdict_of
from .rulings import Rulings
from .solving import Solution
from .tracklets import asked_frames, said_between

Result = TypeVar("Result")
USUAL_TARGET = 0.999  # the part of the labels that must be right, unless another is asked for
# What each stage takes, as measured: so many times as long as a frame is named in, and that again for each frame. The
# last is what whoever called does with the outcome. Where frames are in no order their subject is learned from some of
# them, and all are named again; with edits the take is solved again.
COSTS = {
    "adapt": (5, 0),
    "others": (150, 0),
    "name": (0, 1),
    "learn": (0, 0),
    "name again": (0, 0),
    "vote": (10, 0.3),
    "hear": (0, 0),
    "vote again": (0, 0),
    "pose": (18, 0.12),
    "write": (5, 0.03),
}
COST_OF_LEARNING = 6.0  # times that each frame is named in which the subject of frames in no order is learned


@dataclass(frozen=True)
class PointOptions:
    """How points are named.

    method  as `naming.chosen_method` gives it
    target  the part of the labels that must be right; what is less sure is left unnamed
    hints   what the user may say about the take, for the fitted body
    edits   what a person said of the labels; those that `edits.applying.refuse_unknown` lets pass
    """

    method: str
    target: float = USUAL_TARGET
    hints: Options = field(default_factory=Options)
    edits: Edits = NO_EDITS


def label_points(take: Points, model: Model, options: PointOptions) -> Generator[Progress, None, LabelledChunk]:
    """Names the points of a take, and poses the body on them; labels are (T, P), motion frame for frame.

    Suspects call trajectories by their index in the file (`Points.columns`).
    Raises JobError where the take is not of one subject in the model's markers.
    """
    begin = perf_counter()
    refuse_floods(take.xyz)
    tracklet = cut(take.xyz, take.rate)
    unordered = options.method == "likelihood" and is_unordered(model, tracklet)
    shares = begins(len(take.xyz), options.method, unordered, bool(options.edits))
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        work = _labelled(take, tracklet, model, options, begin)
        return (yield from in_stages(work, shares))


def begins(frames: int, method: str, unordered: bool = False, edited: bool = False) -> dict[str, float]:
    """How far along the work is when each of its stages begins, for a take of so many frames."""
    costs = COSTS | ({"others": (5, 0)} if method == "fit" else {})
    if unordered:
        costs |= {"learn": (COST_OF_LEARNING * min(frames, UNORDERED.frames), 0), "name again": COSTS["name"]}
    if edited:
        costs |= {"vote again": COSTS["vote"]}
    spent = np.array([fixed + each * frames for fixed, each in costs.values()])
    return dict(zip(costs, ((np.cumsum(spent) - spent) / spent.sum()).tolist(), strict=True))


# Stages as they begin, and how far they are.
Steps = Generator[Stage | float | tuple[float, str], None, Result]


@dataclass(frozen=True, eq=False)
class NamedFrames:
    """What the frames of a take say on their own.

    tracklet    (T, P) the tracklet of every point
    adaptation  the model as it is for the take
    namer       what names frames
    labels      (T, P), with their `rate`
    solvable    whether the take can be solved as a whole
    """

    take: Points
    tracklet: np.ndarray
    adaptation: Adaptation
    namer: Namer
    labels: Labels
    solvable: bool

    @property
    def model(self) -> Model:
        """The model as it is for the take."""
        return self.adaptation.model


def _labelled(
    take: Points, tracklet: np.ndarray, model: Model, options: PointOptions, begin: float
) -> Steps[LabelledChunk]:
    """The take from stage to stage, with the tracklet of every point (T, P); `begin` is when that was begun, s."""
    frames = yield from _frame_by_frame(take, tracklet, model, options)
    verdict = yield from _as_a_whole(frames, options.target)
    unedited = applied = None
    if options.edits:
        unedited, applied, verdict = yield from _with_edits(frames, verdict, options)
    named = perf_counter()
    yield Stage("pose", "pose the body")
    markers = verdict.labels.placed(take.xyz, len(model.markerset))
    residual = verdict.labels.placed(take.residual, len(model.markerset))
    for at, place in (applied.places if applied else {}).items():
        markers[at], residual[at] = place, 0.0  # as nobody measured it

    def pose(tell) -> Motion:
        return motion_of(markers, residual, verdict.labels, model.markerset, take.frames, tell)

    motion = yield from in_background(pose)
    seconds = {"label": named - begin, "fit": perf_counter() - named}
    yield Stage("write", "write")
    suspects = verdict.suspects + find_suspects(motion, model.markerset.markers, take.rate)
    if applied:
        asked = applied.edited, model.markerset.by_name, take.first_frame, take.present
        suspects = unanswered(suspects, *asked)
    if take.columns is not None:  # as in label files: by the trajectories' index in the file
        suspects = called_by(suspects, take.columns)
    outcomes = applied.outcomes if applied else ()
    suspects = without_accepted(summarised(suspects, take.rate), options.edits)
    return LabelledChunk(verdict.labels, motion, suspects, seconds, unedited, outcomes)


def _frame_by_frame(take: Points, tracklet: np.ndarray, model: Model, options: PointOptions) -> Steps[NamedFrames]:
    """What every frame says on its own, once it is known whose take it is."""
    learned = options.method == "likelihood"
    yield Stage("adapt", "look who wears the markers")
    adaptation = adapt(model, take.xyz, tracklet, take.rate) if learned else Adaptation(model)
    namer = namer_of(adaptation.model, options.method, options.hints)
    yield Stage("others", "look whether the model is for this take")
    solvable = learned and can_be_solved(adaptation.model, tracklet)
    # What is asked for beyond what a take can promise, each frame must promise on its own.
    few = solvable and options.target <= BELIEVING.max_target
    asked = asked_frames(tracklet, take.rate) if few else np.arange(len(take.xyz))
    sample = refuse_others(adaptation.model, namer, take.xyz[asked], solvable)
    yield Stage("name", f"frame {take.first_frame}")
    labels = yield from _asked(namer, take, asked, sample if few else None)
    if few:
        labels = said_between(labels, asked, tracklet)
    if learned and is_unordered(adaptation.model, tracklet):
        yield Stage("learn", "learn the subject from sure frames")
        trained = adaptation.model.likelihood
        likelihood = yield from learn_subject(trained, take.xyz, labels)
        if likelihood is not trained:
            yield Stage("name again", f"frame {take.first_frame}")
            adaptation = replace(adaptation, model=replace(adaptation.model, likelihood=likelihood))
            again = namer_of(adaptation.model, options.method, options.hints)
            labels = yield from _named(again, take.xyz, take.rate, take.frames)
    return NamedFrames(take, tracklet, adaptation, namer, labels, solvable)


def _asked(namer: Namer, take: Points, asked: np.ndarray, sample: Sample | None) -> Steps[Labels]:
    """The labels (F, P) of the frames (F,) that are asked, of which a sample may have said its own already."""
    if sample is None:
        return (yield from _named(namer, take.xyz[asked], take.rate, take.frames[asked]))
    known = np.isin(np.arange(len(asked)), sample.frames)
    rest = np.flatnonzero(~known)
    if not len(rest):
        return sample.labels
    new = yield from _named(namer, take.xyz[asked[rest]], take.rate, take.frames[asked[rest]])
    order = np.argsort(np.concatenate([sample.frames, rest]))
    return Labels.join([sample.labels, new])[order]


def _named(namer: Namer, points: np.ndarray, rate: float, frames: np.ndarray) -> Steps[Labels]:
    """The labels (T, P) of points (T, P, 3) m, each frame on its own; `frames` (T,) are the source's numbers."""
    parts, done = [], 0
    for part in namer.name(points, rate):
        parts.append(part)
        done += len(part.marker)
        yield done / len(points), f"frame {frames[done - 1]}"
    return Labels.join(parts)


def _as_a_whole(frames: NamedFrames, target: float) -> Steps[Verdict]:
    """The names that the take as a whole bears out; JobError where it is not of the model's markers."""
    take, named, tracklet = frames.take, frames.labels, frames.tracklet
    yield Stage("vote", "solve the whole take" if frames.solvable else "let trajectories vote")
    solution = yield from _solution(frames, named, tracklet)
    if solution is not None:
        refuse_unlike(frames.model, take.xyz, solution.residual)
    verdict = _decided(frames, named, tracklet, solution, target)
    # Who asks for surer labels gets fewer, and the take is of the model's markers all the same.
    usual = verdict if target == USUAL_TARGET else _decided(frames, named, tracklet, solution, USUAL_TARGET)
    refuse_unrecognised(frames.model, frames.namer, take.xyz, usual.labels)
    return verdict


def _solution(
    frames: NamedFrames, named: Labels, tracklet: np.ndarray, rulings: Rulings | None = None
) -> Generator[float, None, Solution | None]:
    """What the take as a whole says of tracklets (T, P) whose frames say `named`; None where it cannot be solved."""
    if not frames.solvable:
        return None
    given = named, tracklet, frames.take.xyz, frames.model, frames.take.rate, frames.take.first_frame
    return (yield from in_background(lambda tell: solution_of(*given, progress=tell, rulings=rulings)))


def _decided(
    frames: NamedFrames, named: Labels, tracklet: np.ndarray, solution: Solution | None, target: float
) -> Verdict:
    """The names that are sure enough for the target, and what is to be said of them.

    By the solution; where there is none, by the tracklets (T, P), the rest of the take, and its motion.
    """
    take, names = frames.take, frames.model.markerset.markers
    verdict = verdict_of(solution, named, tracklet, take.xyz, frames.model, target, take.first_frame)
    if solution is None:
        verdict = borne_out(verdict, frames.adaptation, take.first_frame)
    # Frames in no order have no trajectories that could go over to another marker.
    lasting, marker = are_lasting(frames.tracklet), verdict.labels.marker
    changed = renamed(marker, frames.tracklet, names, take.first_frame) if lasting else ()
    return Verdict(verdict.labels, verdict.suspects + changed)


def _with_edits(
    frames: NamedFrames, verdict: Verdict, options: PointOptions
) -> Steps[tuple[Labels, AppliedEdits, Verdict]]:
    """The labels (T, P) of which the edits give those in the end, what the edits say, and the verdict with them."""
    cells = PointCells.of(frames.take, frames.model.markerset)
    first = apply_to_points(verdict.labels, options.edits, cells)
    rulings = Rulings(first.edited, verdict.labels, frames.tracklet)
    yield Stage("hear", "hear what the edits say")
    heard = rulings.heard((yield from _without_deleted(frames, first.edited.deleted)))
    tracklet = rulings.parted()
    yield Stage("vote again", "solve the take again with the edits")
    solution = yield from _solution(frames, heard, tracklet, rulings)
    again = _decided(frames, heard, tracklet, solution, options.target)
    unedited = first.edited.below(verdict.labels, again.labels)
    applied = replace(apply_to_points(unedited, options.edits, cells), outcomes=first.outcomes)
    return unedited, applied, Verdict(applied.labels, again.suspects)


def _without_deleted(frames: NamedFrames, deleted: np.ndarray) -> Steps[Labels]:
    """What frames say once the points that are no markers, deleted (T, P), are gone from them."""
    take, rows = frames.take, np.flatnonzero(deleted.any(axis=1))
    if not len(rows) or frames.namer.step == BY_FIT:  # which needs all frames in their order
        return frames.labels
    seen = np.where(deleted[rows, :, None], np.nan, take.xyz[rows])
    anew = yield from _named(frames.namer, seen, take.rate, take.frames[rows])
    columns = [getattr(frames.labels, name).copy() for name in ("marker", "step", "confidence", "rate")]
    for name, whole in zip(("marker", "step", "confidence", "rate"), columns, strict=True):
        whole[rows] = getattr(anew, name)
    return Labels(*columns)
