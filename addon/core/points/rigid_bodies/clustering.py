# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters of trajectories in an unlabelled take that move rigidly, found from how little their distances vary."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...data.made import Table
from ...data.physical import MARKER_LIMITS
from ...data.takes import evenly_spread
from ...geometry.rigid import MIN_POINTS, in_axes, laid_on, pairwise_distances, rigid_clusters


@dataclass(frozen=True)
class ClusteringOptions:
    """What tracklets must do to be taken for one rigid thing.

    max_size_m       the widest that a rigid body is; physical: a pelvis or a chest
    max_off_m        physical: a marker's width, which a tracklet may be off its place in the cluster, root mean square;
                     half of it in its distances from others, to go on as the marker of an earlier one
    """

    max_size_m: float = 0.4
    max_off_m: float = 0.01


CLUSTERING = ClusteringOptions()
CLUSTERING_FRAMES = 500  # that a take is looked at in; more show the same
MIN_TRACKLET_S = 0.1  # of a tracklet that is looked at
LAYING_ROUNDS = 6  # of laying a cluster on its mean form; it is still before
MAX_SHARED = 0.05  # part of its frames that a tracklet may share with another of the same marker


@dataclass(frozen=True, eq=False)
class Cluster:
    """n markers that move as one in F frames.

    form          (n, 3) m, the markers in the cluster's own axes, their middle at 0
    tracklets     for each marker, the tracklets that are its
    turn, place   (F, 3, 3) and (F, 3) m, a marker is at turn @ form + place; NaN where too few are seen
    """

    form: np.ndarray
    tracklets: tuple[tuple[int, ...], ...]
    turn: np.ndarray
    place: np.ndarray

    @property
    def markers(self) -> np.ndarray:
        """(F, n, 3) m, where the cluster has its markers, seen or not."""
        return np.einsum("fij,nj->fni", self.turn, self.form) + self.place[:, None]

    @cached_property
    def lengths(self) -> np.ndarray:
        """(n, n) m, between the markers."""
        return pairwise_distances(self.form)


@dataclass(frozen=True, eq=False)
class Sampled:
    """Tracklets of trajectories in some of the take's frames.

    frames  (F,) which, 0-based
    number  (N,) the tracklets' numbers
    points  (F, N, 3) m, NaN where a tracklet is not there
    """

    frames: np.ndarray
    number: np.ndarray
    points: np.ndarray


def sampled(points: Table, tracklet: np.ndarray, rate: float) -> Sampled:
    """The longer tracklets of a take: points (T, P, 3) m with the tracklet of each (T, P), -1 for none."""
    frame, column = np.nonzero(tracklet >= 0)
    number, place, count = np.unique(tracklet[frame, column], return_inverse=True, return_counts=True)
    long = count >= MIN_TRACKLET_S * rate
    frames = evenly_spread(len(points), CLUSTERING_FRAMES)
    row = np.full(len(points), -1)
    row[frames] = np.arange(len(frames))
    new = np.cumsum(long) - 1
    kept = long[place] & (row[frame] >= 0)
    xyz = np.full((len(frames), int(long.sum()), 3), np.nan)
    xyz[row[frame[kept]], new[place[kept]]] = points[frame[kept], column[kept]]
    return Sampled(frames, number[long], xyz)


def find_clusters(seen: Sampled) -> list[Cluster]:
    """Clusters of three markers or more that keep their distances."""
    spread, weight, mean = _deviations(seen.points)
    grown = [np.array(own) for own in rigid_clusters(spread, weight, MARKER_LIMITS.skin_m)]
    laid = [_laid(seen, own, mean) for own in grown if len(own) >= MIN_POINTS]
    return [cluster for cluster in laid if cluster is not None]


def _deviations(points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(N, N) m mean absolute deviation of every distance, (N, N) how many frames show it, and (N, N) m its mean."""
    count = points.shape[1]
    spread, weight = np.ones((count, count)), np.zeros((count, count))
    usual = np.full((count, count), np.nan)
    there = np.isfinite(points[..., 0])
    for one in range(count):
        own = np.flatnonzero(there[:, one])
        others = np.flatnonzero(there[own].any(axis=0))
        seen = points[np.ix_(own, others)]
        known = there[np.ix_(own, others)]
        frames = known.sum(axis=0)
        x, y, z = np.moveaxis(seen - points[own, one, None], 2, 0)
        distance = np.where(known, np.sqrt(x * x + y * y + z * z), 0)
        mean = distance.sum(axis=0) / frames
        varies = np.where(known, np.abs(distance - mean), 0).sum(axis=0) / frames
        spread[one, others] = np.where(mean > CLUSTERING.max_size_m, 1.0, varies)
        weight[one, others], usual[one, others] = frames, mean
    np.fill_diagonal(weight, 0)
    return spread, weight, usual


def _strung(points: np.ndarray, distance: np.ndarray) -> list[list[int]]:
    """Tracklets (F, n, 3) of a cluster, with their mean distances (n, n), strung to markers: one ends, one begins.

    Known by being equally far from two markers or more that both were seen with.
    """
    there = np.isfinite(points[..., 0])
    frames = there.sum(axis=0)
    strings: list[list[int]] = []
    for index in np.argsort(-frames, kind="stable"):
        best, nearest = None, CLUSTERING.max_off_m / 2
        for one in strings:
            off = np.abs(distance[one] - distance[index])
            off = off[:, np.isfinite(off).any(axis=0)]
            shared = _shared(there, one, index) > MAX_SHARED * frames[index]
            if not shared and off.shape[1] >= MIN_POINTS - 1 and np.nanmax(off) < nearest:
                best, nearest = one, float(np.nanmax(off))
        if best is None:
            strings.append([int(index)])
        else:
            best.append(int(index))
    return strings


def _shared(there: np.ndarray, several: list[int], one: int) -> int:
    """In how many frames, there (F, n), one tracklet is beside any of several."""
    return int((there[:, several].any(axis=1) & there[:, one]).sum())


def _first_seen(points: np.ndarray) -> np.ndarray:
    """(F, 3) in each frame the first of points (F, n, 3) that is there; NaN where none is."""
    place = np.isfinite(points[..., 0]).argmax(axis=1)
    return points[np.arange(len(points)), place]


def _laid(seen: Sampled, own: np.ndarray, distance: np.ndarray) -> Cluster | None:
    """What tracklets (n,) that move as one make; None where fewer than three markers hold together."""
    strings = _strung(seen.points[:, own], distance[np.ix_(own, own)])
    points = np.stack([_first_seen(seen.points[:, own[one]]) for one in strings], axis=1)
    form = points[np.isfinite(points[..., 0]).sum(axis=1).argmax()]
    for _ in range(LAYING_ROUNDS):
        turn, place = laid_on(form, points)
        local = in_axes(turn, place, points)
        known = np.isfinite(local[..., 0])
        count = np.maximum(known.sum(axis=0), 1)
        mean = np.where(known[..., None], local, 0).sum(axis=0) / count[:, None]
        off = np.sqrt((np.where(known[..., None], local - mean, 0) ** 2).sum(axis=(0, 2)) / count)
        form = np.where((known.any(axis=0) & (off < CLUSTERING.max_off_m))[:, None], mean, np.nan)
        if np.isfinite(form[:, 0]).sum() < MIN_POINTS:
            return None
    fine = np.flatnonzero(np.isfinite(form[:, 0]))
    centre = form[fine].mean(axis=0)
    tracklets = tuple(tuple(int(seen.number[own[one]]) for one in strings[index]) for index in fine)
    return Cluster(form[fine] - centre, tracklets, turn, place + turn @ centre)
