# SPDX-License-Identifier: GPL-3.0-or-later
"""Markers of the set that were not put on, or fell off: most of a take expects them and does not find them."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .tracking import FrameResult


@dataclass(frozen=True)
class AbsentOptions:
    """When a marker is not there; reckoned.

    min_frames  that must show it: in a few frames anything may be hidden
    max_found   share of the images it should be seen in that have a blob with its name: the body in the way is judged
                far better than that
    max_met     share of the frames in which three cameras agree on its place
    """

    min_frames: int = 60
    max_found: float = 0.2
    max_met: float = 0.05


ABSENT = AbsentOptions()


def absent_markers(results: Sequence[FrameResult | None], options: AbsentOptions = ABSENT) -> np.ndarray:
    """(K,) the markers that are not there in all of these frames."""
    known = [result for result in results if result is not None]
    if len(known) < options.min_frames:
        return np.zeros(0, int)
    due = sum(result.expected.visible.sum(axis=0) for result in known)
    rays = np.array([(result.naming.rays >= 0).sum(axis=0) for result in known])
    met = (rays >= 3).mean(axis=0)
    return np.flatnonzero((rays.sum(axis=0) < options.max_found * due) & (met < options.max_met))
