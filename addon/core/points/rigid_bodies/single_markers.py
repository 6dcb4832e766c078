# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers on no rigid body: the tracklets that keep to their distances from the rigid bodies for the whole take."""

import numpy as np

from .model import RigidBodies

NEIGHBOURS = 8  # named markers that a tracklet is judged by
TOLD = 3  # distances that fix a point; more say partly the same
FAR_OFF = 8.0
WORTH = 0.5  # log odds a tracklet must have at least
LASTING = 0.1  # part of the take that a tracklet must last
LEAD = 2.0  # log odds that it must lead by, over other tracklets at the same time and over other markers
SEEN = 0.5  # part of a tracklet's frames in which its neighbours must be seen
ROOM = 0.5  # m, over which a point that is no marker may be anywhere


def find_loners(rigid_bodies: RigidBodies, named: np.ndarray, missing: np.ndarray, points: np.ndarray) -> np.ndarray:
    """For each of N tracklets (F, N, 3) m the marker (N,) that it surely is, -1 for none.

    `rigid bodies` has the ranges of the person's distances, `named` (F, M, 3) m are the markers known so far, NaN where not,
    and `missing` the indices of those that a tracklet may be.
    """
    odds = _odds(rigid_bodies, named, missing, points)
    there = np.isfinite(points[..., 0]).astype(float)
    together = (there.T @ there) > 0
    marker = np.full(points.shape[1], -1)
    for tracklet, row in enumerate(odds.T):
        if not np.isfinite(row).any() or there[:, tracklet].mean() < LASTING:
            continue
        leader = int(row.argmax())
        others = together[tracklet] & (np.arange(len(marker)) != tracklet)
        alternatives = np.concatenate([np.delete(row, leader), odds[leader, others]])
        if row[leader] >= WORTH and row[leader] - alternatives.max(initial=-np.inf) >= LEAD:
            marker[tracklet] = leader
    return marker


def _odds(rigid_bodies: RigidBodies, named: np.ndarray, missing: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(M, N) log odds of every tracklet being every missing marker, -inf where they cannot be told."""
    known = np.isfinite(named[..., 0]).any(axis=0)
    odds = np.full((len(known), points.shape[1]), -np.inf)
    width = rigid_bodies.high - rigid_bodies.low + 2 * rigid_bodies.slack
    for marker in missing:
        near = np.flatnonzero(known)
        near = near[np.argsort(width[marker, near])[:NEIGHBOURS]]
        if not len(near):
            continue
        for tracklet in range(points.shape[1]):
            frames = np.isfinite(points[:, tracklet, 0])
            distance = np.linalg.norm(named[frames][:, near] - points[frames, tracklet, None], axis=-1)
            seen = np.isfinite(distance)
            if not seen.any(axis=1).mean() > SEEN:
                continue
            breach = rigid_bodies.breach(np.where(seen, distance, 0), np.array(marker), near[None])
            told = np.log(np.maximum(ROOM / width[marker, near], 1)) - np.minimum(0.5 * breach**2, FAR_OFF)
            total = np.where(seen, told, 0).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
            some = seen.any(axis=0)
            odds[marker, tracklet] = total[some].sum() * min(1.0, TOLD / some.sum())
    return odds
