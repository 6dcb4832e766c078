# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories of a file cut into tracklets that are surely one marker's each, and the vote of every tracklet.

A column of a file may hold several trajectories one after the other, and a point may leap from one marker to another.
What frames said one by one of a tracklet's points becomes one name for as long as the point was followed, unless the
frames say for long enough that it went over to another marker; that is reported. No two tracklets have the same marker
at the same time.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise

import numpy as np

from ..data.takes import BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Suspect, Verdict, evenly_spread


@dataclass(frozen=True)
class CutOptions:
    """Where a trajectory may go on as another marker's. All reckoned.

    max_gap_s    without a point, beyond which a column may hold another trajectory
    max_speed    m/s; no marker moves faster
    min_nearest  part of the points to which their column's next is the nearest of the next frame, where columns are
                 trajectories: of people at 10 Hz it is two thirds, of points in any order one in as many as there are
    pairs        of frames that are looked at for that, spread over the take,
    min_steps    from one point of a column to the next that must be in them
    """

    max_gap_s: float = 0.5
    max_speed: float = 12.0
    min_nearest: float = 0.4
    pairs: int = 200
    min_steps: int = 100


@dataclass(frozen=True)
class VoteOptions:
    """How tracklets vote. All reckoned.

    max_frame_log_odds   that one frame can say: beyond it a frame's calibration knows nothing
    ghost_log_odds       that a frame without a name says for a ghost
    frame_weight         part of an independent frame that a frame is worth: neighbours err together
    swap_cost            log odds that a tracklet must speak for another name before it is believed to have swapped
    min_part             of a tracklet's frames that a name must have to be considered, unless it can pay for a swap
    min_majority         of what was said, for the name that wins
    max_overlap_frames   that two tracklets of one marker may share: trackers end one late and start the other early
    max_log_odds         that a vote is sure
    window_frames        that vote together, so that memory does not grow with the take
    min_length_frames    of the usual tracklet; shorter ones have nothing to vote about
    """

    max_frame_log_odds: float = 4.0
    ghost_log_odds: float = 1.0
    frame_weight: float = 0.1
    swap_cost: float = 10.0
    min_part: float = 0.05
    min_majority: float = 0.5
    max_overlap_frames: int = 2
    max_log_odds: float = 30.0
    window_frames: int = 2048
    min_length_frames: int = 5


CUTTING = CutOptions()
VOTE = VoteOptions()


def cut(points: np.ndarray, rate: float, options: CutOptions = CUTTING) -> np.ndarray:
    """(T, P) the number of the tracklet that each point (T, P, 3) m belongs to, -1 where there is none.

    Where columns are no trajectories at all, points being in any order, every point is on its own.
    """
    present = np.isfinite(points).all(axis=2)
    tracklet = np.full(present.shape, -1)
    if not _are_trajectories(points, present, options):
        tracklet[present] = np.arange(present.sum())
        return tracklet
    count = 0
    for column in range(points.shape[1]):
        frames = np.flatnonzero(present[:, column])
        if not len(frames):
            continue
        gap = np.diff(frames)
        step = np.linalg.norm(np.diff(points[frames, column], axis=0), axis=1)
        ends = (gap > options.max_gap_s * rate) | (step > options.max_speed / rate * gap)
        tracklet[frames, column] = count + np.concatenate([[0], np.cumsum(ends)])
        count = int(tracklet[frames[-1], column]) + 1
    return tracklet


def _are_trajectories(points: np.ndarray, present: np.ndarray, options: CutOptions) -> bool:
    """Whether the columns of points (T, P, 3) m, present (T, P), follow anything, as far as can be known."""
    nearest = steps = 0
    for frame in evenly_spread(max(len(points) - 1, 0), options.pairs):
        before, after = np.flatnonzero(present[frame]), np.flatnonzero(present[frame + 1])
        before = before[present[frame + 1, before]]
        if len(before):
            distance = np.linalg.norm(points[frame, before, None] - points[frame + 1, after], axis=2)
            nearest += int((after[distance.argmin(axis=1)] == before).sum())
            steps += len(before)
    return steps < options.min_steps or nearest >= options.min_nearest * steps


def vote_tracklets(
    labels: Labels, tracklet: np.ndarray, names: Sequence[str], first_frame: int = 0, options: VoteOptions = VOTE
) -> Verdict:
    """One name for each tracklet, or part of one that swapped; frames as they are where tracklets are too short.

    labels and tracklet are (T, P); names the M markers; first_frame the source's number of the first frame.
    """
    if not are_lasting(tracklet, options):
        return Verdict(labels)
    voted, sure = np.full(labels.marker.shape, NO_MARKER), np.zeros(labels.marker.shape)
    suspects: list[Suspect] = []
    size = options.window_frames
    edges = [*range(0, max(len(voted) - size // 2, 1), size), len(voted)]
    for first, after in pairwise(edges):
        frames = slice(first, after)
        part = _vote_window(labels[frames], tracklet[frames], names, first_frame + first, options)
        voted[frames], sure[frames] = part.labels.marker, part.labels.confidence
        suspects += part.suspects
        suspects += _gone_over(voted, tracklet, first, names, first_frame)
    step = np.where(voted == NO_MARKER, NO_STEP, BY_TRAJECTORY)
    return Verdict(Labels(voted, step, sure), tuple(sorted(suspects, key=lambda suspect: suspect.first)))


def are_lasting(tracklet: np.ndarray, options: VoteOptions = VOTE) -> bool:
    """Whether the usual point is on a tracklet (T, P) long enough to go by; not so where frames are in no order."""
    lengths = np.bincount(tracklet[tracklet >= 0]) if (tracklet >= 0).any() else np.zeros(0, int)
    return len(lengths) > 0 and bool(np.median(np.repeat(lengths, lengths)) >= options.min_length_frames)


def frame_log_odds(confidence: np.ndarray, options: VoteOptions = VOTE) -> np.ndarray:
    """Log odds that frames on their own say for names of such confidence."""
    odds = np.log(np.maximum(confidence, 1e-6) / np.maximum(1 - confidence, 1e-6))
    return np.clip(odds, 0, options.max_frame_log_odds)


def gone_over(last: int, first: int, before: str, after: str, column: int) -> Suspect:
    """That a trajectory is one marker's up to the frame `last`, and another's from `first` on."""
    return Suspect(last, first, f"goes over from {before} to {after}", column, (before, after))


def _gone_over(marker, tracklet, frame: int, names: Sequence[str], first_frame: int) -> list[Suspect]:
    """Tracklets that two windows, of which the second begins at `frame`, gave two names."""
    if frame == 0:
        return []
    before, after = marker[frame - 1], marker[frame]
    changed = (
        (tracklet[frame - 1] == tracklet[frame]) & (before != after) & (before != NO_MARKER) & (after != NO_MARKER)
    )
    at = frame + first_frame
    return [
        gone_over(at - 1, at, names[before[column]], names[after[column]], column)
        for column in np.flatnonzero(changed).tolist()
    ]


def renamed(
    marker: np.ndarray, tracklet: np.ndarray, names: Sequence[str], first_frame: int = 0
) -> tuple[Suspect, ...]:
    """Where a column goes on with another name behind a gap or a leap: its trajectory was not one marker's.

    marker and tracklet are (T, P), `names` the M markers' and `first_frame` the source's number of the first frame.
    """
    found = []
    for column in range(marker.shape[1]):
        frames = np.flatnonzero(marker[:, column] != NO_MARKER)
        own, part = marker[frames, column], tracklet[frames, column]
        for at in np.flatnonzero((np.diff(own) != 0) & (np.diff(part) != 0)):
            pair = names[own[at]], names[own[at + 1]]
            words = f"is {pair[0]} and, behind a gap or a leap, {pair[1]}"
            last, first = int(frames[at]) + first_frame, int(frames[at + 1]) + first_frame
            found.append(Suspect(last, first, words, column, pair))
    return tuple(found)


def _vote_window(
    labels: Labels, tracklet: np.ndarray, names: Sequence[str], first_frame: int, options: VoteOptions
) -> Verdict:
    """The same for a few frames: every tracklet a column of its own."""
    frame, column = np.nonzero(tracklet >= 0)
    number, place = np.unique(tracklet[frame, column], return_inverse=True)
    present = np.zeros((len(tracklet), len(number)), bool)
    present[frame, place] = True
    said = Labels.none(*present.shape)
    said.marker[frame, place] = labels.marker[frame, column]
    said.confidence[frame, place] = labels.confidence[frame, column]
    owner = np.zeros(len(number), int)
    owner[place] = column
    result = vote(said.marker, said.confidence, present, names, first_frame, options)
    voted = Labels.none(*labels.marker.shape)
    voted.marker[frame, column] = result.labels.marker[frame, place]
    voted.confidence[frame, column] = result.labels.confidence[frame, place]
    # Every suspect of a vote is about one tracklet; a person knows it by the column of the file.
    return Verdict(voted, tuple(replace(one, trajectory=int(owner[one.trajectory])) for one in result.suspects))


@dataclass(frozen=True, eq=False)
class Stretch:
    """A run of frames of one tracklet that has one name.

    point, first, last  the tracklet's column and its first and last frame, both included, 0-based
    said                (M,) log odds added up over its frames; silent, the same for no name
    """

    point: int
    first: int
    last: int
    said: np.ndarray
    silent: float


def vote(
    marker, confidence, present, names: Sequence[str], first_frame: int = 0, options: VoteOptions = VOTE
) -> Verdict:
    """One name for each tracklet, a column each, or for each part of one that swapped.

    marker (T, P) and confidence (T, P) are what frames said on their own, present (T, P) where a tracklet has a
    point, names the M markers and first_frame the source's number of the first frame.
    """
    weight = frame_log_odds(confidence, options)
    stretches = [
        stretch
        for point in range(marker.shape[1])
        for stretch in _stretches(point, marker[:, point], weight[:, point], present[:, point], len(names), options)
    ]
    given = _given(stretches, present, len(names), options)
    voted = np.full(marker.shape, NO_MARKER)
    sure = np.zeros(marker.shape)
    for stretch, (name, chance) in zip(stretches, given, strict=True):
        if name != NO_MARKER:
            frames = slice(stretch.first, stretch.last + 1)
            here = present[frames, stretch.point]
            voted[frames, stretch.point] = np.where(here, name, NO_MARKER)
            sure[frames, stretch.point] = np.where(here, chance, 0)
    suspects = _swaps(stretches, given, names, first_frame)
    suspects += _doubts(stretches, given, names, first_frame, options.max_frame_log_odds)
    step = np.where(voted == NO_MARKER, NO_STEP, BY_TRAJECTORY)
    return Verdict(Labels(voted, step, sure), tuple(sorted(suspects, key=lambda suspect: suspect.first)))


def _stretches(point: int, marker, weight, present, markers: int, options: VoteOptions) -> list[Stretch]:
    """The tracklet cut where it went over to another marker."""
    frames = np.flatnonzero(present)
    if not len(frames):
        return []
    said, worth = marker[frames], weight[frames]
    counts = np.bincount(said[said >= 0], minlength=markers)
    paid = np.bincount(said[said >= 0], weights=worth[said >= 0], minlength=markers) * options.frame_weight
    candidates = np.flatnonzero((counts > options.min_part * len(frames)) | (paid > options.swap_cost))
    state = np.zeros(len(frames), dtype=int)
    if len(candidates) > 1:
        gain = np.where(said[:, None] == candidates, worth[:, None], 0) * options.frame_weight
        state = _most_likely(gain, options.swap_cost)
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(state)) + 1, [len(frames)]])
    made = []
    for first, after in pairwise(cuts):
        own, how = said[first:after], worth[first:after]
        total = np.bincount(own[own >= 0], weights=how[own >= 0], minlength=markers)
        silent = options.ghost_log_odds * float((own < 0).sum())
        made.append(Stretch(point, int(frames[first]), int(frames[after - 1]), total, silent))
    return made


def _most_likely(gain: np.ndarray, cost: float) -> np.ndarray:
    """(T,) the sequence of states of highest total gain (T, K) when every change costs so much (Viterbi's)."""
    frames, states = gain.shape
    best = gain[0].copy()
    origin = np.zeros((frames, states), dtype=int)
    for frame in range(1, frames):
        leader = int(best.argmax())
        moved = best[leader] - cost > best
        origin[frame] = np.where(moved, leader, np.arange(states))
        best = np.where(moved, best[leader] - cost, best) + gain[frame]
    path = np.empty(frames, dtype=int)
    path[-1] = best.argmax()
    for frame in range(frames - 1, 0, -1):
        path[frame - 1] = origin[frame, path[frame]]
    return path


def _given(
    stretches: list[Stretch], present: np.ndarray, markers: int, options: VoteOptions
) -> list[tuple[int, float]]:
    """The marker and chance of every stretch: who has most to say chooses first, and nobody takes what is taken."""
    busy = np.zeros((markers, len(present)), dtype=bool)
    given: list[tuple[int, float]] = [(NO_MARKER, 0.0)] * len(stretches)
    waiting = sorted(range(len(stretches)), key=lambda index: -stretches[index].said.max(initial=0))
    for index in waiting:
        stretch = stretches[index]
        frames = slice(stretch.first, stretch.last + 1)
        here = present[frames, stretch.point]
        allowed = (busy[:, frames] & here).sum(axis=1) <= options.max_overlap_frames
        free = np.where(allowed, stretch.said, 0)
        best = int(free.argmax())
        rest = stretch.said.sum() - stretch.said[best] + stretch.silent
        if free[best] > options.min_majority * (free[best] + rest):
            lead = (free[best] - rest) * options.frame_weight
            given[index] = (best, float(1 / (1 + np.exp(-min(lead, options.max_log_odds)))))
            busy[best, frames] |= here
    return given


def _swaps(stretches, given, names, first_frame) -> list[Suspect]:
    """Tracklets that went over from one marker to another."""
    suspects = []
    for (before, (old, _)), (after, (new, _)) in pairwise(zip(stretches, given, strict=True)):
        if before.point == after.point and NO_MARKER not in (old, new) and old != new:
            last, first = before.last + first_frame, after.first + first_frame
            suspects.append(gone_over(last, first, names[old], names[new], before.point))
    return suspects


def _doubts(stretches, given, names, first_frame, least: float) -> list[Suspect]:
    """Tracklets that frames named often and for which no name won."""
    suspects = []
    for stretch, (name, _) in zip(stretches, given, strict=True):
        order = np.argsort(-stretch.said)[:2]
        if name == NO_MARKER and stretch.said[order[0]] > stretch.silent and stretch.said[order[0]] > least:
            likely = tuple(names[marker] for marker in order if stretch.said[marker] > 0)
            words = f"may be {' or '.join(likely)} and stays unnamed"
            first, last = stretch.first + first_frame, stretch.last + first_frame
            suspects.append(Suspect(first, last, words, stretch.point, likely))
    return suspects
