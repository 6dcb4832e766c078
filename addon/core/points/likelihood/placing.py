# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a rigid body may be: every set of points in a frame that has its form, three markers or more of it."""

from dataclasses import dataclass

import numpy as np

from ...data.takes import NO_POINT
from ...geometry.rigid import pairwise_distances
from ..rigid_bodies.model import RigidBodies


@dataclass(frozen=True)
class PlacingOptions:
    """What a placement of a rigid body in a frame may look like, and what it is worth.

    noise_m        standard deviation of a measured distance; physical: what two good cameras leave
    noise_share    of a length, between takes; physical: plates bend, and calibrations differ
    min_gate_m     that a side of a triangle may be off in any case; physical: seven times that noise
    max_marker_m   that a further marker may be from where the first three put it; physical: a marker's own width
    point_gain     log likelihood of one more point that fits; measured: half of it names 2,257 of 133,000 points on
                   plates wrongly, twice none
    """

    noise_m: float = 0.0007
    noise_share: float = 0.003
    min_gate_m: float = 0.005
    max_marker_m: float = 0.012
    point_gain: float = 7.0

    def spread(self, lengths: np.ndarray | float) -> np.ndarray:
        """The standard deviation, m, of measured lengths, m."""
        return np.hypot(self.noise_m, self.noise_share * lengths)

    def gate(self, length: float) -> float:
        """How far, m, a side of a triangle may be off its length, m."""
        return max(MAX_LENGTH_SDS * float(self.spread(length)), self.min_gate_m)


PLACING = PlacingOptions()
MAX_LENGTH_SDS = 6.0  # that a side of a triangle may be off: no right one is
MAX_PLACEMENTS = 10  # of a rigid body in a frame; by time


@dataclass(frozen=True, eq=False)
class Placements:
    """K placements of a rigid body of n markers in each of F frames.

    points  (F, K, n) index of the point, NO_POINT where the marker is hidden
    score   (F, K) log likelihood, -inf where there are fewer placements
    """

    points: np.ndarray
    score: np.ndarray


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
        frame, one, two = np.nonzero(distance < longest + PLACING.gate(longest))
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
    whole = _completed(form, np.array(bases), which, points, frame, corners, PLACING.max_marker_m)
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
    fitting = np.flatnonzero(np.abs(near.distance - longest) < PLACING.gate(longest))
    frame, one, two = near.frame[fitting], near.one[fitting], near.two[fitting]
    close = np.abs(distance[frame, one] - lengths[first, third]) < PLACING.gate(lengths[first, third])
    close &= np.abs(distance[frame, two] - lengths[second, third]) < PLACING.gate(lengths[second, third])
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
    off = np.where(both, ((np.where(both, measured, 0) - lengths) / PLACING.spread(lengths)) ** 2, 0)
    # Skin gives way now and then: far off costs little more than off.
    mean = 2 * np.log1p(off / 2).sum(axis=(1, 2)) / both.sum(axis=(1, 2))
    count = known.sum(axis=1)
    return PLACING.point_gain * (count - 2) - 0.5 * (3 * count - 6) * mean


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
