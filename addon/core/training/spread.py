# SPDX-License-Identifier: GPL-3.0-or-later
"""What every step of training goes by: how much of a subject is looked at, and how far other subjects are from it."""

import numpy as np

from ..data.takes import evenly_spread

MAJORITY = 0.5  # of the markers that a frame shows, of the names that are known
TAILS, TAIL_SDS = 0.1, 2.563  # part of a normal distribution at either end, and standard deviations between the two


class SPREAD:
    """What several steps of training share."""

    # of a subject that a step looks at, spread over its takes
    frames: int = 120  # measured: with 60 to 240 of the known poses the same bodies are laid into the walkers of McGill
    # heights, that markers of the same name sit elsewhere on somebody else; 17 mm of an adult, between laboratories it
    # is 12 to 14 mm, on thighs and arms more
    marker_sd: float = 0.01  # physical
    # that joints bend beyond what was recorded
    bend_sd_rad: float = 0.2  # measured on four actors, the body of each learned from the others


def some_of(points: np.ndarray) -> np.ndarray:
    """Frames (F, M, 3) spread over those of a subject (T, M, 3)."""
    return points[evenly_spread(len(points), SPREAD.frames)]


def full_frames(points: np.ndarray, fewest: int) -> np.ndarray:
    """Which frames of points (T, M, 3) show `fewest` markers or more, and the majority of the most that any shows."""
    seen = np.isfinite(points).all(axis=2).sum(axis=1)
    return np.flatnonzero(seen >= max(fewest, MAJORITY * seen.max(initial=0)))
