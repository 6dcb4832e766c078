# SPDX-License-Identifier: GPL-3.0-or-later
"""Points in space from unnamed blobs: which rays of different cameras meet, and how well.

A frame's cloud starts the placement: it holds nearly every marker that two cameras see, and some false crossings.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.triangulation import Rays
from ..geometry.views import Sight, View


@dataclass(frozen=True)
class CloudOptions:
    """Which rays meet, and how much is worked on; reckoned.

    max_gap_m        between two rays of one marker at its depth: most of a marker's size, for calibrations that are
                     off, plus what the pixels add
    max_gap_px       what they add
    max_residual_m   root mean square distance of a point from its rays, so that chains of near misses make none
    min_depth_m      nobody stands nearer to a camera
    min_sine         of the angle between two rays; below it they fix no depth
    max_crossings    of pairs of rays in a frame, the best first: more is a crowd, which would take minutes
    distances_once   a camera that are worked on at once: few enough for the processor's cache
    """

    max_gap_m: float = 0.012
    max_gap_px: float = 3.0
    max_residual_m: float = 0.024
    min_depth_m: float = 0.2
    min_sine: float = 0.02
    max_crossings: int = 4000
    distances_once: int = 100_000


CLOUD = CloudOptions()


@dataclass(frozen=True, eq=False)
class Cloud:
    """Q candidate points of one frame.

    points   (Q, 3) m
    support  (Q,) number of cameras whose blobs agree on the point
    weight   (Q,) 0 to 1, how likely the point is a marker: shared blobs share their weight
    """

    points: np.ndarray
    support: np.ndarray
    weight: np.ndarray


def build_cloud(view: View, sight: Sight) -> Cloud:
    """The cloud of one frame: pairs of rays that meet, completed by the other cameras that confirm the point."""
    camera, slot = np.nonzero(view.real)
    rays = Rays(view, sight)
    direction, origin = rays.direction[camera, slot], sight.centres[camera]
    first, second, middle = _crossings(camera, direction, origin, sight)
    if not len(first):
        return Cloud(np.zeros((0, 3)), np.zeros(0, int), np.zeros(0))
    members = _members(middle, view, sight)
    members[np.arange(len(first)), camera[first]] = slot[first]
    members[np.arange(len(first)), camera[second]] = slot[second]
    return _chosen(np.unique(members, axis=0), rays, view.real.shape)


def _crossings(camera, direction, origin, sight):
    """Pairs of rays of different cameras that pass each other closely in front of both, and their mid-points."""
    parts = []
    for one in range(sight.count):
        for other in range(one + 1, sight.count):
            mine, theirs = np.flatnonzero(camera == one), np.flatnonzero(camera == other)
            first, second = np.repeat(mine, len(theirs)), np.tile(theirs, len(mine))
            parts.append(_meetings(first, second, camera, direction, origin, sight))
    first, second, middle, badness = (np.concatenate(column) for column in zip(*parts, strict=True))
    if len(first) > CLOUD.max_crossings:
        best = np.argsort(badness)[: CLOUD.max_crossings]
        return first[best], second[best], middle[best]
    return first, second, middle


def _meetings(first, second, camera, direction, origin, sight):
    """Of pairs of rays, those that meet: their indices, mid-points, and the gap as a share of what is allowed."""
    between = origin[second] - origin[first]
    cosine = np.einsum("ni,ni->n", direction[first], direction[second])
    along_first = np.einsum("ni,ni->n", between, direction[first])
    along_second = np.einsum("ni,ni->n", between, direction[second])
    sine2 = np.maximum(1 - cosine**2, CLOUD.min_sine**2)
    near, far = (along_first - cosine * along_second) / sine2, (cosine * along_first - along_second) / sine2
    low, high = origin[first] + near[:, None] * direction[first], origin[second] + far[:, None] * direction[second]
    pixel = near / sight.focal[camera[first]] + far / sight.focal[camera[second]]
    gap = np.linalg.norm(low - high, axis=1)
    allowed = CLOUD.max_gap_m + CLOUD.max_gap_px * pixel / 2
    kept = (near > CLOUD.min_depth_m) & (far > CLOUD.min_depth_m) & (gap < allowed)
    kept &= 1 - cosine**2 > CLOUD.min_sine**2
    return first[kept], second[kept], ((low + high) / 2)[kept], (gap / allowed)[kept]


def _members(points: np.ndarray, view: View, sight: Sight) -> np.ndarray:
    """(Q, C) slot of the blob nearest to each point's image where it is near enough, else -1."""
    blocks = np.array_split(points, max(1, len(points) * view.image.shape[1] // CLOUD.distances_once))
    return np.concatenate([_block_members(block, view, sight) for block in blocks])


def _block_members(points: np.ndarray, view: View, sight: Sight) -> np.ndarray:
    local = sight.local(points[None])[0]
    image = sight.image(local)
    offset = view.image[:, None] - image[:, :, None]
    distance = np.sqrt(np.einsum("cqki,cqki->cqk", offset, offset))
    nearest = distance.argmin(axis=2)
    metres = np.take_along_axis(distance, nearest[..., None], axis=2)[..., 0] * local[..., 2]
    allowed = CLOUD.max_gap_m + CLOUD.max_gap_px * local[..., 2] / sight.focal[:, None]
    return np.where(metres < allowed, nearest, -1).T


def _chosen(members: np.ndarray, rays: Rays, shape: tuple[int, int]) -> Cloud:
    """Points of the best-supported sets of blobs; a set that only repeats the blobs of better ones goes."""
    seen = members >= 0
    met = rays.meet(members.T)
    support = seen.sum(axis=1)
    fine = np.isfinite(met.residual) & (met.residual < CLOUD.max_residual_m)
    order = np.lexsort((met.residual, -support))
    claimed = np.zeros(shape, dtype=bool)
    everyone = np.arange(shape[0])
    chosen = []
    for index in order[fine[order]]:
        mine = seen[index]
        fresh = ~claimed[everyone[mine], members[index, mine]]
        if support[index] >= 3 and fresh.sum() >= 2:
            claimed[everyone[mine], members[index, mine]] = True
            chosen.append(index)
        elif support[index] == 2 and fresh.all():
            chosen.append(index)
    chosen = np.array(chosen, dtype=int)
    return Cloud(met.points[chosen], support[chosen], _weights(members[chosen], support[chosen], shape))


def _weights(members: np.ndarray, support: np.ndarray, shape) -> np.ndarray:
    """A point confirmed by three cameras counts whole; points that claim one blob share it."""
    claims = np.zeros(shape)
    cameras = np.broadcast_to(np.arange(shape[0]), members.shape)
    has = members >= 0
    np.add.at(claims, (cameras[has], members[has]), 1)
    share = np.where(has, 1 / np.maximum(claims[cameras, np.maximum(members, 0)], 1), 1).min(axis=1, initial=1.0)
    return np.where(support >= 3, 1.0, share)
