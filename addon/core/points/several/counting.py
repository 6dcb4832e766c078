# SPDX-License-Identifier: GPL-3.0-or-later
"""How many bodies a take may show: by groups of points that are apart, and by how many points go together at all."""

from dataclasses import dataclass

import numpy as np

from ...data.takes import evenly_spread
from ..refusals import far_groups
from .holding import Holding
from .wearers import MAX_SUBJECTS


@dataclass(frozen=True)
class CountingOptions:
    """How bodies are counted. All reckoned.

    firm        part of the usual hold of a tracklet on others, below which it is a ghost
    frames      that are looked at
    gap_m       between two bodies that are apart
    least       part of a set's markers that a body shows
    often       part of the frames in which so many are apart
    spare       part of a set's markers that bodies together may lack for there to be one more
    whole       part of a set's markers that a body shows at most times: half a person is none, and whoever is parted in
                two has half of them at most on one side
    fullest     part of the frames in which it may show less
    """

    firm: float = 0.2
    frames: int = 80
    gap_m: float = 0.5
    least: float = 0.5
    often: float = 0.05
    spare: float = 0.4
    whole: float = 0.55
    fullest: float = 0.75


COUNTING = CountingOptions()


@dataclass(frozen=True)
class Counted:
    """How many bodies are `apart` at some time, and the `most` that there may be."""

    apart: int
    most: int


def count_bodies(points: np.ndarray, tracklet: np.ndarray, holding: Holding, markers: int) -> Counted:
    """How many bodies with so many markers are in points (T, L, 3) m of tracklets (T, L), -1 where there is none."""
    firm = np.append(firm_tracklets(holding), False)[tracklet]
    frames = evenly_spread(len(points), COUNTING.frames)
    groups, present = [], []
    for frame in frames.tolist():
        own = points[frame][firm[frame]]
        present.append(len(own))
        groups.append(len(far_groups(own, COUNTING.gap_m, COUNTING.least * markers)))
    groups = np.sort(groups)[::-1]
    apart = int(groups[int(COUNTING.often * len(groups))])
    most = int(np.quantile(present, 1 - COUNTING.often) / markers + COUNTING.spare)
    return Counted(apart, min(max(most, 1), MAX_SUBJECTS))


def firm_tracklets(holding: Holding) -> np.ndarray:
    """(N,) True for the tracklets that hold on to others as markers on a body do."""
    strength = holding.best()
    usual = np.median(strength[strength > 0]) if (strength > 0).any() else 0.0
    return strength >= COUNTING.firm * usual


def is_whole(there: np.ndarray, markers: int) -> bool:
    """Whether a body is one, and no half, of a set of so many markers, by the points (T, L) of it that are there."""
    count = there.sum(axis=1)
    count = count[count > 0]
    return bool(len(count)) and float(np.quantile(count, COUNTING.fullest)) >= COUNTING.whole * markers
