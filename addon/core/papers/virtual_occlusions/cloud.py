# SPDX-License-Identifier: GPL-3.0-or-later
"""Points in space from unnamed blobs: which rays of different cameras meet, and how well.

A frame's cloud starts the placement: it holds nearly every marker that two cameras see, and some false crossings.
"""

from dataclasses import dataclass

import numpy as np

from ...data.physical import SIGMAS
from ...geometry.rigid import pairwise_distances
from ...geometry.triangulation import Rays, passing
from ...geometry.views import Sight, View

# Of a camera, the nearest others whose rays it meets: they see the same side of a body, and what cameras farther apart
# see is confirmed by them. With eight cameras all are partners.
PARTNERS = 7
# Of so few cameras all rays are met at once; of more those of neighbours first, and where so many agree is a point.
FEW_CAMERAS, NEIGHBOUR_CAMERAS, SURE_SUPPORT = 5, 2, 4
MAX_CROSSINGS = 4000  # pairs of rays in a frame, the best first; more is a crowd, which would take minutes
DISTANCES_ONCE = 100_000  # to blobs of a camera that are worked on at once, few enough for the processor's cache
# physical: m, between two rays of one marker at its depth, most of a marker's size; a point is off its rays by twice
# that at most, root mean square, so that chains of near misses make none.
MAX_GAP_M = 0.012


@dataclass(frozen=True, eq=False)
class Cloud:
    """Q candidate points of one frame."""

    points: np.ndarray  # (Q, 3) m
    support: np.ndarray  # (Q,) number of cameras whose blobs agree on the point
    weight: np.ndarray  # (Q,) 0 to 1, how likely the point is a marker: shared blobs share their weight


def build_cloud(view: View, sight: Sight) -> Cloud:
    """The cloud of one frame: pairs of rays that meet, completed by the other cameras that confirm the point.

    Of many cameras the rays of neighbours are met first: what several others confirm is settled, and only the blobs
    that are left go on to be met more widely.
    """
    rays, claimed = Rays(view, sight), np.zeros(view.real.shape, bool)
    parts = []
    if sight.count > FEW_CAMERAS:
        parts.append(_sets(view, sight, rays, claimed, NEIGHBOUR_CAMERAS, SURE_SUPPORT))
    parts.append(_sets(view, sight, rays, claimed, PARTNERS, 2))
    members, points = (np.concatenate(column) for column in zip(*parts, strict=True))
    support = (members >= 0).sum(axis=1)
    return Cloud(points, support, _weights(members, support, view.real.shape))


def partners(centres: np.ndarray, count: int) -> np.ndarray:
    """(C, C) which of the cameras with centres (C, 3) m are among the `count` nearest of one another, either way."""
    rank = pairwise_distances(centres).argsort(axis=1, kind="stable").argsort(axis=1)
    among = rank <= count
    return (among | among.T) & ~np.eye(len(centres), dtype=bool)


def _sets(view: View, sight: Sight, rays: Rays, claimed: np.ndarray, count: int, least: int):
    """Sets of blobs (Q, C) that `least` cameras or more agree on, and their points (Q, 3); their blobs are `claimed`.

    The rays of `count` neighbours are met.
    """
    camera, slot = np.nonzero(view.real & ~claimed)
    direction, origin = rays.direction[camera, slot], sight.centres[camera]
    first, second, middle = _crossings(camera, direction, origin, sight, count)
    if not len(first):
        return np.zeros((0, sight.count), int), np.zeros((0, 3))
    members = _members(middle, view, sight)
    members[np.arange(len(first)), camera[first]] = slot[first]
    members[np.arange(len(first)), camera[second]] = slot[second]
    return _chosen(np.unique(members, axis=0), rays, claimed, least)


def _crossings(camera, direction, origin, sight, count: int):
    """Pairs of rays of neighbours that pass each other closely in front of both, and their mid-points."""
    start = np.searchsorted(camera, np.arange(sight.count + 1))
    one, other = np.nonzero(np.triu(partners(sight.centres, count)))
    mine, theirs = np.diff(start)[one], np.diff(start)[other]
    pair = np.repeat(np.arange(len(one)), mine * theirs)
    within = np.arange(len(pair)) - np.repeat(np.cumsum(mine * theirs) - mine * theirs, mine * theirs)
    first, second = start[one[pair]] + within // theirs[pair], start[other[pair]] + within % theirs[pair]
    first, second, middle, badness = _meetings(first, second, camera, direction, origin, sight)
    if len(first) > MAX_CROSSINGS:
        best = np.argsort(badness)[:MAX_CROSSINGS]
        return first[best], second[best], middle[best]
    return first, second, middle


def _meetings(first, second, camera, direction, origin, sight):
    """Of pairs of rays, those that meet: their indices, mid-points, and the gap as a share of what is allowed."""
    near, far, between, fixed = passing(direction, origin, first, second)
    pixel = near / sight.focal[camera[first]] + far / sight.focal[camera[second]]
    gap, allowed = np.linalg.norm(between, axis=0), MAX_GAP_M + SIGMAS * pixel / 2
    kept = fixed & (gap < allowed)
    first, second, middle = first[kept], second[kept], between.T[kept] / 2
    middle += origin[first] + near[kept, None] * direction[first]
    return first, second, middle, (gap / allowed)[kept]


def _members(points: np.ndarray, view: View, sight: Sight) -> np.ndarray:
    """(Q, C) slot of the blob nearest to each point's image where it is near enough, else -1."""
    nearest, metres, depth = nearest_blobs(points, view, sight)
    allowed = MAX_GAP_M + SIGMAS * depth / sight.focal[:, None]
    return np.where(metres < allowed, nearest, -1).T


def nearest_blobs(points: np.ndarray, view: View, sight: Sight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of points (Q, 3) m the nearest blob's slot in each camera (C, Q), how far off at its depth, and that depth, m."""
    blocks = np.array_split(points, max(1, len(points) * view.image.shape[1] // DISTANCES_ONCE))
    parts = [_nearest_of_block(block, view, sight) for block in blocks]
    nearest, metres, depth = (np.concatenate(part, axis=1) for part in zip(*parts, strict=True))
    return nearest, metres, depth


def _nearest_of_block(points, view, sight) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    local = sight.local(points[None])[0]
    image = sight.image(local)
    square, other = (view.image[:, None, :, axis] - image[..., axis, None] for axis in (0, 1))
    square *= square
    other *= other
    square += other
    nearest = square.argmin(axis=2)
    least = np.take_along_axis(square, nearest[..., None], axis=2)[..., 0]
    return nearest, np.sqrt(least) * local[..., 2], local[..., 2]


def _chosen(members: np.ndarray, rays: Rays, claimed: np.ndarray, least: int) -> tuple[np.ndarray, np.ndarray]:
    """The best-supported sets of blobs, and their points; a set that only repeats the blobs of better ones goes."""
    members = members[(members >= 0).sum(axis=1) >= least]
    seen = members >= 0
    support = seen.sum(axis=1)
    met = rays.meet(members.T)
    fine = np.isfinite(met.residual) & (met.residual < 2 * MAX_GAP_M)
    order = np.lexsort((met.residual, -support))
    everyone = np.arange(len(claimed))
    chosen = []
    for index in order[fine[order]]:
        mine = seen[index]
        fresh = ~claimed[everyone[mine], members[index, mine]]
        if support[index] >= 3 and fresh.sum() >= 2:
            claimed[everyone[mine], members[index, mine]] = True
            chosen.append(index)
        elif support[index] == 2 and fresh.all():
            chosen.append(index)
    return members[chosen], met.points[chosen]


def _weights(members: np.ndarray, support: np.ndarray, shape) -> np.ndarray:
    """A point confirmed by three cameras counts whole; points that claim one blob share it."""
    claims = np.zeros(shape)
    cameras = np.broadcast_to(np.arange(shape[0]), members.shape)
    has = members >= 0
    np.add.at(claims, (cameras[has], members[has]), 1)
    share = np.where(has, 1 / np.maximum(claims[cameras, np.maximum(members, 0)], 1), 1).min(axis=1, initial=1.0)
    return np.where(support >= 3, 1.0, share)
