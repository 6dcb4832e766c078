# SPDX-License-Identifier: GPL-3.0-or-later
"""What becomes of each camera's blobs: how many have a name, how many beside a marker have none, how far off."""

import numpy as np

from ..data.lanes import blocks
from ..data.takes import NO_MARKER, Blobs, Labels, Motion
from ..geometry.cameras import Cameras
from .suspects import MAX_OFF_BODY_M

# Edges of the classes that errors, px, are counted in, which grow by 6 %: as well is their median known.
ERROR_EDGES = np.geomspace(1e-3, 1e4, 281)


class CameraBlobs:
    """Counts over the chunks of a take of blobs."""

    def __init__(self, cameras: Cameras):
        self.cameras, self.names = cameras, cameras.names
        count = len(cameras.names)
        self.blobs, self._named, self._beside = (np.zeros(count, np.int64) for _ in range(3))
        self._errors = np.zeros((count, len(ERROR_EDGES) - 1), np.int64)

    def add(self, blobs: Blobs, labels: Labels, motion: Motion):
        """Adds a chunk."""
        for frames in blocks(len(blobs.frames), len(self.names) * motion.markers.shape[1]):
            rows = slice(*np.searchsorted(blobs.frame, [frames.start, frames.stop]).tolist())
            frame = blobs.frame[rows] - frames.start
            self._add(frame, blobs.camera[rows], blobs.xy[rows], labels.marker[rows], motion, frames)

    def _add(self, frame, camera, xy, marker, motion: Motion, frames: slice):
        count = len(self.names)
        named = marker != NO_MARKER
        self.blobs += np.bincount(camera, minlength=count)
        self._named += np.bincount(camera[named], minlength=count)
        own = camera[named], frame[named], marker[named]
        error = np.linalg.norm(self.cameras.project(motion.markers[frames])[own] - xy[named], axis=1)
        known = error > 0
        np.add.at(self._errors, (own[0][known], np.searchsorted(ERROR_EDGES[1:-1], error[known], side="right")), 1)
        given = np.zeros((count, *motion.expected[frames].shape[:2]), bool)
        given[own] = True
        where = self.cameras.project(motion.expected[frames])
        where[given] = np.nan
        ahead = np.einsum("ci,fmi->cfm", self.cameras.rotation[:, 2], motion.expected[frames])
        ahead += self.cameras.translation[:, 2, None, None]
        left = camera[~named], frame[~named]
        with np.errstate(invalid="ignore", divide="ignore"):
            away = np.linalg.norm(where[left] - xy[~named][:, None], axis=2)
            near = (away < MAX_OFF_BODY_M * self.cameras.focal[left[0], None] / ahead[left]).any(axis=1)
        self._beside += np.bincount(left[0][near], minlength=count)

    def figures(self) -> dict[str, dict]:
        """What a report says of each camera.

        How many blobs it has, how many of these have a name, and how many have none beside where the body has a marker
        that has no blob in the image; and how far, px, a blob is from where its marker is in the image, median.
        """
        found = {}
        for index, name in enumerate(self.names):
            upto = np.cumsum(self._errors[index])
            place = int(np.searchsorted(upto, upto[-1] / 2))
            error = float(f"{np.sqrt(ERROR_EDGES[place] * ERROR_EDGES[place + 1]):.3g}")
            found[name] = {
                "blobs": int(self.blobs[index]),
                "named_blobs": int(self._named[index]),
                "unnamed_beside_markers": int(self._beside[index]),
                "reprojection_px": error if upto[-1] else None,
            }
        return found
