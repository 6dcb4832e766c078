# SPDX-License-Identifier: GPL-3.0-or-later
"""Which markers the body hides from which camera: the virtual occlusions of the first paper's section 4.

A marker is hidden when the straight line from it to the camera's centre passes through the body. The body here is
capsules in closed form; another volume (a mesh in a scene) answers the same question behind the same `Occlusion`.
"""

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from ...data.markersets import MarkerSet
from ...data.takes import Motion
from ...kernels import calls, stands_for

MIN_DIVISOR_M2 = 1e-12  # what is divided by is never less


RAYS_ONCE = 60_000  # rays against capsules that are worked on at once, few enough for the processor's cache


class OCCLUDING:
    """How a body hides markers."""

    # heights, how far a marker's centre is off the skin that carries it, the radius of a 14 mm marker and its base
    standoff: float = 0.005  # physical
    # nearer to a capsule's axis than this part of its radius, nobody knows on which side of the body a marker sits
    min_side_share: float = 0.25  # paper, 4: rather visible than hidden
    # of the radii of a body that is being fitted; 0.4 % of the markers seen are then believed hidden, with whole radii
    # 1.7 % (`gait15`)
    fitted_shrink: float = 0.9  # measured


class Occlusion(Protocol):
    """Any body volume that can say which markers it hides."""

    def hidden(
        self, rotations: np.ndarray, joints: np.ndarray, scale: np.ndarray, markers: np.ndarray, centres: np.ndarray
    ) -> np.ndarray:
        """(B, C, M) True where the body of each of B poses hides a marker from a camera.

        rotations (B, J, 3, 3) and joints (B, J, 3) m are the segments' pose in the world, scale (B, 3) is S of the
        paper's equation 6, markers (B, M, 3) m and centres (C, 3) m the cameras' positions. A marker that is NaN is
        not hidden. A marker is never hidden by the skin that it sits on, but by the far side of the same volume it is.
        """
        ...


def hidden_by_any(
    bodies: Sequence[Occlusion], each: Sequence[Motion], markers: np.ndarray, centres: np.ndarray
) -> np.ndarray:
    """(F, C, M) True where any of S bodies, moving as `each` has it, hides a marker (F, M, 3) m of whomever.

    centres (C, 3) m. A body that was not found in a frame hides nothing there.
    """
    found = np.zeros((len(markers), len(centres), markers.shape[1]), bool)
    for body, motion in zip(bodies, each, strict=True):
        there = np.flatnonzero(np.isfinite(motion.joints).all(axis=(1, 2)))
        if len(there):
            pose = motion.rotations[there], motion.joints[there], motion.scale[there]
            found[there] |= body.hidden(*pose, markers[there], centres)
    return found


class CapsuleOcclusion:
    """The capsules of a marker set as the volume in the way.

    A marker inside a capsule, or nearer to its surface than a marker's own radius, is first pushed straight out of
    it: so it is seen from its own side, down to grazing angles, and hidden from the other. In doubt it is visible, as
    the paper asks: a marker that is believed hidden can take no part in the fit.

    shrink multiplies every radius: below 1, a body that fits badly hides less.
    """

    def __init__(self, markerset: MarkerSet, shrink: float = 1.0):
        capsules = markerset.capsules
        self.segment = np.asarray(capsules.segment, dtype=int)
        self.start = np.asarray(capsules.start, dtype=float).reshape(-1, 3)
        self.axis = np.asarray(capsules.end, dtype=float).reshape(-1, 3) - self.start
        self.radius = np.asarray(capsules.radius, dtype=float) * shrink

    def hidden(
        self, rotations: np.ndarray, joints: np.ndarray, scale: np.ndarray, markers: np.ndarray, centres: np.ndarray
    ) -> np.ndarray:
        """See `Occlusion.hidden`."""
        bodies, cameras, count = len(markers), len(centres), markers.shape[1]
        if not len(self.segment):  # as of a prop: nothing is in the way
            return np.zeros((bodies, cameras, count), dtype=bool)
        block = max(1, RAYS_ONCE // max(1, cameras * count * len(self.segment)))
        found = np.empty((bodies, cameras, count), dtype=bool)
        for first in range(0, bodies, block):
            part = slice(first, first + block)
            start, axis, radius = self._posed(rotations[part], joints[part], scale[part])
            standoff = OCCLUDING.standoff * scale[part].mean(axis=1)
            share = OCCLUDING.min_side_share
            found[part] = capsules_hide(start, axis, radius, markers[part], centres, standoff, share)
        return found

    def _posed(
        self, rotations: np.ndarray, joints: np.ndarray, scale: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Capsules of each body in the world: start and axis (B, K, 3) m, radius (B, K) m."""
        turn, size = rotations[:, self.segment], scale[:, None, :]
        start = joints[:, self.segment] + (turn @ (self.start * size)[..., None])[..., 0]
        axis = (turn @ (self.axis * size)[..., None])[..., 0]
        return start, axis, self.radius * scale.mean(axis=1)[:, None]


@stands_for(calls.capsules_hide)
def capsules_hide(
    start: np.ndarray,
    axis: np.ndarray,
    radius: np.ndarray,
    markers: np.ndarray,
    centres: np.ndarray,
    standoff: np.ndarray,
    min_side_share: float,
) -> np.ndarray:
    """(B, C, M) True where a capsule of the body stands between a marker and a camera's centre.

    start, axis (B, K, 3) and radius (B, K) are the capsules, markers (B, M, 3), centres (C, 3), standoff (B,) how far
    off a capsule's surface a marker that sits on it is looked at from; all m. `min_side_share` see `OCCLUDING`.
    """
    # Distances come out of differences of squares, so nothing may be far from the origin.
    origin = start[:, :1]
    starts, points, eyes = start - origin, markers - origin, centres[None] - origin
    length2 = np.maximum(np.einsum("bkx,bkx->bk", axis, axis), MIN_DIVISOR_M2)
    points, side_known = _pushed_out(starts, axis, length2, radius, points, standoff, min_side_share)
    distance2 = segment_distance2(starts, axis, length2, points, eyes)
    inside = distance2 < (radius * radius)[:, None, None, :]
    return (inside & side_known[:, None]).any(axis=-1)


def _pushed_out(starts, axis, length2, radius, points, standoff, min_side_share) -> tuple[np.ndarray, np.ndarray]:
    """Every marker outside every capsule (B, M, K, 3), and whether its side of that capsule was clear (B, M, K)."""
    from_start = points[:, :, None] - starts[:, None]
    along = np.einsum("bmkx,bkx->bmk", from_start, axis) / length2[:, None]
    along = np.minimum(np.maximum(along, 0.0), 1.0)
    outward = from_start - along[..., None] * axis[:, None]
    distance = np.sqrt(np.einsum("bmkx,bmkx->bmk", outward, outward))
    missing = np.maximum((radius + standoff[:, None])[:, None] - distance, 0.0)
    pushed = points[:, :, None] + outward * (missing / np.maximum(distance, MIN_DIVISOR_M2))[..., None]
    return pushed, distance > min_side_share * radius[:, None]


def segment_distance2(starts, axis, length2, points, eyes) -> np.ndarray:
    """(B, C, M, K) squared distance between the line from a point (B, M, K, 3) to an eye (B, C, 3) and an axis.

    The nearest points of two segments, with only dot products as large as the result (Ericson, Real-Time Collision
    Detection, 5.1.9): `ray` runs from the point to the eye, `gap` from the axis' start to the point.
    """
    bodies, count, capsules = points.shape[:3]
    point2 = np.einsum("bmkx,bmkx->bmk", points, points)[:, None]
    point_start = np.einsum("bmkx,bkx->bmk", points, starts)[:, None]
    point_axis = np.einsum("bmkx,bkx->bmk", points, axis)[:, None]
    start2 = np.einsum("bkx,bkx->bk", starts, starts)[:, None, None]
    start_axis = np.einsum("bkx,bkx->bk", starts, axis)[:, None, None]
    eye_point = (eyes @ points.reshape(bodies, -1, 3).transpose(0, 2, 1)).reshape(bodies, -1, count, capsules)
    eye_start = (eyes @ starts.transpose(0, 2, 1))[:, :, None]
    eye_axis = (eyes @ axis.transpose(0, 2, 1))[:, :, None]
    eye2 = np.einsum("bcx,bcx->bc", eyes, eyes)[:, :, None, None]

    gap2 = point2 - 2 * point_start + start2
    gap_axis = point_axis - start_axis
    axis2 = length2[:, None, None]
    ray2 = np.maximum(eye2 - 2 * eye_point + point2, MIN_DIVISOR_M2)
    ray_gap = eye_point - eye_start - point2 + point_start
    ray_axis = eye_axis - point_axis

    cross = np.maximum(ray2 * axis2 - ray_axis * ray_axis, MIN_DIVISOR_M2 * MIN_DIVISOR_M2)
    on_ray = np.minimum(np.maximum((ray_axis * gap_axis - ray_gap * axis2) / cross, 0.0), 1.0)
    on_axis = np.minimum(np.maximum((ray_axis * on_ray + gap_axis) / axis2, 0.0), 1.0)
    on_ray = np.minimum(np.maximum((ray_axis * on_axis - ray_gap) / ray2, 0.0), 1.0)
    return (
        gap2
        + on_ray * (on_ray * ray2 + 2 * (ray_gap - on_axis * ray_axis))
        + on_axis * (on_axis * axis2 - 2 * gap_axis)
    )
