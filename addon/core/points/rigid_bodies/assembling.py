# SPDX-License-Identifier: GPL-3.0-or-later
"""Putting rigid bodies together: one placement each at most, no point twice, distances between rigid bodies as ever seen.

A beam search over the rigid bodies, those first that are best linked to the ones before; then the markers on no rigid body, and
those that were missed, by what their distances to the named ones allow.
"""

import numpy as np

from ..likelihood.naming import IMPOSSIBLE, NO_POINT, one_to_one
from ..likelihood.solving import Solved
from .model import RigidBodies
from .placing import Placements, distances, place

BEAM = 16
LINKED = 3  # earlier rigid bodies that a rigid body is compared with
STRETCHED = 8.0  # weight of the mean breach between two rigid bodies
STEADY = 0.1  # m that distances between rigid bodies vary by, up to which a link counts fully
LEAST_LINK = 0.15
LIMIT = 4.0  # the most that one breach costs
NEIGHBOURS = 8  # markers that a lone marker is judged by
SURE_OF_THREE = 3.0  # distances that fix a point; more say partly the same
LONE_WORTH = 1.0  # log odds a lone marker must have beside the number of points that it may be
ROOM = 1.0  # side of the cube that ghosts fill, in distances between markers
ROUNDS = 2


def assemble(rigid_bodies: RigidBodies, points: np.ndarray) -> Solved:
    """The best naming of frames of points (F, P, 3) m, NaN where there is none."""
    apart = distances(points)
    naming, score = _beam(rigid_bodies, points, apart)
    best = naming[:, 0]
    rival = np.where(naming[:, 1:] == best[:, None], -np.inf, (score[:, 1:] - score[:, :1])[..., None])
    margin = np.where(best >= 0, -rival.max(axis=1, initial=-50.0), 0)
    best, lone = _filled(rigid_bodies, apart, np.isfinite(points[..., 0]), best)
    margin = np.where(np.isfinite(lone), np.minimum(lone, np.where(margin > 0, margin, 50.0)), margin)
    return Solved(best, score[:, 0], np.where(best >= 0, margin, 0), np.ones(len(best)))


def rigid_body_order(rigid_bodies: RigidBodies) -> list[tuple[int, list[tuple[int, float]]]]:
    """The rigid bodies in the order of the search, each with earlier ones to compare it with and how much each counts.

    Rigid bodies that share a joint say more of each other than those that do not.
    """
    loose = np.array(
        [
            [
                np.partition((rigid_bodies.high - rigid_bodies.low)[np.ix_(a, b)].ravel(), 2)[2]
                for b in rigid_bodies.groups
            ]
            for a in rigid_bodies.groups
        ]
    )
    order = [int(np.argmin(np.sort(loose + 1e3 * np.eye(len(loose)), axis=1)[:, :2].sum(axis=1)))]
    while len(order) < len(loose):
        rest = [index for index in range(len(loose)) if index not in order]
        order.append(min(rest, key=lambda index: loose[index, order].min()))
    links = [sorted(order[:place], key=lambda other: loose[index, other])[:LINKED] for place, index in enumerate(order)]
    weights = [
        [(other, float(np.clip(STEADY / loose[index, other], LEAST_LINK, 1))) for other in others]
        for index, others in zip(order, links, strict=True)
    ]
    return list(zip(order, weights, strict=True))


def _beam(rigid_bodies: RigidBodies, points: np.ndarray, apart: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Namings (F, B, M) and scores (F, B) of the best B, the best first."""
    frames, count = points.shape[:2]
    naming = np.full((frames, 1, len(rigid_bodies.form)), NO_POINT)
    score = np.zeros((frames, 1))
    used = np.zeros((frames, 1, count + 1), dtype=bool)
    rows = np.arange(frames)[:, None]
    for index, links in rigid_body_order(rigid_bodies):
        group = rigid_bodies.groups[index]
        found = place(rigid_bodies, group, points, apart)
        total = score[:, :, None] + found.score[:, None]
        for other, weight in links:
            total = total + weight * _linked(rigid_bodies, group, rigid_bodies.groups[other], found, naming, apart)
        # A hidden marker's place is the column beyond the last point, which is never used up.
        slots = np.where(found.points >= 0, found.points, count)
        taken = used[rows[..., None, None], np.arange(naming.shape[1])[:, None, None], slots[:, None]].any(axis=3)
        total = np.where(taken, -np.inf, total)
        options = np.concatenate([total, score[:, :, None]], axis=2)
        width = options.shape[2]
        flat = options.reshape(frames, -1)
        top = np.argsort(-flat, axis=1, kind="stable")[:, :BEAM]
        score = np.take_along_axis(flat, top, axis=1)
        parent, choice = top // width, top % width
        naming, used = naming[rows, parent], used[rows, parent]
        padded = np.concatenate([slots, np.full((frames, 1, len(group)), count)], axis=1)
        chosen = padded[rows, choice]
        naming[:, :, group] = np.where(chosen < count, chosen, NO_POINT)
        np.put_along_axis(used, chosen, True, axis=2)
        used[:, :, count] = False
    return naming, score


def _linked(
    rigid_bodies: RigidBodies, group, other, found: Placements, naming: np.ndarray, apart: np.ndarray
) -> np.ndarray:
    """(F, B, K) what the distances to another rigid body, as the namings have it, say of a rigid body's placements."""
    there = naming[:, :, other]
    frame = np.arange(len(naming))[:, None, None, None, None]
    distance = apart[frame, np.maximum(there, 0)[:, :, None, :, None], np.maximum(found.points, 0)[:, None, :, None]]
    known = (there >= 0)[:, :, None, :, None] & (found.points >= 0)[:, None, :, None]
    breach = rigid_bodies.breach(np.where(known, distance, 0), other[:, None], group[None])
    cost = np.where(known, np.minimum(0.5 * breach**2, LIMIT), 0)
    return -STRETCHED * cost.sum(axis=(3, 4)) / np.maximum(known.sum(axis=(3, 4)), 1)


def _filled(rigid_bodies: RigidBodies, apart, present, naming) -> tuple[np.ndarray, np.ndarray]:
    """The naming with lone and missed markers named, and their lead (F, M) on the next best; NaN for others."""
    lone = np.full(naming.shape, np.nan)
    naming = naming.copy()
    for _ in range(ROUNDS):
        odds = _lone_odds(rigid_bodies, apart, present, naming)
        added = one_to_one(odds)
        new = (added >= 0) & (naming < 0)
        chosen = np.take_along_axis(odds, np.maximum(added, 0)[..., None], axis=2)[..., 0]
        np.put_along_axis(odds, np.maximum(added, 0)[..., None], IMPOSSIBLE, axis=2)
        second = np.maximum(odds.max(axis=2), 0)
        lone = np.where(new, chosen - second, lone)
        naming = np.where(new, added, naming)
    return naming, lone


def _lone_odds(rigid_bodies: RigidBodies, apart, present, naming) -> np.ndarray:
    """(F, M, P) log odds that a free point is an unnamed marker, from its distances to the named."""
    frames, markers = naming.shape
    count = present.shape[1]
    odds = np.full((frames, markers, count), IMPOSSIBLE)
    taken = np.zeros((frames, count + 1), dtype=bool)
    np.put_along_axis(taken, np.where(naming >= 0, naming, count), True, axis=1)
    free = present & ~taken[:, :count]
    width = rigid_bodies.high - rigid_bodies.low + 2 * rigid_bodies.slack
    scale = ROOM * np.median(rigid_bodies.high)
    price = LONE_WORTH + np.log1p(free.sum(axis=1))
    for marker in range(markers):
        rows = np.flatnonzero(naming[:, marker] < 0)
        near = np.argsort(width[marker] + 1e3 * (np.arange(markers) == marker))[:NEIGHBOURS]
        if not len(rows):
            continue
        there = naming[rows][:, near]
        known = there >= 0
        distance = apart[rows[:, None], np.maximum(there, 0)]
        breach = rigid_bodies.breach(distance, np.array(marker), near[None, :, None])
        gain = np.log(np.maximum(scale / width[marker, near], 1))[None, :, None] - np.minimum(
            0.5 * breach**2, 2 * LIMIT
        )
        total = np.where(known[..., None], gain, 0).sum(axis=1)
        total *= np.minimum(1, SURE_OF_THREE / np.maximum(known.sum(axis=1), 1))[:, None]
        odds[rows, marker] = np.where(free[rows], total - price[rows, None], IMPOSSIBLE)
    return odds
