# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers on no rigid body: the tracklets that keep to their distances from the rigid bodies for the whole take."""

from dataclasses import dataclass

import numpy as np

from .model import RigidBodies
from .structure import INDEPENDENT, MAX_COST


@dataclass(frozen=True)
class SingleMarkerOptions:
    """When a tracklet is a marker on no rigid body, in log odds.

    min_lead       that it must lead by, over other tracklets at the same time and over other markers; measured on the
                   raw take S09_KneeltoRun02
    room_m         over which a point that is no marker may be anywhere; physical: about a limb
    """

    min_lead: float = 2.0
    room_m: float = 0.5


SINGLE_MARKER = SingleMarkerOptions()
JUDGES = 8  # named markers that a tracklet is judged by


def find_single_markers(
    rigid_bodies: RigidBodies,
    named: np.ndarray,
    missing: np.ndarray,
    points: np.ndarray,
) -> np.ndarray:
    """For each of N tracklets (F, N, 3) m the marker (N,) that it surely is, -1 for none.

    `rigid_bodies` has the ranges of the subject's distances, `named` (F, M, 3) m are the markers known so far, NaN
    where not, and `missing` the indices of those that a tracklet may be.
    """
    odds = _odds(rigid_bodies, named, missing, points)
    there = np.isfinite(points[..., 0]).astype(float)
    together = (there.T @ there) > 0
    marker = np.full(points.shape[1], -1)
    for tracklet, row in enumerate(odds.T):
        if not np.isfinite(row).any():
            continue
        leader = int(row.argmax())
        others = together[tracklet] & (np.arange(len(marker)) != tracklet)
        alternatives = np.concatenate([np.delete(row, leader), odds[leader, others]])
        if row[leader] > 0 and row[leader] - alternatives.max(initial=-np.inf) >= SINGLE_MARKER.min_lead:
            marker[tracklet] = leader
    return marker


def _odds(rigid_bodies: RigidBodies, named: np.ndarray, missing: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(M, N) log odds of every tracklet being every missing marker, -inf where nothing says."""
    known = np.flatnonzero(np.isfinite(named[..., 0]).any(axis=0))
    odds = np.full((named.shape[1], points.shape[1]), -np.inf)
    if not len(known) or not len(missing):
        return odds
    width = rigid_bodies.high - rigid_bodies.low + 2 * rigid_bodies.slack
    place = np.argsort(width[np.ix_(missing, known)], axis=1)[:, :JUDGES]
    near = missing[:, None], known[place]
    gain = np.log(np.maximum(SINGLE_MARKER.room_m / width[near], 1))
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
