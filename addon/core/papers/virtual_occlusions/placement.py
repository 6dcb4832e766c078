# SPDX-License-Identifier: GPL-3.0-or-later
"""Where does the person stand, which way do they face and how tall are they: section 3 of the first paper.

From nothing but the blobs: translation by equations 1 to 5, height and facing from the cloud's principal axes,
and then several starts all around, because axes do not know front from back.
"""

from dataclasses import dataclass

import numpy as np

from ...body.bodies import Bodies, BodyModel
from ...data.errors import JobError
from ...data.physical import possible_height
from ...geometry import rotations
from ...geometry.views import View
from .cloud import Cloud


class GUESSING:
    """What a first guess from a cloud may be."""

    # of a cloud's weight, false crossings at each end of its box, one point of fifty
    trimmed_share: float = 0.02  # physical


@dataclass(frozen=True)
class Guess:
    """A first idea of the subject: height in m, facing in rad from world +x (or its opposite)."""

    height: float
    facing: float


def blob_centroids(view: View) -> tuple[np.ndarray, np.ndarray]:
    """Mean of each camera's blobs (C, 2), normalised image, and which cameras have any (C,)."""
    count = view.real.sum(axis=1)
    total = np.where(view.real[..., None], view.image, 0).sum(axis=1)
    return total / np.maximum(count, 1)[:, None], count > 0


def solve_translation(centroids: np.ndarray, extrinsics: np.ndarray, centre: np.ndarray) -> np.ndarray:
    """T (3,) m with c_i = P_i (C_v + T) for all cameras, in the least squares sense: equations 1 to 5.

    centroids (C, 2) are normalised image coordinates, extrinsics (C, 3, 4) the P_i, centre (3,) is C_v, m. Rows are
    scaled by a first solution's depth so that every camera's error counts in metres.
    Raises JobError when the cameras do not fix the translation (one camera, or all looking along one line).
    """
    rays = np.concatenate([centroids, np.ones((len(centroids), 1))], axis=1)
    skew = rotations.cross_matrix(rays / np.linalg.norm(rays, axis=1, keepdims=True))
    rows = skew @ extrinsics[:, :, :3]
    right = -(skew @ (extrinsics[:, :, :3] @ centre + extrinsics[:, :, 3])[..., None])
    first = _least_squares(rows, right)
    depth = np.linalg.norm(extrinsics[:, :, :3] @ (centre + first) + extrinsics[:, :, 3], axis=1)
    scale = 1 / np.maximum(depth, 0.1)[:, None, None]
    return _least_squares(rows * scale, right * scale)


def _least_squares(rows: np.ndarray, right: np.ndarray) -> np.ndarray:
    solution, _, rank, _ = np.linalg.lstsq(rows.reshape(-1, 3), right.ravel(), rcond=1e-6)
    if rank < 3:
        raise JobError(
            "the cameras that see blobs do not fix a position in space; expected blobs in two cameras or more"
        )
    return solution


def principal_guess(cloud: Cloud, tallest_marker: float) -> Guess:
    """Height and facing from the cloud's principal components: the paper's future work, in space rather than by image.

    The longer horizontal axis runs from hand to hand; the subject faces along the other, or against it.
    """
    weight = cloud.weight / cloud.weight.sum()
    flat = cloud.points[:, :2] - weight @ cloud.points[:, :2]
    _, axes = np.linalg.eigh((flat * weight[:, None]).T @ flat)
    facing = np.arctan2(axes[1, 0], axes[0, 0])
    return Guess(stature(cloud, tallest_marker), float(facing))


def stature(cloud: Cloud, tallest_marker: float) -> float:
    """Height in m of the body whose highest marker, at `tallest_marker` heights, is a cloud's highest point."""
    tall = extent(cloud.points[:, 2:], cloud.weight)[0] / tallest_marker
    return float(possible_height(tall))


def extent(values: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(A,) extent of each column of values (Q, A) without the outermost of the weight at each end."""
    low, high = _ends(values, weight)
    return high - low


def _ends(values: np.ndarray, weight: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    order = np.argsort(values, axis=0)
    ranked = np.take_along_axis(values, order, axis=0)
    cumulative = np.cumsum(weight[order], axis=0)
    total = cumulative[-1]
    low = (cumulative >= GUESSING.trimmed_share * total).argmax(axis=0)
    high = (cumulative >= (1 - GUESSING.trimmed_share) * total).argmax(axis=0)
    columns = np.arange(values.shape[1])
    return ranked[low, columns], ranked[high, columns]


def make_starts(model: BodyModel, point: np.ndarray, height: float, facings: np.ndarray) -> Bodies:
    """Rest bodies of `height` m facing each of `facings` (B,) rad, the centroid of their markers at `point` (3,) m."""
    starts = model.rest(len(facings), height)
    quaternion = rotations.about_z(facings)
    centre = model.markerset.rest_markers.mean(axis=0) * height
    translation = point - rotations.quaternion_to_matrix(quaternion) @ centre
    return Bodies(translation, quaternion, starts.scale, starts.bends, starts.shape, starts.own)


def blob_centre(view: View, extrinsics: np.ndarray) -> np.ndarray:
    """(3,) m the point in space that the centroids of all cameras' blobs agree on: equations 1 to 5 with C_v = 0."""
    centroids, seen = blob_centroids(view)
    return solve_translation(centroids[seen], extrinsics[seen], np.zeros(3))
