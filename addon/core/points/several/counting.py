# SPDX-License-Identifier: GPL-3.0-or-later
"""How many bodies a take may show: by groups of points that are apart, and by how many points go together at all."""

from dataclasses import dataclass

import numpy as np

from ...data.made import Table
from ...data.takes import evenly_spread
from ..refusals import REFUSAL, far_groups
from .affinity import Affinity
from .wearers import MAX_SUBJECTS


@dataclass(frozen=True)
class CountingOptions:
    """What a body shows of itself.

    firm        part of the usual affinity of a tracklet to others, below which it is a ghost; measured: half or twice
                names eight meetings alike
    often       part of the frames in which so many are apart; measured: as firm
    whole       part of a set's markers that a body shows at most times; physical: whoever is parted in two has half of
                them at most on one side
    """

    firm: float = 0.2
    often: float = 0.05
    whole: float = 0.55


COUNTING = CountingOptions()
FRAMES_COUNTED = 80  # that are looked at


def count_bodies(points: Table, tracklet: np.ndarray, affinity: Affinity, markers: int) -> tuple[int, int]:
    """How many bodies with so many markers are apart at some time, and the most that there may be.

    In points (T, L, 3) m of tracklets (T, L), -1 where there is none.
    """
    firm = np.append(firm_tracklets(affinity), False)[tracklet]
    frames = evenly_spread(len(points), FRAMES_COUNTED)
    sizes, present = [], []
    for frame in frames.tolist():
        own = points[frame][firm[frame]]
        present.append(len(own))
        sizes.append(len(far_groups(own, REFUSAL.gap_m, markers / 2)))
    groups = np.sort(sizes)[::-1]
    apart = int(groups[int(COUNTING.often * len(groups))])
    most = round(float(np.quantile(present, 1 - COUNTING.often)) / markers)
    return apart, min(max(most, 1), MAX_SUBJECTS)


def firm_tracklets(affinity: Affinity) -> np.ndarray:
    """(N,) True for the tracklets whose affinity to others is that of markers on a body."""
    strength = affinity.best()
    usual = np.median(strength[strength > 0]) if (strength > 0).any() else 0.0
    return strength >= COUNTING.firm * usual


def is_whole(there: np.ndarray, markers: int) -> bool:
    """Whether a body is one, and no half, of a set of so many markers, by the points (T, L) of it that are there."""
    return usual_count(there.sum(axis=1)) >= COUNTING.whole * markers


def usual_count(counts: np.ndarray) -> float:
    """How many there are where most are there: the upper quartile of counts (T,), but for those of 0."""
    counts = counts[counts > 0]
    return float(np.quantile(counts, 0.75)) if len(counts) else 0.0
