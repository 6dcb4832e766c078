# SPDX-License-Identifier: GPL-3.0-or-later
"""Where markers are missing, and what is known of a take around that."""

from dataclasses import dataclass, field

import numpy as np

from ..data.lanes import PACKING
from ..data.physical import MARKER_LIMITS
from ..data.takes import evenly_spread
from ..geometry.rigid import pairwise_distances
from ..review.suspects import runs


class LEARNED_BY:
    """What the rest of a take must show before it says anything of a marker."""

    # with all that is looked at together, before anything is learned of it; 100 errs as much, but with 40 a take of
    # 30 frames has no neighbours to fill by
    min_frames: int = 10  # measured
    # a filled sample helps to fill gaps this many times as long as its own; with 1 four markers that are missing
    # together err by twice what is expected
    help_ratio: int = 4  # measured
    # nearest neighbours that make axes, carry a marker, and tell how fast it moves; 6 err by 10 % more, as they
    # follow joints
    of_axes: int = 4  # measured


# s that strays last at most, then it is the marker's own path or another's; half and twice of it find the same in 43
# recorded takes
STRAYS_LAST_S = 0.2  # measured


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
        gaps += [Gap(start, stop, int(marker)) for start, stop in runs(~present[:, marker])]
    return sorted(gaps, key=lambda gap: (len(gap), gap))


def find_strays(xyz: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """Samples of markers (T, M, 3) m that these cannot have been at, (T, M), and jumps.

    A jump (T, M) is True in the frame of a sample that cannot be reached from the last one that is no stray.
    """
    strays, jumps = np.zeros(xyz.shape[:2], bool), np.zeros(xyz.shape[:2], bool)
    for marker in range(xyz.shape[1]):
        at = np.flatnonzero(np.isfinite(xyz[:, marker, 0]))
        if len(at) > 1:
            stray, jump = _beyond_reach(xyz[:, marker], at, rate)
            strays[stray, marker], jumps[jump, marker] = True, True
    return strays, jumps


def _beyond_reach(path: np.ndarray, at: np.ndarray, rate: float) -> tuple[np.ndarray, np.ndarray]:
    """The frames of strays of a marker's path (T, 3) m, seen in frames (N,), and those of jumps.

    Strays are short pieces that are too far from a long one beside them.
    """

    def too_far(one: np.ndarray, other: np.ndarray) -> np.ndarray:
        reach = MARKER_LIMITS.max_noise_m + MARKER_LIMITS.fastest_m_s * np.abs(other - one) / rate
        return np.linalg.norm(path[other] - path[one], axis=1) > reach

    leaps = too_far(at[:-1], at[1:])
    if not leaps.any():
        return at[:0], at[:0]
    pieces = np.split(at, np.flatnonzero((np.diff(at) > 1) | leaps) + 1)
    most = max(len(piece) for piece in pieces)
    long = [min(most, STRAYS_LAST_S * rate) <= len(piece) for piece in pieces]
    strays, jumps, before = [at[:0]], [], None
    behind = np.append(np.flatnonzero(long), len(pieces))
    for index, piece in enumerate(pieces):
        away = before is not None and too_far(before[-1:], piece[:1])[0]
        if long[index]:
            jumps += [int(piece[0])] * bool(away)
            before = piece
            continue
        after = pieces[behind[np.searchsorted(behind, index)]] if index < behind[-2] else None
        if away or (after is not None and too_far(piece[-1:], after[:1])[0]):
            strays.append(piece)
    return np.concatenate(strays), np.array(jumps, int)


@dataclass(eq=False)
class KnownMarkers:
    """The markers of a take while their gaps are filled, the shortest first."""

    xyz: np.ndarray  # (T, M, 3) m, NaN where neither measured nor filled yet
    # (T, M) frames of the gap that a filled sample is of; 0 where measured or still missing
    length: np.ndarray = field(init=False)
    # (M, M) m, by how much the distance of two markers varies: standard deviation, inf where not known
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
        known = np.isfinite(self.xyz[part, :, 0]) & (LEARNED_BY.help_ratio * self.length[part] <= len(gap))
        spread = np.where(known.all(axis=0), self.spread[gap.marker], np.inf)
        spread[gap.marker] = np.inf
        order = np.argsort(spread, kind="stable")
        return order[np.isfinite(spread[order])]


def _spread(xyz: np.ndarray) -> np.ndarray:
    distances = pairwise_distances(xyz[evenly_spread(len(xyz), PACKING.spread_out)])
    known = np.isfinite(distances)
    count = np.maximum(known.sum(axis=0), 1)
    mean = np.where(known, distances, 0).sum(axis=0) / count
    square = (np.where(known, distances - mean, 0) ** 2).sum(axis=0) / count
    return np.where(known.sum(axis=0) >= LEARNED_BY.min_frames, np.sqrt(square), np.inf)
