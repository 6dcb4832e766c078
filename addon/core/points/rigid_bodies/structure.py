# SPDX-License-Identifier: GPL-3.0-or-later
"""What is learned of how rigid bodies lie on a body that holds for other people too: not the form of a rigid body, but its place.

How far rigid bodies are from each other, which meet in a joint and how far from it, and which way round the body is.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations

import numpy as np

from ...geometry.rigid import MIN_POINTS, laid_on
from .model import RigidBodies

FRAMES = 300  # of a subject that are learned from
ENDS = 1.0  # per cent of a distance's range left out at either end
SLACK_LENGTH, SLACK_SHARE, SLACK_RANGE = 0.025, 0.08, 0.2  # m, of the distance, of its range: what people differ by
LEAST_VOLUME_SD = 0.05
PLACED_SD = 0.004  # m by which a marker put on elsewhere changes the volumes of its triples, in their sides
TELLING = 1.5  # standard deviations from 0 of a volume that tells a body from its mirror image
LINKED = 0.025  # m that rigid bodies with a joint between them may be off it, root mean square
LEAST_TURN = 0.15  # rad, about, that rigid bodies must turn against each other to tell a joint
JOINT_PULL = 0.05  # draws a joint to its rigid bodies along axes about which nothing turns
JOINT_KEPT = 0.9  # part of the frames that a joint is found from
LEAST_FRAMES = 20
FIRM, FIRMER = 0.004, 3.0  # m, and times the usual, that a rigid body's own markers may move against each other
BESIDE = 0.03  # m that a marker on no rigid body may move against one, root mean square, to be looked for on it
MOST_MEMBERS = 7  # markers of a rigid body with those beside it


@dataclass(frozen=True, eq=False)
class Joints:
    """Of every two of K rigid things, the point that is most constant in both.

    miss  (K, K) m, root mean square, by which it is not; NaN where they were never seen together
    at    (K, K, 3) m, the point in the first one's axes
    turn  (K, K) rad, about, how far they turn against each other
    """

    miss: np.ndarray
    at: np.ndarray
    turn: np.ndarray

    @property
    def arm(self) -> np.ndarray:
        """(K, K) m from the middle of the first to the point."""
        return np.linalg.norm(self.at, axis=2)


@dataclass(frozen=True, eq=False)
class Inner:
    """How n markers lie on a rigid body: its own `core` first, then those beside it that hardly move against it.

    members        (n,) which markers
    form           (n, 3) m, in the rigid body's axes, the middle of the core at 0
    away, away_sd  (n, K) m, how far they are from the middles of the rigid bodies, and how much that changes
    side, side_sd  (C, K) signed volumes of three of them, in the order of `triples`, with those middles
    """

    members: np.ndarray
    core: int
    form: np.ndarray
    away: np.ndarray
    away_sd: np.ndarray
    side: np.ndarray
    side_sd: np.ndarray


@dataclass(frozen=True, eq=False)
class Structure:
    """How K rigid bodies lie on a body.

    low, high    (K, K) m, the range of the distance between the middles of two rigid bodies, and slack (K, K) m beyond
    quads        (Q, 4) rigid bodies whose middles tell left from right, with mean and sd (Q,) of their signed volume
    joints       between the rigid bodies; `linked` (K, K) is True where there is one
    inner        what is known within each rigid body
    markers      M, of the set
    """

    low: np.ndarray
    high: np.ndarray
    slack: np.ndarray
    quads: np.ndarray
    volume: np.ndarray
    volume_sd: np.ndarray
    joints: Joints
    linked: np.ndarray
    inner: tuple[Inner, ...]
    markers: int

    def __len__(self) -> int:
        return len(self.inner)


def unseen_is_nan() -> warnings.catch_warnings:
    """A context in which NumPy does not warn of means over nothing: what was never seen together is NaN, and meant."""
    return warnings.catch_warnings(action="ignore", category=RuntimeWarning)


def learn_structure(rigid_bodies: RigidBodies, subjects: Sequence[np.ndarray]) -> Structure:
    """The structure of labelled frames of each subject, (F, M, 3) m, NaN where missing."""
    with unseen_is_nan():
        return _learn(rigid_bodies, subjects)


def _learn(rigid_bodies: RigidBodies, subjects: Sequence[np.ndarray]) -> Structure:
    frames = np.concatenate([points[:: max(len(points) // FRAMES, 1)] for points in subjects])
    groups = [_firm(group, frames) for group in rigid_bodies.groups]
    poses = [
        laid_on(rigid_bodies.form[group] - rigid_bodies.form[group].mean(axis=0), frames[:, group]) for group in groups
    ]
    turn, place = (np.stack(part, axis=1) for part in zip(*poses, strict=True))
    distance = np.linalg.norm(place[:, :, None] - place[:, None], axis=-1)
    low, high = np.nanpercentile(distance, [ENDS, 100 - ENDS], axis=0)
    quads = np.array(list(combinations(range(len(poses)), 4)), int).reshape(-1, 4)
    volumes = signed_volumes(*(place[:, quads[:, corner]] for corner in range(4)))
    mean, spread = np.nanmean(volumes, axis=0), np.hypot(np.nanstd(volumes, axis=0), LEAST_VOLUME_SD)
    telling = np.abs(mean) > TELLING * spread
    joints = find_joints(turn, place)
    lone = np.setdiff1d(np.arange(frames.shape[1]), np.concatenate(groups))
    inner = [
        _learn_inner(rigid_bodies, group, lone, frames, turn[:, index], place[:, index], place)
        for index, group in enumerate(groups)
    ]
    return Structure(
        low,
        high,
        SLACK_LENGTH + SLACK_SHARE * (low + high) / 2 + SLACK_RANGE * (high - low),
        quads[telling],
        mean[telling],
        spread[telling],
        joints,
        (joints.miss < LINKED) & (joints.turn > LEAST_TURN),
        tuple(inner),
        frames.shape[1],
    )


def _firm(group: np.ndarray, frames: np.ndarray) -> np.ndarray:
    """The markers of a rigid body without those that move against the rest, such as one on the joint below."""
    markers = frames[:, group]
    spread = np.nanstd(np.linalg.norm(markers[:, :, None] - markers[:, None], axis=-1), axis=0)
    loose = np.median(spread, axis=0)
    firm = loose < max(FIRM, FIRMER * np.median(loose))
    return group[firm] if firm.sum() >= MIN_POINTS else group


def signed_volumes(one: np.ndarray, two: np.ndarray, three: np.ndarray, four: np.ndarray) -> np.ndarray:
    """(...) volumes of tetrahedra with corners (..., 3), in units of their sides; a mirror image has the other sign."""
    corners = np.broadcast_arrays(one, two, three, four)
    volume = np.einsum("...i,...i->...", np.cross(two - one, three - one), four - one)
    sides = [np.linalg.norm(a - b, axis=-1) for a, b in combinations(corners, 2)]
    return volume / np.sqrt(np.maximum(np.prod(sides, axis=0), 1e-18))


def triples(count: int) -> np.ndarray:
    """(C, 3) all triples of a rigid body's markers."""
    return np.array(list(combinations(range(count), 3)))


def find_joints(turn: np.ndarray, place: np.ndarray) -> Joints:
    """The joints of K rigid things, (F, K, 3, 3) and (F, K, 3) m, NaN where not seen."""
    count = turn.shape[1]
    miss, bend = np.full((2, count, count), np.nan)
    at = np.full((count, count, 3), np.nan)
    for one, two in combinations(range(count), 2):
        seen = np.isfinite(place[:, one, 0]) & np.isfinite(place[:, two, 0])
        if seen.sum() >= LEAST_FRAMES:
            found = _joint(turn[seen, one], place[seen, one], turn[seen, two], place[seen, two])
            miss[one, two], at[one, two], at[two, one], bend[one, two] = found
            miss[two, one], bend[two, one] = miss[one, two], bend[one, two]
    return Joints(miss, at, bend)


def _joint(turn, place, other_turn, other_place) -> tuple[float, np.ndarray, np.ndarray, float]:
    """How far the best joint is off, where it is in the axes of either, and how far the two turn; least squares."""
    between = np.swapaxes(turn, 1, 2) @ other_turn
    apart = np.einsum("fji,fj->fi", turn, other_place - place)
    matrix = np.concatenate([np.broadcast_to(np.eye(3), between.shape), -between], axis=2)
    kept = np.ones(len(apart), dtype=bool)
    for _ in range(2):
        normal = np.einsum("fji,fjk->ik", matrix[kept], matrix[kept]) / kept.sum()
        right = np.einsum("fji,fj->i", matrix[kept], apart[kept]) / kept.sum()
        point = np.linalg.solve(normal + JOINT_PULL**2 * np.eye(6), right)
        off = np.linalg.norm(matrix @ point - apart, axis=1)
        # A trajectory that goes astray takes its whole rigid body with it; the joint is what most frames say.
        kept = off <= np.quantile(off, JOINT_KEPT)
    miss = np.sqrt((off[kept] ** 2).mean())
    bend = np.sqrt(max(3 - np.linalg.norm(between.mean(axis=0)) ** 2, 0.0))
    return float(miss), point[:3], point[3:], float(bend)


def farther(markers: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(F, n, K) m, how far markers (F, n, 3) are from middles (F, K, 3)."""
    return np.linalg.norm(markers[:, :, None] - place[:, None], axis=-1)


def _learn_inner(rigid_bodies: RigidBodies, group: np.ndarray, lone: np.ndarray, frames, turn, place, middles) -> Inner:
    """What is known within one rigid body, `group`, with pose (F, 3, 3) and (F, 3), and those of the `lone` beside it."""
    local = np.einsum("fji,fnj->fni", turn, frames[:, lone] - place[:, None])
    spread = np.sqrt(np.nanvar(local, axis=0).sum(axis=1)) if len(lone) else np.zeros(0)
    order = np.argsort(spread)
    beside = order[spread[order] < BESIDE][: max(MOST_MEMBERS - len(group), 0)]
    members = np.concatenate([group, lone[beside]]).astype(int)
    form = rigid_bodies.form[group] - rigid_bodies.form[group].mean(axis=0)
    markers = frames[:, members]
    distance = farther(markers, middles)
    volumes = rigid_body_volumes(markers, triples(len(members)), middles)
    # Of the whole rigid body: that one marker's distance hardly changed says more of the takes than of the body.
    change = np.nanvar(distance - np.nanmean(distance, axis=1, keepdims=True), axis=0).mean(axis=0, keepdims=True)
    return Inner(
        members,
        len(group),
        np.concatenate([form, np.nanmean(local[:, beside], axis=0)]),
        np.nanmean(distance, axis=0),
        np.broadcast_to(np.sqrt(change), (len(members), middles.shape[1])),
        np.nanmean(volumes, axis=0),
        np.hypot(np.nanstd(volumes, axis=0), _placement(markers)[:, None]),
    )


def _placement(markers: np.ndarray) -> np.ndarray:
    """(C,) how much the volumes of triples of markers (F, n, 3) change by how people put them on: small ones more."""
    chosen = triples(markers.shape[1])
    sides = [
        np.linalg.norm(markers[:, chosen[:, a]] - markers[:, chosen[:, b]], axis=2) for a, b in ((0, 1), (1, 2), (2, 0))
    ]
    return np.hypot(LEAST_VOLUME_SD, PLACED_SD / np.nanmean(sides, axis=(0, 1)))


def rigid_body_volumes(markers: np.ndarray, chosen: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(F, C, K) signed volumes of triples (C, 3) of markers (F, n, 3) with the middles (F, K, 3)."""
    one, two, three = (markers[:, chosen[:, corner], None] for corner in range(3))
    return signed_volumes(one, two, three, place[:, None])
