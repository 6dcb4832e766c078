# SPDX-License-Identifier: GPL-3.0-or-later
"""A take of 3D points from end to end: name each frame on its own, solve the take as a whole, pose the body.

The counterpart of `blobs.pipeline` for points. What the take shows of its subject is learned first; takes that the
model is not for are refused, before the work and after it. Edits are constraints, and they hold in the end: the labels
without them tell what edits such as an exchange mean; the take is solved again with what they say of its points, and
they are applied to what comes of it.
"""

from collections.abc import Callable, Generator, Iterable
from dataclasses import dataclass, replace
from time import perf_counter
from typing import TYPE_CHECKING

import numpy as np
from threadpoolctl import threadpool_limits

from ...data.lanes import PACKING, blocks
from ...data.made import IN_MEMORY, Made, MakeTable
from ...data.progress import Progress, Stage, Steps, in_stages
from ...data.takes import Labels, Points, Suspect, Verdict
from ...edits.applying import AppliedEdits, apply_edits, cells_of_take
from ...edits.kinds import NO_EDITS, Edits
from ...posing.finer import finer
from ...review.answering import unanswered, without_accepted
from ...review.suspects import summarised
from ..models import USUAL_TARGET, Model, Namer, namer_of
from ..motion import LabelledPoints, by_marker, take_motion
from ..possible import refuse_impossible
from ..refusals import (
    NO_FIT,
    REFUSAL,
    Sample,
    SubjectsError,
    UnsuitedError,
    points_at_a_time,
    refuse_floods,
    refuse_others,
    refuse_two_groups,
    refuse_unlike,
    refuse_unrecognised,
    sure_share,
)
from ..tracklets import are_lasting, cut, renamed
from ..unordered import FRAMES_LEARNED_FROM, is_unordered, learn_subject
from .deciding import can_be_solved, once, verdict_of
from .rulings import Rulings
from .search import Moves
from .solution import Solution
from .solving import solve_take
from .tracklets import FrameLabels, labels_between

if TYPE_CHECKING:  # most sets are on no rigid bodies
    from .recognition import Recognition


class ASKING:
    """How often frames are named on their own."""

    # frames a second; with 10 names of 2 % of a part of acrobatics are wrong, 30 change no label of it
    rate: float = 15.0  # measured


def asked_frames(tracklet: np.ndarray, rate: float) -> np.ndarray:
    """(F,) the frames to name first, of tracklets (T, P) at `rate` frames a second: no tracklet has none."""
    chosen = _every(len(tracklet), rate)
    last = np.full(int(tracklet.max(initial=-1)) + 1, -1)
    for part in blocks(*tracklet.shape):
        row, column = np.nonzero(tracklet[part] >= 0)
        np.maximum.at(last, tracklet[part][row, column], row + part.start)
    seen = last < 0
    some = tracklet[chosen]
    seen[some[some >= 0]] = True
    for one in np.argsort(last, kind="stable").tolist():
        if not seen[one]:
            chosen[last[one]] = True
            here = tracklet[last[one]]
            seen[here[here >= 0]] = True
    return np.flatnonzero(chosen)


def _every(frames: int, rate: float) -> np.ndarray:
    """(T,) True for as many of so many frames, of `rate` a second, as are to be named."""
    chosen = np.zeros(frames, dtype=bool)
    chosen[:: max(round(rate / ASKING.rate), 1)] = True
    return chosen


# What each stage takes, as measured: so many times as long as a frame is named in, and that again for each frame. The
# last is what whoever called does with the outcome. Where frames are in no order their subject is learned from some of
# them, and all are named again; with edits the take is solved again.
COSTS = {
    "adapt": (5, 0),
    "others": (150, 0),
    "name": (0, 1),
    "learn": (0, 0),
    "name again": (0, 0),
    "vote": (100, 0.1),
    "hear": (0, 0),
    "vote again": (0, 0),
    "pose": (100, 0.75),
    "write": (50, 0.2),
}
COST_OF_LEARNING = 6.0  # times that each frame is named in which the subject of frames in no order is learned


@dataclass(frozen=True)
class PointOptions:
    """How points are named."""

    method: str  # as `models.chosen_method` gives it
    # the part of the labels that must be right; what is less sure is left unnamed; names by motion know none
    target: float = USUAL_TARGET
    edits: Edits = NO_EDITS  # what a person said of the labels; those that `edits.applying.refuse_unknown` lets pass
    room: MakeTable = IN_MEMORY  # where large tables of what comes of a take are kept; with edits they are in memory
    force: bool = False  # name the points although the take cannot be as it says, or is not of the model's markers
    traced: bool = False  # the points are where rays of blobs meet: their cameras say what cannot be
    finer: bool = False  # the body is posed with what joints its markers can show beside those that they are named by
    search: Moves = "all"  # which moves are tried on a take, as in `solve_take`


def label_take(take: Points, model: Model, options: PointOptions) -> Generator[Progress, None, LabelledPoints]:
    """Names the points of a take, and poses the body on them.

    Labels are by lanes, as the points; suspects call trajectories by their index in the file (`Points.columns`).
    Raises JobError where the take is not of one subject in the model's markers, or cannot be as it says.
    """
    begin = perf_counter()
    refuse_floods(take.xyz)
    if not (options.force or options.traced):
        refuse_impossible(take.xyz, take.rate, take.lanes, [model])
    tracklet = cut(take.xyz, take.rate, lanes=take.lanes)
    unordered = options.method == "likelihood" and is_unordered(model, tracklet)
    shares = begins(len(take.xyz), unordered, bool(options.edits))
    with threadpool_limits(1, user_api="blas"):  # many threads on small matrices cost more than they bring
        work = _labelled(take, tracklet, model, options, begin)
        del tracklet  # a long take's is large
        return (yield from in_stages(work, shares))


def begins(frames: int, unordered: bool = False, edited: bool = False) -> dict[str, float]:
    """How far along the work is when each of its stages begins, for a take of so many frames."""
    costs: dict[str, tuple[float, float]] = dict(COSTS)
    if unordered:
        costs |= {"learn": (COST_OF_LEARNING * min(frames, FRAMES_LEARNED_FROM), 0), "name again": COSTS["name"]}
    if edited:
        costs |= {"vote again": COSTS["vote"]}
    done = np.cumsum([0, *(fixed + each * frames for fixed, each in costs.values())])
    return dict(zip(costs, (done[:-1] / done[-1]).tolist(), strict=True))


# What `refuse_others` does.
Refuse = Callable[[Model, Namer, Made, bool], Sample | None]


@dataclass(frozen=True, eq=False)
class NamedFrames:
    """What the frames of a take say on their own; where its rigid bodies are others, what their motion says."""

    take: Points
    tracklet: np.ndarray  # (T, L) the tracklet of every point
    model: Model  # as it is for the take
    # what the take itself tells of the rigid bodies in it; None of a set that is not on such
    recognition: "Recognition | None"
    namer: Namer  # what names frames
    labels: FrameLabels  # (T, P), with their `rate`; of a long take worked out when they are asked for
    solvable: bool  # whether the take can be solved as a whole
    room: MakeTable  # as in `PointOptions`
    sure: bool = True  # whether some frames were sure enough of the model's markers before all were named
    search: Moves = "all"  # as in `PointOptions`
    # (K, M, 3) m where the subject's markers were in other frames, NaN where one was not; None where nobody knows
    shown: np.ndarray | None = None
    # in how many frames the subject may be, of which its markers are in some; None where that is all of the take
    occupied: int | None = None
    # what the take comes to by the model's other likelihood where that is likelier, but refuses it
    other: Solution | None = None

    @property
    def by_motion(self) -> bool:
        """Whether the names are those that the motion of rigid bodies tells, whose forms nobody knows."""
        return self.recognition is not None and self.recognition.by_motion


def _labelled(
    take: Points, tracklet: np.ndarray, model: Model, options: PointOptions, begin: float
) -> Steps[LabelledPoints]:
    """The take from stage to stage, with the tracklet of every point (T, P); `begin` is when that was begun, s."""
    frames, solution, verdict = yield from _likelier(take, tracklet, model, options)
    model = frames.model
    unedited = applied = None
    if options.edits:
        unedited, applied, verdict = yield from _with_edits(frames, solution, verdict, options)
    del frames, tracklet, solution  # a long take's are large
    named = perf_counter()
    yield Stage("pose", "pose the body")
    places = dict(applied.places if applied else {})
    markers = by_marker(take.xyz, verdict.labels, len(model.markerset), places)
    nothing = dict.fromkeys(places, 0.0)  # they were not measured
    residual = by_marker(take.residual, verdict.labels, len(model.markerset), nothing)
    body = finer(model.markerset) if options.finer else model.markerset
    of_take = verdict.labels, body, take.frames, options.room
    motion = yield from take_motion(markers, residual, *of_take)
    seconds = {"label": named - begin, "fit": perf_counter() - named}
    yield Stage("write", "write")
    doubts = motion.suspects(model.markerset.markers, take.rate)
    suspects = unanswered(as_in_file(verdict.suspects + doubts, take), options.edits, model.markerset.by_name)
    suspects = without_accepted(summarised(suspects, take.rate), options.edits)
    outcomes = applied.outcomes if applied else ()
    return LabelledPoints(verdict.labels, motion, suspects, seconds, unedited, outcomes, doubts)


def _likelier(
    take: Points, tracklet: np.ndarray, model: Model, options: PointOptions
) -> Steps[tuple[NamedFrames, Solution | None, Verdict]]:
    """What frames say, and what the take as a whole comes to; where frames are not sure, by the model's second, too.

    Of both likelihoods that is kept by which the markers sit likelier, also where it alone would refuse the take. Where
    it does and frames are sure by the other, that one is kept, and what it names otherwise is not sure. UnsuitedError
    where each refuses the take.
    """
    found, fitting, refusals, asked = [], [], [], [model]
    if model.second is not None and options.method == "likelihood":
        asked.append(replace(model, likelihood=model.second))
    for one in asked:
        try:
            frames = yield from name_frames(take, tracklet, one, options)
            # In frames that show nothing nobody is, so of no marker they say that it is seldom there.
            frames = replace(frames, occupied=int(np.count_nonzero(points_at_a_time(take.xyz))))
            found.append((frames, *(yield from as_a_whole(frames, options))))
            refuse_named(*found[-1], options)
            fitting.append(found[-1])
        except UnsuitedError as error:
            refusals.append(error)
        if (fitting and fitting[-1][0].sure) or any(isinstance(error, SubjectsError) for error in refusals):
            break
    if not fitting:
        raise refusals[0]
    # Who says less of a take is refused sooner, and is not wrong for that.
    likely, fits = max(found, key=_log_likelihood), max(fitting, key=_log_likelihood)
    if likely is fits or not fitting[-1][0].sure or likely[1] is None or fits[1] is None:
        return likely
    frames = replace(fits[0], other=likely[1])
    return frames, fits[1], decided_of(frames, frames.labels, tracklet, fits[1], options.target)


def _log_likelihood(one: tuple[NamedFrames, Solution | None, Verdict]) -> float:
    """How likely the markers sit as they are named."""
    return NO_FIT.log_likelihood if one[1] is None else one[1].fit.log_likelihood


def as_in_file(suspects: Iterable[Suspect], take: Points) -> tuple[Suspect, ...]:
    """The suspects with trajectories, which they call by their lane, called as label files call points."""

    def called(one: Suspect) -> Suspect:
        column = one.trajectory
        if column is None:
            return one
        if take.lanes is not None:
            column = int(take.lanes.at(*np.array([one.first - take.first_frame, column])))
        return replace(one, trajectory=column if take.columns is None else int(take.columns[column]))

    return tuple(map(called, suspects))


def name_frames(
    take: Points,
    tracklet: np.ndarray,
    model: Model,
    options: PointOptions,
    refuse: Refuse | None = None,
) -> Steps[NamedFrames]:
    """What every frame says on its own, once it is known whose take it is.

    Before its stage "name" begins `refuse`, or else `refuse_others`, raises JobError where the take is not of the
    model's markers; of a take that is forced nobody asks. Of rigid bodies that are others single frames know nothing:
    their motion names them at once, and all that is refused, unless `refuse` is given, are two groups of them.
    """
    learned, room = options.method == "likelihood", IN_MEMORY if options.edits else options.room
    yield Stage("adapt", "look who wears the markers")
    recognition = None
    if learned and model.rigid_bodies is not None and model.structure is not None:
        from .recognition import recognise

        recognition = recognise(model.structure, model.rigid_bodies, take.xyz, tracklet, take.rate)
    namer = namer_of(model, options.method)
    if recognition is not None and recognition.by_motion:
        if refuse is None and not options.force:
            refuse_two_groups(model, take.xyz)
        yield Stage("name", "name by motion")
        return NamedFrames(take, tracklet, model, recognition, namer, recognition.labels, False, room)
    yield Stage("others", "look whether the model is for this take")
    solvable = learned and can_be_solved(model, tracklet)
    unordered = learned and is_unordered(model, tracklet)
    few = learned and not unordered
    asked = asked_frames(tracklet, take.rate) if few else np.arange(len(take.xyz))
    points = take.ordered(asked)
    if refuse is None and not options.force:
        refuse = refuse_others
    sample = None if refuse is None else refuse(model, namer, points, solvable)
    yield Stage("name", f"frame {take.first_frame}")
    labels = yield from _asked(namer, take, asked, sample if few else None)
    given = labels_between(labels, asked, tracklet) if few else labels
    if unordered:
        yield Stage("learn", "learn the subject from sure frames")
        trained = model.learned_likelihood
        likelihood = yield from learn_subject(trained, take.xyz, labels)
        if likelihood is not trained:
            yield Stage("name again", f"frame {take.first_frame}")
            model = replace(model, likelihood=likelihood)
            again = namer_of(model, options.method)
            given = yield from _asked(again, take, asked)
    if sample is not None:
        sure = sample.sure
    else:  # of a forced take nobody has looked
        sure = not options.force or sure_share(labels, points, len(model.markerset)) >= REFUSAL.min_sure
    return NamedFrames(take, tracklet, model, recognition, namer, given, solvable, room, sure, options.search)


def _asked(namer: Namer, take: Points, asked: np.ndarray, sample: Sample | None = None) -> Steps[Labels]:
    """The labels (F, L) of the frames (F,) that are asked, of which a sample may have said its own already.

    Frames that say something on their own are named in parts, so that nothing is made of all of them but labels.
    """
    shape, rest = (len(asked), take.xyz.shape[1]), np.arange(len(asked))
    found = replace(Labels.none(*shape), rate=np.zeros(shape))
    if sample is not None:
        found.put(sample.frames, take.in_order(asked[sample.frames]).labels(sample.labels))
        rest = np.setdiff1d(rest, sample.frames)
    for first in range(0, len(rest), PACKING.block_frames):
        rows = rest[first : first + PACKING.block_frames]
        some = take.in_order(asked[rows])
        share = first / len(rest), (first + len(rows)) / len(rest)
        new = yield from _named(namer, some.xyz, take.rate, take.frames[asked[rows]], share)
        found.put(rows, some.labels(new))
    return found


def _named(
    namer: Namer, points: np.ndarray, rate: float, frames: np.ndarray, share: tuple[float, float] = (0.0, 1.0)
) -> Steps[Labels]:
    """The labels (T, P) of points (T, P, 3) m, each frame on its own; `frames` (T,) are the source's numbers.

    `share` is how far along the stage is when they are begun with, and when they are done.
    """
    parts, done = [], 0
    for part in namer.name(points, rate):
        parts.append(part)
        done += len(part.marker)
        yield share[0] + (share[1] - share[0]) * done / len(points), f"frame {frames[done - 1]}"
    return Labels.join(parts)


def as_a_whole(frames: NamedFrames, options: PointOptions) -> Steps[tuple[Solution | None, Verdict]]:
    """The names that the take as a whole bears out, by a solution."""
    named, tracklet = frames.labels, frames.tracklet
    yield Stage("vote", "solve the whole take" if frames.solvable else "let trajectories vote")
    solution = yield from solution_for(frames, named, tracklet)
    return solution, decided_of(frames, named, tracklet, solution, options.target)


def refuse_named(frames: NamedFrames, solution: Solution | None, verdict: Verdict, options: PointOptions):
    """Raises UnsuitedError where a take that is not forced was named `as_a_whole`, and is of another marker set.

    Who asks for surer labels gets fewer, and the take is of the model's markers all the same.
    """
    if options.force:
        return
    if options.target != USUAL_TARGET:
        verdict = decided_of(frames, frames.labels, frames.tracklet, solution, USUAL_TARGET)
    refuse_solved(frames, solution, verdict.labels)


def refuse_solved(frames: NamedFrames, solution: Solution | None, usual: Labels):
    """Raises UnsuitedError where a take with a solution, and labels of the usual target, is of another marker set."""
    if solution is not None:
        refuse_unlike(frames.model, frames.namer, frames.take.xyz, solution.fit, frames.sure)
    refuse_unrecognised(frames.model, frames.namer, frames.take.xyz, usual, frames.sure)


def solution_for(
    frames: NamedFrames, named: FrameLabels, tracklet: np.ndarray, rulings: Rulings | None = None
) -> Generator[float, None, Solution | None]:
    """What the take as a whole says of tracklets (T, P) whose frames say `named`; None where it cannot be solved."""
    if not frames.solvable:
        return None
    given = frames.take.xyz, tracklet, named, frames.model, frames.take.rate
    return (yield from solve_take(*given, rulings, frames.occupied, frames.sure, frames.search, frames.shown))


def decided_of(
    frames: NamedFrames, named: FrameLabels, tracklet: np.ndarray, solution: Solution | None, target: float
) -> Verdict:
    """The names that are sure enough for the target, and what is to be said of them.

    By the solution; where there is none, by the tracklets (T, P) and the rest of the take. Names by motion are as sure
    as they are, whatever the target.
    """
    take, names = frames.take, frames.model.markerset.markers
    if solution is not None and frames.other is not None:
        solution = solution.doubted(frames.other)
    given = solution, named, tracklet, frames.model, target, take.first_frame, take.lanes
    if frames.by_motion:
        labels = named.whole()
        first = once(labels.marker, labels.confidence, len(names), take.lanes)
        verdict = Verdict(labels.kept(first == labels.marker))
    else:
        verdict = verdict_of(*given, frames.room)
    if frames.recognition is not None:
        verdict = replace(verdict, suspects=frames.recognition.suspects(verdict, names, take.first_frame))
    # Frames in no order have no trajectories that could go over to another marker.
    lasting, marker = are_lasting(frames.tracklet), verdict.labels.marker
    changed = renamed(marker, frames.tracklet, names, take.first_frame, take.lanes) if lasting else ()
    return Verdict(verdict.labels, verdict.suspects + changed)


def _with_edits(
    frames: NamedFrames, solved: Solution | None, verdict: Verdict, options: PointOptions
) -> Steps[tuple[Labels, AppliedEdits, Verdict]]:
    """The labels (T, P) of which the edits give those in the end, what the edits say, and the verdict with them."""
    markerset = frames.model.markerset
    cells = cells_of_take(frames.take, markerset.by_name, len(markerset))
    first = apply_edits(verdict.labels, options.edits, cells)
    rulings = Rulings(first.edited, verdict.labels, frames.tracklet, solved)
    yield Stage("hear", "hear what the edits say")
    ruled = rulings.applied_to((yield from without_deleted(frames, first.edited.deleted)))
    tracklet = rulings.parted()
    yield Stage("vote again", "solve the take again with the edits")
    solution = yield from solution_for(frames, ruled, tracklet, rulings)
    again = decided_of(frames, ruled, tracklet, solution, options.target)
    unedited = first.edited.below(verdict.labels, again.labels)
    applied = replace(apply_edits(unedited, options.edits, cells), outcomes=first.outcomes)
    return unedited, applied, Verdict(applied.labels, again.suspects)


def without_deleted(frames: NamedFrames, deleted: np.ndarray) -> Steps[Labels]:
    """What frames say once the points that are no markers, deleted (T, P), are gone from them."""
    take, rows, labels = frames.take, np.flatnonzero(deleted.any(axis=1)), frames.labels.whole()
    if not len(rows) or frames.by_motion:
        return labels
    some = take.in_order(rows)
    seen = np.where(some.of(deleted[rows])[..., None], np.nan, some.xyz)
    again = some.labels((yield from _named(frames.namer, seen, take.rate, take.frames[rows])))
    columns = [getattr(labels, name).copy() for name in ("marker", "step", "confidence", "rate")]
    for name, whole in zip(("marker", "step", "confidence", "rate"), columns, strict=True):
        whole[rows] = getattr(again, name)
    return Labels(*columns)
