# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories vote: what frames said one by one of a point becomes one name for as long as the point was followed.

A trajectory keeps one name unless the frames say for long enough that it went over to another marker; that is reported.
No two trajectories have the same marker at the same time.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from ..data.takes import NO_MARKER, Suspect

MOST_SAID = 4.0  # log odds that one frame can say
GHOST_SAID = 1.0  # log odds that a frame without a name says for a ghost
INDEPENDENT = 0.1  # a frame is worth this part of an independent one: neighbours err together
SWAP_COST = 10.0  # log odds a trajectory must speak for another name before it is believed to have swapped
CANDIDATE = 0.05  # part of a trajectory's frames that a name must have to be considered, unless it can pay for a swap
MAJORITY = 0.5  # of what was said, for the name that wins
OVERLAP = 2  # frames that two trajectories of one marker may share: trackers end one late and start the other early


@dataclass(frozen=True, eq=False)
class Stretch:
    """A run of frames of one trajectory that has one name.

    point, first, last  the trajectory and its first and last frame, both included, 0-based
    said                (M,) log odds added up over its frames, and silent the same for no name
    """

    point: int
    first: int
    last: int
    said: np.ndarray
    silent: float


@dataclass(frozen=True, eq=False)
class Voted:
    """The names after the vote.

    marker      (T, P) index of the marker, NO_MARKER where unnamed
    confidence  (T, P) chance that it is right; 0 where unnamed
    suspects    trajectories that changed names or were of two minds
    """

    marker: np.ndarray
    confidence: np.ndarray
    suspects: tuple[Suspect, ...]


def vote(marker, confidence, present, names: Sequence[str], first_frame: int = 0) -> Voted:
    """One name for each trajectory, or for each part of one that swapped.

    marker (T, P) and confidence (T, P) are what frames said on their own, present (T, P) where a trajectory has a
    point, names the M markers and first_frame the source's number of the first frame.
    """
    weight = np.clip(np.log(np.maximum(confidence, 1e-6) / np.maximum(1 - confidence, 1e-6)), 0, MOST_SAID)
    stretches = [
        stretch
        for point in range(marker.shape[1])
        for stretch in _stretches(point, marker[:, point], weight[:, point], present[:, point], len(names))
    ]
    given = _given(stretches, present, len(names))
    voted = np.full(marker.shape, NO_MARKER)
    sure = np.zeros(marker.shape)
    for stretch, (name, chance) in zip(stretches, given, strict=True):
        if name != NO_MARKER:
            frames = slice(stretch.first, stretch.last + 1)
            here = present[frames, stretch.point]
            voted[frames, stretch.point] = np.where(here, name, NO_MARKER)
            sure[frames, stretch.point] = np.where(here, chance, 0)
    suspects = _swaps(stretches, given, names, first_frame) + _doubts(stretches, given, names, first_frame)
    return Voted(voted, sure, tuple(sorted(suspects, key=lambda suspect: suspect.first)))


def _stretches(point: int, marker, weight, present, markers: int) -> list[Stretch]:
    """The trajectory cut where it went over to another marker."""
    frames = np.flatnonzero(present)
    if not len(frames):
        return []
    said, worth = marker[frames], weight[frames]
    counts = np.bincount(said[said >= 0], minlength=markers)
    paid = np.bincount(said[said >= 0], weights=worth[said >= 0], minlength=markers) * INDEPENDENT > SWAP_COST
    candidates = np.flatnonzero((counts > CANDIDATE * len(frames)) | paid)
    state = np.zeros(len(frames), dtype=int)
    if len(candidates) > 1:
        state = _most_likely(np.where(said[:, None] == candidates, worth[:, None], 0) * INDEPENDENT)
    cuts = np.concatenate([[0], np.flatnonzero(np.diff(state)) + 1, [len(frames)]])
    made = []
    for first, after in pairwise(cuts):
        own, how = said[first:after], worth[first:after]
        total = np.bincount(own[own >= 0], weights=how[own >= 0], minlength=markers)
        made.append(
            Stretch(point, int(frames[first]), int(frames[after - 1]), total, GHOST_SAID * float((own < 0).sum()))
        )
    return made


def _most_likely(gain: np.ndarray) -> np.ndarray:
    """(T,) the sequence of states of highest total gain (T, K) when every change costs SWAP_COST (Viterbi's)."""
    frames, states = gain.shape
    best = gain[0].copy()
    origin = np.zeros((frames, states), dtype=int)
    for frame in range(1, frames):
        leader = int(best.argmax())
        moved = best[leader] - SWAP_COST > best
        origin[frame] = np.where(moved, leader, np.arange(states))
        best = np.where(moved, best[leader] - SWAP_COST, best) + gain[frame]
    path = np.empty(frames, dtype=int)
    path[-1] = best.argmax()
    for frame in range(frames - 1, 0, -1):
        path[frame - 1] = origin[frame, path[frame]]
    return path


def _given(stretches: list[Stretch], present: np.ndarray, markers: int) -> list[tuple[int, float]]:
    """The marker and chance of every stretch: who has most to say chooses first, and nobody takes what is taken."""
    busy = np.zeros((markers, len(present)), dtype=bool)
    given: list[tuple[int, float]] = [(NO_MARKER, 0.0)] * len(stretches)
    waiting = sorted(range(len(stretches)), key=lambda index: -stretches[index].said.max(initial=0))
    for index in waiting:
        stretch = stretches[index]
        frames = slice(stretch.first, stretch.last + 1)
        here = present[frames, stretch.point]
        allowed = (busy[:, frames] & here).sum(axis=1) <= OVERLAP
        free = np.where(allowed, stretch.said, 0)
        best = int(free.argmax())
        rest = stretch.said.sum() - stretch.said[best] + stretch.silent
        if free[best] > MAJORITY * (free[best] + rest):
            lead = (free[best] - rest) * INDEPENDENT
            given[index] = (best, float(1 / (1 + np.exp(-min(lead, 30.0)))))
            busy[best, frames] |= here
    return given


def _swaps(stretches, given, names, first_frame) -> list[Suspect]:
    """Trajectories that went over from one marker to another."""
    suspects = []
    for (before, (old, _)), (after, (new, _)) in pairwise(zip(stretches, given, strict=True)):
        if before.point == after.point and NO_MARKER not in (old, new) and old != new:
            suspects.append(
                Suspect(
                    before.last + first_frame,
                    after.first + first_frame,
                    f"goes over from {names[old]} to {names[new]}",
                    before.point,
                )
            )
    return suspects


def _doubts(stretches, given, names, first_frame) -> list[Suspect]:
    """Trajectories that frames named often and for which no name won."""
    suspects = []
    for stretch, (name, _) in zip(stretches, given, strict=True):
        order = np.argsort(-stretch.said)[:2]
        if name == NO_MARKER and stretch.said[order[0]] > stretch.silent and stretch.said[order[0]] > MOST_SAID:
            words = " or ".join(names[marker] for marker in order if stretch.said[marker] > 0)
            suspects.append(
                Suspect(
                    stretch.first + first_frame,
                    stretch.last + first_frame,
                    f"may be {words} and stays unnamed",
                    stretch.point,
                )
            )
    return suspects
