# SPDX-License-Identifier: GPL-3.0-or-later
"""What there is to draw in one frame, as plain arrays in the world: no drawing here."""

from dataclasses import dataclass

import numpy as np

from ..core.takes import CONFLICT, EXCLUSIVE, NO_MARKER, NO_STEP, REMAINING
from ..scene.take import Stored

GREEN, CYAN, MAGENTA, GREY = (
    (0.15, 0.85, 0.3, 1.0),
    (0.1, 0.85, 0.95, 1.0),
    (0.95, 0.2, 0.85, 1.0),
    (0.55, 0.55, 0.55, 0.9),
)
BLACK, WHITE = (0.02, 0.02, 0.02, 1.0), (1.0, 1.0, 1.0, 1.0)

# Of a link's two ends, the blob and the body's marker, by the step that named the blob: the paper's figure 5.
STEP_COLOURS = np.empty((4, 2, 4))
STEP_COLOURS[NO_STEP] = GREY, GREY
STEP_COLOURS[EXCLUSIVE] = GREEN, GREEN
STEP_COLOURS[CONFLICT] = CYAN, MAGENTA
STEP_COLOURS[REMAINING] = BLACK, WHITE


@dataclass(frozen=True, eq=False)
class CameraMarks:
    """One frame through one camera.

    blobs     (N, 3) m, a point on each blob's ray, lens taken out
    marker    (N,) index of the blob's marker, NO_MARKER where unnamed
    step      (N,) how it was named
    expected  (M, 3) m, where the body carries each marker; NaN where nobody was found
    """

    blobs: np.ndarray
    marker: np.ndarray
    step: np.ndarray
    expected: np.ndarray


def frame_index(stored: Stored, frame: int) -> int:
    """Which of the take's frames Blender's `frame` is; -1 outside the take."""
    frames = stored.motion.frames
    at = int(np.searchsorted(frames, frame - stored.shift))
    return at if at < len(frames) and frames[at] == frame - stored.shift else -1


def camera_marks(stored: Stored, index: int, camera: int, pose: np.ndarray) -> CameraMarks:
    """What camera number `camera` saw in frame `index`; `pose` (4, 4) is the Blender camera's, which looks along -z."""
    blobs, labels = stored.blobs, stored.labels
    first, last = np.searchsorted(blobs.frame, [index, index + 1])
    rows = first + np.flatnonzero(blobs.camera[first:last] == camera)
    image = stored.cameras.undistort(blobs.xy[rows], blobs.camera[rows])
    ahead = np.column_stack([image[:, 0], -image[:, 1], np.full(len(rows), -1.0)])
    return CameraMarks(
        ahead @ pose[:3, :3].T + pose[:3, 3], labels.marker[rows], labels.step[rows], stored.motion.expected[index]
    )


def links(marks: CameraMarks) -> tuple[np.ndarray, np.ndarray]:
    """Ends (L, 2, 3) m and colours (L, 2, 4) of the lines from named blobs to where the body expects their markers."""
    named = np.flatnonzero(marks.marker != NO_MARKER)
    ends = np.stack([marks.blobs[named], marks.expected[marks.marker[named]]], axis=1)
    there = np.isfinite(ends).all(axis=(1, 2))
    return ends[there], STEP_COLOURS[marks.step[named][there]]


def room_for_words(places: np.ndarray, widths: np.ndarray, height: float, gap: float) -> np.ndarray:
    """(N, 2) px where the words beside places (N, 2) begin so that none lies on another; NaN where there is no room.

    Words go to the right of their place, else to the left, above or below it; `widths` (N,) and `height` are theirs.
    """
    starts = np.full(places.shape, np.nan)
    taken = np.empty((0, 4))
    for index, (x, y) in enumerate(places):
        if not np.isfinite(x):
            continue
        width = widths[index]
        right, left, middle = x + gap, x - gap - width, x - width / 2
        for left_end, base in (
            (right, y - height / 3),
            (left, y - height / 3),
            (middle, y + gap),
            (middle, y - gap - height),
        ):
            box = np.array([left_end, base, left_end + width, base + height])
            if not ((box[:2] < taken[:, 2:]) & (taken[:, :2] < box[2:])).all(axis=1).any():
                starts[index] = left_end, base
                taken = np.vstack([taken, box])
                break
    return starts


def to_region(points: np.ndarray, perspective: np.ndarray, size: tuple[int, int]) -> np.ndarray:
    """(..., 2) px in a region of `size` of points (..., 3) m, by its perspective matrix; NaN behind the viewer."""
    flat = np.concatenate([points, np.ones((*points.shape[:-1], 1))], axis=-1) @ perspective.T
    with np.errstate(invalid="ignore", divide="ignore"):
        image = flat[..., :2] / np.where(flat[..., 3:] > 1e-6, flat[..., 3:], np.nan)
    return (image + 1) / 2 * np.asarray(size, dtype=float)
