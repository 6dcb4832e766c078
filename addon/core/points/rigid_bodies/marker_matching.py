# SPDX-License-Identifier: GPL-3.0-or-later
"""Which point of a group is which marker of its rigid body: the likeliest of all ways to put them, and how far it leads."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from .match import NO_GROUP, Matched, mirror_odds
from .steady import Group
from .structure import LEAST_TURN, LINKED, Inner, Joints, Structure, farther, find_joints, rigid_body_volumes, triples
from .ways import ABSENT, spread_of, ways_of

AWAY_SD = 0.015  # m that people differ by in how much farther one marker is than its rigid body
SWING = 0.4  # rad that a rigid body may be turned further than in training, in the mean over a take
INCOMPLETE = 6.0  # what a marker of the rigid body costs that no point is
FAR_OFF = 8.0
TOLD = 3  # rigid bodies that say all there is of where a marker is; more say partly the same
SIDES_TOLD = 6
TELLING = 1.0  # standard deviations of a volume's mean from 0 that make it worth asking


@dataclass(frozen=True, eq=False)
class Placed:
    """Which point of which group each marker is.

    rigid body, point  (M,) the rigid body and the index of the point in the rigid body's group, ABSENT where there is none
    margin        (M,) how much less likely the rigid body is where the marker is another point, log odds
    """

    rigid_body: np.ndarray
    point: np.ndarray
    margin: np.ndarray


def place_markers(structure: Structure, groups: Sequence[Group], matched: Matched) -> Placed:
    """The markers of every rigid body that has a group, and those beside it."""
    markers = structure.markers
    placed = Placed(np.full(markers, ABSENT), np.full(markers, ABSENT), np.zeros(markers))
    named = np.flatnonzero(matched.group != NO_GROUP)
    frames = len(groups[0].place) if groups else 0
    middles = np.full((frames, len(structure), 3), np.nan)
    turns = np.full((frames, len(structure), 3, 3), np.nan)
    for rigid_body in named:
        middles[:, rigid_body], turns[:, rigid_body] = (
            getattr(groups[matched.group[rigid_body]], name) for name in ("place", "turn")
        )
    joints = find_joints(turns, middles)
    for rigid_body in named:
        members = structure.inner[rigid_body].members
        point, margin = _one_plate(structure, rigid_body, groups[matched.group[rigid_body]], middles, joints)
        # A marker beside two rigid bodies is where it is surer.
        better = (point != ABSENT) & (margin > placed.margin[members])
        placed.rigid_body[members[better]], placed.point[members[better]] = rigid_body, point[better]
        placed.margin[members[better]] = margin[better]
    return placed


def _one_plate(
    structure: Structure, rigid_body: int, group: Group, middles, joints: Joints
) -> tuple[np.ndarray, np.ndarray]:
    """For each marker of the rigid body its point in the group, and the lead of that."""
    inner = structure.inner[rigid_body]
    ways = ways_of(inner.form, group.form)
    points = group.markers
    others = np.arange(len(structure)) != rigid_body
    score = _form_fit(inner, group.form, ways)
    score += _away_fit(inner, points, middles, others, ways)
    score += _joint_fit(structure, rigid_body, group.form, joints, ways)
    score += _side_fit(inner, points, middles, others, ways)
    best = int(score.argmax())
    chosen = ways[best]
    alternatives = np.where(ways != chosen, score[:, None], -np.inf).max(axis=0)
    return chosen, np.where(chosen >= 0, score[best] - alternatives, 0.0)


def _form_fit(inner: Inner, form: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """(W,) how well the lengths between points fit the rigid body's own, and how much of the rigid body there is."""
    wanted = np.linalg.norm(inner.form[:, None] - inner.form[None], axis=-1)
    lengths = np.linalg.norm(form[:, None] - form[None], axis=-1)
    there = (ways[:, :, None] >= 0) & (ways[:, None] >= 0)
    off = (lengths[ways[:, :, None], ways[:, None]] - wanted) / spread_of(wanted)
    cost = np.where(there, np.minimum(0.5 * off**2, FAR_OFF), 0).sum(axis=(1, 2)) / 2
    pairs = (there.sum(axis=(1, 2)) - (ways >= 0).sum(axis=1)) / 2
    return -cost * TOLD / np.maximum(pairs, TOLD) - INCOMPLETE * (ways[:, : inner.core] < 0).sum(axis=1)


def _away_fit(
    inner: Inner, points: np.ndarray, middles: np.ndarray, others: np.ndarray, ways: np.ndarray
) -> np.ndarray:
    """(W,) how well the points lie nearer to and farther from the other rigid bodies."""
    distance = farther(points, middles)
    seen = others & np.isfinite(distance).any(axis=(0, 1))
    away = np.nanmean(distance[:, :, seen], axis=0)
    swing = SWING * np.linalg.norm(inner.form, axis=1, keepdims=True)
    misfit = _misfit(away, inner.away[:, seen], np.sqrt(inner.away_sd[:, seen] ** 2 + AWAY_SD**2 + swing**2), ways)
    return -misfit.sum(axis=1) * TOLD / max(int(seen.sum()), TOLD)


def _misfit(found: np.ndarray, wanted: np.ndarray, spread: np.ndarray, ways: np.ndarray) -> np.ndarray:
    """(W, L) how ill distances (points, L) fit those that markers should have (markers, L), their means apart."""
    there = (ways >= 0)[..., None]
    count = np.maximum(there.sum(axis=1, keepdims=True), 1)
    found, wanted = found[ways], np.broadcast_to(wanted, (len(ways), *wanted.shape))
    found = found - np.where(there, found, 0).sum(axis=1, keepdims=True) / count
    wanted = wanted - np.where(there, wanted, 0).sum(axis=1, keepdims=True) / count
    return np.where(there, np.minimum(0.5 * ((found - wanted) / spread) ** 2, FAR_OFF), 0).sum(axis=1)


def _joint_fit(structure: Structure, rigid_body: int, form: np.ndarray, joints: Joints, ways: np.ndarray) -> np.ndarray:
    """(W,) how well the points lie towards the joints of the rigid body, which no pose changes."""
    known = structure.linked[rigid_body] & (joints.miss[rigid_body] < LINKED) & (joints.turn[rigid_body] > LEAST_TURN)
    wanted = farther(structure.inner[rigid_body].form[None], structure.joints.at[rigid_body][None, known])[0]
    found = farther(form[None], joints.at[rigid_body][None, known])[0]
    return -_misfit(found, wanted, np.array(AWAY_SD), ways).sum(axis=1)


def _side_fit(
    inner: Inner, points: np.ndarray, middles: np.ndarray, others: np.ndarray, ways: np.ndarray
) -> np.ndarray:
    """(W,) log odds against the mirror image of the rigid body."""
    chosen = triples(len(inner.members))
    score, told = np.zeros(len(ways)), np.zeros(len(ways))
    volume = _all_volumes(points, middles)
    for row, other in np.argwhere(others & (np.abs(inner.side) > TELLING * inner.side_sd)):
        corners = ways[:, chosen[row]]
        found = volume[(*np.maximum(corners, 0).T, other)]
        there = (corners >= 0).all(axis=1) & np.isfinite(found)
        score += np.where(
            there, mirror_odds(np.nan_to_num(found), inner.side[row, other], inner.side_sd[row, other]), 0
        )
        told += there
    return score * SIDES_TOLD / np.maximum(told, SIDES_TOLD)


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
