# SPDX-License-Identifier: GPL-3.0-or-later
"""Whoever leaves and comes back: whose a presence is, by who else is there, and by how people are built.

No tracklet lasts over an absence of everybody. Two who are there at a time are two; where that leaves more ways than
one, each presence is named on its own, and the distances on it are compared with those of the first presences.
"""

from dataclasses import dataclass
from itertools import product

import numpy as np

from ...data.takes import Labels
from .counting import usual_count
from .places import NO_BODY

MAX_OVERLAP = 0.1  # part of the shorter of two presences that may be one's: bodies are parted some frames off
MAX_WAYS = 10_000  # that are tried; by time


def spans_of(tracklet: np.ndarray, body: np.ndarray, count: int) -> np.ndarray:
    """(T, K) when each of so many presences is there, by the bodies (N,) of tracklets (T, L)."""
    own = np.append(body, NO_BODY)[tracklet]
    there = np.stack([(own == one).sum(axis=1) for one in range(count)], axis=1)
    return 2 * there >= np.maximum([usual_count(column) for column in there.T], 1)


def ways_of(there: np.ndarray, count: int) -> list[tuple[int, ...]]:
    """All ways in which presences (T, K) after the first `count`, which are somebody each, can be theirs.

    Those of one are not there at the same time. None at all where there are too many.
    """
    both = there.T.astype(int) @ there
    length = np.maximum(np.diag(both), 1)
    apart = both <= MAX_OVERLAP * np.minimum(length[:, None], length)
    may = [np.flatnonzero(apart[one, :count]).tolist() for one in range(count, len(apart))]
    if np.prod([float(len(some)) for some in may]) > MAX_WAYS:
        return []
    pairs = [(one, other) for other in range(count, len(apart)) for one in range(count, other) if not apart[one, other]]
    return [way for way in product(*may) if all(way[one - count] != way[other - count] for one, other in pairs)]


@dataclass(frozen=True, eq=False)
class UnidentifiedPresence:
    """A presence that may be several people's: the frames (T,) in which it is there, its tracklets (N,)."""

    there: np.ndarray
    tracklets: np.ndarray

    def is_open(self, tracklet: np.ndarray, labels: Labels) -> bool:
        """Whether most of it has no name, by the tracklet and label (T, L) of every point of the take."""
        own = np.append(self.tracklets, False)[tracklet]
        return 2 * (~labels.named & own).sum() > own.sum()
