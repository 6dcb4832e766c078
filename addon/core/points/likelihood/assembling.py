# SPDX-License-Identifier: GPL-3.0-or-later
"""Putting rigid bodies together: one placement each at most, no point twice, distances between them as ever seen.

A beam search over the rigid bodies, those first that are best linked to the ones before; then the markers on no rigid
body, and those that were missed, by what their distances to the named ones allow.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...data.takes import NO_POINT
from ..rigid_bodies.model import RigidBodies, linking_order
from .naming import IMPOSSIBLE, one_to_one
from .placing import NearPairs, Placements, distances, place
from .solving import Solved


@dataclass(frozen=True)
class AssemblyOptions:
    """What distances between rigid bodies are worth in a frame, log likelihood.

    breach_weight    of the mean breach between two rigid bodies; measured: of 133,000 labels on plates half loses none,
                     twice 80
    single_cost      log odds a single marker must have beside the number of points that it may be; measured: twice
                     loses 1,411 of them, half none; without it 9 are wrong
    """

    breach_weight: float = 8.0
    single_cost: float = 1.0


ASSEMBLY = AssemblyOptions()
NAMINGS_KEPT = 16  # namings of a frame that are followed; by time
MAX_LINKS = 3  # earlier rigid bodies that one is compared with: three distances fix a place
NAMED_NEAR = 8  # markers that a single marker is judged by, and
INDEPENDENT_DISTANCES = 3.0  # distances that fix a point; more say partly the same
SINGLES_ROUNDS = 2  # of naming single markers, each by those that were named before
UNRIVALLED = 50.0  # log odds that a name without an alternative leads by


def assemble(rigid_bodies: RigidBodies, points: np.ndarray) -> Solved:
    """The best naming of frames of points (F, P, 3) m, NaN where there is none."""
    distance = distances(points)
    naming, score = _beam(rigid_bodies, points, distance)
    best, most = naming[:, 0], UNRIVALLED
    lead = np.where(naming[:, 1:] == best[:, None], -np.inf, (score[:, 1:] - score[:, :1])[..., None])
    margin = np.where(best >= 0, -lead.max(axis=1, initial=-most), 0)
    best, single = _filled(rigid_bodies, distance, np.isfinite(points[..., 0]), best)
    margin = np.where(np.isfinite(single), np.minimum(single, np.where(margin > 0, margin, most)), margin)
    return Solved(best, score[:, 0], np.where(best >= 0, margin, 0), np.ones(len(best)))


@lru_cache(maxsize=4)
def rigid_body_order(rigid_bodies: RigidBodies) -> list[tuple[int, list[int]]]:
    """The rigid bodies in the order of the search, each with earlier ones to compare it with.

    Rigid bodies that share a joint say more of each other than those that do not.
    """
    width, groups = rigid_bodies.high - rigid_bodies.low, rigid_bodies.members
    loose = np.array([[np.partition(width[np.ix_(a, b)].ravel(), 2)[2] for b in groups] for a in groups])
    order = linking_order(loose)
    ordered = []
    for place_, index in enumerate(order):
        ordered.append((index, sorted(order[:place_], key=lambda other: loose[index, other])[:MAX_LINKS]))
    return ordered


def _beam(rigid_bodies: RigidBodies, points: np.ndarray, distance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Namings (F, B, M) and scores (F, B) of the best B, the best first."""
    frames, count = points.shape[:2]
    naming = np.full((frames, 1, len(rigid_bodies.form)), NO_POINT)
    score = np.zeros((frames, 1))
    used = np.zeros((frames, 1, count + 1), dtype=bool)
    # Of each rigid body its placements, and which of them each naming has; what is behind the last is none.
    placed: dict[int, Placements] = {}
    had = np.zeros((frames, 1, len(rigid_bodies.members)), dtype=int)
    rows = np.arange(frames)[:, None]
    near = NearPairs.of(rigid_bodies, distance)
    for index, links in rigid_body_order(rigid_bodies):
        group = rigid_bodies.members[index]
        found = placed[index] = place(rigid_bodies, index, points, distance, near)
        total = score[:, :, None] + found.score[:, None]
        for other in links:
            cost = _link_cost(rigid_bodies, group, rigid_bodies.members[other], found, placed[other], distance)
            total = total - ASSEMBLY.breach_weight * cost[rows, had[:, :, other]]
        # A hidden marker's place is the column beyond the last point, which is never used up.
        slots = np.where(found.points >= 0, found.points, count)
        taken = used[rows[..., None, None], np.arange(naming.shape[1])[:, None, None], slots[:, None]].any(axis=3)
        total = np.where(taken, -np.inf, total)
        choices = np.concatenate([total, score[:, :, None]], axis=2)
        width = choices.shape[2]
        flat = choices.reshape(frames, -1)
        top = np.argsort(-flat, axis=1, kind="stable")[:, :NAMINGS_KEPT]
        score = np.take_along_axis(flat, top, axis=1)
        parent, choice = top // width, top % width
        naming, used, had = naming[rows, parent], used[rows, parent], had[rows, parent]
        had[:, :, index] = choice
        padded = np.concatenate([slots, np.full((frames, 1, len(group)), count)], axis=1)
        chosen = padded[rows, choice]
        naming[:, :, group] = np.where(chosen < count, chosen, NO_POINT)
        np.put_along_axis(used, chosen, True, axis=2)
        used[:, :, count] = False
    return naming, score


def _link_cost(
    rigid_bodies: RigidBodies, group, other, found: Placements, before: Placements, distance: np.ndarray
) -> np.ndarray:
    """(F, B + 1, K) mean breach of the distances between K placements of a rigid body and B of another one.

    The last row, 0, is where the other one has no placement.
    """
    # Most frames have fewer placements than there is room for.
    frame, one, two = np.nonzero((before.score > -np.inf)[:, :, None] & (found.score > -np.inf)[:, None])
    ends = before.points[frame, one][:, :, None], found.points[frame, two][:, None]
    known = (ends[0] >= 0) & (ends[1] >= 0)
    between = distance[frame[:, None, None], *(np.maximum(end, 0) for end in ends)]
    breach = rigid_bodies.breach(between, other[:, None], group[None])
    cost = np.where(known, 0.5 * breach**2, 0)
    mean = np.zeros((len(distance), before.score.shape[1] + 1, found.score.shape[1]))
    mean[frame, one, two] = cost.sum(axis=(1, 2)) / np.maximum(known.sum(axis=(1, 2)), 1)
    return mean


def _filled(rigid_bodies: RigidBodies, distance, present, naming) -> tuple[np.ndarray, np.ndarray]:
    """The naming with single and missed markers named, and their lead (F, M) on the next best; NaN for others."""
    single = np.full(naming.shape, np.nan)
    naming = naming.copy()
    for _ in range(SINGLES_ROUNDS):
        odds = _single_odds(rigid_bodies, distance, present, naming)
        added = one_to_one(odds)
        new = (added >= 0) & (naming < 0)
        chosen = np.take_along_axis(odds, np.maximum(added, 0)[..., None], axis=2)[..., 0]
        np.put_along_axis(odds, np.maximum(added, 0)[..., None], IMPOSSIBLE, axis=2)
        second = np.maximum(odds.max(axis=2), 0)
        single = np.where(new, chosen - second, single)
        naming = np.where(new, added, naming)
    return naming, single


def _single_odds(rigid_bodies: RigidBodies, distance, present, naming) -> np.ndarray:
    """(F, M, P) log odds that a free point is an unnamed marker, from its distances to the named."""
    frames, markers = naming.shape
    count = present.shape[1]
    odds = np.full((frames, markers, count), IMPOSSIBLE)
    taken = np.zeros((frames, count + 1), dtype=bool)
    np.put_along_axis(taken, np.where(naming >= 0, naming, count), True, axis=1)
    free = present & ~taken[:, :count]
    width = rigid_bodies.high - rigid_bodies.low + 2 * rigid_bodies.slack
    scale = np.median(rigid_bodies.high)
    price = ASSEMBLY.single_cost + np.log1p(free.sum(axis=1))
    near = np.argsort(width + 1e3 * np.eye(markers), axis=1)[:, :NAMED_NEAR]
    log_gain = np.log(np.maximum(scale / np.take_along_axis(width, near, axis=1), 1))
    frame, marker = np.nonzero(naming < 0)
    there = naming[frame[:, None], near[marker]]
    known = there >= 0
    breach = rigid_bodies.breach(
        distance[frame[:, None], np.maximum(there, 0)], marker[:, None, None], near[marker][..., None]
    )
    gain = log_gain[marker][..., None] - 0.5 * breach**2
    total = np.where(known[..., None], gain, 0).sum(axis=1)
    total *= np.minimum(1, INDEPENDENT_DISTANCES / np.maximum(known.sum(axis=1), 1))[:, None]
    odds[frame, marker] = np.where(free[frame], total - price[frame, None], IMPOSSIBLE)
    return odds
