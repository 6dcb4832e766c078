# SPDX-License-Identifier: GPL-3.0-or-later
"""The affinity of tracklets: how near they stay to each other, and how steady their distance is, in all of a take.

Only pairs that are there at a time are kept, so memory grows with the tracklets and not with their square.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import lru_cache
from typing import Self

import numpy as np

from ...data.lanes import blocks
from ...data.made import Table
from ...data.physical import MARKER_LIMITS
from ...data.takes import evenly_spread


class AFFINITY:
    """What distances between two markers of one body do, and how much of a take is looked at."""

    # frames a second that are looked at
    sample_rate: float = 20.0  # physical: nobody walks past anybody in a twentieth of a second
    # frames that the prior counts for, by which distances vary by `loose`; 3 leaves 6 % of points to several bodies
    # and not 4, 12 puts 0.4 % more on the wrong one
    unknown: float = 6.0  # measured on 20 kinds of meetings
    # part of a distance that it varies by
    loose: float = 0.25  # physical: a bent limb shortens distances across it by a quarter
    # frames that what was seen counts for at most where nothing moves more than skin does, and more as the square
    # grows: who stands still for two seconds shows no more by standing longer
    known: float = 40.0  # physical
    # standard deviation of the places of two markers; where they move less, what their distance varies by counts as if
    # they moved so far: who stands sways, and nobody sways alike; with 0.2 two who walk beside each other in step for
    # less than a second have a foot of the other
    moved_m: float = 0.1  # measured
    steady_m: float = 0.02  # that a distance on a body varies by; physical: skin moves so far over bone


AFFINE_TRACKLETS = 6  # of a body, whose mean affinity to one is the body's; as many markers as a segment has at most
MIN_SAMPLES = 4  # frames of a tracklet that are looked at, at least: with fewer a distance has no variance
TRACKLETS_AT_ONCE = 1000  # whose pairs are added up at a time; by memory


@dataclass(frozen=True, eq=False)
class Affinity:
    """How strongly the N tracklets of a take go together in pairs."""

    frames: np.ndarray  # (F,) those that were looked at
    # (N + 1,) where the pairs of each tracklet begin, each pair being there for both of its tracklets
    first: np.ndarray
    other: np.ndarray  # (E,) the other tracklet of each, the strongest affinity first
    strength: np.ndarray  # (E,) the affinity, 1/m²

    @classmethod
    def of(cls, points: Table, tracklet: np.ndarray, rate: float, every: int | None = None) -> Self:
        """That of points (T, L, 3) m of tracklets (T, L), -1 where there is none, at `rate` frames a second.

        `every` is how many tracklets there are, where some of them are left out.
        """
        frames = _looked_at(tracklet, rate)
        every = int(tracklet.max(initial=-1)) + 1 if every is None else every
        one, other, strength = _pairs(points, tracklet, frames, every)
        one, other, strength = np.append(one, other), np.append(other, one), np.append(strength, strength)
        order = np.lexsort((-strength, one))
        first = np.searchsorted(one[order], np.arange(every + 1))
        return cls(frames, first, other[order], strength[order])

    def __len__(self) -> int:
        return len(self.first) - 1

    def of_tracklet(self, index: int) -> tuple[np.ndarray, np.ndarray]:
        """The tracklets (K,) that were there with one, and the affinities (K,)."""
        own = slice(self.first[index], self.first[index + 1])
        return self.other[own], self.strength[own]

    def best(self) -> np.ndarray:
        """(N,) the strongest affinity of each."""
        return self.on(np.zeros(len(self), int), 1)[:, 0]

    def on(self, body: np.ndarray, count: int) -> np.ndarray:
        """(N, K) the affinity of each to so many bodies, by the bodies (N,) of all tracklets."""
        found, size = np.zeros((len(self), count)), np.diff(self.first)
        for one in range(count):
            own = body[self.other] == one
            place = np.append(0, np.cumsum(own))
            chosen = own & (place[1:] - np.repeat(place[self.first[:-1]], size) <= AFFINE_TRACKLETS)
            row = np.repeat(np.arange(len(self)), size)[chosen]
            found[:, one] = np.bincount(row, self.strength[chosen], len(self)) / AFFINE_TRACKLETS
        return found


def _looked_at(tracklet: np.ndarray, rate: float) -> np.ndarray:
    """(F,) the frames that are looked at: often enough for tracklets that are there shortly, too."""
    step = max(int(rate / AFFINITY.sample_rate), 1)
    wanted = np.zeros(len(tracklet), bool)
    wanted[::step] = True
    for lane in range(tracklet.shape[1]):
        own = tracklet[:, lane]
        there = np.flatnonzero(own >= 0)
        if not len(there):
            continue
        begins = np.append(0, np.flatnonzero(np.diff(own[there])) + 1)
        seldom = np.add.reduceat(wanted[there].astype(int), begins) < MIN_SAMPLES
        ends = np.append(begins[1:], len(there))
        for begin, end in zip(begins[seldom].tolist(), ends[seldom].tolist(), strict=True):
            part = there[begin:end]
            wanted[part[evenly_spread(len(part), MIN_SAMPLES)]] = True
    return np.flatnonzero(wanted)


def _pairs(
    points: Table, tracklet: np.ndarray, frames: np.ndarray, every: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Pairs (E,) of tracklets that meet, each once, and how near they stay and how well they keep their distance."""
    parts = [_met(points, tracklet, some, every) for some in _windows(tracklet, frames)]
    key, number, total, squares = map(np.concatenate, zip(*parts, strict=True)) if parts else np.zeros((4, 0))
    key, place = np.unique(key.astype(np.int64), return_inverse=True)
    number, total, squares = (np.bincount(place, values, len(key)) for values in (number, total, squares))
    mean = total / np.maximum(number, 1)
    one, other = np.divmod(key, every)
    variance = _variances(points, tracklet, frames, every)
    skin = MARKER_LIMITS.skin_m**2
    moved = np.maximum(variance[one] + variance[other], skin)
    counts = np.minimum(number, AFFINITY.known * moved / skin)
    seen = np.maximum(squares / np.maximum(number, 1) - mean**2, 0) * np.maximum(AFFINITY.moved_m**2 / moved, 1)
    varied = counts * seen + AFFINITY.unknown * (AFFINITY.loose * mean) ** 2
    return one, other, 1 / (varied / (counts + AFFINITY.unknown) + AFFINITY.steady_m**2)


def _variances(points: Table, tracklet: np.ndarray, frames: np.ndarray, every: int) -> np.ndarray:
    """(N,) m², the variance of each tracklet's place, of all three axes together."""
    number, total, squares = np.zeros(every), np.zeros((every, 3)), np.zeros((every, 3))
    for part in blocks(len(frames), tracklet.shape[1]):
        own, places = tracklet[frames[part]], points[frames[part]]
        there = own >= 0
        own, places = own[there], places[there].astype(float)
        number += np.bincount(own, minlength=every)
        for axis in range(3):
            total[:, axis] += np.bincount(own, places[:, axis], every)
            squares[:, axis] += np.bincount(own, places[:, axis] ** 2, every)
    mean = total / np.maximum(number, 1)[:, None]
    return np.maximum(squares / np.maximum(number, 1)[:, None] - mean**2, 0).sum(axis=1)


def _windows(tracklet: np.ndarray, frames: np.ndarray) -> Iterator[np.ndarray]:
    """The frames (F,) in parts that have not too many tracklets."""
    begin = 0
    known: set[int] = set()
    for place, frame in enumerate(frames.tolist()):
        own = tracklet[frame]
        new = known.union(own[own >= 0].tolist())
        if len(new) > TRACKLETS_AT_ONCE and place > begin:
            yield frames[begin:place]
            begin, new = place, set(own[own >= 0].tolist())
        known = new
    if begin < len(frames):
        yield frames[begin:]


def _met(points: Table, tracklet: np.ndarray, frames: np.ndarray, every: int) -> tuple[np.ndarray, ...]:
    """Of tracklets that meet in some frames a number (E,) for each pair; in how many, distances and squares."""
    local = np.unique(tracklet[frames])
    local = local[local >= 0].astype(np.int64)
    size = len(local)
    number, total, squares = np.zeros((3, size * size))
    for frame in frames.tolist():
        own = np.searchsorted(local, tracklet[frame])
        lane = np.flatnonzero(tracklet[frame] >= 0)
        lane = lane[own[lane].argsort()]
        one, other = _every_two(len(lane))
        off = points[frame][lane][one] - points[frame][lane][other]
        square = off[:, 0] ** 2 + off[:, 1] ** 2 + off[:, 2] ** 2
        key = own[lane][one] * size + own[lane][other]
        number[key] += 1
        total[key] += np.sqrt(square)
        squares[key] += square
    met = np.flatnonzero(number)
    one, other = np.divmod(met, size)
    return (local[one] * every + local[other], *(table[met] for table in (number, total, squares)))


@lru_cache(maxsize=256)
def _every_two(count: int) -> tuple[np.ndarray, np.ndarray]:
    """The first and the second (K,) of every two of so many things."""
    return np.triu_indices(count, 1)
