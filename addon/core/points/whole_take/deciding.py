# SPDX-License-Identifier: GPL-3.0-or-later
"""From what is known of tracklets to the labels of points, and what a person should look at.

The solution of a whole take says it; where there is none, tracklets vote by what frames say one by one.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Self

import numpy as np

from ...data.lanes import PACKING, Lanes, blocks, trajectories_at
from ...data.made import IN_MEMORY, MakeTable
from ...data.takes import BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Suspect, Verdict
from ...review.suspects import EITHER_WAY, NOT_TOLD
from ..likelihood.model import chance
from ..models import Model
from ..tracklets import VOTE, are_lasting, gone_over, gone_over_between, vote
from .layout import Question
from .objective import OBJECTIVE
from .solution import Solution
from .tracklets import FrameLabels


class DECIDING:
    """What is sure enough to be said."""

    # of the log odds of a target, that a tracklet's name must be ahead of any other by a solution; with half names of
    # 2 % of people of other labs are wrong, with twice they lose 6 %
    odds_of_target: float = 0.6  # measured


@dataclass(frozen=True, eq=False)
class Votes:
    """What the tracklets (T, L) of a take were voted, window by window, and what a person should look at."""

    marker: np.ndarray  # (T, L)
    # the frames of each window, with how sure its votes are: the different values (K,) and which of them each is (F,
    # L), as there are few; where there are many the values are None, and these (F, L) are it
    windows: list[tuple[slice, np.ndarray | None, np.ndarray]]
    suspects: tuple[Suspect, ...]

    @classmethod
    def of(cls, named: FrameLabels, tracklet: np.ndarray, names: Sequence[str], first_frame: int) -> Self:
        """The votes of what frames of tracklets (T, L) say on their own; the same where they are too short to vote."""
        if not are_lasting(tracklet):
            labels = named.whole()
            return cls(labels.marker, [(slice(0, len(tracklet)), None, labels.confidence)], ())
        found = cls(np.full(tracklet.shape, NO_MARKER, np.int16), [], ())
        suspects: list[Suspect] = []
        size = VOTE.window_frames
        edges = [*range(0, max(len(tracklet) - size // 2, 1), size), len(tracklet)]
        for first, after in pairwise(edges):
            frames, border = slice(first, after), slice(first - 1, first + 1)
            part = vote(named[frames], tracklet[frames], names, first_frame + first)
            found.marker[frames] = part.labels.marker
            found.windows.append((frames, *_few(part.labels.confidence, tracklet.size)))
            suspects += part.suspects
            if first:
                suspects += gone_over_between(found.marker[border], tracklet[border], first + first_frame, names)
        return replace(found, suspects=tuple(sorted(suspects, key=lambda suspect: suspect.first)))

    def how_sure(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Some frames at a time, and how sure their votes are (F, L)."""
        for frames, values, which in self.windows:
            for own in blocks(*which.shape):
                part = slice(frames.start + own.start, frames.start + own.stop)
                yield part, which[own].copy() if values is None else values[which[own]]


def _few(values: np.ndarray, cells: int) -> tuple[np.ndarray | None, np.ndarray]:
    """Values (F, L) as `Votes` keeps them: of a table of so many cells, where it is large and they are few, narrow."""
    if cells <= PACKING.whole_cells:
        return None, values
    some, which = np.unique(values, return_inverse=True)
    if len(some) > np.iinfo(np.uint16).max:
        return None, values
    return some, which.reshape(values.shape).astype(np.uint16)


def decide(
    named: FrameLabels, tracklet: np.ndarray, model: Model, target: float, first_frame: int, lanes: Lanes | None = None
) -> Verdict:
    """Lets the tracklets (T, P) vote and keeps what is sure enough that a part `target` of it is right.

    named are the labels (T, P) of frames on their own, with their `rate`. Where the vote says what the frame said, the
    frame's own step stays.
    """
    votes = Votes.of(named, tracklet, model.markerset.markers, first_frame)
    decided = Labels.none(*tracklet.shape)
    for part, sure in votes.how_sure():
        own, marker = named[part], votes.marker[part].copy()
        enough, alone = sure >= target, marker == own.marker
        np.maximum(sure, own.confidence, out=sure, where=alone)
        step = np.where(alone, own.step, BY_TRAJECTORY)
        marker[~(enough | (alone & (own.sure(target) != NO_MARKER)))] = NO_MARKER
        marker = once(marker, sure, len(model.markerset), lanes, part.start)
        nothing = marker == NO_MARKER
        step[nothing], sure[nothing] = NO_STEP, 0.0
        decided.marker[part], decided.step[part], decided.confidence[part] = marker, step, sure
    return Verdict(decided, votes.suspects)


def once(marker: np.ndarray, sure: np.ndarray, markers: int, lanes: Lanes | None = None, start: int = 0) -> np.ndarray:
    """Labels (T, L) of which each frame has every marker once: the surest, of equals the first in the file.

    They begin with the frame `start` of the take.
    """
    kept = marker.copy()
    for part in blocks(*marker.shape):
        frame, lane = np.nonzero(marker[part] != NO_MARKER)
        key = frame * markers + marker[part][frame, lane]
        more = np.flatnonzero(np.bincount(key)[key] > 1)
        frame, lane, key = frame[more] + part.start, lane[more], key[more]
        number = trajectories_at(lanes, frame + start, lane)
        order = np.lexsort((number, -sure[frame, lane], key))
        again = order[1:][np.diff(key[order]) == 0]
        kept[frame[again], lane[again]] = NO_MARKER
    return kept


def can_be_solved(model: Model, tracklet: np.ndarray) -> bool:
    """Whether a take with tracklets (T, P) is solved as a whole; a set on rigid bodies is known by these."""
    if model.likelihood is None or model.rigid_bodies is not None or len(model.markerset) < OBJECTIVE.min_seen:
        return False
    return are_lasting(tracklet)


def verdict_of(
    solution: Solution | None,
    named: FrameLabels,
    tracklet: np.ndarray,
    model: Model,
    target: float,
    first_frame: int,
    lanes: Lanes | None = None,
    make_table: MakeTable = IN_MEMORY,
) -> Verdict:
    """What is sure enough for the target: by the solution, else by the tracklets (T, L)."""
    if solution is not None:
        return labels_of(solution, named, target, model.markerset.markers, first_frame, lanes, make_table)
    return decide(named, tracklet, model, target, first_frame, lanes)


def labels_of(
    solution: Solution,
    named: FrameLabels,
    target: float,
    names: Sequence[str],
    first_frame: int = 0,
    lanes: Lanes | None = None,
    make_table: MakeTable = IN_MEMORY,
) -> Verdict:
    """What a solution says of all points, sure enough that a part `target` of it is right.

    named (T, L) is what frames say on their own, names the M markers', first_frame the source's number of the first;
    `make_table` says where confidences are kept.
    """
    tracklets, believed = solution.tracklets, _believed(solution, target, len(names))
    of_tracklet = chance(solution.margin)
    shape = tracklets.table.shape
    marker, step = np.empty(shape, np.int16), np.empty(shape, np.int8)
    labels = Labels(marker, step, make_table(shape, float))
    for part in blocks(*tracklets.table.shape):
        given, sure = tracklets.spread(believed, NO_MARKER, part), tracklets.spread(of_tracklet, 0.0, part)
        given, own = once(given, sure, len(names), lanes, part.start), named[part]
        given[_by_itself(solution, given, part)] = NO_MARKER
        there, alone = given != NO_MARKER, (given == own.marker) & (given != NO_MARKER)
        labels.marker[part] = given
        labels.step[part] = np.where(there, np.where(alone, own.step, BY_TRAJECTORY), NO_STEP)
        labels.confidence[part] = np.where(there, np.where(alone, np.maximum(sure, own.confidence), sure), 0.0)
    # What stays unsure whatever is answered is unnamed, and no question.
    asked = [one for one in _asked(solution, target) if one.answered >= least_margin(target)]
    suspects = _questions(solution, asked, names, first_frame)
    suspects += _gone_over(solution, believed, names, first_frame, lanes)
    about = {name for one in asked for name in (one.one, one.other)}
    return Verdict(labels, suspects + _unnamed(solution, believed, names, first_frame, about))


def _by_itself(solution: Solution, given: np.ndarray, part: slice) -> np.ndarray:
    """(F, L) True for names given in some frames where none of the nearest markers is there: who has left, has left.

    Without it, of somebody who returns to cameras 1 % of the names are wrong.
    """
    if solution.near is None:
        return np.zeros(given.shape, bool)
    named = solution.tracklets.spread(solution.marker, NO_MARKER, part)
    there = np.zeros((len(given), len(solution.near)), bool)
    frame, lane = np.nonzero(named != NO_MARKER)
    there[frame, named[frame, lane]] = True
    beside = there[:, solution.near].any(axis=2)
    held = solution.tracklets.spread(solution.tracklets.held, NO_MARKER, part) != NO_MARKER
    return (given != NO_MARKER) & ~held & ~np.take_along_axis(beside, np.maximum(given, 0), axis=1)


def _believed(solution: Solution, target: float, markers: int) -> np.ndarray:
    """(N,) the markers of the tracklets that are sure enough."""
    believed = np.where(solution.margin >= least_margin(target), solution.marker, NO_MARKER)
    doubted = np.zeros(markers, dtype=bool)
    for question in _asked(solution, target):
        doubted[[name for name in (question.one, question.other) if name < markers]] = True
    believed[np.append(doubted, False)[believed]] = NO_MARKER
    return believed


def least_margin(target: float) -> float:
    """Log odds by which a tracklet's name must be ahead of any other for the target."""
    return DECIDING.odds_of_target * float(np.log(target / (1 - target)))


def _asked(solution: Solution, target: float) -> list[Question]:
    """What holds for all of the take, is not sure enough for the target, and only a person can tell.

    Limbs are exchanged whole, with markers that nothing is on either side: of two such there is nothing to ask.
    """
    there = np.isin([(one.one, one.other) for one in solution.questions], solution.marker).reshape(-1, 2).any(axis=1)
    every = zip(solution.questions, there, strict=True)
    return [one for one, seen in every if seen and one.odds < least_margin(target)]


def _questions(solution: Solution, asked: list[Question], names: Sequence[str], first: int) -> tuple[Suspect, ...]:
    """What is asked, once for all of the take from the frame `first` on; of a marker, on its longest trajectory.

    Neither of the two has a name (`_believed`), so there is nothing to swap.
    """
    questions, tracklets = {}, solution.tracklets
    for question in asked:
        pair = tuple(names[name] for name in (question.one, question.other) if name < len(names))
        span, lane, words = (0, len(tracklets.table) - 1), None, words_of_pair(pair)
        if len(pair) == 1:
            longest = np.where(solution.marker == question.one, tracklets.count, 0).argmax()
            span, lane = (int(tracklets.first[longest]), int(tracklets.last[longest])), int(tracklets.lane[longest])
            words = f"another marker sits where {pair[0]} may be: look which of the two it is"
        questions[frozenset(pair)] = Suspect(span[0] + first, span[1] + first, words, lane, pair)
    return tuple(questions.values())


def words_of_pair(pair: Sequence[str], named: bool = False) -> str:
    """What is said of two markers that may be each other in all of the take, also after a person `named` blobs so."""
    who = " and ".join(pair)
    if named:
        return f"{who}: the blobs that were named {NOT_TOLD}: each stays unnamed"
    return f"{who} {EITHER_WAY} in the whole take: each stays unnamed"


def pairs_in_doubt(solution: Solution, columns: int, target: float) -> list[tuple[int, int]]:
    """The markers of which a solution doubts which is which, where its first columns are the M markers by their names.

    Columns that are another marker for most of the time, and what is asked for the target. Where the solution gives the
    same names, two have said so, whose log odds add up: half are enough.
    """
    asked = [one for one in _asked(solution, target) if one.odds < least_margin(target) / 2]
    pairs = [(one.one, one.other) for one in asked if max(one.one, one.other) < columns]
    tracklets, count = solution.tracklets, np.zeros((columns, columns))
    own = tracklets.lane < columns
    some = own & (solution.marker != NO_MARKER)
    np.add.at(count, (tracklets.lane[some], solution.marker[some]), tracklets.count[some])
    there = np.bincount(tracklets.lane[own], tracklets.count[own], columns)
    pairs += [(int(one), int(count[one].argmax())) for one in np.flatnonzero(2 * count.max(axis=1) > there)]
    return sorted({(min(pair), max(pair)) for pair in pairs if pair[0] != pair[1]})


def _gone_over(
    solution: Solution, believed: np.ndarray, names: Sequence[str], first_frame: int, lanes: Lanes | None
) -> tuple[Suspect, ...]:
    """Trajectories that are one marker's and then, without a gap, another's."""
    tracklets, found = solution.tracklets, []
    column = tracklets.lane
    number = trajectories_at(lanes, tracklets.first, column)
    order = np.lexsort((tracklets.first, number))
    for one, other in pairwise(order.tolist()):
        old, new = believed[one], believed[other]
        joined = number[one] == number[other] and tracklets.first[other] == tracklets.last[one] + 1
        if joined and NO_MARKER not in (old, new) and old != new:
            last, first = int(tracklets.last[one]) + first_frame, int(tracklets.first[other]) + first_frame
            found.append(gone_over(last, first, names[old], names[new], int(column[one])))
    return tuple(found)


def _unnamed(
    solution: Solution, believed: np.ndarray, names: Sequence[str], first_frame: int, asked: set[int]
) -> tuple[Suspect, ...]:
    """Tracklets that are likely a marker, and not surely, but one that is `asked` about in all of the take."""
    tracklets, found = solution.tracklets, []
    for index in np.flatnonzero((believed == NO_MARKER) & ~np.isin(solution.likely, [NO_MARKER, *asked])).tolist():
        beside = (tracklets.first <= tracklets.last[index]) & (tracklets.last >= tracklets.first[index])
        if (beside & (believed == solution.likely[index])).any():
            continue  # that marker is another at the time
        name = names[solution.likely[index]]
        words = f"may be {name} and stays unnamed"
        first, last = int(tracklets.first[index]), int(tracklets.last[index])
        column = int(tracklets.lane[index])
        found.append(Suspect(first + first_frame, last + first_frame, words, column, (name,)))
    return tuple(found)
