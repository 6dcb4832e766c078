# SPDX-License-Identifier: GPL-3.0-or-later
"""What there is to draw in one frame, as plain arrays in the world: no drawing here."""

import re
from dataclasses import dataclass

import numpy as np

from ..core.data.takes import BY_EDIT, CONFLICT, EXCLUSIVE, NO_MARKER, REMAINING, STEPS, PointRows, rows_in_frame
from ..scene.picking import Dots
from ..scene.take import Stored
from ..scene.trajectories import DOUBTFUL, FILLED, states_of

GREEN, CYAN = (0.15, 0.85, 0.3, 1.0), (0.1, 0.85, 0.95, 1.0)
MAGENTA, GREY = (0.95, 0.2, 0.85, 1.0), (0.55, 0.55, 0.55, 0.9)
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


def links(stored: Stored, index: int, blobs: Dots) -> tuple[np.ndarray, np.ndarray]:
    """Ends (L, 2, 3) m and colours (L, 2, 4) of the lines from named blobs to where the body expects their markers."""
    named = np.flatnonzero(blobs.marker != NO_MARKER)
    ends = np.stack([blobs.xyz[named], stored.motion.expected[index, blobs.marker[named]]], axis=1)
    there = np.isfinite(ends).all(axis=(1, 2))
    return ends[there], STEP_COLOURS[stored.labels.step[blobs.trajectory[named[there]]]]


@dataclass(frozen=True, eq=False)
class PointMarks:
    """One frame of a take without cameras, and of any take seen from anywhere."""

    named: np.ndarray  # (M, 3) m the markers that were found; NaN where one was not
    doubtful: np.ndarray  # (M,) True for those that a person should look at
    unnamed: np.ndarray  # (N, 3) m the points without a name
    filled: np.ndarray  # (M,) True for those that were filled, and so not measured
    asked: dict[int, str]  # {index into `unnamed`: what it is called in the review}, for those that may be markers


def point_marks(stored: Stored, index: int) -> PointMarks:
    """What there is in frame `index`."""
    markers = range(len(stored.names))
    states = states_of(stored, markers, slice(index, index + 1))[0] if markers else np.zeros(0, np.int8)
    unnamed, asked = np.empty((0, 3)), {}
    if isinstance(stored.rows, PointRows):
        here, frame = rows_in_frame(stored.rows, index), stored.rows.frames[index]
        left = here.start + np.flatnonzero(~stored.labels.named[here])
        unnamed, numbers = stored.rows.xyz[left], stored.rows.trajectory[left].tolist()
        # Reasons count things as well, so a number is a trajectory's only where they call it one.
        reasons = [suspect.reason for suspect in stored.suspects if suspect.first <= frame <= suspect.last]
        called = {int(number) for words in reasons for found in CALLED.findall(words) for number in found.split()}
        asked = {row: f"trajectory {number}" for row, number in enumerate(numbers) if number in called}
    return PointMarks(stored.motion.markers[index], states == DOUBTFUL, unnamed, states == FILLED, asked)


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
    x, y, wide = *places[there].T, widths[there]
    left = np.stack([x + gap, x - gap - wide, x - wide / 2, x - wide / 2], axis=1)
    lower = np.stack([y - height / 3, y - height / 3, y + gap, y - gap - height], axis=1)
    boxes = np.stack([left, lower, left + wide[:, None], lower + height], axis=2)
    discs = np.concatenate([places[there] - mark, places[there] + mark], axis=1)
    clear = ~_meets(boxes[:, :, None], discs).any(axis=2)
    # Which boxes meet is asked of all at once: one by one it would cost half a redraw's time.
    flat = boxes.reshape(-1, 4)
    meets = _meets(flat[:, None], flat + np.array([-gap, 0, gap, 0]) / 2)  # a space is between two words
    taken = _meets(flat[:, None], covered).any(axis=1)
    for place, (index, alone) in enumerate(zip(there.tolist(), clear.tolist(), strict=True)):
        free = [way for way, full in enumerate(taken[4 * place : 4 * place + 4].tolist()) if not full]
        if free:
            chosen = 4 * place + next((way for way in free if alone[way]), free[0])
            starts[index] = flat[chosen, :2]
            taken |= meets[chosen]
    return starts


def _meets(boxes: np.ndarray, others: np.ndarray) -> np.ndarray:
    """Whether boxes (..., 4) lie on others (..., 4): left, lower, right, upper end."""
    left, lower, right, upper = np.moveaxis(boxes, -1, 0)
    other_left, other_lower, other_right, other_upper = np.moveaxis(others, -1, 0)
    return (left < other_right) & (other_left < right) & (lower < other_upper) & (other_lower < upper)
