# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points from end to end: name each frame on its own, solve the take as a whole, pose the body.

The counterpart of `blobs.pipeline` for points. What the take shows of its subject is learned first; takes that the
model is not for are refused, before the work and after it.
"""

from collections.abc import Generator
from dataclasses import dataclass, field, replace
from time import perf_counter

import numpy as np
from threadpoolctl import threadpool_limits

from ..blobs.pipeline import Options
from ..data.background import in_background
from ..data.progress import Progress, within
from ..data.takes import LabelledChunk, Labels, Points, Verdict, called_by
from ..edits.answering import without_accepted
from ..edits.applying import PointCells
from ..edits.kinds import NO_EDITS, Edits
from ..points.adaptation import Adaptation, adapt, borne_out
from ..points.deciding import consistent, decide
from ..points.models import Model
from ..points.motion import motion_of
from ..points.naming import Namer, namer_of
from ..points.refusals import refuse_floods, refuse_others, refuse_unlike, refuse_unrecognised
from ..points.tracklets import are_lasting, cut, renamed
from ..points.unordered import UNORDERED, is_unordered, learn_subject
from ..points.whole_take.deciding import can_be_solved, labels_of, solution_of
from ..points.whole_take.rulings import Rulings
from ..points.whole_take.solving import Solution
from ..review.suspects import find_suspects, summarised
from .edited_points import EditedVerdict, with_edits

USUAL_TARGET = 0.999  # the part of the labels that must be right, unless another is asked for
# What each part takes, as measured: so many times as long as a frame is named in, and that again for each frame. The
# last is what whoever called does with the outcome. Where frames are in no order their subject is learned from some of
# them, and all are named again.
COSTS = {
    "adapt": (5, 0),
    "others": (150, 0),
    "name": (0, 1),
    "learn": (0, 0),
    "vote": (10, 0.3),
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
    refuse_floods(take.xyz)
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        begin = perf_counter()
        cells = PointCells.of(take, model.markerset)
        tracklet = cut(take.xyz, take.rate)
        learned = options.method == "likelihood"
        shares = begins(len(take.xyz), options.method, learned and is_unordered(model, tracklet))
        found = yield from _named(take, model, options, cells, tracklet, shares)
        named, labels = perf_counter(), found.verdict.labels
        given = take.xyz, take.residual, labels, model.markerset, take.frames
        places = {} if found.applied is None else found.applied.places
        work = in_background(lambda tell: motion_of(*given, progress=tell, places=places))
        motion = yield from within(work, shares["pose"], shares["write"], "pose the body")
        seconds = {"label": named - begin, "fit": perf_counter() - named}
    yield Progress(shares["write"], "write")
    said = found.unanswered(found.verdict.suspects, cells)
    moved = found.unanswered(find_suspects(motion, model.markerset.markers, take.rate), cells)
    # As in label files: by the trajectories' index in the file.
    said = said if take.columns is None else called_by(said, take.columns)
    suspects = without_accepted(summarised(said + moved, take.rate), options.edits)
    return LabelledChunk(labels, motion, suspects, seconds, found.unedited, found.outcomes)


def begins(frames: int, method: str, unordered: bool = False) -> dict[str, float]:
    """How far along the work is when each of its parts begins, for a take of so many frames."""
    costs = COSTS | ({"others": (5, 0)} if method == "fit" else {})
    if unordered:
        costs = costs | {"learn": (_cost_of_learning(frames), 1)}
    spent = np.array([fixed + each * frames for fixed, each in costs.values()])
    return dict(zip(costs, ((np.cumsum(spent) - spent) / spent.sum()).tolist(), strict=True))


def _cost_of_learning(frames: int) -> float:
    """The same of learning the subject of so many frames in no order."""
    return COST_OF_LEARNING * min(frames, UNORDERED.frames)


def _named(
    take: Points,
    model: Model,
    options: PointOptions,
    cells: PointCells,
    tracklet: np.ndarray,
    shares: dict[str, float],
) -> Generator[Progress, None, EditedVerdict]:
    """What is said of every point in the end."""
    yield Progress(shares["adapt"], "look who wears the markers")
    learned = options.method == "likelihood"
    adaptation = adapt(model, take.xyz, tracklet, take.rate) if learned else Adaptation(model)
    namer = namer_of(adaptation.model, options.method, options.hints)
    yield Progress(shares["others"], "look whether the model is for this take")
    solvable = learned and can_be_solved(adaptation.model, tracklet)
    refuse_others(adaptation.model, namer, take.xyz, solvable)
    named = yield from _frame_by_frame(namer, take, shares["name"], shares["learn"])
    if learned and is_unordered(adaptation.model, tracklet):
        adaptation, named = yield from _named_again(named, adaptation, take, options, shares)
    yield Progress(shares["vote"], "let trajectories vote")
    solution = None
    if solvable:
        given = named, tracklet, take.xyz, adaptation.model, take.rate, take.first_frame
        work = in_background(lambda tell: solution_of(*given, progress=tell))
        solution = yield from within(work, shares["vote"], shares["pose"], "solve the whole take")
        refuse_unlike(adaptation.model, take.xyz, solution.residual)
    known = named, tracklet, adaptation, take, solution
    decided = _decided(*known, options.target)
    # Who asks for surer labels gets fewer, and the take is of the model's markers all the same.
    usual = decided if options.target == USUAL_TARGET else _decided(*known, USUAL_TARGET)
    refuse_unrecognised(adaptation.model, namer, take.xyz, usual.labels)
    first = _with_changes(decided, tracklet, take, model)
    if not options.edits:
        return EditedVerdict(first)

    def decide_again(heard: Labels, pieces: np.ndarray, rulings: Rulings) -> Verdict:
        solved = None
        if solution is not None:
            given = heard, pieces, take.xyz, adaptation.model, take.rate, take.first_frame
            solved = solution_of(*given, rulings=rulings)
        again = _decided(heard, pieces, adaptation, take, solved, options.target)
        return _with_changes(again, tracklet, take, model)

    yield Progress(shares["pose"], "solve the take again with the edits")
    known = first, named, tracklet, take, namer, options.edits, cells, decide_again
    return (yield from within(in_background(lambda _: with_edits(*known)), shares["pose"], shares["pose"], "edits"))


def _with_changes(verdict: Verdict, tracklet: np.ndarray, take: Points, model: Model) -> Verdict:
    """The verdict with what is to be said of trajectories that go on as another marker."""
    # Frames in no order have no trajectories that could go over to another marker.
    names = model.markerset.markers
    changed = renamed(verdict.labels.marker, tracklet, names, take.first_frame) if are_lasting(tracklet) else ()
    return Verdict(verdict.labels, verdict.suspects + changed)


def _named_again(
    named: Labels, adaptation: Adaptation, take: Points, options: PointOptions, shares: dict[str, float]
) -> Generator[Progress, None, tuple[Adaptation, Labels]]:
    """The model as it is for the subject that frames in no order show, and what every frame says by it."""
    trained, first, last = adaptation.model.likelihood, shares["learn"], shares["vote"]
    learning = _cost_of_learning(len(take.xyz))
    middle = first + (last - first) * learning / (learning + len(take.xyz))
    work = learn_subject(trained, take.xyz, named)
    likelihood = yield from within(work, first, middle, "learn the subject from sure frames")
    if likelihood is trained:
        return adaptation, named
    adaptation = replace(adaptation, model=replace(adaptation.model, likelihood=likelihood))
    namer = namer_of(adaptation.model, options.method, options.hints)
    return adaptation, (yield from _frame_by_frame(namer, take, middle, last))


def _frame_by_frame(namer: Namer, take: Points, first: float, last: float) -> Generator[Progress, None, Labels]:
    """What every frame says on its own, as the part of the work from `first` to `last`."""
    parts, done = [], 0
    yield Progress(first, f"frame {take.first_frame}")
    for part in namer.name(take.xyz, take.rate):
        parts.append(part)
        done += len(part.marker)
        share = first + (last - first) * done / len(take.xyz)
        yield Progress(share, f"frame {take.first_frame + done - 1}")
    return Labels.join(parts)


def _decided(
    named: Labels,
    tracklet: np.ndarray,
    adaptation: Adaptation,
    take: Points,
    solution: Solution | None,
    target: float,
) -> Verdict:
    """The names that the take as a whole bears out, sure enough for the target.

    By its solution; where it has none, by its tracklets, the rest of it, and its motion.
    """
    model = adaptation.model
    if solution is not None:
        return labels_of(solution, named, target, model.markerset.markers, take.first_frame)
    verdict = decide(named, tracklet, model, target, take.first_frame)
    verdict = consistent(verdict, take.xyz, model.likelihood, take.first_frame)
    return borne_out(verdict, adaptation, take.first_frame)
