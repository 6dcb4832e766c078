# SPDX-License-Identifier: GPL-3.0-or-later
"""A take as rows over time, each a marker or a trajectory without a name: what every stretch is. No drawing here."""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from ..core.data.takes import BY_EDIT, NO_MARKER, PointRows
from ..core.edits.kinds import Place
from ..core.review.answering import MIN_SURE, markers_meant
from .clock import TakeClock
from .stored import Stored, changed_between

# What a stretch is, in the order in which stretches are drawn: what is rare and short lies on top.
STATES = ("named", "unnamed", "gap", "filled", "edited", "doubtful")
NAMED, UNNAMED, GAP, FILLED, CORRECTED, DOUBTFUL = range(len(STATES))
FOLDED = "short ones"


# s that a trajectory without a name is there, in all of a take, to have its own row; assumed: shorter ones are mostly
# ghosts that flicker.
MIN_OWN_ROW_S = 1.0


@dataclass(frozen=True, eq=False)
class Runs:
    """Stretches of R rows over the frames of the source: first the markers, then trajectories, long ones first."""

    names: tuple[str, ...]  # of the rows
    marker: np.ndarray  # (R,) index of the row's marker, NO_MARKER for others
    trajectory: np.ndarray  # (R,) the number of the row's trajectory, -1 for markers and for the row of all short ones
    found: np.ndarray  # (R,) frames with a point, filled ones not counted
    runs: np.ndarray  # (N, 4) row, first frame, last frame and one of STATES
    span: tuple[int, int]  # first and last frame of the take
    clock: TakeClock  # which of Blender's frames they are

    def __len__(self) -> int:
        return len(self.names)

    def nearest_frame(self, row: int, frame: int) -> int:
        """The frame nearest to `frame` in which a row's trajectory is without a name; `frame` itself for a marker."""
        if self.trajectory[row] < 0:
            return frame
        mine = self.runs[self.runs[:, 0] == row]
        inside = np.clip(frame, mine[:, 1], mine[:, 2])
        return int(inside[np.abs(inside - frame).argmin()])


@dataclass(eq=False)
class KeptRows:
    """The rows of the take that was asked for last: of one that was edited since, only what changed is made again."""

    stored: Stored | None = None  # that take
    states: np.ndarray = field(default_factory=lambda: np.empty((0, 0), np.int8))  # (M, F) of its markers
    # (N, 4) stretches of each of its markers, frames by their index, and
    markers: list[np.ndarray] = field(default_factory=list)
    found: list[int] = field(default_factory=list)  # frames in which each has a point, filled ones not counted
    unfolded: bool = False  # whether short trajectories have rows of their own, and
    # the names, numbers, frames with a point and stretches of trajectories
    points: tuple[list[str], list[int], list[int], list[np.ndarray]] = ([], [], [], [])
    made: Runs | None = None  # what came of it

    def runs(self, stored: Stored, unfolded: bool) -> Runs:
        """The rows of a take, the same ones as long as it is the same."""
        if self.made is None or stored is not self.stored or unfolded != self.unfolded:
            same = unfolded == self.unfolded and self._same_points(stored)
            self._look_at_markers(stored)
            self.points = self.points if same else _rows_of_points(stored, unfolded)
            self.stored, self.unfolded = stored, unfolded
            self.made = self._joined()
        return self.made

    def _same_points(self, stored: Stored) -> bool:
        last = self.stored
        if last is None or last.rows is not stored.rows or last.rate != stored.rate:
            return False
        return last.labels is stored.labels or np.array_equal(last.labels.named, stored.labels.named)

    def _look_at_markers(self, stored: Stored):
        changed = None if self.stored is None else _about(self.stored, stored)
        if changed is None:
            whole = slice(0, len(stored.motion.frames))
            changed = dict.fromkeys(range(len(stored.names)), whole)
            self.states = np.empty((len(changed), whole.stop), np.int8)
            self.markers, self.found = [np.empty((0, 4), int)] * len(changed), [0] * len(changed)
        if not changed:
            return
        markers, spans = list(changed), changed.values()
        frames = slice(min(span.start for span in spans), max(span.stop for span in spans))
        self.states[markers, frames] = states_of(stored, markers, frames).T
        for index in markers:
            states = self.states[index]
            self.found[index] = int(((states != GAP) & (states != FILLED)).sum())
            self.markers[index] = _runs_of_states(index, states)

    def _joined(self) -> Runs:
        frames = self.stored.motion.frames
        names, numbers, found, tables = self.points
        runs = np.concatenate([np.empty((0, 4), int), *self.markers, *tables])
        runs[:, 1:3] = frames[runs[:, 1:3]] if len(frames) else 0
        count = len(self.stored.names)
        marker = np.append(np.arange(count), np.full(len(names), NO_MARKER))
        numbers = np.append(np.full(count, -1), np.array(numbers, int))
        span = (int(frames[0]), int(frames[-1])) if len(frames) else (0, 0)
        found = np.array([*self.found, *found], int)
        return Runs((*self.stored.names, *names), marker, numbers, found, runs, span, self.stored.clock)


def _about(before: Stored, after: Stored) -> dict[int, slice] | None:
    """The markers of which two takes that differ by edits may say something else, and the frames in which they may.

    Frames are given by their index; None where the takes differ by more.
    """
    about = changed_between(before, after)
    if about is None:
        return None
    of_word = {name: index for index, name in enumerate(after.names)}
    for suspect in set(before.suspects) ^ set(after.suspects):
        start, stop = np.searchsorted(after.motion.frames, [suspect.first, suspect.last + 1]).tolist()
        for marker in markers_meant(suspect, of_word):
            own = about.get(marker, slice(start, stop))
            about[marker] = slice(min(own.start, start), max(own.stop, stop))
    return about


def _rows_of_points(stored: Stored, unfolded: bool) -> tuple[list[str], list[int], list[int], list[np.ndarray]]:
    """The names, numbers, frames with a point and stretches (N, 4) of the trajectories without a name."""
    left = np.flatnonzero(~stored.labels.named) if isinstance(stored.rows, PointRows) else np.empty(0, int)
    if not len(left):
        return [], [], [], []
    # Rows are in the order of frames, which a stable sort keeps within each trajectory.
    left = left[np.argsort(stored.rows.trajectory[left].astype(np.int32), kind="stable")]
    there, frame = stored.rows.trajectory[left], stored.rows.frame[left]
    fresh = np.diff(there, prepend=there[0] - 1) != 0
    own, row = there[fresh], np.cumsum(fresh) - 1
    count = np.bincount(row)
    long_enough = unfolded | (count >= MIN_OWN_ROW_S * stored.rate)
    rank = np.argsort(np.where(long_enough, -count, 1), kind="stable")
    kept = rank[: int(long_enough.sum())]
    place = np.full(len(own), len(kept))
    place[kept] = np.arange(len(kept))
    markers = len(stored.names)
    table = _runs_of_points(place[row] + markers, row, frame, markers + len(kept))
    short = int((~long_enough).sum())
    names = [f"trajectory {number}" for number in own[kept]] + [f"{short} {FOLDED}"] * bool(short)
    numbers = own[kept].tolist() + [-1] * bool(short)
    found = count[kept].tolist() + [int(count[~long_enough].sum())] * bool(short)
    return names, numbers, found, [table]


def states_of(stored: Stored, markers: Sequence[int], frames: slice) -> np.ndarray:
    """(F, K) one of STATES for each of F frames, by their index from start to stop, and of K markers, by theirs."""
    markers = list(markers)
    there = np.isfinite(np.array([stored.motion.markers[frames, marker, 0] for marker in markers]).T)
    states = np.where(there, NAMED, GAP).astype(np.int8)
    column_of = np.full(len(stored.names) + 1, -1)  # the last is that of NO_MARKER, -1
    column_of[markers] = np.arange(len(markers))
    for unlike, state in zip(_unlike_others(stored, markers, frames), (DOUBTFUL, CORRECTED), strict=True):
        states[unlike] = state
    states[~there] = GAP  # of a blob that one camera alone has, whoever named it
    of_word = {name: index for index, name in enumerate(stored.names)}
    own_frames = stored.motion.frames[frames]
    for suspect in stored.suspects:
        part = slice(*np.searchsorted(own_frames, [suspect.first, suspect.last + 1]).tolist())
        doubted = markers_meant(suspect, of_word) if part.start < part.stop else ()
        for place in (column_of[marker] for marker in doubted if column_of[marker] >= 0):
            column = states[part, place]
            column[column == NAMED] = DOUBTFUL
    for edit in stored.edits:
        place = column_of[stored.words[edit.marker]] if isinstance(edit, Place) and edit.marker in stored.words else -1
        row = int(np.searchsorted(own_frames, edit.frame)) if place >= 0 else len(states)
        if row < len(states) and own_frames[row] == edit.frame and there[row, place]:
            states[row, place] = CORRECTED
    for marker, filled in stored.filled_markers.items():
        if column_of[marker] >= 0:
            states[filled[frames], column_of[marker]] = FILLED
    return states


def _unlike_others(stored: Stored, markers: list[int], frames: slice) -> tuple[tuple[np.ndarray, np.ndarray], ...]:
    """Frame and place in `markers` of each sample whose name is not sure, and of each that a person named.

    Of markers of frames by their index.
    """
    labels, points = stored.labels, isinstance(stored.rows, PointRows)
    if points and stored.held is not None:  # quicker
        row = stored.held.cells[markers, frames]
        unsure = row >= 0
        unsure[unsure] = labels.confidence[row[unsure]] < MIN_SURE
        return np.nonzero(unsure.T), np.nonzero(stored.held.by_edit[markers, frames].T)
    column_of = np.full(len(stored.names) + 1, -1)  # the last is that of NO_MARKER, -1
    column_of[markers] = np.arange(len(markers))
    rows = slice(*np.searchsorted(stored.rows.frame, [frames.start, frames.stop]).tolist())
    frame, column = stored.rows.frame[rows] - frames.start, column_of[labels.marker[rows]]
    # Of blobs every camera has its own say.
    unsure = (labels.confidence[rows] < MIN_SURE) & points
    both = [np.flatnonzero(flags & (column >= 0)) for flags in (unsure, labels.step[rows] == BY_EDIT)]
    return tuple((frame[which], column[which]) for which in both)


def _runs_of_states(row: int, states: np.ndarray) -> np.ndarray:
    """(N, 4) row, first and last frame (0-based) and state of the stretches of a row with these states (F,)."""
    first = np.flatnonzero(np.diff(states, prepend=np.int8(-1)))
    last = np.append(first[1:], len(states)) - 1
    return np.column_stack([np.full(len(first), row), first, last[: len(first)], states[first]]).astype(int)


def _runs_of_points(row: np.ndarray, trajectory: np.ndarray, frame: np.ndarray, folded: int) -> np.ndarray:
    """The same of points (N,) without names, sorted by trajectory and frame; of the row `folded`, of all of them."""
    here = row == folded
    short = np.unique(frame[here])
    row = np.concatenate([row[~here], np.full(len(short), folded)])
    trajectory = np.concatenate([trajectory[~here], np.full(len(short), -1)])
    frame = np.concatenate([frame[~here], short])
    if not len(frame):
        return np.empty((0, 4), int)
    fresh = np.ones(len(frame), bool)
    fresh[1:] = (np.diff(trajectory) != 0) | (np.diff(frame) != 1)
    first = np.flatnonzero(fresh)
    last = np.append(first[1:], len(frame)) - 1
    return np.column_stack([row[first], frame[first], frame[last], np.full(len(first), UNNAMED)])
