# SPDX-License-Identifier: GPL-3.0-or-later
"""What poses people take: read off recorded takes once, kept with a body, and mirrored for use."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..body.bodies import Bodies, BodyModel
from ..body.sides import other_side
from ..data.markersets import MarkerSet
from ..geometry import rotations
from ..posing.posing import fit_points

MIRRORED_TURN = np.array([-1.0, 1.0, -1.0])  # a rotation vector's, left and right exchanged


def poses_of(markerset: MarkerSet, points: np.ndarray) -> np.ndarray:
    """(F, J, 3) the poses in which a subject's labelled frames (T, M, 3) m show the body, as `Spread.poses` has them.

    Raises ValueError when no frame shows markers enough.
    """
    model = BodyModel(markerset)
    bodies = fit_points(model, points)
    bodies = bodies.pick(np.isfinite(bodies.translation[:, 0]))
    turn = rotations.quaternion_to_matrix(bodies.quaternion)
    heading = rotations.about_z(-np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
    bends = rotations.rotation_vector(rotations.turn_of(bodies.bends))
    bends[:, 0] = rotations.rotation_vector(rotations.quaternion_to_matrix(heading) @ turn)
    return bends


def known_poses(markerset: MarkerSet, bodies: Sequence[MarkerSet]) -> np.ndarray:
    """(P, J, 3) the poses that any of the bodies keeps of the marker set's segments, where it has all of them."""
    wanted = _with_parents(markerset)
    found = [np.zeros((0, len(wanted), 3))]
    for body in bodies:
        own = _with_parents(body)
        if len(body.spread.poses) and set(wanted) <= set(own):
            found.append(body.spread.poses[:, [own.index(segment) for segment in wanted]])
    return np.concatenate(found)


def _with_parents(markerset: MarkerSet) -> list[tuple[str, str | None]]:
    """Every segment's name and its parent's."""
    names = markerset.skeleton.segments
    parents = (None if above < 0 else names[above] for above in markerset.skeleton.parents)
    return list(zip(names, parents, strict=True))


def mirrored_poses(poses: np.ndarray, segments: Sequence[str]) -> np.ndarray:
    """The mirror images of poses (P, J, 3)."""
    order = [segments.index(other_side(name)) for name in segments]
    return poses[:, order] * MIRRORED_TURN


def with_mirrored(markerset: MarkerSet, poses: np.ndarray) -> np.ndarray:
    """(2 P, J, 3) poses (P, J, 3) of the marker set's segments, and their mirror images."""
    return np.concatenate([poses, mirrored_poses(poses, markerset.skeleton.segments)])


def posed_bodies(model: BodyModel, poses: np.ndarray, size: float) -> Bodies:
    """A body of some size, m, in poses (P, J, 3), upright at the world's origin."""
    bends = poses.copy()
    bends[:, 0] = 0
    lean = rotations.turned(np.tile([1.0, 0, 0, 0], (len(poses), 1)), poses[:, 0])
    return replace(model.rest(len(poses), size), bends=bends, quaternion=lean)
