# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers in space from their blobs in two or more cameras."""

from dataclasses import dataclass

import numpy as np

from .cameras import Cameras
from .views import Sight, View


@dataclass(frozen=True)
class MeetingOptions:
    """How rays meet; reckoned.

    max_condition  rays whose normal equations are worse conditioned than this fix no depth: two that are nearer to
                   parallel than half a degree
    ridge          share of the equations' size that keeps parallel rays from a division by nought
    kept_share     of the points, best first, that the noise of the blobs is taken from: a wrong name or a merged blob
                   is not noise
    trimmed_scale  by what leaving out the rest divides a normal deviation
    max_rows_condition, rows_ridge  the two of `meet_rows`, stricter: it has no expected place to begin with
    near_m, far_m  how short a ray is taken to be at least, and how long where its point is unknown
    """

    max_condition: float = 1e5
    ridge: float = 1e-12
    kept_share: float = 0.8
    trimmed_scale: float = 1.35
    max_rows_condition: float = 1e4
    rows_ridge: float = 1e-9
    near_m: float = 1e-2
    far_m: float = 1e3


MEETING = MeetingOptions()
RIDGES = MEETING.ridge * np.eye(3)


@dataclass(frozen=True, eq=False)
class Meeting:
    """Where the rays of M sets of blobs meet.

    points    (M, 3) m; NaN with fewer than two rays, or rays that are parallel
    residual  (M,) m, root mean square of `miss` over the cameras that count
    miss      (C, M) m between the point and each ray; zero where a camera does not count
    """

    points: np.ndarray
    residual: np.ndarray
    miss: np.ndarray


class Rays:
    """The rays of every blob of a frame, ready to be met in any combination."""

    def __init__(self, view: View, sight: Sight):
        self.centres = sight.centres
        local = np.concatenate([view.image, np.ones((*view.image.shape[:2], 1))], axis=-1)
        direction = local @ sight.rotation
        self.direction = direction / np.sqrt(np.einsum("cki,cki->ck", direction, direction))[..., None]
        self.across = np.eye(3) - self.direction[..., :, None] * self.direction[..., None, :]
        self.anchor = (self.across @ self.centres[:, None, :, None])[..., 0]
        self.cameras = np.arange(len(self.centres))[:, None]

    def meet(self, slot: np.ndarray, depth: np.ndarray | None = None) -> Meeting:
        """Meets the blobs in slots (C, M), -1 where a camera does not count.

        Every ray counts by its length, so that what is least is the reprojection error. `depth` (C, M) m says about
        how long they are; without it the point nearest to all rays comes first.
        """
        seen = slot >= 0
        index = np.maximum(slot, 0)
        across, anchor = self.across[self.cameras, index], self.anchor[self.cameras, index]
        if depth is None:
            arm = _nearest(across, anchor, seen.astype(float)) - self.centres[:, None]
            depth = np.sqrt(np.einsum("cmi,cmi->cm", arm, arm))
        points = _nearest(across, anchor, seen / np.maximum(depth, 1e-3) ** 2)
        arm = points - self.centres[:, None]
        missing = (across @ arm[..., None])[..., 0]
        miss2 = np.einsum("cmi,cmi->cm", missing, missing) * seen
        count = seen.sum(axis=0)
        residual = np.sqrt(miss2.sum(axis=0) / np.maximum(count, 1))
        lost = (count < 2) | ~np.isfinite(points[:, 0])
        points[lost], residual[lost] = np.nan, np.nan
        return Meeting(points, residual, np.where(lost, 0, np.sqrt(miss2)))


def _nearest(across: np.ndarray, anchor: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """(M, 3) the points nearest to their weighted rays; NaN where the rays do not fix one."""
    normal = np.einsum("cm,cmij->mij", weight, across)
    right = np.einsum("cm,cmi->mi", weight, anchor)
    size = np.einsum("mii->m", normal) + MEETING.ridge
    inverse = np.linalg.inv(normal / size[:, None, None] + RIDGES)
    points = (inverse @ right[..., None])[..., 0] / size[:, None]
    points[np.einsum("mii->m", inverse) > MEETING.max_condition] = np.nan
    return points


def trimmed_deviation(squares: np.ndarray, freedom: np.ndarray, options: MeetingOptions = MEETING) -> float:
    """Standard deviation of what rays miss their points by, the worst of the points left out.

    squares (N,) are the sums of squares over the rays of each point, freedom (N,) how many of them are free.
    """
    order = np.argsort(squares / freedom)[: int(np.ceil(options.kept_share * len(squares)))]
    return float(np.sqrt(squares[order].sum() / freedom[order].sum()) * options.trimmed_scale)


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
        size = np.einsum("nii->n", normal)[:, None, None] + MEETING.ridge
        inverse = np.linalg.inv(normal / size + MEETING.rows_ridge * np.eye(3))
        found = np.einsum("nij,nj->ni", inverse, right / size[:, 0])
        found[np.einsum("nii->n", inverse) > MEETING.max_rows_condition] = np.nan
        if not last:
            length = np.linalg.norm(found[point] - centres, axis=1)
            weight = 1 / np.maximum(np.nan_to_num(length, nan=MEETING.far_m), MEETING.near_m) ** 2
    return found
