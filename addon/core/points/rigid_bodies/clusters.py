# SPDX-License-Identifier: GPL-3.0-or-later
"""Clusters of trajectories in an unlabelled take that move rigidly, and which cluster is which rigid body.

They are found from how little their distances vary. Of all ways to assign them to rigid bodies the likeliest is taken,
with how far it leads.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from ...data.made import Table
from ...data.physical import MARKER_LIMITS
from ...data.takes import evenly_spread
from ...geometry.rigid import MIN_POINTS, in_axes, laid_on, pairwise_distances, rigid_clusters
from .model import RIGID_BODY, linking_order
from .structure import INDEPENDENT, JOINT, MAX_COST, Structure, find_joints, quad_volumes


class CLUSTER_MATCH:
    """What tracklets do that are one rigid thing, and what is worth, log likelihood, that it is a rigid body."""

    # of a rigid body that the take does not show as a cluster
    missing_cost: float = 9.0  # measured on the raw take S09_KneeltoRun02
    odd_marker_cost: float = 0.7  # what a marker more or fewer costs; measured on it
    joint_gain: float = 2.0  # what a joint is worth where it is as in training; measured on it


CLUSTERING_FRAMES = 500  # that a take is looked at in; more show the same
MIN_TRACKLET_S = 0.1  # of a tracklet that is looked at
LAYING_ROUNDS = 6  # of laying a cluster on its mean form; it is still before
MAX_SHARED = 0.05  # part of its frames that a tracklet may share with another of the same marker
NO_CLUSTER = -1
ASSIGNMENTS_KEPT = 2000  # assignments that are followed; by time
MAX_CLUSTERS = 40  # that are looked at, those that are seen longest; by memory
MAX_MARKERS = 12  # of a cluster that is looked at; by time
PERCENTILES = (2, 14, 26, 38, 50, 62, 74, 86, 98)  # of a distance over the take that are compared with its range


@dataclass(frozen=True, eq=False)
class Cluster:
    """n markers that move as one in F frames."""

    form: np.ndarray  # (n, 3) m, the markers in the cluster's own axes, their middle at 0
    tracklets: tuple[tuple[int, ...], ...]  # for each marker, the tracklets that are its
    # (F, 3, 3) and (F, 3) m, a marker is at turn @ form + place; NaN where too few are seen
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
    """Tracklets of trajectories in some of the take's frames."""

    frames: np.ndarray  # (F,) which, 0-based
    number: np.ndarray  # (N,) the tracklets' numbers
    points: np.ndarray  # (F, N, 3) m, NaN where a tracklet is not there


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
        spread[one, others] = np.where(mean > MARKER_LIMITS.trunk_m, 1.0, varies)
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
        best, nearest = None, RIGID_BODY.max_marker_m / 2
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
        form = np.where((known.any(axis=0) & (off < RIGID_BODY.max_marker_m))[:, None], mean, np.nan)
        if np.isfinite(form[:, 0]).sum() < MIN_POINTS:
            return None
    fine = np.flatnonzero(np.isfinite(form[:, 0]))
    centre = form[fine].mean(axis=0)
    tracklets = tuple(tuple(int(seen.number[own[one]]) for one in strings[index]) for index in fine)
    return Cluster(form[fine] - centre, tracklets, turn, place + turn @ centre)


@dataclass(frozen=True, eq=False)
class Matched:
    """Which cluster is which rigid body."""

    cluster: np.ndarray  # (K,) index of each rigid body's cluster, NO_CLUSTER where none is
    margin: np.ndarray  # (K,) how much less likely all is when the rigid body has another cluster, log odds


@dataclass(frozen=True, eq=False)
class _Likeness:
    """Log likelihoods of rigid bodies being clusters, `own` (K, G), and of two being two, `pair` (K, K, G, G).

    `volumes` are those of every four clusters, as `quad_volumes` has them.
    """

    own: np.ndarray
    pair: np.ndarray
    volumes: np.ndarray


def match_clusters(structure: Structure, clusters: Sequence[Cluster]) -> Matched:
    """The likeliest assignment of clusters to rigid bodies, found by a beam search, the best linked bodies first."""
    if not len(clusters):
        return Matched(np.full(len(structure), NO_CLUSTER), np.zeros(len(structure)))
    seen = [np.isfinite(cluster.place[:, 0]).sum() for cluster in clusters]
    longest = np.argsort(seen, kind="stable")[::-1][:MAX_CLUSTERS]
    states, score = _search(structure, _likeness(structure, [clusters[one] for one in longest]))
    best = states[0]
    alternatives = np.where(states != best, score[:, None], score.min()).max(axis=0)
    return Matched(np.append(longest, NO_CLUSTER)[best], np.where(best == NO_CLUSTER, 0.0, score[0] - alternatives))


def _likeness(structure: Structure, clusters: Sequence[Cluster]) -> _Likeness:
    turn, place = (np.stack([getattr(cluster, name) for cluster in clusters], axis=1) for name in ("turn", "place"))
    forms = [inner.form[: inner.core] for inner in structure.inner]
    own = np.array([[_form_fit(form, cluster.form) for cluster in clusters] for form in forms])
    pair = _distance_fit(structure, place) + _joint_fit(structure, turn, place)
    return _Likeness(own, pair, quad_volumes(place))


def _form_fit(form: np.ndarray, cluster: np.ndarray) -> float:
    """How well the distances in a cluster (n, 3) could be a rigid body's (m, 3), whatever marker is which."""
    small, large = sorted((form, cluster), key=len)
    if len(large) > MAX_MARKERS:
        return -MAX_COST
    chosen = np.array(list(combinations(range(len(large)), len(small))))
    between = pairwise_distances(large)[chosen[:, :, None], chosen[:, None]]
    best = ((_sorted_lengths(between) - _sorted_lengths(pairwise_distances(small))) ** 2).mean(axis=1).min()
    odd = CLUSTER_MATCH.odd_marker_cost * (len(large) - len(small))
    return -min(0.5 * best / MARKER_LIMITS.placed_m**2, MAX_COST) - odd


def _sorted_lengths(distance: np.ndarray) -> np.ndarray:
    """(..., n (n - 1) / 2) of distances (..., n, n), the shortest first."""
    one, other = np.triu_indices(distance.shape[-1], 1)
    return np.sort(distance[..., one, other], axis=-1)


def _distance_fit(structure: Structure, place: np.ndarray) -> np.ndarray:
    """(K, K, G, G) what the distances between clusters say; 0 where never seen together."""
    quantiles = np.nanpercentile(pairwise_distances(place), PERCENTILES, axis=0)
    low, high, slack = (table[:, :, None, None, None] for table in (structure.low, structure.high, structure.slack))
    breach = np.maximum(np.maximum(low - quantiles, quantiles - high), 0) / slack
    room = np.log(structure.high - structure.low + 2.5 * structure.slack)[:, :, None, None]
    fit = -np.minimum(0.5 * breach**2, MAX_COST).mean(axis=2) - room
    return np.where(np.isfinite(quantiles).all(axis=0), fit, 0)


def _joint_fit(structure: Structure, turn: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(K, K, G, G) what joints say: rigid bodies that have one need it, where it is in training."""
    seen = find_joints(turn, place)
    fit = np.zeros((len(structure), len(structure), *seen.miss.shape))
    for one, two in np.argwhere(structure.joints.sure):
        off = seen.miss - np.maximum(structure.joints.miss[one, two], JOINT.max_miss_m)
        cost = np.minimum(0.5 * (np.maximum(off, 0) / JOINT.max_miss_m) ** 2, MAX_COST)
        for arm, usual in ((seen.arm, structure.joints.arm[one, two]), (seen.arm.T, structure.joints.arm[two, one])):
            cost = cost + np.minimum(0.5 * ((arm - usual) / MARKER_LIMITS.lab_m) ** 2, MAX_COST / 2)
        fit[one, two] = np.where(
            np.isfinite(seen.miss) & (seen.turn > JOINT.min_turn_rad), CLUSTER_MATCH.joint_gain - cost, 0
        )
    return fit


def _search(structure: Structure, likeness: _Likeness) -> tuple[np.ndarray, np.ndarray]:
    """Assignments (B, K) and their log likelihoods (B,), the best first."""
    order = linking_order(structure.high - structure.low + np.where(structure.joints.sure, 0, 1.0))
    place = np.argsort(order)
    latest = place[structure.quads].max(axis=1) if len(structure.quads) else np.zeros(0, int)
    states, score = np.full((1, len(order)), NO_CLUSTER), np.zeros(1)
    clusters = likeness.own.shape[1]
    for step, rigid_body in enumerate(order):
        odds = _from_pairs(likeness, states, rigid_body, order[:step])
        odds += _from_volumes(structure, likeness, states, rigid_body, np.flatnonzero(latest == step))
        odds += likeness.own[rigid_body]
        for other in order[:step]:
            taken = np.flatnonzero(states[:, other] >= 0)
            odds[taken, states[taken, other]] = -np.inf
        total = np.concatenate([score[:, None] + odds, score[:, None] - CLUSTER_MATCH.missing_cost], axis=1).ravel()
        kept = np.argsort(-total, kind="stable")[:ASSIGNMENTS_KEPT]
        kept = kept[np.isfinite(total[kept])]
        states, score = states[kept // (clusters + 1)].copy(), total[kept]
        choice = kept % (clusters + 1)
        states[:, rigid_body] = np.where(choice < clusters, choice, NO_CLUSTER)
    return states, score


def _from_pairs(likeness: _Likeness, states: np.ndarray, rigid_body: int, earlier: list[int]) -> np.ndarray:
    """(B, G) what the clusters of earlier rigid bodies say of the clusters that the next may be."""
    odds = np.zeros((len(states), likeness.own.shape[1]))
    known = np.zeros((len(states), 1))
    for other in earlier:
        there = states[:, other]
        odds += np.where((there >= 0)[:, None], likeness.pair[rigid_body, other][:, np.maximum(there, 0)].T, 0)
        known += (there >= 0)[:, None]
    return odds * INDEPENDENT / np.maximum(known, INDEPENDENT)


def _from_volumes(structure: Structure, likeness: _Likeness, states, rigid_body: int, rows: np.ndarray) -> np.ndarray:
    """(B, G) log odds against the mirror image, of the quads in `rows`, whose last rigid body is the next."""
    clusters = likeness.own.shape[1]
    total, known = np.zeros((2, len(states), clusters))
    for row in rows:
        quad = structure.quads[row].tolist()
        others = states[:, [one for one in quad if one != rigid_body]]
        # Most states have the three that are named before in common.
        _, first, same = np.unique(others @ (clusters + 1) ** np.arange(3), return_index=True, return_inverse=True)
        corners = list(others[first].T[..., None])
        corners.insert(quad.index(rigid_body), np.arange(clusters)[None])
        volume = likeness.volumes[tuple(corners)]
        odds = mirror_odds(volume, structure.volume[row], structure.volume_sd[row])
        total += np.where(volume != 0, odds, 0)[same]
        known += (volume != 0)[same]
    return total * INDEPENDENT / np.maximum(known, INDEPENDENT)


def mirror_odds(volume: np.ndarray, mean: np.ndarray, spread: np.ndarray) -> np.ndarray:
    """Log likelihood of a signed volume, beside that of either it or its mirror image, each of MAX_COST at most."""
    right = -np.minimum(0.5 * ((volume - mean) / spread) ** 2, MAX_COST)
    wrong = -np.minimum(0.5 * ((volume + mean) / spread) ** 2, MAX_COST)
    return right - np.logaddexp(right, wrong) + np.log(2)
