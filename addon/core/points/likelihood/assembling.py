# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of a set on rigid bodies: where each may be, and one placement of each at most, put together.

A rigid body may be at every set of points that has its form, three markers or more of it. A beam search goes over the
rigid bodies, those first that are best linked to the ones before: no point twice, distances between them as ever seen.
Then the markers on no rigid body, and those that were missed, by what their distances to the named ones allow.
"""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from ...data.takes import NO_POINT
from ...geometry.rigid import pairwise_distances
from ..rigid_bodies.model import RIGID_BODY, RigidBodies, linking_order
from .naming import IMPOSSIBLE, one_to_one
from .solving import Solved


@dataclass(frozen=True)
class AssemblyOptions:
    """What a placement of a rigid body may look like, and what it, and distances between rigid bodies, are worth."""

    noise_share: float = 0.003  # of a length, between takes; physical: plates bend, and calibrations differ
    # log likelihood of one more point that fits
    point_gain: float = 7.0  # measured: half of it names 2,257 of 133,000 points on plates wrongly, twice none
    # of the mean breach between two rigid bodies
    breach_weight: float = 8.0  # measured: of 133,000 labels on plates half loses none, twice 80
    # log odds a single marker must have beside the number of points that it may be
    single_cost: float = 1.0  # measured: twice loses 1,411 of them, half none; without it 9 are wrong

    def spread(self, lengths: np.ndarray | float) -> np.ndarray:
        """The standard deviation, m, of measured lengths, m."""
        return np.hypot(RIGID_BODY.min_sd_m, self.noise_share * lengths)

    def gate(self, length: float) -> float:
        """How far, m, a side of a triangle may be off its length, m."""
        return MAX_LENGTH_SDS * float(self.spread(length))


ASSEMBLY = AssemblyOptions()
MAX_LENGTH_SDS = 6.0  # that a side of a triangle may be off: no right one is
MAX_PLACEMENTS = 10  # of a rigid body in a frame; by time
NAMINGS_KEPT = 16  # namings of a frame that are followed; by time
MAX_LINKS = 3  # earlier rigid bodies that one is compared with: three distances fix a place
NAMED_NEAR = 8  # markers that a single marker is judged by, and
INDEPENDENT_DISTANCES = 3.0  # distances that fix a point; more say partly the same
UNRIVALLED = 50.0  # log odds that a name without an alternative leads by


@dataclass(frozen=True, eq=False)
class Placements:
    """K placements of a rigid body of n markers in each of F frames."""

    points: np.ndarray  # (F, K, n) index of the point, NO_POINT where the marker is hidden
    score: np.ndarray  # (F, K) log likelihood, -inf where there are fewer placements


def distances(points: np.ndarray) -> np.ndarray:
    """(F, P, P) m between points (F, P, 3), infinite to where there is none and from a point to itself."""
    distance = pairwise_distances(np.nan_to_num(points))
    gone = ~np.isfinite(points[..., 0])
    distance[gone[:, :, None] | gone[:, None] | np.eye(points.shape[1], dtype=bool)] = np.inf
    return distance


@dataclass(frozen=True, eq=False)
class NearPairs:
    """The N pairs of points of some frames, both ways round, that lie as near to each other as markers of a rigid body.

    frame, one, two (N,) indices, distance (N,) m.
    """

    frame: np.ndarray
    one: np.ndarray
    two: np.ndarray
    distance: np.ndarray

    @classmethod
    def of(cls, rigid_bodies: RigidBodies, distance: np.ndarray) -> "NearPairs":
        """Those of frames in which points are `distance` (F, P, P) m from each other."""
        longest = max(rigid_bodies.lengths(group).max() for group in rigid_bodies.members)
        frame, one, two = np.nonzero(distance < longest + ASSEMBLY.gate(longest))
        return cls(frame, one, two, distance[frame, one, two])


def place(
    rigid_bodies: RigidBodies,
    index: int,
    points: np.ndarray,
    distance: np.ndarray,
    near: NearPairs,
) -> Placements:
    """The likeliest placements of a rigid body, by its index, in frames of points (F, P, 3) m.

    `distance` (F, P, P) m is between the points, and `near` those of them that are near each other.
    """
    group = rigid_bodies.members[index]
    lengths, form, bases = rigid_bodies.lengths(group), rigid_bodies.form[group], rigid_bodies.bases[index]
    found = [_triangles(lengths, base, distance, near) for base in bases]
    which = np.repeat(np.arange(len(bases)), [len(frame) for frame, _ in found])
    if not len(which):
        return Placements(np.full((len(points), 1, len(group)), NO_POINT), np.full((len(points), 1), -np.inf))
    frame, corners = (np.concatenate(parts) for parts in zip(*found, strict=True))
    whole = _completed(form, np.array(bases), which, points, frame, corners, RIGID_BODY.max_marker_m)
    rows = _unique_rows(np.concatenate([frame[:, None], whole], axis=1))
    scores = _scores(lengths, distance, rows[:, 0], rows[:, 1:])
    return _best(len(points), rows, scores, MAX_PLACEMENTS)


def _unique_rows(rows: np.ndarray) -> np.ndarray:
    """The different ones of rows (N, K), in their order; several times as fast as NumPy's."""
    rows = rows[np.lexsort(rows.T[::-1])]
    return rows[np.append(True, (rows[1:] != rows[:-1]).any(axis=1))]


def _triangles(
    lengths: np.ndarray, base: tuple[int, int, int], distance: np.ndarray, near: NearPairs
) -> tuple[np.ndarray, np.ndarray]:
    """Frames (K,) and points (K, 3) of all triangles with the sides of the base."""
    first, second, third = base
    longest = lengths[first, second]
    fitting = np.flatnonzero(np.abs(near.distance - longest) < ASSEMBLY.gate(longest))
    frame, one, two = near.frame[fitting], near.one[fitting], near.two[fitting]
    close = np.abs(distance[frame, one] - lengths[first, third]) < ASSEMBLY.gate(lengths[first, third])
    close &= np.abs(distance[frame, two] - lengths[second, third]) < ASSEMBLY.gate(lengths[second, third])
    row, three = np.nonzero(close)
    return frame[row], np.stack([one[row], two[row], three], axis=1)


def _axes(corners: np.ndarray) -> np.ndarray:
    """(..., 3, 3) right-handed axes, one a row, of triangles (..., 3, 3)."""
    along = corners[..., 1, :] - corners[..., 0, :]
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    side = corners[..., 2, :] - corners[..., 0, :]
    side = side - (side * along).sum(axis=-1, keepdims=True) * along
    side = side / np.maximum(np.linalg.norm(side, axis=-1, keepdims=True), 1e-9)
    return np.stack([along, side, np.cross(along, side)], axis=-2)


def _completed(form, bases, which, points, frame, corners, max_distance: float) -> np.ndarray:
    """(K, n) the points of whole rigid bodies on triangles: the nearest to where each further marker must be.

    The triangles of points `corners` (K, 3) are in frames (K,), and of the bases (B, 3) those of `which` (K,).
    """
    triangles = form[bases]
    local = (form - triangles.mean(axis=1, keepdims=True)) @ _axes(triangles).swapaxes(1, 2)
    at = points[frame[:, None], corners]
    expected = local[which] @ _axes(at) + at.mean(axis=1, keepdims=True)
    # Nowhere, rather than nothing: what is nowhere is nearest to nothing.
    there = np.nan_to_num(points, nan=np.inf)[frame]
    rows = np.arange(len(frame))
    found = np.full((len(frame), len(form)), NO_POINT)
    found[rows[:, None], bases[which]] = corners
    for marker in range(len(form)):
        gap = there - expected[:, marker, None]
        gap = np.einsum("kpc,kpc->kp", gap, gap)
        nearest = gap.argmin(axis=1)
        free = (found != nearest[:, None]).all(axis=1) & (found[:, marker] < 0)
        good = free & (gap[rows, nearest] < max_distance**2)
        found[good, marker] = nearest[good]
    return found


def _scores(lengths, distance, frame, found) -> np.ndarray:
    """(K,) how many points fit, and how well their distances do."""
    known = found >= 0
    both = known[:, :, None] & known[:, None] & ~np.eye(len(lengths), dtype=bool)
    measured = distance[frame[:, None, None], np.maximum(found, 0)[:, :, None], np.maximum(found, 0)[:, None]]
    off = np.where(both, ((np.where(both, measured, 0) - lengths) / ASSEMBLY.spread(lengths)) ** 2, 0)
    # Skin gives way now and then: far off costs little more than off.
    mean = 2 * np.log1p(off / 2).sum(axis=(1, 2)) / both.sum(axis=(1, 2))
    count = known.sum(axis=1)
    return ASSEMBLY.point_gain * (count - 2) - 0.5 * (3 * count - 6) * mean


def _best(frames: int, rows: np.ndarray, scores: np.ndarray, count: int) -> Placements:
    """The best few placements of every frame out of rows (N, 1 + n) of frame and points."""
    order = np.lexsort((-scores, rows[:, 0]))
    rows, scores = rows[order], scores[order]
    starts = np.searchsorted(rows[:, 0], np.arange(frames + 1))
    rank = np.arange(len(rows)) - starts[rows[:, 0]]
    kept = rank < count
    rows, scores, rank = rows[kept], scores[kept], rank[kept]
    width = int(rank.max()) + 1
    points = np.full((frames, width, rows.shape[1] - 1), NO_POINT)
    score = np.full((frames, width), -np.inf)
    points[rows[:, 0], rank], score[rows[:, 0], rank] = rows[:, 1:], scores
    return Placements(points, score)


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
    odds = _single_odds(rigid_bodies, distance, present, naming)
    added = one_to_one(odds)
    new = (added >= 0) & (naming < 0)
    chosen = np.take_along_axis(odds, np.maximum(added, 0)[..., None], axis=2)[..., 0]
    np.put_along_axis(odds, np.maximum(added, 0)[..., None], IMPOSSIBLE, axis=2)
    second = np.maximum(odds.max(axis=2), 0)
    return np.where(new, added, naming), np.where(new, chosen - second, np.nan)


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
