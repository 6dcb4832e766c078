# SPDX-License-Identifier: GPL-3.0-or-later
"""What becomes of each camera's blobs: how many have a name, how many beside a marker have none, how far off."""

from dataclasses import dataclass

import numpy as np

from ..data.lanes import blocks
from ..data.takes import NO_MARKER, Blobs, Labels, Motion
from ..geometry.cameras import Cameras
from .suspects import SUSPECTING
from .tallies import Lengths


@dataclass(frozen=True)
class CameraFinding:
    """One camera over a take.

    blobs           all of them, of which `named` have a name, and
    unnamed_beside  have none, beside where the body has a marker that has no blob in the image
    error_px        from a blob to where the marker is in its image, median; NaN where nothing is known
    """

    name: str
    blobs: int
    named: int
    unnamed_beside: int
    error_px: float

    @property
    def unnamed_share(self) -> float:
        """The part of the blobs beside markers that have no name; NaN where there are none."""
        beside = self.named + self.unnamed_beside
        return self.unnamed_beside / beside if beside else float("nan")

    def as_dict(self) -> dict:
        """What a report says of it."""
        error = float(f"{self.error_px:.3g}") if np.isfinite(self.error_px) else None
        return {
            "blobs": self.blobs,
            "named_blobs": self.named,
            "unnamed_beside_markers": self.unnamed_beside,
            "reprojection_px": error,
        }


class CameraBlobs:
    """Counts over the chunks of a take of blobs."""

    def __init__(self, cameras: Cameras):
        self.cameras, self.names = cameras, cameras.names
        count = len(cameras.names)
        self._blobs, self._named, self._beside = (np.zeros(count, np.int64) for _ in range(3))
        self._errors = Lengths(count)

    def add(self, blobs: Blobs, labels: Labels, motion: Motion):
        """Adds a chunk."""
        for frames in blocks(len(blobs.frames), len(self.names) * motion.markers.shape[1]):
            rows = slice(*np.searchsorted(blobs.frame, [frames.start, frames.stop]).tolist())
            frame = blobs.frame[rows] - frames.start
            self._add(frame, blobs.camera[rows], blobs.xy[rows], labels.marker[rows], motion, frames)

    def _add(self, frame, camera, xy, marker, motion: Motion, frames: slice):
        count = len(self.names)
        named = marker != NO_MARKER
        self._blobs += np.bincount(camera, minlength=count)
        self._named += np.bincount(camera[named], minlength=count)
        own = camera[named], frame[named], marker[named]
        error = np.linalg.norm(self.cameras.project(motion.markers[frames])[own] - xy[named], axis=1)
        self._errors.add(error, own[0])
        given = np.zeros((count, *motion.expected[frames].shape[:2]), bool)
        given[own] = True
        where = self.cameras.project(motion.expected[frames])
        where[given] = np.nan
        ahead = np.einsum("ci,fmi->cfm", self.cameras.rotation[:, 2], motion.expected[frames])
        ahead += self.cameras.translation[:, 2, None, None]
        left = camera[~named], frame[~named]
        with np.errstate(invalid="ignore", divide="ignore"):
            away = np.linalg.norm(where[left] - xy[~named][:, None], axis=2)
            near = (away < SUSPECTING.max_off_body_m * self.cameras.focal[left[0], None] / ahead[left]).any(axis=1)
        self._beside += np.bincount(left[0][near], minlength=count)

    def blobs_of(self, name: str) -> int:
        """How many blobs a camera has."""
        return int(self._blobs[self.names.index(name)])

    def figures(self) -> list[CameraFinding]:
        """Each camera, in order."""
        counts = zip(self.names, self._blobs.tolist(), self._named.tolist(), self._beside.tolist(), strict=True)
        return [CameraFinding(*one, self._errors.quantile(0.5, index)) for index, one in enumerate(counts)]
