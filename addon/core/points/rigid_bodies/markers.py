# SPDX-License-Identifier: GPL-3.0-or-later
"""Which points are which markers: of a cluster, those of its rigid body; of the rest, those that keep their distances.

Within a cluster the likeliest correspondence is taken, with how far it leads. A marker on no rigid body is the tracklet
that keeps to its distances from the rigid bodies for the whole take.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from ...data.physical import MARKER_LIMITS
from ...data.takes import NO_POINT
from .clusters import NO_CLUSTER, Cluster, Matched, mirror_odds
from .model import RigidBodies
from .structure import (
    INDEPENDENT,
    MAX_COST,
    MAX_MEMBERS,
    Inner,
    Joints,
    Structure,
    farther,
    find_joints,
    length_spread,
    rigid_body_volumes,
    triples,
)


class MARKER_MATCH:
    """What is worth that a point is a marker of its rigid body, log likelihood, or a tracklet one on none, log odds."""

    # that a rigid body may be turned further than in training, in the mean over a take
    swing_rad: float = 0.4  # physical: 23°
    # what a marker of the rigid body costs that no point is
    missing_cost: float = 6.0  # measured on the raw take S09_KneeltoRun02
    # that a rigid body's cluster, a point and a tracklet must lead by over what else they may be; with 5 of a point the
    # raw take S09_KneeltoRun02 has 56 markers and not 58, made up people in other plates have as many wrong
    min_lead: float = 3.0  # measured


INDEPENDENT_SIDES = 2 * INDEPENDENT  # volumes that are all the evidence of which side is which
JUDGES = 8  # named markers that a tracklet is judged by


@dataclass(frozen=True, eq=False)
class Placed:
    """Which point of which cluster each marker is."""

    # (M,) the rigid body and the index of the point in its cluster, NO_POINT where there is none
    rigid_body: np.ndarray
    point: np.ndarray
    margin: np.ndarray  # (M,) how much less likely the rigid body is where the marker is another point, log odds


def place_markers(structure: Structure, clusters: Sequence[Cluster], matched: Matched) -> Placed:
    """The markers of every rigid body that has a cluster, and those beside it."""
    markers = structure.markers
    placed = Placed(np.full(markers, NO_POINT), np.full(markers, NO_POINT), np.zeros(markers))
    named = np.flatnonzero(matched.cluster != NO_CLUSTER).tolist()
    frames = len(clusters[0].place) if clusters else 0
    middles = np.full((frames, len(structure), 3), np.nan)
    turns = np.full((frames, len(structure), 3, 3), np.nan)
    for rigid_body in named:
        middles[:, rigid_body], turns[:, rigid_body] = (
            getattr(clusters[matched.cluster[rigid_body]], name) for name in ("place", "turn")
        )
    joints = find_joints(turns, middles)
    for rigid_body in named:
        members = structure.inner[rigid_body].members
        cluster = clusters[matched.cluster[rigid_body]]
        point, margin = _match_one(structure, rigid_body, cluster, middles, joints)
        # A marker beside two rigid bodies is where it is surer.
        better = (point != NO_POINT) & (margin > placed.margin[members])
        placed.rigid_body[members[better]], placed.point[members[better]] = rigid_body, point[better]
        placed.margin[members[better]] = margin[better]
    return placed


def _match_one(
    structure: Structure, rigid_body: int, cluster: Cluster, middles, joints: Joints
) -> tuple[np.ndarray, np.ndarray]:
    """For each marker of the rigid body its point in the cluster, and the lead of that."""
    inner = structure.inner[rigid_body]
    tried = correspondences(len(inner.form), cluster.form)
    points = cluster.markers
    others = np.arange(len(structure)) != rigid_body
    known = structure.joints.sure[rigid_body] & joints.sure[rigid_body]
    meet = structure.joints.at[rigid_body, known], joints.at[rigid_body, known]
    away = _away_fit(inner, points, middles, others, tried)
    joint = _joint_fit(inner.form, cluster.form, *meet, tried)
    side = _side_fit(inner, points, middles, others, tried)
    score = _form_fit(inner, cluster.lengths, tried) + away + joint + side
    best = int(score.argmax())
    chosen = tried[best]
    alternatives = np.where(tried != chosen, score[:, None], -np.inf).max(axis=0)
    return chosen, np.where(chosen >= 0, score[best] - alternatives, 0.0)


def correspondences(markers: int, points: np.ndarray) -> np.ndarray:
    """(W, n) all ways in which points (p, 3) m may be n markers of a rigid body: indices, NO_POINT where one has none.

    Of the points those nearest to their middle, as many as all ways can be tried of.
    """
    near = np.argsort(np.linalg.norm(points, axis=1), kind="stable")[:MAX_MEMBERS]
    if len(near) >= markers:
        return near[np.array(list(permutations(range(len(near)), markers)))]
    taken = np.array(list(permutations(range(markers), len(near))))
    tried = np.full((len(taken), markers), NO_POINT)
    np.put_along_axis(tried, taken, near[None], axis=1)
    return tried


def _form_fit(inner: Inner, lengths: np.ndarray, tried: np.ndarray) -> np.ndarray:
    """(W,) how well the lengths (n, n) m between points fit the rigid body's own, and how much of it there is."""
    there = (tried[:, :, None] >= 0) & (tried[:, None] >= 0)
    off = (lengths[tried[:, :, None], tried[:, None]] - inner.lengths) / length_spread(inner.lengths)
    cost = np.where(there, np.minimum(0.5 * off**2, MAX_COST), 0).sum(axis=(1, 2)) / 2
    pairs = (there.sum(axis=(1, 2)) - (tried >= 0).sum(axis=1)) / 2
    missing = MARKER_MATCH.missing_cost * (tried[:, : inner.core] < 0).sum(axis=1)
    return -cost * INDEPENDENT / np.maximum(pairs, INDEPENDENT) - missing


def _away_fit(
    inner: Inner, points: np.ndarray, middles: np.ndarray, others: np.ndarray, tried: np.ndarray
) -> np.ndarray:
    """(W,) how well the points lie nearer to and farther from the other rigid bodies."""
    distance = farther(points, middles)
    seen = others & np.isfinite(distance).any(axis=(0, 1))
    away = np.nanmean(distance[:, :, seen], axis=0)
    swing = MARKER_MATCH.swing_rad * np.linalg.norm(inner.form, axis=1, keepdims=True)
    spread = np.sqrt(inner.away_sd[:, seen] ** 2 + MARKER_LIMITS.placed_m**2 + swing**2)
    cost = _costs(away, inner.away[:, seen], spread, tried).sum(axis=1)
    return -cost * INDEPENDENT / max(int(seen.sum()), INDEPENDENT)


def _costs(found: np.ndarray, wanted: np.ndarray, spread: np.ndarray, tried: np.ndarray) -> np.ndarray:
    """(W, L) how ill distances (points, L) fit those that markers should have (markers, L), but for their means."""
    there = (tried >= 0)[..., None]
    count = np.maximum(there.sum(axis=1, keepdims=True), 1)
    found, wanted = found[tried], np.broadcast_to(wanted, (len(tried), *wanted.shape))
    found = found - np.where(there, found, 0).sum(axis=1, keepdims=True) / count
    wanted = wanted - np.where(there, wanted, 0).sum(axis=1, keepdims=True) / count
    return np.where(there, np.minimum(0.5 * ((found - wanted) / spread) ** 2, MAX_COST), 0).sum(axis=1)


def _joint_fit(form, points, wanted, found, tried: np.ndarray) -> np.ndarray:
    """(W,) how well points (n, 3) lie towards the joints `found` (L, 3), as form (m, 3) to `wanted`.

    No pose changes that.
    """
    away, usual = (farther(markers[None], joints[None])[0] for markers, joints in ((points, found), (form, wanted)))
    return -_costs(away, usual, np.array(MARKER_LIMITS.placed_m), tried).sum(axis=1)


def _side_fit(
    inner: Inner, points: np.ndarray, middles: np.ndarray, others: np.ndarray, tried: np.ndarray
) -> np.ndarray:
    """(W,) log odds against the mirror image of the rigid body."""
    chosen = triples(len(inner.members))
    score, asked = np.zeros(len(tried)), np.zeros(len(tried))
    volume = _all_volumes(points, middles)
    for row, other in np.argwhere(others & (np.abs(inner.side) > inner.side_sd)):
        corners = tried[:, chosen[row]]
        found = volume[(*np.maximum(corners, 0).T, other)]
        there = (corners >= 0).all(axis=1) & np.isfinite(found)
        usual = inner.side[row, other], inner.side_sd[row, other]
        score += np.where(there, mirror_odds(np.nan_to_num(found), *usual), 0)
        asked += there
    return score * INDEPENDENT_SIDES / np.maximum(asked, INDEPENDENT_SIDES)


def _all_volumes(points: np.ndarray, middles: np.ndarray) -> np.ndarray:
    """(n, n, n, K) median signed volume of every three points with every middle, whatever their order."""
    count = points.shape[1]
    table = np.full((count, count, count, middles.shape[1]), np.nan)
    if count < 3:
        return table
    chosen = triples(count)
    volume = np.nanmedian(rigid_body_volumes(points, chosen, middles), axis=0)
    for order in permutations(range(3)):
        sign = np.linalg.det(np.eye(3)[list(order)])
        table[tuple(chosen[:, order].T)] = sign * volume
    return table


def find_single_markers(
    rigid_bodies: RigidBodies,
    named: np.ndarray,
    missing: np.ndarray,
    points: np.ndarray,
) -> np.ndarray:
    """For each of N tracklets (F, N, 3) m the marker (N,) that it surely is, -1 for none.

    `rigid_bodies` has the ranges of distances, `named` (F, M, 3) m are the markers known so far, NaN where not, and
    `missing` the indices of those that a tracklet may be.
    """
    odds = _single_odds(rigid_bodies, named, missing, points)
    there = np.isfinite(points[..., 0]).astype(float)
    together = (there.T @ there) > 0
    marker = np.full(points.shape[1], -1)
    for tracklet, row in enumerate(odds.T):
        if not np.isfinite(row).any():
            continue
        leader = int(row.argmax())
        others = together[tracklet] & (np.arange(len(marker)) != tracklet)
        alternatives = np.concatenate([np.delete(row, leader), odds[leader, others]])
        if row[leader] > 0 and row[leader] - alternatives.max(initial=-np.inf) >= MARKER_MATCH.min_lead:
            marker[tracklet] = leader
    return marker


def _single_odds(rigid_bodies: RigidBodies, named: np.ndarray, missing: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(M, N) log odds of every tracklet being every missing marker, -inf where nothing says."""
    known = np.flatnonzero(np.isfinite(named[..., 0]).any(axis=0))
    odds = np.full((named.shape[1], points.shape[1]), -np.inf)
    if not len(known) or not len(missing):
        return odds
    width = rigid_bodies.high - rigid_bodies.low + 2 * rigid_bodies.slack
    place = np.argsort(width[np.ix_(missing, known)], axis=1)[:, :JUDGES]
    near = missing[:, None], known[place]
    gain = np.log(np.maximum(MARKER_LIMITS.limb_m / width[near], 1))
    for tracklet in range(points.shape[1]):
        frames = np.isfinite(points[:, tracklet, 0])
        every = np.linalg.norm(named[np.ix_(frames, known)] - points[frames, tracklet, None], axis=-1)
        distance = every[:, place]
        seen = np.isfinite(distance)
        enough = np.flatnonzero(2 * seen.any(axis=2).mean(axis=0) > 1)
        distance, seen = distance[:, enough], seen[:, enough]
        breach = rigid_bodies.breach(np.where(seen, distance, 0), missing[enough, None], known[place[enough]])
        odd = gain[enough] - np.minimum(0.5 * breach**2, MAX_COST)
        count = seen.sum(axis=0)
        mean = np.where(seen, odd, 0).sum(axis=0) / np.maximum(count, 1)
        some = (count > 0).sum(axis=1)
        odds[missing[enough], tracklet] = mean.sum(axis=1) * np.minimum(1.0, INDEPENDENT / some)
    return odds
