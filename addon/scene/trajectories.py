# SPDX-License-Identifier: GPL-3.0-or-later
"""A take as rows over time, each a marker or a trajectory without a name: what every stretch is. No drawing here."""

from dataclasses import dataclass

import numpy as np

from ..core.data.takes import BY_EDIT, NO_MARKER, PointRows
from ..core.edits.kinds import Place
from ..core.review.doubtful import markers_of, unsure_names
from .stored import Stored

# What a stretch is, in the order in which stretches are drawn: what is rare and short lies on top.
STATES = ("named", "unnamed", "gap", "filled", "edited", "doubtful")
NAMED, UNNAMED, GAP, FILLED, CORRECTED, DOUBTFUL = range(len(STATES))
# s; trajectories without a name that are shorter, in all of a take, share a row: mostly ghosts that flicker.
LONG_S = 1.0
FOLDED = "short ones"


@dataclass(frozen=True, eq=False)
class Runs:
    """Stretches of R rows over the frames that Blender counts: first the markers, then trajectories, long ones first.

    names       of the rows
    marker      (R,) index of the row's marker, NO_MARKER for others
    trajectory  (R,) the number of the row's trajectory, -1 for markers and for the row of all short ones
    found       (R,) frames with a point, filled ones not counted
    runs        (N, 4) row, first frame, last frame and one of STATES
    span        first and last frame of the take
    """

    names: tuple[str, ...]
    marker: np.ndarray
    trajectory: np.ndarray
    found: np.ndarray
    runs: np.ndarray
    span: tuple[int, int]

    def __len__(self) -> int:
        return len(self.names)

    def nearest_frame(self, row: int, frame: int) -> int:
        """The frame nearest to `frame` in which a row's trajectory is without a name; `frame` itself for a marker."""
        if self.trajectory[row] < 0:
            return frame
        mine = self.runs[self.runs[:, 0] == row]
        inside = np.clip(frame, mine[:, 1], mine[:, 2])
        return int(inside[np.abs(inside - frame).argmin()])


def runs_of(stored: Stored, unfolded: bool = False) -> Runs:
    """The rows of a take; `unfolded` gives each short trajectory a row of its own too."""
    frames = stored.motion.frames + stored.shift
    left = np.flatnonzero(~stored.labels.named) if isinstance(stored.rows, PointRows) else np.empty(0, int)
    states = states_of(stored)
    seen = ((states != GAP) & (states != FILLED)).sum(axis=0)
    tables = [_runs_of_table(states)]
    names, numbers, found = list(stored.names), [-1] * len(stored.names), seen.tolist()
    if len(left):
        # Rows are in the order of frames, which a stable sort keeps within each trajectory.
        left = left[np.argsort(stored.rows.trajectory[left].astype(np.int32), kind="stable")]
        there, frame = stored.rows.trajectory[left], stored.rows.frame[left]
        fresh = np.diff(there, prepend=there[0] - 1) != 0
        own, row = there[fresh], np.cumsum(fresh) - 1
        count = np.bincount(row)
        long_enough = unfolded | (count >= LONG_S * stored.rate)
        rank = np.argsort(np.where(long_enough, -count, 1), kind="stable")
        kept = rank[: int(long_enough.sum())]
        place = np.full(len(own), len(kept))
        place[kept] = np.arange(len(kept))
        tables.append(_runs_of_points(place[row] + len(names), row, frame, len(names) + len(kept)))
        short = int((~long_enough).sum())
        names += [f"trajectory {number}" for number in own[kept]] + [f"{short} {FOLDED}"] * bool(short)
        numbers += own[kept].tolist() + [-1] * bool(short)
        found += count[kept].tolist() + [int(count[~long_enough].sum())] * bool(short)
    runs = np.concatenate(tables)
    runs[:, 1:3] = frames[runs[:, 1:3]] if len(frames) else 0
    marker = np.where(np.arange(len(names)) < len(stored.names), np.arange(len(names)), NO_MARKER)
    span = (int(frames[0]), int(frames[-1])) if len(frames) else (0, 0)
    return Runs(tuple(names), marker, np.array(numbers, int), np.array(found, int), runs, span)


def states_of(stored: Stored) -> np.ndarray:
    """(F, M) one of STATES for every frame and marker."""
    there = np.isfinite(stored.motion.markers[..., 0])
    states = np.where(there, NAMED, GAP).astype(np.int8)
    states[unsure_names(stored.rows, stored.labels, states.shape)] = DOUBTFUL
    by_hand = np.flatnonzero((stored.labels.step == BY_EDIT) & (stored.labels.marker != NO_MARKER))
    states[stored.rows.frame[by_hand], stored.labels.marker[by_hand]] = CORRECTED
    states[~there] = GAP  # of a blob that one camera alone has, whoever named it
    of_word = {name: index for index, name in enumerate(stored.names)}
    for suspect in stored.suspects:
        part = slice(*np.searchsorted(stored.motion.frames, [suspect.first, suspect.last + 1]))
        for marker in markers_of(suspect, of_word):
            column = states[part, marker]
            column[column == NAMED] = DOUBTFUL
    for edit in stored.edits:
        if isinstance(edit, Place) and edit.marker in stored.words:
            row = int(np.searchsorted(stored.motion.frames, edit.frame))
            if row < len(states) and there[row, stored.words[edit.marker]]:
                states[row, stored.words[edit.marker]] = CORRECTED
    states[stored.filled()] = FILLED
    return states


def _runs_of_table(states: np.ndarray) -> np.ndarray:
    """(N, 4) row, first and last frame (0-based) and state of the stretches of a table (F, M), a row a column."""
    frames = len(states)
    flat = states.T.ravel()
    if not len(flat):
        return np.empty((0, 4), int)
    fresh = np.diff(flat, prepend=-1) != 0
    fresh[::frames] = True
    first = np.flatnonzero(fresh)
    last = np.append(first[1:], len(flat)) - 1
    return np.column_stack([first // frames, first % frames, last % frames, flat[first]]).astype(int)


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
