# SPDX-License-Identifier: GPL-3.0-or-later
"""Whole namings that a cloud may be mistaken for: a limb for the other side's, the body for itself seen from behind."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..body.sides import limb_exchanges, mirror_order
from ..geometry.upright import turned
from ..points.likelihood.shape import Shape

OTHER_SIDE, TURNED_ROUND = "sides", "turn"

MAX_TURNS = 4  # of the whole cloud that are judged, the likeliest; a square has three
MIN_RENAMED_SHARE = 0.5  # of the markers, by a turn of the whole body
YAWS = 24  # turns of the whole cloud that are tried, every 15 degrees
MIN_TURN_RAD = np.pi / 4 - 1e-6  # an eighth of a turn: a body that is turned less is the same body


@dataclass(frozen=True, eq=False)
class Renaming:
    """Many markers that take each other's points at once."""

    kind: str  # OTHER_SIDE: a limb and its mirror image; TURNED_ROUND: the whole set, turned about the vertical
    order: np.ndarray  # (M,) the marker whose point each marker takes, itself where nothing changes
    yaw: float  # rad

    @property
    def moved(self) -> np.ndarray:
        """(N,) the markers that change their points."""
        return np.flatnonzero(self.order != np.arange(len(self.order)))


def renamings(markers: Sequence[str], shape: Shape) -> list[Renaming]:
    """What to try: every limb with the other side's, and the turns after which the cloud looks most like itself."""
    limbs = [Renaming(OTHER_SIDE, order, 0.0) for order in limb_exchanges(mirror_order(markers), shape.mean)]
    return [*limbs, *_turns(shape)]


def _turns(shape: Shape) -> list[Renaming]:
    """The turned clouds that lie best on the cloud itself, each marker on the nearest in standard deviations."""
    from scipy.optimize import linear_sum_assignment

    mean = shape.mean - shape.mean.mean(axis=0)
    variance = shape.noise + (shape.modes**2).sum(axis=(1, 2)) / 3
    both = variance[:, None] + variance
    found: dict[tuple[int, ...], tuple[float, float]] = {}
    yaws = np.arange(1, YAWS) * (2 * np.pi / YAWS)
    for yaw in yaws[np.minimum(yaws, 2 * np.pi - yaws) >= MIN_TURN_RAD]:
        image = turned(mean, np.array(yaw))
        square = ((mean[:, None] - image[None]) ** 2).sum(axis=2) / both
        rows, columns = linear_sum_assignment(square)
        total = float(square[rows, columns].sum())
        key = tuple(columns.tolist())
        if (columns != rows).mean() >= MIN_RENAMED_SHARE and total < found.get(key, (np.inf, 0.0))[0]:
            found[key] = total, float(yaw)
    best = sorted(found.items(), key=lambda row: row[1][0])[:MAX_TURNS]
    return [Renaming(TURNED_ROUND, np.array(key), yaw) for key, (_, yaw) in best]
