# SPDX-License-Identifier: GPL-3.0-or-later
"""Places for markers on a body: around a marker along the surface of its segment."""

import numpy as np

from ..data.markersets import MarkerSet
from ..papers.virtual_occlusions.occlusion import CapsuleOcclusion

PLACES_AROUND = 8  # places around a marker that are tried
# Heights, of two rings of cameras around the body, as they hang in a room.
CAMERA_RING_HEIGHTS, CAMERA_RING_RADIUS = (0.5, 1.2), 3.0
MIN_SEEN_SHARE = 0.45  # of the cameras that should see a marker; a convex body hides half
CAPSULE_END = 0.1  # of its length, by which places stay off its ends, and a marker may leave them: joints bend there
MIN_RADIUS = 0.005  # heights, of a capsule that is walked around: a finger's


def in_view(markerset: MarkerSet, segment: int, places: np.ndarray) -> np.ndarray:
    """(N,) the part of a ring of cameras that sees places (N, 3) on a segment of the body at rest."""
    ring = CAMERA_RING_RADIUS * _circle(2 * PLACES_AROUND)
    eyes = np.concatenate([np.column_stack([ring, np.full(len(ring), height)]) for height in CAMERA_RING_HEIGHTS])
    joints = markerset.skeleton.rest_joints
    turns = np.tile(np.eye(3), (1, len(joints), 1, 1))
    hidden = CapsuleOcclusion(markerset).hidden(
        turns, joints[None], np.ones((1, 3)), (joints[segment] + places)[None], eyes
    )
    return 1 - hidden[0].mean(axis=0)


def nearby(markerset: MarkerSet, marker: int, distance: float) -> np.ndarray:
    """(N, 3) places `distance` (heights) from a marker along its segment's surface, in the segment's axes.

    As far from the capsule's axis as the marker is; where the segment has no capsule, along the segment's own axes.
    Places that the body hides more than the marker's own, and from most sides, are left out.
    """
    places, segment = _nearby(markerset, marker, distance), int(markerset.attachment[marker])
    share = in_view(markerset, segment, np.concatenate([markerset.offsets[[marker]], places]))
    return places[share[1:] >= min(share[0], MIN_SEEN_SHARE)]


def _nearby(markerset: MarkerSet, marker: int, distance: float) -> np.ndarray:
    """All of them, around the capsule that the marker is nearest to."""
    own = markerset.offsets[marker]
    mine = np.flatnonzero(markerset.capsules.segment == markerset.attachment[marker])
    if not len(mine):
        return own + distance * np.concatenate([np.eye(3), -np.eye(3)])
    capsules = markerset.capsules
    starts, axes = capsules.start[mine], capsules.end[mine] - capsules.start[mine]
    share = np.clip(((own - starts) * axes).sum(axis=1) / np.maximum((axes**2).sum(axis=1), 1e-12), 0, 1)
    away = own - starts - share[:, None] * axes
    nearest = int((np.linalg.norm(away, axis=1) - capsules.radius[mine]).argmin())
    start, axis = starts[nearest], axes[nearest]
    length = max(np.linalg.norm(axis), 1e-9)
    along = axis / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
    height = float((own - start) @ along)
    out = own - start - height * along
    radius = max(np.linalg.norm(out), MIN_RADIUS)
    if np.linalg.norm(out) < 1e-9:  # on the axis: any direction across will do
        out = np.eye(3)[np.abs(along).argmin()]
        out = out - (out @ along) * along
    first = out / np.linalg.norm(out)
    second = np.cross(along, first)
    up, aside = _circle(PLACES_AROUND).T
    heights, turns = height + distance * up, distance * aside / radius
    low, high = min(height, -CAPSULE_END * length), max(height, (1 + CAPSULE_END) * length)
    on = (heights >= low - 1e-9) & (heights <= high + 1e-9) & (np.abs(turns) <= np.pi)
    ring = np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second
    return (start + heights[:, None] * along + radius * ring)[on]


def _circle(count: int) -> np.ndarray:
    """(count, 2) points around a circle of radius 1."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)
