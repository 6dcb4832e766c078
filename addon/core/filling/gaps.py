# SPDX-License-Identifier: GPL-3.0-or-later
"""Where markers are missing, and what is known of a take around that."""

from dataclasses import dataclass, field

import numpy as np

from ..data.takes import evenly_spread
from ..geometry.rigid import pairwise_distances


@dataclass(frozen=True)
class NeighbourOptions:
    """Which markers are known well enough to fill a gap by; reckoned.

    spread_frames  that the spread of distances is taken from; more change the order of neighbours no more
    min_together   frames that two markers must share for the spread of their distance to say anything
    help_ratio     a filled sample helps to fill gaps this many times as long as its own: those err far more than it
    """

    spread_frames: int = 600
    min_together: int = 10
    help_ratio: int = 4


NEIGHBOURS = NeighbourOptions()


@dataclass(frozen=True, order=True)
class Gap:
    """Frames from `start` up to, not including, `stop` (0-based) in which a marker (an index) is missing."""

    start: int
    stop: int
    marker: int

    def __len__(self) -> int:
        return self.stop - self.start

    @property
    def frames(self) -> np.ndarray:
        """The gap's frames."""
        return np.arange(self.start, self.stop)

    def ends(self, own: np.ndarray) -> list[int]:
        """The frames right before and right after it in which the marker may be looked at, by `own` (T,)."""
        return [end for end in (self.start - 1, self.stop) if 0 <= end < len(own) and own[end]]

    def led(self, values: list[np.ndarray]) -> np.ndarray:
        """What each of its frames takes over from its ends: of two a mean, (L, 3), by how near they are."""
        if len(values) == 1:
            return values[0]
        along = (np.arange(1, len(self) + 1) / (len(self) + 1))[:, None]
        return (1 - along) * values[0] + along * values[1]


def find_gaps(present: np.ndarray) -> list[Gap]:
    """All gaps of markers that are seen at all, present (T, M), the shortest first."""
    gaps = []
    for marker in np.flatnonzero(present.any(axis=0)):
        edges = np.flatnonzero(np.diff(np.r_[True, present[:, marker], True].astype(np.int8)))
        pairs = edges.reshape(-1, 2)
        gaps += [Gap(int(start), int(stop), int(marker)) for start, stop in pairs]
    return sorted(gaps, key=lambda gap: (len(gap), gap))


@dataclass(eq=False)
class KnownMarkers:
    """The markers of a take while their gaps are filled, the shortest first.

    xyz     (T, M, 3) m, NaN where neither measured nor filled yet
    length  (T, M) frames of the gap that a filled sample is of; 0 where measured or still missing
    spread  (M, M) m, by how much the distance of two markers varies: standard deviation, inf where not known
    """

    xyz: np.ndarray
    length: np.ndarray = field(init=False)
    spread: np.ndarray = field(init=False)

    def __post_init__(self):
        self.xyz = np.array(self.xyz, dtype=float)
        self.length = np.zeros(self.xyz.shape[:2], dtype=np.int32)
        self.spread = _spread(self.xyz)

    @property
    def known(self) -> np.ndarray:
        """(T, M) True where measured or filled."""
        return np.isfinite(self.xyz[..., 0])

    def put(self, gap: Gap, filled: np.ndarray):
        """Fills a gap with positions (L, 3) m."""
        self.xyz[gap.start : gap.stop, gap.marker] = filled
        self.length[gap.start : gap.stop, gap.marker] = len(gap)

    def window(self, gap: Gap) -> slice:
        """The gap with the frame before and the frame after it, where the take has them."""
        return slice(max(gap.start - 1, 0), min(gap.stop + 1, len(self.xyz)))

    def helping(self, gap: Gap) -> np.ndarray:
        """The markers that are known all through a gap and its ends, those that move most like it first."""
        part = self.window(gap)
        known = np.isfinite(self.xyz[part, :, 0]) & (NEIGHBOURS.help_ratio * self.length[part] <= len(gap))
        spread = np.where(known.all(axis=0), self.spread[gap.marker], np.inf)
        spread[gap.marker] = np.inf
        order = np.argsort(spread, kind="stable")
        return order[np.isfinite(spread[order])]


def _spread(xyz: np.ndarray) -> np.ndarray:
    distances = pairwise_distances(xyz[evenly_spread(len(xyz), NEIGHBOURS.spread_frames)])
    known = np.isfinite(distances)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, distances, 0).sum(axis=0) / count
    square = (np.where(known, distances - mean, 0) ** 2).sum(axis=0) / count
    return np.where(known.sum(axis=0) >= NEIGHBOURS.min_together, np.sqrt(square), np.inf)
