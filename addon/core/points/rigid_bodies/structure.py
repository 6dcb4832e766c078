# SPDX-License-Identifier: GPL-3.0-or-later
"""What is learned of how rigid bodies lie on a subject that holds for others too: not their forms, but their places.

How far rigid bodies are from each other, which meet in a joint and how far from it, and which way round the body is, by
the volumes that four of them span.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations

import numpy as np

from ...data.physical import MARKER_LIMITS
from ...data.takes import evenly_spread
from ...geometry.rigid import centre_of_rotation, in_axes, laid_on, pairwise_distances
from ...kernels import point_calls, stands_for
from .model import RIGID_BODY, RigidBodies

VOLUMES_AT_ONCE = 100_000  # volumes at once, of all frames together; small enough for the processor's own memory


def signed_volumes(one: np.ndarray, two: np.ndarray, three: np.ndarray, four: np.ndarray) -> np.ndarray:
    """(...) volumes of tetrahedra with corners (..., 3), in units of their sides; a mirror image has the other sign."""
    # Axis by axis: NumPy's own cross and norm take several times as long on vectors of three.
    corners = [np.moveaxis(corner, -1, 0) for corner in (one, two, three, four)]
    (ax, ay, az), (bx, by, bz), (cx, cy, cz) = (corner - corners[0] for corner in corners[1:])
    volume = (ay * bz - az * by) * cx + (az * bx - ax * bz) * cy + (ax * by - ay * bx) * cz
    sides = 1.0
    for start, end in combinations(corners, 2):
        along = end - start
        sides = sides * (along[0] ** 2 + along[1] ** 2 + along[2] ** 2)
    return volume / np.sqrt(np.sqrt(np.maximum(sides, 1e-36)))


def quad_volumes(place: np.ndarray) -> np.ndarray:
    """(G + 1,) * 4 the median signed volumes of any four of G things at place (F, G, 3) m, NaN where not seen.

    0 where they were never seen together, where one of the four is there twice, and for -1, which is none.
    """
    quads = np.array(list(combinations(range(place.shape[1]), 4)), int).reshape(-1, 4)
    volume = median_volumes(np.ascontiguousarray(np.moveaxis(place, 0, 2)), quads)
    table = np.zeros((place.shape[1] + 1,) * 4)
    for order in permutations(range(4)):
        table[tuple(quads[:, order].T)] = np.linalg.det(np.eye(4)[list(order)]) * volume
    return table


@stands_for(point_calls.median_volumes)
def median_volumes(place: np.ndarray, quads: np.ndarray) -> np.ndarray:
    """(Q,) the median volumes of quads (Q, 4) of different things at place (G, 3, F) m; 0 where never together."""
    size = max(VOLUMES_AT_ONCE // max(place.shape[2], 1), 1)
    corners = np.moveaxis(place, 1, 2)
    parts = [
        _median(signed_volumes(*(corners[corner] for corner in quads[first : first + size].T)))
        for first in range(0, len(quads), size)
    ]
    return np.concatenate([np.zeros(0), *parts])


def _median(values: np.ndarray) -> np.ndarray:
    """(Q,) the median of values (Q, F) that are not NaN, 0 where all are."""
    ascending = np.sort(values, axis=1)
    count = np.isfinite(ascending).sum(axis=1, keepdims=True)
    middle = np.maximum(np.concatenate([count - 1, count], axis=1) // 2, 0)
    found = np.take_along_axis(ascending, np.minimum(middle, values.shape[1] - 1), axis=1).mean(axis=1)
    return np.where(count[:, 0] > 0, found, 0.0)


class JOINT:
    """When two rigid bodies are taken to meet in a joint, and how subjects differ."""

    # root mean square, that rigid bodies with a joint between them may be off it, and a marker beside one may move
    # against it to be looked for on it: flesh on bone; across a joint it moves more
    max_miss_m: float = 0.025  # physical
    min_turn_rad: float = 0.15  # about, that rigid bodies must turn against each other to show a joint; physical: 9°
    # people's proportions, in parts of a distance on or between rigid bodies, and of a volume over its sides, besides
    # what plates put on by hand do
    proportions_sd: float = 0.08  # physical


STRUCTURE_FRAMES = 300  # of a subject that are learned from, evenly spread
JOINT_PULL = 0.05  # of a joint to the middles of its rigid bodies, along axes about which nothing turns
MIN_FRAMES = 20  # in which two rigid bodies must be seen to have a joint
FRAMES_OF_JOINT = 0.9  # part of them that a joint is found from, those that agree best: some trajectories go astray
MIDDLES_TAILS = [1.0, 99.0]  # per cent of a distance, between which its range is; beyond are outliers
MAX_MEMBERS = 7  # markers of a rigid body with those beside it, of which all correspondences are tried: 8 have 40,320
INDEPENDENT = 3  # distances that are all the evidence there is of a place; more are partly the same
MAX_COST = 8.0  # the most that one fact counts against, log likelihood: four standard deviations


@dataclass(frozen=True, eq=False)
class Joints:
    """Of every two of K rigid things, the point that is most constant in both."""

    miss: np.ndarray  # (K, K) m, root mean square, by which it is not; NaN where they were never seen together
    at: np.ndarray  # (K, K, 3) m, the point in the first one's axes
    turn: np.ndarray  # (K, K) rad, about, how far they turn against each other

    @property
    def arm(self) -> np.ndarray:
        """(K, K) m from the middle of the first to the point."""
        return np.linalg.norm(self.at, axis=2)

    @property
    def sure(self) -> np.ndarray:
        """(K, K) whether there is a joint: the two were seen together, turn enough to show it, and keep to it."""
        return (self.miss < JOINT.max_miss_m) & (self.turn > JOINT.min_turn_rad)


@dataclass(frozen=True, eq=False)
class Inner:
    """How n markers lie on a rigid body: its own `core` first, then those beside it that hardly move against it."""

    members: np.ndarray  # (n,) which markers
    core: int
    form: np.ndarray  # (n, 3) m, in the rigid body's axes, the middle of the core at 0
    # (n, K) m, how far they are from the middles of the rigid bodies, and how much that changes
    away: np.ndarray
    away_sd: np.ndarray
    # (C, K) signed volumes of three of them, in the order of `triples`, with those middles
    side: np.ndarray
    side_sd: np.ndarray

    @cached_property
    def lengths(self) -> np.ndarray:
        """(n, n) m, between the markers."""
        return pairwise_distances(self.form)


@dataclass(frozen=True, eq=False)
class Structure:
    """How K rigid bodies lie on a body."""

    # (K, K) m, the range of the distance between the middles of two rigid bodies, and slack (K, K) m beyond
    low: np.ndarray
    high: np.ndarray
    slack: np.ndarray
    # (Q, 4) rigid bodies whose middles tell left from right, with mean and sd (Q,) of their signed volume
    quads: np.ndarray
    volume: np.ndarray
    volume_sd: np.ndarray
    joints: Joints  # between the rigid bodies
    inner: tuple[Inner, ...]  # what is known within each rigid body
    markers: int  # M, of the set

    def __len__(self) -> int:
        return len(self.inner)


def unseen_is_nan() -> warnings.catch_warnings:
    """A context in which NumPy does not warn of means over nothing: what was never seen together is NaN, and meant."""
    return warnings.catch_warnings(action="ignore", category=RuntimeWarning)


def learn_structure(rigid_bodies: RigidBodies, subjects: Sequence[np.ndarray]) -> Structure:
    """The structure of labelled frames of each subject, (F, M, 3) m, NaN where missing."""
    with unseen_is_nan():
        frames = np.concatenate([points[evenly_spread(len(points), STRUCTURE_FRAMES)] for points in subjects])
        groups = [group[:MAX_MEMBERS] for group in rigid_bodies.members]
        poses = [laid_on(_centred(rigid_bodies.form[group]), frames[:, group]) for group in groups]
        turn, place = (np.stack(part, axis=1) for part in zip(*poses, strict=True))
        low, high = np.nanpercentile(pairwise_distances(place), MIDDLES_TAILS, axis=0)
        quads = np.array(list(combinations(range(len(poses)), 4)), int).reshape(-1, 4)
        volumes = signed_volumes(*(place[:, quads[:, corner]] for corner in range(4)))
        mean, spread = np.nanmean(volumes, axis=0), np.hypot(np.nanstd(volumes, axis=0), JOINT.proportions_sd)
        telling = np.abs(mean) > spread
        single = np.setdiff1d(np.arange(frames.shape[1]), np.concatenate(groups))
        inner = [
            _learn_inner(rigid_bodies, group, single, frames, turn[:, index], place[:, index], place)
            for index, group in enumerate(groups)
        ]
        return Structure(
            low,
            high,
            between_subjects((low + high) / 2) + RIGID_BODY.slack_range * (high - low),
            quads[telling],
            mean[telling],
            spread[telling],
            find_joints(turn, place),
            tuple(inner),
            frames.shape[1],
        )


def between_subjects(distance: np.ndarray) -> np.ndarray:
    """m, how much a distance, m, differs from one subject's to another's."""
    return MARKER_LIMITS.placed_m + JOINT.proportions_sd * distance


def length_spread(lengths: np.ndarray) -> np.ndarray:
    """The standard deviation, m, of lengths, m, within a rigid body, from one subject's to another's."""
    return np.hypot(MARKER_LIMITS.placed_m, JOINT.proportions_sd * lengths)


def _centred(form: np.ndarray) -> np.ndarray:
    return form - form.mean(axis=0)


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
        if seen.sum() < MIN_FRAMES:
            continue
        both = np.ix_(seen, [one, two])
        middles = np.zeros((2, 3))
        (at[one, two], at[two, one]), off = centre_of_rotation(
            turn[both], place[both], middles, JOINT_PULL, FRAMES_OF_JOINT
        )
        mean = (np.swapaxes(turn[seen, one], 1, 2) @ turn[seen, two]).mean(axis=0)
        miss[one, two] = miss[two, one] = off
        bend[one, two] = bend[two, one] = np.sqrt(max(3 - np.linalg.norm(mean) ** 2, 0.0))
    return Joints(miss, at, bend)


def farther(markers: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(F, n, K) m, how far markers (F, n, 3) are from middles (F, K, 3)."""
    return np.linalg.norm(markers[:, :, None] - place[:, None], axis=-1)


def _learn_inner(
    rigid_bodies: RigidBodies, group: np.ndarray, single: np.ndarray, frames, turn, place, middles
) -> Inner:
    """What is known within a rigid body, `group`, with pose (F, 3, 3) and (F, 3), and of `single` markers beside it."""
    local = in_axes(turn, place, frames[:, single])
    spread = np.sqrt(np.nanvar(local, axis=0).sum(axis=1)) if len(single) else np.zeros(0)
    order = np.argsort(spread)
    beside = order[spread[order] < JOINT.max_miss_m][: max(MAX_MEMBERS - len(group), 0)]
    members = np.concatenate([group, single[beside]]).astype(int)
    markers = frames[:, members]
    distance = farther(markers, middles)
    volumes = rigid_body_volumes(markers, triples(len(members)), middles)
    # Of the whole rigid body: that one marker's distance hardly changed says more of the takes than of the body.
    change = np.nanvar(distance - np.nanmean(distance, axis=1, keepdims=True), axis=0).mean(axis=0, keepdims=True)
    return Inner(
        members,
        len(group),
        np.concatenate([_centred(rigid_bodies.form[group]), np.nanmean(local[:, beside], axis=0)]),
        np.nanmean(distance, axis=0),
        np.broadcast_to(np.sqrt(change), (len(members), middles.shape[1])),
        np.nanmean(volumes, axis=0),
        np.hypot(np.nanstd(volumes, axis=0), JOINT.proportions_sd),
    )


def rigid_body_volumes(markers: np.ndarray, chosen: np.ndarray, place: np.ndarray) -> np.ndarray:
    """(F, C, K) signed volumes of triples (C, 3) of markers (F, n, 3) with the middles (F, K, 3)."""
    one, two, three = (markers[:, chosen[:, corner], None] for corner in range(3))
    return signed_volumes(one, two, three, place[:, None])
