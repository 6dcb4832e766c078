# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that a whole take contradicts: a marker that for some frames is not where its rigid neighbours have it.

One subject keeps the distances between markers on one bone. What they are, the take itself tells best.
"""

from itertools import pairwise

import numpy as np

from ..data.takes import Suspect
from .likelihood.distances import DistanceConstraints

LOOSE = 4.0  # standard deviations of a tie's length that are no contradiction
LEAST = 0.015  # m
MOST = 0.5  # share of a marker's ties that may be broken
FEWEST = 2  # ties of a marker that must be seen
SEEN = 20  # frames that tell a distance
BRIDGED = 5  # frames between two findings that are one


def strays(markers: np.ndarray, constraints: DistanceConstraints) -> np.ndarray:
    """(T, M) True where a marker of (T, M, 3) m, NaN where missing, is off most of those that it moves with."""
    count, size = markers.shape[:2]
    broken, known = np.zeros((2, count, size))
    for (one, two), sd in zip(constraints.pair.tolist(), constraints.sd.tolist(), strict=True):
        distance = np.linalg.norm(markers[:, one] - markers[:, two], axis=1)
        there = np.isfinite(distance)
        if there.sum() < min(SEEN, count):
            continue
        usual = np.median(distance[there])
        off = there & (np.abs(distance - usual) > max(LOOSE * sd, LEAST))
        for marker in (one, two):
            broken[:, marker] += off
            known[:, marker] += there
    return (known >= FEWEST) & (broken > MOST * known)


def stray_suspects(stray: np.ndarray, names, first_frame: int) -> tuple[Suspect, ...]:
    """What a person should look at: ranges of frames by marker, short interruptions bridged."""
    found = []
    for marker in np.flatnonzero(stray.any(axis=0)):
        at = np.flatnonzero(stray[:, marker])
        edges = [0, *(np.flatnonzero(np.diff(at) > BRIDGED) + 1), len(at)]
        reason = f"{names[marker]} was off the markers that it moves with, and lost its name"
        for first, after in pairwise(edges):
            found.append(Suspect(int(at[first]) + first_frame, int(at[after - 1]) + first_frame, reason))
    return tuple(found)
