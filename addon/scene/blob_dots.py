# SPDX-License-Identifier: GPL-3.0-or-later
"""The dots of a take of blobs: through a camera its blobs, from anywhere else the markers; and what a blob may be.

The counterpart of `picking` for blobs. A blob goes by its row in the take, as a point does by its
trajectory; what it is in other frames is told by its track in the camera.
"""

from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ..core.data.errors import InputError, JobError
from ..core.data.takes import NO_MARKER, NO_POINT, Blobs, rows_in_frame
from ..core.data.wording import words_of_frames
from ..core.edits.blob_tracks import BlobTracks
from ..core.edits.kinds import BlobEdit
from ..core.reconstruction.trajectories import Reconstructor
from .picking import Dots, limbs, missing, predicted, ranked
from .stored import Stored

FAR = 5.0  # m that a ray is drawn where no point says how far the subject is
PLACE_DIGITS = 2  # of a pixel that an edit keeps: the file's single precision is finer, and people read it


def rows_of_image(stored: Stored, index: int, camera: int) -> np.ndarray:
    """(K,) the rows of the blobs of a camera, by its index, in frame `index`."""
    here = rows_in_frame(stored.rows, index)
    return here.start + np.flatnonzero(stored.rows.camera[here] == camera)


def on_rays(stored: Stored, rows: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """(K, 3) m, a point on the ray of each blob, lens taken out; `pose` (4, 4) is the Blender camera's."""
    image = stored.cameras.undistort(stored.rows.xy[rows], stored.rows.camera[rows])
    ahead = np.column_stack([image[:, 0], -image[:, 1], np.full(len(rows), -1.0)])
    return ahead @ pose[:3, :3].T + pose[:3, 3]


def blob_dots(stored: Stored, index: int, camera: int, pose: np.ndarray) -> Dots:
    """The blobs of a camera in frame `index`, where `pose` (4, 4), the Blender camera's, has them."""
    rows = rows_of_image(stored, index, camera)
    return Dots(rows, stored.labels.marker[rows], on_rays(stored, rows, pose))


def marker_dots(stored: Stored, index: int) -> Dots:
    """The markers in frame `index`, which are no blobs of one camera."""
    markers = np.flatnonzero(~missing(stored, index))
    return Dots(np.full(len(markers), NO_POINT), markers, stored.unfilled.markers[index, markers])


@dataclass(frozen=True, eq=False)
class FrameRays:
    """Where the rays of one frame's blobs meet, whatever they are called."""

    points: np.ndarray  # (P, 3) m
    ends: np.ndarray  # (R, 2, 3) m, of each ray that makes a point: its camera and the point
    # (K, 2, 3) m, of each ray that makes none: its camera, and as far away as the points are in the median
    loose: np.ndarray

    @classmethod
    def of(cls, stored: Stored, index: int) -> "FrameRays":
        """Of frame `index` of a take of blobs by itself: no trajectory tells."""
        here, centres = rows_in_frame(stored.rows, index), stored.cameras.centres
        cameras, xy = stored.rows.camera[here], stored.rows.xy[here]
        points, point, used = np.zeros((0, 3)), np.zeros(0, int), np.zeros(0, int)
        if len(stored.cameras) > 1:
            with suppress(JobError):  # for a flood of blobs, which Label says
                blobs = Blobs(stored.rows.frames[[index]], 0 * cameras, cameras, xy, stored.rows.area[here])
                found = Reconstructor(stored.cameras, stored.rate).reconstruct(blobs)
                points, (point, camera) = found.points, np.nonzero(found.rows >= 0)
                used = found.rows[point, camera]
        left = np.setdiff1d(np.arange(len(cameras)), used)
        begins = centres[cameras[left]]
        way = stored.cameras.directions(stored.cameras.undistort(xy[left], cameras[left]), cameras[left])
        far = np.median(np.linalg.norm(points[:, None] - centres, axis=2)) if len(points) else FAR
        away = begins + far * way
        ends = np.stack([centres[cameras[used]], points[point]], axis=1)
        return cls(points, ends, np.stack([begins, away], axis=1))


def rows_now(stored: Stored, tracks: BlobTracks, rows: list[int], index: int) -> list[int]:
    """The rows in frame `index` of the tracks of some rows; a track that is not there then has none."""
    found: list[int] = []
    for row in (row for row in rows if row < len(stored.rows)):
        track = np.array([row]) if stored.rows.frame[row] == index else tracks.rows(row)
        found += track[stored.rows.frame[track] == index].tolist()
    return found


def missing_in_image(stored: Stored, index: int, camera: int) -> np.ndarray:
    """(M,) True for the markers that no blob of a camera is in frame `index`."""
    found = np.ones(len(stored.names), bool)
    own = stored.labels.marker[rows_of_image(stored, index, camera)]
    found[own[own != NO_MARKER]] = False
    return found


def asked_in_image(stored: Stored, index: int, camera: int) -> np.ndarray:
    """(M,) True for the markers to ask for in an image: those without a place in space; else all that it lacks."""
    lacking = missing_in_image(stored, index, camera)
    nowhere = lacking & missing(stored, index)
    return nowhere if nowhere.any() else lacking


def likely_of_blob(stored: Stored, tracks: BlobTracks, row: int) -> list[int]:
    """All markers, the likeliest for a blob first: `ranked` by how far from it in the image they are or should be."""
    index, camera = int(stored.rows.frame[row]), int(stored.rows.camera[row])
    seen = stored.unfilled.markers[index]
    place = np.where(np.isfinite(seen), seen, predicted(stored, index))
    off = np.linalg.norm(stored.cameras.project(place)[camera] - stored.rows.xy[row], axis=1)
    free = missing_in_image(stored, index, camera)
    return ranked(off, free, stored.labels.marker[tracks.rows(row)], stored.names, limbs(stored, index))


def ray_of(stored: Stored, row: int) -> tuple[np.ndarray, np.ndarray]:
    """Where a blob's ray begins (3,) m, and its direction (3,)."""
    camera = int(stored.rows.camera[row])
    image = stored.cameras.undistort(stored.rows.xy[[row]], np.array([camera]))[0]
    return stored.cameras.centres[camera], np.append(image, 1.0) @ stored.cameras.rotation[camera]


def blob_edit(kind: type[BlobEdit], stored: Stored, row: int, frames: tuple[int, int] | None, *marker: str) -> BlobEdit:
    """An edit of a blob: in its own frame alone, or along its track in some frames, None for all of the take."""
    frame = int(stored.rows.frames[stored.rows.frame[row]])
    span = (int(stored.rows.frames[0]), int(stored.rows.frames[-1])) if frames is None else frames
    if not span[0] <= frame <= span[1]:
        own, first, last = map(stored.clock.whole, (frame, *span))
        words = f"the blob is of frame {own}, and it is {words_of_frames(first, last)} that would be corrected"
        raise InputError(f"{words}; expected its own among them")
    x, y = (round(float(value), PLACE_DIGITS) for value in stored.rows.xy[row])
    camera = stored.cameras.names[int(stored.rows.camera[row])]
    return kind(camera, frame, x, y, *marker, frames=None if span == (frame, frame) else span)
