# SPDX-License-Identifier: GPL-3.0-or-later
"""Which of the marker sets that are known is worn in a take, by a part of it.

A set may be worn where nearly all of its markers are there; of one that a single subject taught, mostly by a standing
trial, half of them, which is asked: some are taken off for the motion. Of two such, A leads B by

    sum_i (a_i - b_i) + sum_A (a_i - e) - sum_B (b_i - e) + h (hidden_B - hidden_A)

a_i, b_i  log odds of the names that A and B give to a point of one frame, given all their others
i         the points that both name, and not the same: what both call the same tells of labs, not of sets
A, B      the points that only one of them names, which must bring e: else it is a marker that no set has
hidden    markers that are not there in a frame; h are the log odds of a marker that is worn to be there

e is what the point of one marker may know; a set that another leads by more is out. Of sets that name the same points
alike the one that lacks less is worn. The one that is left is worn if a take of it is not refused, and little is beside
it; where more are left nobody knows. A set with which the take is refused, or of which more is missing, puts no other
out, but makes it unsure.

A search takes longest where a set is another. So it is begun with those that no other leads before it; where one of
these is worn for sure, the rest is not looked at again.

A take that is refused may be of a model with another axis up: what single frames say shows which is likeliest, and a
part of the take whether it would be named so. Or it is of another model that is known.
"""

from collections.abc import Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from threadpoolctl import threadpool_limits

from ..body.sides import mirror_order
from ..data.errors import JobError
from ..data.markersets import MarkerSet
from ..data.physical import MARKER_LIMITS
from ..data.progress import Progress, Steps, finished, in_stages, within
from ..data.takes import NO_MARKER, Labels, Points, evenly_spread
from ..points.models import USUAL_TARGET, Model, namer_of
from ..points.possible import FRAMES_TRIED, refuse_impossible
from ..points.refusals import REFUSAL, UnsuitedError, far_groups, points_at_a_time, refuse_floods
from ..points.tracklets import cut
from ..points.whole_take.objective import OBJECTIVE, Objective, usual_fit
from ..points.whole_take.pipeline import (
    NamedFrames,
    PointOptions,
    begins,
    decided_of,
    label_take,
    name_frames,
    refuse_solved,
    solution_for,
)
from ..points.whole_take.solution import Solution
from ..points.whole_take.solving import MARGINS

HOW_TO_TURN = "by --up"  # on the command line; Blender puts words of its sidebar there
TRIED_S = 2.0  # of the take, around its middle, that is labelled again: memory and time


def misfit_of(
    error: UnsuitedError,
    take: Points,
    models: Sequence[Model],
    options: PointOptions,
    turns: dict[str, np.ndarray],
    others: Sequence[Model],
) -> Generator[Progress, None, UnsuitedError]:
    """The error with which a take that is of none of the models was refused, with the reason where there is one.

    turns are rotations (3, 3) by the axis that would then point up, others the models that are known.
    """
    asked = take.in_order(evenly_spread(len(take.xyz), FRAMES_TRIED)).xyz
    each = product(models, turns)
    model, axis = max(each, key=lambda one: worth_of(one[0], asked @ turns[one[1]].T))
    part = middle_of(take)
    turned = replace(part, xyz=part.xyz @ turns[axis].T)
    if worth_of(model, asked @ turns[axis].T) > worth_of(model, asked):
        with suppress(JobError):
            tried = PointOptions(options.method, options.target, traced=True)
            yield from within(label_take(turned, model, tried), 1.0, 1.0, f"try {model.markerset.name}")
            words = f"stands with {axis} up, as which it looks like a take of model {model.markerset.name}"
            return UnsuitedError(f"{words}; expected that axis to be given, {HOW_TO_TURN} {axis}")
    _, likely = yield from set_worn(take, others)
    suited = f"; it looks like a take of {' or '.join(one.markerset.name for one in likely)}" if likely else ""
    return UnsuitedError(error.message + suited)


def worth_of(model: Model, points: np.ndarray) -> float:
    """Log likelihood of the usual frame of points (F, P, 3) m with the names that each finds on its own."""
    if model.likelihood is None:
        return 0.0
    labels = Labels.join(namer_of(model, "likelihood").name(points, 0.0))
    found = usual_fit(model.likelihood, labels.placed(points, len(model.markerset))).log_likelihood
    return float(found * labels.named.sum()) if np.isfinite(found) else 0.0


def middle_of(take: Points) -> Points:
    """The part of a take that is tried: around the middle of the frames that show as many points as is usual.

    Without frames before and after that show nothing: of no marker they say that it is seldom there.
    """
    count = points_at_a_time(take.xyz)
    shown = np.flatnonzero(count >= max(np.median(count), 1))
    half, middle = max(round(TRIED_S * take.rate / 2), 1), int(shown[len(shown) // 2]) if len(shown) else 0
    rows = slice(max(middle - half, 0), min(middle + half, len(take.xyz)))
    there = rows.start + np.flatnonzero(count[rows])
    rows = slice(int(there[0]), int(there[-1]) + 1) if len(there) else rows
    first = take.first_frame + rows.start
    lanes = None if take.lanes is None else take.lanes.between(rows.start, rows.stop)
    return replace(take, xyz=take.xyz[rows], residual=take.residual[rows], first_frame=first, lanes=lanes)


# On the command line; Blender puts words of its sidebar there.
HOW_TO_CHOOSE, HOW_TO_FIND = "by --model", "by --model MODEL, or a model that is trained"


class WORN:
    """When a set may be worn."""

    # part of the places of its markers that are hardly there: 0.13 at most in takes of the set, in which a lab has left
    # markers away or no camera saw a hand; 0.21 at least of the largest set in takes of others
    max_absent: float = 0.15  # measured
    max_unfound: float = 0.3  # measured: the same before the search, which finds as many again in takes of other labs
    # times its markers that are worn beside it: 0.1 at most with props, 0.4 at least where another set is worn that
    # nobody knows
    max_beside: float = 0.3  # measured


@dataclass(frozen=True, eq=False)
class FittingSet:
    """A model that may be of a take, and what it makes of its points."""

    model: Model
    frames: NamedFrames  # what single frames of it say
    solution: Solution | None  # what the take as a whole says; None where it cannot be solved so
    marker: np.ndarray  # (T, L) the name of each, NO_MARKER where it has none
    odds: np.ndarray  # (T, L) log odds of the names, what one may know where the take is not solved as a whole
    beside: float  # times its markers that are always there beside them
    refused: bool = False  # whether the take would be

    @cached_property
    def there(self) -> np.ndarray:
        """(M,) which of its markers are there."""
        return _there(self.marker, len(self.model.markerset))

    @property
    def absent(self) -> float:
        """The part of the places of its markers that are hardly there: a marker and its mirror image have one."""
        every, order = np.arange(len(self.there)), mirror_order(self.model.markerset.markers)
        order = every if order is None else order
        return 1 - float((self.there & self.there[order])[every <= order].mean())

    @property
    def suits(self) -> bool:
        """Whether no more of its markers are absent than may be."""
        return self.absent <= _may_lack(self.model, WORN.max_absent)

    def beats(self, other: "FittingSet") -> bool:
        """Whether another set is not worn, because this one may be."""
        one, two = self.marker != NO_MARKER, other.marker != NO_MARKER
        alike = one & two & (other._called_as(self.model.markerset)[other.marker] == self.marker)
        if ((one | two) & ~alike).sum() < REFUSAL.min_half * len(one):
            return bool((~self.there).sum() < (~other.there).sum())
        return self._worth(one & ~alike) - other._worth(two & ~alike) > OBJECTIVE.max_marker

    def _worth(self, own: np.ndarray) -> float:
        """Log odds a frame of its names of some points (T, L), and of the markers that are not there."""
        named = (self.odds[own] - OBJECTIVE.max_marker + MARGINS.there).sum() / len(own)
        return float(named - MARGINS.there * len(self.model.markerset))

    def _called_as(self, other: MarkerSet) -> np.ndarray:
        """(M,) which marker of another set each marker is by its names, NO_MARKER for none."""
        own, known = self.model.markerset.by_name, other.by_name
        same = {own[name]: known[name] for name in own if name in known}
        return np.array([same.get(marker, NO_MARKER) for marker in range(len(self.there))])


def model_worn(
    take: Points, turns: dict[str, np.ndarray] | None, known: dict[Model, str], forced: bool = False
) -> Generator[Progress, None, tuple[str, str]]:
    """The name of the one of the known models that a take wears, and a note of that; else as `known_worn`.

    Raises JobError where several may be worn, or none is.
    """
    worn, likely = yield from known_worn(take, turns, known, forced)
    if worn is not None:
        return likely[worn], f"{likely[worn]} was found among {len(known)} marker sets"
    first, *others = names = list(likely.values())
    doubt = "" if others else ", but not surely"
    words = f"looks like a take of {' as well as '.join(names)}{doubt}"
    raise JobError(f"{words}; expected the one that is worn, {HOW_TO_CHOOSE} {first}")


def known_worn(
    take: Points, turns: dict[str, np.ndarray] | None, known: dict[Model, str], forced: bool = False
) -> Generator[Progress, None, tuple[Model | None, dict[Model, str]]]:
    """The known model that a take wears, None where that is not sure; and all that it may, with their names.

    turns are rotations as `misfit_of` has them, None for points that cameras traced: these are as they say. Raises
    JobError where there is no model, and ForceableError where the take cannot be as it says and is not `forced`.
    """
    learned = [model for model in known if model.likelihood is not None]
    if turns is not None and not forced:
        refuse_impossible(take.xyz, take.rate, take.lanes, learned)
    worn, likely = yield from set_worn(take, learned)
    if likely:
        return worn, {model: known[model] for model in likely}
    words = f"looks like a take of none of the {len(learned)} known marker sets"
    error = UnsuitedError(f"{words}; expected the one that is worn, {HOW_TO_FIND}")
    if turns is not None:
        error = yield from misfit_of(error, take, learned, PointOptions("likelihood"), turns, ())
    raise JobError(error.message)  # there is no model that could be forced


def set_worn(take: Points, models: Sequence[Model]) -> Generator[Progress, None, tuple[Model | None, list[Model]]]:
    """The one of the models, which have a likelihood, that is worn in a take, if that is sure; and all that may be.

    Of sets with the same markers the likeliest stands for all. None may be where the take would be refused with each.
    Raises JobError where there are no points, or too many.
    """
    part = middle_of(take)
    refuse_floods(part.xyz)
    own = _of_one_body(part.xyz[:], cut(part.xyz, part.rate, lanes=part.lanes))
    part = replace(part, xyz=np.where(own[..., None], part.xyz, np.nan))
    most, some = own.sum(axis=1).max(initial=0), part.in_order(evenly_spread(len(part.xyz), FRAMES_TRIED)).xyz
    if not most:
        raise JobError("shows too few points for a body; expected the markers of a subject")
    kinds: dict[frozenset[str], list[Model]] = {}
    for model in models:
        if most >= (1 - _may_lack(model, WORN.max_unfound)) * len(model.markerset):
            kinds.setdefault(frozenset(model.markerset.markers), []).append(model)
    tried = [max(alike, key=lambda one: worth_of(one, some)) if alike[1:] else alike[0] for alike in kinds.values()]
    tracklet, begun, share = cut(part.xyz, part.rate, lanes=part.lanes), [], 0.5 / max(len(tried), 1)
    with threadpool_limits(1, user_api="blas"):
        for number, model in enumerate(tried):
            work = in_stages(_begun(part, tracklet, model), begins(len(part.xyz)))
            with suppress(JobError):
                begun.append((yield from within(work, number * share, (number + 1) * share)))
        every = [one for one in begun if one is not None]
        first, found = _unbeaten(every), list[FittingSet]()
        for those in first, [one for one in every if one not in first]:
            for one in those:
                done, words = 0.5 + len(found) * share, f"try {one.model.markerset.name}"
                found.append((yield from within(_searched(one), done, done + share, words)))
            worn, likely = _worn(found)
            if worn is not None:
                break
    return worn, likely


def _worn(every: Sequence[FittingSet]) -> tuple[Model | None, list[Model]]:
    """The model of which the take surely is, None for none; and all of which it may be."""
    suiting, left = _suiting(every), _unbeaten(every)
    likely = [one for one in left if one in suiting]
    sure = len(left) == len(likely) == 1 and left[0].beside <= WORN.max_beside and left[0].absent <= WORN.max_absent
    if suiting and not likely:  # what beats them all lacks too many of its markers
        likely = [one for one in left if not one.refused] + suiting
    return left[0].model if sure else None, [one.model for one in likely]


def _unbeaten(every: Sequence[FittingSet]) -> list[FittingSet]:
    """Those that no other beats of those that suit."""
    suiting = _suiting(every)
    return [one for one in every if not any(other.beats(one) for other in suiting)]


def _suiting(every: Sequence[FittingSet]) -> list[FittingSet]:
    return [one for one in every if one.suits and not one.refused]


def _may_lack(model: Model, usual: float) -> float:
    """The part of its markers that a take in a model's set may lack, and `usual`ly does at most.

    Many of those by which one subject was shown standing are taken off for the motion.
    """
    return REFUSAL.min_half if model.of_one_subject else usual


def _begun(take: Points, tracklet: np.ndarray, model: Model) -> Steps[FittingSet | None]:
    """What a model makes of points with such tracklets (T, L) without a search, None if it lacks markers.

    JobError if frames refuse them.
    """
    frames = yield from name_frames(take, tracklet, model, PointOptions("likelihood", traced=True, search="none"))
    solution = finished(solution_for(frames, frames.labels, tracklet))
    if solution is not None:
        marker = solution.tracklets.spread(solution.marker, NO_MARKER, slice(None))
        if _there(marker, len(model.markerset)).mean() < 1 - _may_lack(model, WORN.max_unfound):
            return None
    return _fitting(model, frames, solution)


def _searched(begun: FittingSet) -> Steps[FittingSet]:
    """The same with a search; of a crowd, and of what cannot be solved as a whole, there is none."""
    if begun.solution is None or begun.solution.crowd:
        return begun
    frames = replace(begun.frames, search="all")
    return _fitting(begun.model, frames, (yield from solution_for(frames, frames.labels, frames.tracklet)))


def _fitting(model: Model, frames: NamedFrames, solution: Solution | None) -> FittingSet:
    """What a model makes of frames by their solution, None where they cannot be solved as a whole."""
    take, refused = frames.take, True
    labels = decided_of(frames, frames.labels, frames.tracklet, solution, USUAL_TARGET).labels
    with suppress(JobError):
        refuse_solved(frames, solution, labels)
        refused = False
    if solution is None:
        odds = np.full(frames.tracklet.shape, OBJECTIVE.max_marker)
        return FittingSet(model, frames, None, labels.marker, odds, 0.0, refused)
    tracklets, marker = solution.tracklets, solution.marker
    objective = Objective(take.xyz, tracklets, frames.labels, frames.model, take.rate)
    odds = objective.of(marker).odds * objective.weight / tracklets.count
    size, every = len(model.markerset), tracklets.spread(solution.every, NO_MARKER, slice(None))
    spread = tracklets.spread(marker, NO_MARKER, slice(None)), tracklets.spread(odds, 0.0, slice(None))
    beside = _there(every, size + solution.extras)[size:].sum() / size
    return FittingSet(model, frames, solution, *spread, beside, refused)


def _there(marker: np.ndarray, size: int) -> np.ndarray:
    """(M,) which of so many markers are among those of points, marker (T, L), half of the time."""
    count = np.bincount(marker[marker != NO_MARKER], minlength=size)
    return count >= REFUSAL.min_half * len(marker)


def _of_one_body(points: np.ndarray, tracklet: np.ndarray) -> np.ndarray:
    """(T, L) which of the points (T, L, 3) m, of such tracklets, are on the largest body, followed through the take."""
    own, known = np.zeros(tracklet.shape, dtype=bool), np.zeros(tracklet.max(initial=-1) + 2, dtype=bool)
    for frame, number in enumerate(tracklet):
        groups = far_groups(points[frame] * [1, 1, 0], MARKER_LIMITS.limb_m, 1)  # a hip may be farther above a knee
        if groups:
            own[frame] = max(groups, key=lambda group: known[number[group]].sum())
            known[number[own[frame]]] = True
    return own
