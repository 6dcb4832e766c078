# SPDX-License-Identifier: GPL-3.0-or-later
"""Which point of a cluster is which marker of its rigid body: the likeliest correspondence, and how far it leads."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from ...data.takes import NO_POINT
from .cluster_matching import NO_CLUSTER, Matched, mirror_odds
from .clustering import Cluster
from .correspondences import correspondences, spread_of
from .structure import Inner, Joints, Structure, farther, find_joints, rigid_body_volumes, triples


@dataclass(frozen=True)
class MarkerMatchOptions:
    """What says that a point is a marker of its rigid body, in log likelihood, and how much.

    Chosen with the raw take S09_KneeltoRun02 of the Clouthier recordings in sight, as docs/method.md says.

    distance_sd_m      that subjects differ by in how much farther one marker is than its rigid body
    swing_rad          that a rigid body may be turned further than in training, in the mean over a take
    missing_cost       what a marker of the rigid body costs that no point is
    max_cost           the most that one fact says against
    independent        rigid bodies, or lengths, that say all there is of a marker; more say partly the same
    independent_sides  volumes that say all there is of which side is which
    min_mirror_sds     standard deviations of a volume's mean from 0 that make it worth asking
    """

    distance_sd_m: float = 0.015
    swing_rad: float = 0.4
    missing_cost: float = 6.0
    max_cost: float = 8.0
    independent: int = 3
    independent_sides: int = 6
    min_mirror_sds: float = 1.0


MARKER_MATCH = MarkerMatchOptions()


@dataclass(frozen=True, eq=False)
class Placed:
    """Which point of which cluster each marker is.

    rigid_body, point  (M,) the rigid body and the index of the point in its cluster, NO_POINT where there is none
    margin             (M,) how much less likely the rigid body is where the marker is another point, log odds
    """

    rigid_body: np.ndarray
    point: np.ndarray
    margin: np.ndarray


def place_markers(
    structure: Structure, clusters: Sequence[Cluster], matched: Matched, options: MarkerMatchOptions = MARKER_MATCH
) -> Placed:
    """The markers of every rigid body that has a cluster, and those beside it."""
    markers = structure.markers
    placed = Placed(np.full(markers, NO_POINT), np.full(markers, NO_POINT), np.zeros(markers))
    named = np.flatnonzero(matched.cluster != NO_CLUSTER)
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
        point, margin = _match_one(structure, rigid_body, cluster, middles, joints, options)
        # A marker beside two rigid bodies is where it is surer.
        better = (point != NO_POINT) & (margin > placed.margin[members])
        placed.rigid_body[members[better]], placed.point[members[better]] = rigid_body, point[better]
        placed.margin[members[better]] = margin[better]
    return placed


def _match_one(
    structure: Structure, rigid_body: int, cluster: Cluster, middles, joints: Joints, options: MarkerMatchOptions
) -> tuple[np.ndarray, np.ndarray]:
    """For each marker of the rigid body its point in the cluster, and the lead of that."""
    inner = structure.inner[rigid_body]
    tried = correspondences(inner.form, cluster.form)
    points = cluster.markers
    others = np.arange(len(structure)) != rigid_body
    known = structure.linked[rigid_body] & joints.sure[rigid_body]
    meet = structure.joints.at[rigid_body, known], joints.at[rigid_body, known]
    away = _away_fit(inner, points, middles, others, tried, options)
    joint = _joint_fit(inner.form, cluster.form, *meet, tried, options)
    side = _side_fit(inner, points, middles, others, tried, options)
    score = _form_fit(inner, cluster.lengths, tried, options) + away + joint + side
    best = int(score.argmax())
    chosen = tried[best]
    alternatives = np.where(tried != chosen, score[:, None], -np.inf).max(axis=0)
    return chosen, np.where(chosen >= 0, score[best] - alternatives, 0.0)


def _form_fit(inner: Inner, lengths: np.ndarray, tried: np.ndarray, options: MarkerMatchOptions) -> np.ndarray:
    """(W,) how well the lengths (n, n) m between points fit the rigid body's own, and how much of it there is."""
    there = (tried[:, :, None] >= 0) & (tried[:, None] >= 0)
    off = (lengths[tried[:, :, None], tried[:, None]] - inner.lengths) / spread_of(inner.lengths)
    cost = np.where(there, np.minimum(0.5 * off**2, options.max_cost), 0).sum(axis=(1, 2)) / 2
    pairs = (there.sum(axis=(1, 2)) - (tried >= 0).sum(axis=1)) / 2
    missing = options.missing_cost * (tried[:, : inner.core] < 0).sum(axis=1)
    return -cost * options.independent / np.maximum(pairs, options.independent) - missing


def _away_fit(
    inner: Inner, points: np.ndarray, middles: np.ndarray, others: np.ndarray, tried: np.ndarray, options
) -> np.ndarray:
    """(W,) how well the points lie nearer to and farther from the other rigid bodies."""
    distance = farther(points, middles)
    seen = others & np.isfinite(distance).any(axis=(0, 1))
    away = np.nanmean(distance[:, :, seen], axis=0)
    swing = options.swing_rad * np.linalg.norm(inner.form, axis=1, keepdims=True)
    spread = np.sqrt(inner.away_sd[:, seen] ** 2 + options.distance_sd_m**2 + swing**2)
    cost = _costs(away, inner.away[:, seen], spread, tried, options.max_cost).sum(axis=1)
    return -cost * options.independent / max(int(seen.sum()), options.independent)


def _costs(found: np.ndarray, wanted: np.ndarray, spread: np.ndarray, tried: np.ndarray, max_cost: float) -> np.ndarray:
    """(W, L) how ill distances (points, L) fit those that markers should have (markers, L), but for their means."""
    there = (tried >= 0)[..., None]
    count = np.maximum(there.sum(axis=1, keepdims=True), 1)
    found, wanted = found[tried], np.broadcast_to(wanted, (len(tried), *wanted.shape))
    found = found - np.where(there, found, 0).sum(axis=1, keepdims=True) / count
    wanted = wanted - np.where(there, wanted, 0).sum(axis=1, keepdims=True) / count
    return np.where(there, np.minimum(0.5 * ((found - wanted) / spread) ** 2, max_cost), 0).sum(axis=1)


def _joint_fit(form, points, wanted, found, tried: np.ndarray, options: MarkerMatchOptions) -> np.ndarray:
    """(W,) how well points (n, 3) lie towards the joints `found` (L, 3), as form (m, 3) to `wanted`.

    No pose changes that.
    """
    away, usual = (farther(markers[None], joints[None])[0] for markers, joints in ((points, found), (form, wanted)))
    return -_costs(away, usual, np.array(options.distance_sd_m), tried, options.max_cost).sum(axis=1)


def _side_fit(
    inner: Inner, points: np.ndarray, middles: np.ndarray, others: np.ndarray, tried: np.ndarray, options
) -> np.ndarray:
    """(W,) log odds against the mirror image of the rigid body."""
    chosen = triples(len(inner.members))
    score, said = np.zeros(len(tried)), np.zeros(len(tried))
    volume = _all_volumes(points, middles)
    for row, other in np.argwhere(others & (np.abs(inner.side) > options.min_mirror_sds * inner.side_sd)):
        corners = tried[:, chosen[row]]
        found = volume[(*np.maximum(corners, 0).T, other)]
        there = (corners >= 0).all(axis=1) & np.isfinite(found)
        usual = inner.side[row, other], inner.side_sd[row, other]
        score += np.where(there, mirror_odds(np.nan_to_num(found), *usual, options.max_cost), 0)
        said += there
    return score * options.independent_sides / np.maximum(said, options.independent_sides)


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
