# SPDX-License-Identifier: GPL-3.0-or-later
"""From the solution of a whole take to the labels of its points, and what a person should look at."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ...data.takes import BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Suspect, Verdict
from ..deciding import consistent, decide, once
from ..likelihood.calibration import chance
from ..models import Model
from ..tracklets import VOTE, are_lasting, gone_over
from .layout import Question
from .rulings import Rulings
from .solving import ROUNDS, Solution, solve_take


@dataclass(frozen=True)
class BelievingOptions:
    """What of a solution is said. Reckoned, with an eye on people and motions left out of training.

    sure_target      part of the frames' and their tracklets' labels that is right, of those that are begun with
    odds_of_target   of the log odds of a target, that a tracklet's name must be ahead of any other; and
    least            at least,
    max_target       beyond which nothing is promised of a take as a whole: frames must be as sure on their own
    votes            log odds that frames on their own add to those of two names, if all of them agree; of which,
    layout_of_target of the log odds of a target, below which neither of two markers is named that may have each
                     other's names
    max_question     log odds below which a person is asked
    """

    sure_target: float = 0.999
    odds_of_target: float = 0.6
    least: float = 2.0
    max_target: float = 0.9999
    votes: float = 2.0
    layout_of_target: float = 0.362
    max_question: float = 3.0


BELIEVING = BelievingOptions()


def can_be_solved(model: Model, tracklet: np.ndarray) -> bool:
    """Whether a take with tracklets (T, P) is solved as a whole; a set on rigid bodies is known by these."""
    if model.likelihood is None or model.rigid_bodies is not None or len(model.markerset) < ROUNDS.min_markers:
        return False
    return are_lasting(tracklet)


def solution_of(
    named: Labels,
    tracklet: np.ndarray,
    points: np.ndarray,
    model: Model,
    rate: float,
    first_frame: int,
    progress: Callable[[float], None] | None = None,
    rulings: Rulings | None = None,
) -> Solution:
    """A take of points (T, P, 3) m solved as a whole, from what its tracklets (T, P) and frames are usually sure of.

    named is what frames say on their own, with their `rate`. With `rulings` both are as these have them, and what the
    take was solved to without them is begun with.
    """
    voted = decide(named, tracklet, model, BELIEVING.sure_target, first_frame)
    kept = consistent(voted, points, model.likelihood, first_frame).labels.marker
    sure = kept if rulings is None else rulings.start
    tracklet = parted(tracklet, voted.labels.marker)
    return solve_take(points, tracklet, named, sure, model, rate, progress, rulings)


def parted(tracklet: np.ndarray, voted: np.ndarray) -> np.ndarray:
    """Tracklets (T, P), cut where by the votes of frames (T, P) they go over from one marker to another."""
    found = tracklet.copy()
    count = int(tracklet.max(initial=-1)) + 1
    for column in range(tracklet.shape[1]):
        own, said = tracklet[:, column], voted[:, column]
        frames = np.flatnonzero((said != NO_MARKER) & (own >= 0))
        for after in frames[1:][(np.diff(own[frames]) == 0) & (np.diff(said[frames]) != 0)].tolist():
            found[after:, column][own[after:] == own[after]] = count
            count += 1
    return found


def verdict_of(
    solution: Solution | None,
    named: Labels,
    tracklet: np.ndarray,
    points: np.ndarray,
    model: Model,
    target: float,
    first_frame: int,
) -> Verdict:
    """What is sure enough for the target: by the solution, else by the tracklets (T, P) and what contradicts them."""
    if solution is not None:
        return labels_of(solution, named, target, model.markerset.markers, first_frame)
    verdict = decide(named, tracklet, model, target, first_frame)
    return consistent(verdict, points, model.likelihood, first_frame)


def labels_of(solution: Solution, named: Labels, target: float, names: Sequence[str], first_frame: int = 0) -> Verdict:
    """What a solution says of all points, sure enough that a part `target` of it is right.

    named (T, P) is what frames say on their own, names the M markers', first_frame the source's number of the first.
    """
    tracklets, believed = solution.tracklets, _believed(solution, target, len(names))
    marker = tracklets.spread(believed, named.marker.shape)
    sure = np.zeros(named.marker.shape)
    sure[tracklets.row, tracklets.column] = chance(np.minimum(solution.margin, VOTE.max_log_odds))[tracklets.owner]
    marker = once(marker, sure, len(names))
    if target > BELIEVING.max_target:
        marker = np.where((marker == named.marker) & (named.rate >= target), marker, NO_MARKER)
    alone = (marker == named.marker) & (marker != NO_MARKER)
    sure = np.where(alone, np.maximum(sure, named.confidence), sure)
    step = np.where(alone, named.step, BY_TRAJECTORY)
    given = marker != NO_MARKER
    labels = Labels(marker, np.where(given, step, NO_STEP), np.where(given, sure, 0.0))
    suspects = _gone_over(solution, believed, names, first_frame) + _unnamed(solution, believed, names, first_frame)
    return Verdict(labels, _questions(solution, names, len(named.marker), first_frame) + suspects)


def _believed(solution: Solution, target: float, markers: int) -> np.ndarray:
    """(N,) the markers of the tracklets that are sure enough."""
    asked = float(np.log(target / (1 - target)))
    needed = max(BELIEVING.odds_of_target * asked, BELIEVING.least)
    believed = np.where(solution.margin >= needed, solution.marker, NO_MARKER)
    least = BELIEVING.layout_of_target * asked
    for question in solution.questions:
        agreement = 0.0 if question.shifted else _agreement(solution, question) if question.other < markers else np.inf
        if question.odds + agreement < least:
            doubted = [name for name in (question.one, question.other) if name < markers]
            believed[np.isin(believed, doubted)] = NO_MARKER
    return believed


def _agreement(solution: Solution, question: Question) -> float:
    """Log odds that frames on their own add to the names of two markers, if all of them say so."""
    one, other = question.one, question.other
    of_one, of_other = (solution.tracklets.votes[solution.marker == name].sum(axis=0) for name in (one, other))
    as_named, exchanged = float(of_one[one] + of_other[other]), float(of_one[other] + of_other[one])
    return BELIEVING.votes * (as_named - exchanged) / max(as_named + exchanged, 1.0)


def _questions(solution: Solution, names: Sequence[str], frames: int, first_frame: int) -> tuple[Suspect, ...]:
    """What holds for all of the take, and only a person can tell."""
    said = {}
    for question in solution.questions:
        if question.odds < BELIEVING.max_question:
            one = names[question.one]
            if question.other < len(names):
                pair = one, names[question.other]
                words = f"{one} and {pair[1]} may have each other's names in the whole take"
            else:
                pair = (one,)
                words = f"another marker sits where {one} may be: look which of the two it is"
            said[words] = Suspect(first_frame, first_frame + frames - 1, words, markers=pair)
    return tuple(said.values())


def _gone_over(solution: Solution, believed: np.ndarray, names: Sequence[str], first_frame: int) -> tuple[Suspect, ...]:
    """Trajectories that are one marker's and then, without a gap, another's."""
    tracklets, found = solution.tracklets, []
    column = tracklets.column[tracklets.begin[:-1]]
    order = np.lexsort((tracklets.first, column))
    for one, other in pairwise(order.tolist()):
        old, new = believed[one], believed[other]
        joined = column[one] == column[other] and tracklets.first[other] == tracklets.last[one] + 1
        if joined and NO_MARKER not in (old, new) and old != new:
            last, first = int(tracklets.last[one]) + first_frame, int(tracklets.first[other]) + first_frame
            found.append(gone_over(last, first, names[old], names[new], int(column[one])))
    return tuple(found)


def _unnamed(solution: Solution, believed: np.ndarray, names: Sequence[str], first_frame: int) -> tuple[Suspect, ...]:
    """Tracklets that are likely a marker, and not surely."""
    tracklets, found = solution.tracklets, []
    for index in np.flatnonzero((believed == NO_MARKER) & (solution.likely != NO_MARKER)).tolist():
        name = names[solution.likely[index]]
        words = f"may be {name} and stays unnamed"
        first, last = int(tracklets.first[index]), int(tracklets.last[index])
        column = int(tracklets.column[tracklets.begin[index]])
        found.append(Suspect(first + first_frame, last + first_frame, words, column, (name,)))
    return tuple(found)
