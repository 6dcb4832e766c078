# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers in space from their blobs in two or more cameras."""

from dataclasses import dataclass

import numpy as np

from ..kernels import calls, stands_for
from .cameras import Cameras
from .views import VIEWING, Sight, View


class MEETING:
    """How rays meet."""

    # of the points, best first, that the noise of the blobs is taken from: a wrong name or a merged blob is not noise
    kept_share: float = 0.8  # measured
    # by what leaving out the rest divides a normal deviation: 1.5 where two rays meet, 1.2 where three do, by the
    # truncated distribution of squares
    trimmed_scale: float = 1.35  # measured


MIN_SINE = 0.02  # of the angle between two rays; below it, one degree, they fix no depth
MAX_CONDITION = 1e5  # of the equations of rays; two that are nearer to parallel than half a degree fix no depth
RAY_RIDGE = 1e-12  # of the equations' size, which keeps parallel rays from a division by nought


@dataclass(frozen=True, eq=False)
class Meeting:
    """Where the rays of M sets of blobs meet."""

    points: np.ndarray  # (M, 3) m; NaN with fewer than two rays, or rays that are parallel
    residual: np.ndarray  # (M,) m, root mean square of `miss` over the cameras that count
    miss: np.ndarray  # (C, M) m between the point and each ray; zero where a camera does not count


class Rays:
    """The rays of every blob of a frame, ready to be met in any combination."""

    def __init__(self, view: View, sight: Sight):
        self.centres = sight.centres
        self.direction, self.across, self.anchor = blob_rays(view.image, sight.rotation, sight.centres)

    def meet(self, slot: np.ndarray, depth: np.ndarray | None = None) -> Meeting:
        """Meets the blobs in slots (C, M), -1 where a camera does not count.

        Every ray counts by its length, so that what is least is the reprojection error. `depth` (C, M) m says about
        how long they are; without it the point nearest to all rays comes first.
        """
        parts = self.across, self.anchor, self.centres
        return Meeting(*meet(slot, depth, *parts, RAY_RIDGE, MAX_CONDITION))


def passing(
    direction: np.ndarray, origin: np.ndarray, first: np.ndarray, second: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Where pairs of rays pass each other: how far along the first and along the second (N,) m, the gap (3, N) m.

    Rays are direction (B, 3) and origin (B, 3) m, pairs their indices (N,). Also whether that is in front of both, and
    the angle between them fixes a depth (N,).
    """
    # Axis by axis: NumPy is slow to add up three of something.
    direction, origin = direction.T, origin.T
    one, two = np.take(direction, first, axis=1), np.take(direction, second, axis=1)
    between = np.take(origin, second, axis=1) - np.take(origin, first, axis=1)
    cosine, along_one, along_two = _summed(one * two), _summed(between * one), _summed(between * two)
    sine2 = 1 - cosine**2
    floor = np.maximum(sine2, MIN_SINE**2)
    near, far = (along_one - cosine * along_two) / floor, (cosine * along_one - along_two) / floor
    fixed = (sine2 > MIN_SINE**2) & (near > VIEWING.min_depth_m) & (far > VIEWING.min_depth_m)
    return near, far, between + far * two - near * one, fixed


def _summed(parts: np.ndarray) -> np.ndarray:
    """(N,) the sum of the rows of an array (3, N)."""
    return parts[0] + parts[1] + parts[2]


@stands_for(calls.blob_rays)
def blob_rays(image, rotation, centres) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Of blobs (C, K, 2): the rays' directions (C, K, 3), what projects across them (C, K, 3, 3), centres across."""
    local = np.concatenate([image, np.ones((*image.shape[:2], 1))], axis=-1)
    direction = local @ rotation
    direction /= np.sqrt(np.einsum("cki,cki->ck", direction, direction))[..., None]
    across = np.eye(3) - direction[..., :, None] * direction[..., None, :]
    return direction, across, (across @ centres[:, None, :, None])[..., 0]


@stands_for(calls.meet)
def meet(slot, depth, across, anchor, centres, ridge, max_condition) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Points (M, 3), residual (M,) and miss (C, M) of `Rays.meet`."""
    cameras, seen, index = np.arange(len(centres))[:, None], slot >= 0, np.maximum(slot, 0)
    across, anchor = across[cameras, index], anchor[cameras, index]
    if depth is None:
        arm = _nearest(across, anchor, seen.astype(float), ridge, max_condition) - centres[:, None]
        depth = np.sqrt(np.einsum("cmi,cmi->cm", arm, arm))
    points = _nearest(across, anchor, seen / np.maximum(depth, 1e-3) ** 2, ridge, max_condition)
    arm = points - centres[:, None]
    missing = (across @ arm[..., None])[..., 0]
    miss2 = np.einsum("cmi,cmi->cm", missing, missing) * seen
    count = seen.sum(axis=0)
    residual = np.sqrt(miss2.sum(axis=0) / np.maximum(count, 1))
    lost = (count < 2) | ~np.isfinite(points[:, 0])
    points[lost], residual[lost] = np.nan, np.nan
    return points, residual, np.where(lost, 0, np.sqrt(miss2))


def _nearest(across: np.ndarray, anchor: np.ndarray, weight: np.ndarray, ridge, max_condition) -> np.ndarray:
    """(M, 3) the points nearest to their weighted rays; NaN where the rays do not fix one."""
    normal = np.einsum("cm,cmij->mij", weight, across)
    right = np.einsum("cm,cmi->mi", weight, anchor)
    size = np.einsum("mii->m", normal) + ridge
    inverse = np.linalg.inv(normal / size[:, None, None] + ridge * np.eye(3))
    points = (inverse @ right[..., None])[..., 0] / size[:, None]
    points[np.einsum("mii->m", inverse) > max_condition] = np.nan
    return points


def trimmed_deviation(squares: np.ndarray, freedom: np.ndarray) -> float:
    """Standard deviation of what rays miss their points by, the worst of the points left out.

    squares (N,) are the sums of squares over the rays of each point, freedom (N,) how many of them are free.
    """
    order = np.argsort(squares / freedom)[: int(np.ceil(MEETING.kept_share * len(squares)))]
    return float(np.sqrt(squares[order].sum() / freedom[order].sum()) * MEETING.trimmed_scale)


def meet_rows(
    cameras: Cameras, camera: np.ndarray, image: np.ndarray, point: np.ndarray, count: int, others: bool = False
) -> np.ndarray:
    """(count, 3) m: where the rays of rows with the same number `point` (N,) meet; NaN where they fix no point.

    camera (N,) index, image (N, 2) normalised image without the lens. Rays count by their length, so that what is least
    is the reprojection error. With `others` the result is (N, 3): for every row the point of the other rows of its
    number.
    """
    ahead = cameras.directions(image, camera)
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None, :]
    across[~np.isfinite(ahead).all(axis=1)] = 0
    centres = cameras.centres[camera]
    weight = np.ones(len(image))
    for last in (False, True):  # all rays first, which says how long each is
        part = across * weight[:, None, None]
        normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(normal, point, part)
        np.add.at(right, point, np.einsum("nij,nj->ni", part, centres))
        if others and last:
            normal, right = normal[point] - part, right[point] - np.einsum("nij,nj->ni", part, centres)
        size = np.einsum("nii->n", normal)[:, None, None] + RAY_RIDGE
        inverse = np.linalg.inv(normal / size + RAY_RIDGE * np.eye(3))
        found = np.einsum("nij,nj->ni", inverse, right / size[:, 0])
        found[np.einsum("nii->n", inverse) > MAX_CONDITION] = np.nan
        if not last:
            length = np.linalg.norm(found[point] - centres, axis=1)
            weight = 1 / np.maximum(np.nan_to_num(length, nan=np.inf), VIEWING.min_depth_m) ** 2
    return found
