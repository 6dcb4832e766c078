# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories of a file cut into tracklets that are surely one marker's each, and the vote of every tracklet.

A trajectory of a file may be several markers' one after the other, and a point may leap from one marker to another.
What frames said one by one of a tracklet's points becomes one name for as long as the point was followed, unless the
frames say for long enough that it went over to another marker; that is reported. No two tracklets have the same marker
at the same time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..data.lanes import PACKING, Lanes, blocks, standing_in, trajectories_at
from ..data.made import Table
from ..data.physical import MARKER_LIMITS
from ..data.takes import BY_TRAJECTORY, NO_MARKER, Labels, Suspect, Verdict, evenly_spread, there_in
from .likelihood.model import chance


class CUTTING:
    """Where a trajectory may go on as another marker's."""

    # s without a point, half a stride: a whole limb has moved on, and another marker may be in its place
    max_gap_s: float = 0.5  # physical
    # part of the points to which their column's next is the nearest of the next frame, where columns are trajectories:
    # two thirds of people at 10 Hz; of points in any order one in as many as there are, and half where only two frames
    # at a time follow each other
    min_nearest: float = 0.6  # measured


class VOTE:
    """How tracklets vote."""

    # that one frame can say, beyond which its calibration knows nothing; half or twice as much changes no label of
    # plates
    max_frame_log_odds: float = 4.0  # measured
    ghost_log_odds: float = 1.0  # measured: that a frame without a name says for a ghost; nor does this
    # part of an independent frame that a frame is worth, as neighbours err together; nor does this
    frame_weight: float = 0.1  # measured
    # log odds that a tracklet must speak for another name to have swapped; nor does this
    swap_cost: float = 10.0  # measured
    # that two tracklets of one marker may share: trackers end one late and start the other early
    max_overlap_frames: int = 2  # physical
    window_frames: int = 2048  # memory: frames that vote together, as labels of all frames of a long take are large
    min_length_frames: int = 5  # physical: of the usual tracklet; shorter ones are shorter than any motion


PAIRS_COMPARED = 200  # pairs of frames in which it is seen whether columns are trajectories; by time
MIN_STEPS = 100  # from one point of a column to the next, of which a share is known to a twentieth
POINTS_AT_ONCE = 200_000  # that are cut at once; by memory


def cut(points: Table, rate: float, lanes: Lanes | None = None) -> np.ndarray:
    """(T, L) the number of the tracklet that each point (T, L, 3) m belongs to, -1 where there is none.

    No tracklet is of two trajectories, which stand as `lanes` say; by their order tracklets are numbered. Where columns
    are no trajectories at all, points being in any order, every point is on its own.
    """
    present = there_in(points)
    standing = standing_in(lanes, present.shape)
    tracklet = np.full(present.shape, -1, np.int32)
    if not are_trajectories(points, lanes):
        tracklet[present] = np.arange(present.sum())
        return tracklet
    count, size, waiting = 0, 0, []
    for _, span, lane in standing.each_alone():
        frames = np.flatnonzero(present[span, lane]) + span.start
        waiting.append((frames, np.full(len(frames), lane)))
        size += len(frames)
        if size >= POINTS_AT_ONCE:
            count, size, waiting = _cut_some(tracklet, points, waiting, count, rate), 0, []
    if waiting:
        count = _cut_some(tracklet, points, waiting, count, rate)
    narrow = tracklet.size > PACKING.whole_cells and count <= np.iinfo(np.int16).max
    return tracklet.astype(np.int16) if narrow else tracklet


def _cut_some(tracklet: np.ndarray, points: Table, some: list, count: int, rate: float) -> int:
    """Numbers the tracklets of some trajectories, by frames and lanes (K,) of each, from `count` on; the next one."""
    frames, lane = (np.concatenate(parts) for parts in zip(*some, strict=True))
    if not len(frames):
        return count
    gap = np.diff(frames)
    step = np.linalg.norm(np.diff(points[frames, lane], axis=0), axis=1)
    ends = (gap > CUTTING.max_gap_s * rate) | (step > MARKER_LIMITS.fastest_m_s / rate * gap)
    ends |= np.diff(np.repeat(np.arange(len(some)), [len(own) for own, _ in some])) != 0
    number = count + np.concatenate([[0], np.cumsum(ends)])
    tracklet[frames, lane] = number
    return int(number[-1]) + 1


def are_trajectories(points: Table, lanes: Lanes | None = None) -> bool:
    """Whether the trajectories of points (T, L, 3) m follow anything, as far as can be known."""
    frames = evenly_spread(max(len(points) - 1, 0), PAIRS_COMPARED)
    now, then = (np.isfinite(points[some]).all(axis=2) for some in (frames, frames + 1))
    goes_on = now & then
    if lanes is not None:
        tables = [lanes.table(slice(frame, frame + 2)) for frame in frames]
        goes_on &= np.array([before == after for before, after in tables], bool).reshape(goes_on.shape)
    there = np.argsort(~then, axis=1, kind="stable")[:, : int(then.sum(axis=1).max(initial=0))]
    nearest, steps = 0, int(goes_on.sum())
    for part in blocks(len(frames), there.shape[1] ** 2):
        if steps < MIN_STEPS or nearest >= CUTTING.min_nearest * steps:
            break
        at, lane = frames[part, None], there[part]
        before, after = points[at, lane].T, points[at + 1, lane].T
        square = sum((one[:, None] - other[None]) ** 2 for one, other in zip(after, before, strict=True))
        own = np.where(np.isnan(square), np.inf, square).argmin(axis=0) == np.arange(lane.shape[1])[:, None]
        nearest += int((own & np.take_along_axis(goes_on[part], lane, axis=1).T).sum())
    return steps < MIN_STEPS or nearest >= CUTTING.min_nearest * steps


def are_lasting(tracklet: np.ndarray) -> bool:
    """Whether the usual point is on a tracklet (T, P) long enough to go by; not so where frames are in no order."""
    lengths = np.zeros(int(tracklet.max(initial=-1)) + 1, int)
    for part in blocks(*tracklet.shape):
        lengths += np.bincount(tracklet[part][tracklet[part] >= 0], minlength=len(lengths))
    lengths = np.sort(lengths)
    before, whole = np.cumsum(lengths), int(lengths.sum())
    # The median over the points of how long the tracklet of each is.
    middle = lengths[np.searchsorted(before, [(whole - 1) // 2, whole // 2], side="right")] if whole else lengths
    return whole > 0 and bool(middle.mean() >= VOTE.min_length_frames)


def frame_log_odds(confidence: np.ndarray) -> np.ndarray:
    """Log odds that frames on their own say for names of such confidence."""
    odds = np.log(np.maximum(confidence, 1e-6) / np.maximum(1 - confidence, 1e-6))
    return np.clip(odds, 0, VOTE.max_frame_log_odds)


def gone_over(last: int, first: int, before: str, after: str, column: int) -> Suspect:
    """That a trajectory is one marker's up to the frame `last`, and another's from `first` on."""
    return Suspect(last, first, f"goes over from {before} to {after}", column, (before, after))


def gone_over_between(marker: np.ndarray, tracklet: np.ndarray, at: int, names: Sequence[str]) -> tuple[Suspect, ...]:
    """Tracklets (2, L) that have two names, marker (2, L), in two frames, the second of which is `at` in the source."""
    changed = (tracklet[0] == tracklet[1]) & (marker[0] != marker[1]) & (marker != NO_MARKER).all(axis=0)
    columns = np.flatnonzero(changed)
    return tuple(
        gone_over(at - 1, at, names[marker[0, column]], names[marker[1, column]], column)
        for column in columns[np.argsort(tracklet[1, columns], kind="stable")].tolist()
    )


def renamed(
    marker: np.ndarray,
    tracklet: np.ndarray,
    names: Sequence[str],
    first_frame: int = 0,
    lanes: Lanes | None = None,
) -> tuple[Suspect, ...]:
    """Where a trajectory goes on with another name behind a gap or a leap: it was not one marker's.

    marker and tracklet are (T, L), `names` the M markers' and `first_frame` the source's number of the first frame.
    """
    changes: list[tuple[int, ...]] = []
    for some in blocks(marker.shape[1], len(marker)):
        lane, frame = np.nonzero((marker[:, some] != NO_MARKER).T)
        lane += some.start
        own, part = marker[frame, lane], tracklet[frame, lane]
        at = np.flatnonzero((lane[1:] == lane[:-1]) & (own[1:] != own[:-1]) & (part[1:] != part[:-1]))
        one, other = (trajectories_at(lanes, frame[place], lane[place]) for place in (at, at + 1))
        at, one = at[one == other], one[one == other]
        change = one, frame[at], frame[at + 1], lane[at], own[at], own[at + 1]
        changes += zip(*(values.tolist() for values in change), strict=True)
    found = []
    for _, last, first, lane, old, new in sorted(changes):  # in the order of the file, whatever lanes there are
        pair = names[old], names[new]
        words = f"is {pair[0]} and, behind a gap or a leap, {pair[1]}"
        found.append(Suspect(last + first_frame, first + first_frame, words, lane, pair))
    return tuple(found)


@dataclass(frozen=True, eq=False)
class Stretch:
    """A run of frames of one tracklet that has one name."""

    # its number, and where it stands
    tracklet: int
    lane: int
    frames: np.ndarray  # (F,) in which it has a point, 0-based
    odds: np.ndarray  # (M,) log odds added up over them; silent, the same for no name
    silent: float


def vote(labels: Labels, tracklet: np.ndarray, names: Sequence[str], first_frame: int = 0) -> Verdict:
    """One name for each tracklet, or for each part of one that swapped, of frames that all vote together.

    labels and tracklet are (T, L), names the M markers and first_frame the source's number of the first frame.
    """
    stretches = _stretches(labels, tracklet, len(names))
    given = _given(stretches, len(tracklet), len(names))
    voted = Labels.none(*tracklet.shape)
    for stretch, (name, sure) in zip(stretches, given, strict=True):
        if name != NO_MARKER:
            at = stretch.frames, stretch.lane
            voted.marker[at], voted.step[at], voted.confidence[at] = name, BY_TRAJECTORY, sure
    suspects = _swaps(stretches, given, names, first_frame)
    suspects += _doubts(stretches, given, names, first_frame)
    return Verdict(voted, tuple(sorted(suspects, key=lambda suspect: suspect.first)))


def _stretches(labels: Labels, tracklet: np.ndarray, markers: int) -> list[Stretch]:
    """The tracklets (T, L) cut where they went over to another marker, those of which no frame says anything left out.

    There may be very many of these, a ghost each, so points are gone through in a row and not in a table of tracklets.
    """
    frame, lane = np.nonzero(tracklet >= 0)
    number, marker = tracklet[frame, lane], labels.marker[frame, lane]
    named = np.zeros(int(tracklet.max(initial=-1)) + 1, bool)
    named[number[marker != NO_MARKER]] = True
    row = np.flatnonzero(named[number])
    if not len(row):
        return []
    row = row[np.argsort(number[row], kind="stable")]
    frame, lane, number, marker = frame[row], lane[row], number[row], marker[row]
    worth = frame_log_odds(labels.confidence[frame, lane].astype(float))
    begin = np.flatnonzero(np.diff(number, prepend=-1))
    # What cannot pay for a change in all of a tracklet cannot in a part of it.
    able = _added_up(begin, marker, worth, markers) * VOTE.frame_weight > VOTE.swap_cost
    cuts, ends = [begin], np.append(begin[1:], len(number))
    for one in np.flatnonzero(able.sum(axis=1) > 1).tolist():
        own = slice(begin[one], ends[one])
        gain = np.where(marker[own, None] == np.flatnonzero(able[one]), worth[own, None], 0) * VOTE.frame_weight
        cuts.append(own.start + 1 + np.flatnonzero(np.diff(_most_likely(gain, VOTE.swap_cost))))
    begin = np.sort(np.concatenate(cuts))
    total = _added_up(begin, marker, worth, markers)
    silent = VOTE.ghost_log_odds * np.add.reduceat(marker == NO_MARKER, begin, dtype=float)
    parts = zip(number[begin].tolist(), lane[begin].tolist(), np.split(frame, begin[1:]), total, silent, strict=True)
    return [Stretch(*part) for part in parts]


def _added_up(begin: np.ndarray, marker: np.ndarray, worth: np.ndarray, markers: int) -> np.ndarray:
    """(N, M) what markers (K,), each worth (K,), are worth together from each of N beginnings to the next."""
    part = np.repeat(np.arange(len(begin)), np.diff(begin, append=len(marker)))
    some = marker != NO_MARKER
    cell = part[some] * markers + marker[some]
    return np.bincount(cell, worth[some], len(begin) * markers).reshape(len(begin), markers)


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


def _given(stretches: list[Stretch], frames: int, markers: int) -> list[tuple[int, float]]:
    """The marker and chance of every stretch: who has most to say chooses first, and nobody takes what is taken."""
    busy = np.zeros((frames, markers), dtype=bool)
    given: list[tuple[int, float]] = [(NO_MARKER, 0.0)] * len(stretches)
    waiting = sorted(range(len(stretches)), key=lambda index: -stretches[index].odds.max(initial=0))
    for index in waiting:
        stretch = stretches[index]
        allowed = np.add.reduce(busy[stretch.frames], axis=0, dtype=int) <= VOTE.max_overlap_frames
        free = np.where(allowed, stretch.odds, 0)
        best = int(free.argmax())
        rest = stretch.odds.sum() - stretch.odds[best] + stretch.silent
        if free[best] > rest:
            lead = (free[best] - rest) * VOTE.frame_weight
            given[index] = (best, float(chance(lead)))
            busy[stretch.frames, best] = True
    return given


def _swaps(stretches, given, names, first_frame) -> list[Suspect]:
    """Tracklets that went over from one marker to another."""
    suspects = []
    for (before, (old, _)), (after, (new, _)) in pairwise(zip(stretches, given, strict=True)):
        if before.tracklet == after.tracklet and NO_MARKER not in (old, new) and old != new:
            last, first = int(before.frames[-1]) + first_frame, int(after.frames[0]) + first_frame
            suspects.append(gone_over(last, first, names[old], names[new], before.lane))
    return suspects


def _doubts(stretches, given, names, first_frame) -> list[Suspect]:
    """Tracklets that frames named often and for which no name won."""
    suspects = []
    for stretch, (name, _) in zip(stretches, given, strict=True):
        if name == NO_MARKER and stretch.odds.max() > max(stretch.silent, VOTE.max_frame_log_odds):
            likely = tuple(names[marker] for marker in np.argsort(-stretch.odds)[:2] if stretch.odds[marker] > 0)
            words = f"may be {' or '.join(likely)} and stays unnamed"
            first, last = (int(stretch.frames[at]) + first_frame for at in (0, -1))
            suspects.append(Suspect(first, last, words, stretch.lane, likely))
    return suspects
