# SPDX-License-Identifier: GPL-3.0-or-later
"""What there is to draw in one frame, as plain arrays in the world: no drawing here."""

import re
from dataclasses import dataclass

import numpy as np

from ..core.data.takes import BY_EDIT, CONFLICT, EXCLUSIVE, NO_MARKER, REMAINING, STEPS, PointRows, rows_in_frame
from ..core.review.doubtful import DOUBTFUL_NAMES, markers_meant
from ..scene.blob_dots import on_rays, rows_of_image
from ..scene.take import Stored

GREEN, CYAN, MAGENTA, GREY = (
    (0.15, 0.85, 0.3, 1.0),
    (0.1, 0.85, 0.95, 1.0),
    (0.95, 0.2, 0.85, 1.0),
    (0.55, 0.55, 0.55, 0.9),
)
CALLED = re.compile(r"\btrajector(?:y|ies)((?: \d+)+)")  # trajectories in a reason, one or a list of them
ORANGE, RED = (1.0, 0.75, 0.2, 1.0), (1.0, 0.15, 0.2, 1.0)
YELLOW = (1.0, 0.9, 0.2, 1.0)  # a person named it, as in the timeline
BLUE = (0.337, 0.706, 0.914, 1.0)  # filled, as in the timeline
BLACK, WHITE = (0.02, 0.02, 0.02, 1.0), (1.0, 1.0, 1.0, 1.0)

# Of a link's two ends, the blob and the body's marker, by the step that named the blob: the paper's figure 5.
# What names points colours no link.
STEP_COLOURS = np.tile(np.array(GREY), (len(STEPS), 2, 1))
STEP_COLOURS[EXCLUSIVE] = GREEN, GREEN
STEP_COLOURS[CONFLICT] = CYAN, MAGENTA
STEP_COLOURS[REMAINING] = BLACK, WHITE
STEP_COLOURS[BY_EDIT] = YELLOW, YELLOW


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
    rows, labels = rows_of_image(stored, index, camera), stored.labels
    places = on_rays(stored, rows, pose)
    return CameraMarks(places, labels.marker[rows], labels.step[rows], stored.motion.expected[index])


def links(marks: CameraMarks) -> tuple[np.ndarray, np.ndarray]:
    """Ends (L, 2, 3) m and colours (L, 2, 4) of the lines from named blobs to where the body expects their markers."""
    named = np.flatnonzero(marks.marker != NO_MARKER)
    ends = np.stack([marks.blobs[named], marks.expected[marks.marker[named]]], axis=1)
    there = np.isfinite(ends).all(axis=(1, 2))
    return ends[there], STEP_COLOURS[marks.step[named][there]]


@dataclass(frozen=True, eq=False)
class PointMarks:
    """One frame of a take without cameras, and of any take seen from anywhere.

    named     (M, 3) m the markers that were found; NaN where one was not
    doubtful  (M,) True for those that a person should look at
    unnamed   (N, 3) m the points without a name
    filled    (M,) True for those that were filled, and so not measured
    asked     {index into `unnamed`: what it is called in the review}, for those that may be markers
    """

    named: np.ndarray
    doubtful: np.ndarray
    unnamed: np.ndarray
    filled: np.ndarray
    asked: dict[int, str]


def point_marks(stored: Stored, index: int) -> PointMarks:
    """What there is in frame `index`: doubtful is what has little confidence or is named among the suspects."""
    frame = stored.motion.frames[index] if len(stored.motion.frames) else 0
    here = [suspect for suspect in stored.suspects if suspect.first <= frame <= suspect.last]
    reasons, of_word = [suspect.reason for suspect in here], {name: at for at, name in enumerate(stored.names)}
    doubtful = np.zeros(len(stored.names), dtype=bool)
    doubtful[[marker for suspect in here for marker in markers_meant(suspect, of_word)]] = True
    markers, labels = stored.motion.markers[index], stored.labels
    here_filled = {fill.marker for fill in stored.fitting if fill.first <= frame <= fill.last}
    filled = np.array([name in here_filled for name in stored.names], dtype=bool)
    if not isinstance(stored.rows, PointRows):
        return PointMarks(markers, doubtful, np.empty((0, 3)), filled, {})
    here = rows_in_frame(stored.rows, index)
    marker, confidence = labels.marker[here], labels.confidence[here]
    doubtful[marker[(marker != NO_MARKER) & (confidence < DOUBTFUL_NAMES.min_confidence)]] = True
    left = here.start + np.flatnonzero(marker == NO_MARKER)
    numbers = stored.rows.trajectory[left].tolist()
    # Reasons count things as well, so a number is a trajectory's only where they call it one.
    called = {number for reason in reasons for found in CALLED.findall(reason) for number in map(int, found.split())}
    asked = {row: f"trajectory {number}" for row, number in enumerate(numbers) if number in called}
    return PointMarks(markers, doubtful, stored.rows.xyz[left], filled, asked)


NOTHING_COVERED = np.empty((0, 4))


def room_for_words(
    places: np.ndarray,
    widths: np.ndarray,
    height: float,
    gap: float,
    mark: float = 0,
    covered: np.ndarray = NOTHING_COVERED,
) -> np.ndarray:
    """(N, 2) px where the words beside places (N, 2) begin so that none lies on another; NaN where there is no room.

    Words go to the right of their place, else to the left, above or below it, and where they can not onto the marks
    of `mark` px to each side of all places; `widths` (N,) and `height` are the words'. None goes onto what is covered
    (K, 4), such as a toolbar: left, lower, right and upper end.
    """
    starts = np.full(places.shape, np.nan)
    there = np.flatnonzero(np.isfinite(places).all(axis=1))
    boxes = _boxes_beside(places[there], widths[there], height, gap)
    discs = np.concatenate([places[there] - mark, places[there] + mark], axis=1)
    clear = ~_meets(boxes[:, :, None], discs).any(axis=2)
    # Which boxes meet is asked of all at once: one by one it would cost half a redraw's time.
    flat = boxes.reshape(-1, 4)
    meets = _meets(flat[:, None], flat)
    taken = _meets(flat[:, None], covered).any(axis=1)
    for place, (index, alone) in enumerate(zip(there.tolist(), clear.tolist(), strict=True)):
        free = [way for way, full in enumerate(taken[4 * place : 4 * place + 4].tolist()) if not full]
        if free:
            chosen = 4 * place + next((way for way in free if alone[way]), free[0])
            starts[index] = flat[chosen, :2]
            taken |= meets[chosen]
    return starts


def _boxes_beside(places: np.ndarray, widths: np.ndarray, height: float, gap: float) -> np.ndarray:
    """(N, 4, 4) boxes, left, lower, right, upper end, of words to the right of places (N, 2), left, above and below."""
    x, y = places.T
    left = np.stack([x + gap, x - gap - widths, x - widths / 2, x - widths / 2], axis=1)
    lower = np.stack([y - height / 3, y - height / 3, y + gap, y - gap - height], axis=1)
    return np.stack([left, lower, left + widths[:, None], lower + height], axis=2)


def _meets(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Whether boxes (..., 4) lie on others (..., 4): left, lower, right, upper end."""
    left, lower, right, upper = np.moveaxis(boxes, -1, 0)
    other_left, other_lower, other_right, other_upper = np.moveaxis(others, -1, 0)
    return (left < other_right) & (other_left < right) & (lower < other_upper) & (other_lower < upper)
