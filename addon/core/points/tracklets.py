# SPDX-License-Identifier: GPL-3.0-or-later
"""Trajectories of a file cut into tracklets that are surely one marker's each, and the vote of every tracklet.

A column of a file may hold several trajectories one after the other, and a point may leap from one marker to another.
"""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise

import numpy as np

from ..data.takes import NO_MARKER, Suspect
from .votes import Voted, vote

LONGEST_GAP = 0.5  # s without a point, beyond which a column may hold another trajectory
FASTEST = 12.0  # m/s; no marker moves faster
WINDOW = 2048  # frames that vote together
LEAST_LENGTH = 5  # frames of the usual tracklet; shorter ones have nothing to vote about


def cut(points: np.ndarray, rate: float) -> np.ndarray:
    """(T, P) the number of the tracklet that each point (T, P, 3) m belongs to, -1 where there is none."""
    present = np.isfinite(points).all(axis=2)
    tracklet = np.full(present.shape, -1)
    count = 0
    for column in range(points.shape[1]):
        frames = np.flatnonzero(present[:, column])
        if not len(frames):
            continue
        gap = np.diff(frames)
        step = np.linalg.norm(np.diff(points[frames, column], axis=0), axis=1)
        ends = (gap > LONGEST_GAP * rate) | (step > FASTEST / rate * gap)
        tracklet[frames, column] = count + np.concatenate([[0], np.cumsum(ends)])
        count = int(tracklet[frames[-1], column]) + 1
    return tracklet


def vote_tracklets(
    marker: np.ndarray, confidence: np.ndarray, tracklet: np.ndarray, names: Sequence[str], first_frame: int = 0
) -> Voted:
    """One name for each tracklet, or part of one that swapped; frames as they are where tracklets are too short to vote.

    marker, confidence and tracklet are (T, P); names the M markers; first_frame the source's number of the first frame.
    """
    lengths = np.bincount(tracklet[tracklet >= 0]) if (tracklet >= 0).any() else np.zeros(0, int)
    if not len(lengths) or np.median(np.repeat(lengths, lengths)) < LEAST_LENGTH:
        return Voted(marker, confidence, ())
    voted, sure = np.full(marker.shape, NO_MARKER), np.zeros(marker.shape)
    suspects: list[Suspect] = []
    edges = [*range(0, max(len(marker) - WINDOW // 2, 1), WINDOW), len(marker)]
    for first, after in pairwise(edges):
        frames = slice(first, after)
        part = _vote_window(marker[frames], confidence[frames], tracklet[frames], names, first_frame + first)
        voted[frames], sure[frames] = part.marker, part.confidence
        suspects += part.suspects
        suspects += _gone_over(voted, tracklet, first, names, first_frame)
    return Voted(voted, sure, tuple(sorted(suspects, key=lambda suspect: suspect.first)))


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
        Suspect(at - 1, at, f"goes over from {names[before[column]]} to {names[after[column]]}", column)
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
            words = f"is {names[own[at]]} and, behind a gap or a leap, {names[own[at + 1]]}"
            found.append(Suspect(int(frames[at]) + first_frame, int(frames[at + 1]) + first_frame, words, column))
    return tuple(found)


def _vote_window(marker, confidence, tracklet, names, first_frame) -> Voted:
    """The same for a few frames: every tracklet a column of its own."""
    frame, column = np.nonzero(tracklet >= 0)
    number, place = np.unique(tracklet[frame, column], return_inverse=True)
    shape = (len(marker), len(number))
    said, worth, present = np.full(shape, NO_MARKER), np.zeros(shape), np.zeros(shape, bool)
    said[frame, place], worth[frame, place] = marker[frame, column], confidence[frame, column]
    present[frame, place] = True
    owner = np.zeros(len(number), int)
    owner[place] = column
    result = vote(said, worth, present, names, first_frame)
    voted, sure = np.full(marker.shape, NO_MARKER), np.zeros(marker.shape)
    voted[frame, column], sure[frame, column] = result.marker[frame, place], result.confidence[frame, place]
    # Every suspect of a vote is about one tracklet; a person knows it by the column of the file.
    return Voted(voted, sure, tuple(replace(one, trajectory=int(owner[one.trajectory])) for one in result.suspects))
