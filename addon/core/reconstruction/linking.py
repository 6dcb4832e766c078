# SPDX-License-Identifier: GPL-3.0-or-later
"""Points of one frame after the other joined into trajectories: the nearest to where each should be, one to one."""

from dataclasses import dataclass, replace

import numpy as np

from ..data.physical import MARKER_LIMITS
from .matching import Expected


@dataclass(frozen=True)
class LinkingOptions:
    """How points are linked, beside what `MARKER_LIMITS` says of markers.

    max_reach_m  measured: m, from where a point is expected, and of a trajectory that has just begun; twice of it
                 exchanges trajectories
    max_gap_s    measured: s without a point, after which a trajectory ends; half of it breaks three times as many
    """

    max_reach_m: float = 0.12
    max_gap_s: float = 0.12


LINKING = LinkingOptions()


@dataclass(eq=False)
class Links:
    """The trajectories that are being followed, N of them: number, place, velocity, length and frames without a point.

    number (N,); points (N, 3) m; velocity (N, 3) m a frame; length (N,) points so far; missing (N,) frames
    """

    rate: float
    number: np.ndarray
    points: np.ndarray
    velocity: np.ndarray
    length: np.ndarray
    missing: np.ndarray
    begun: int
    options: LinkingOptions = LINKING

    @classmethod
    def at(cls, rate: float) -> "Links":
        """No trajectories yet, `rate` frames a second."""
        none = np.zeros(0, int)
        return cls(rate, none, np.zeros((0, 3)), np.zeros((0, 3)), none, none, begun=0)

    def backwards(self, points: np.ndarray, numbers: np.ndarray) -> "Links":
        """The same trajectories, to be followed into the past from where they had `points` with these `numbers`."""
        place = {number: index for index, number in enumerate(self.number.tolist())}
        at = np.array([place.get(number, -1) for number in numbers.tolist()], dtype=int)
        velocity = np.where((at >= 0)[:, None], -self.velocity[at], 0.0) if len(self.number) else 0 * points
        length = np.where(at >= 0, self.length[at], 1) if len(self.number) else np.ones(len(points), int)
        return replace(
            self,
            number=numbers.copy(),
            points=points.copy(),
            velocity=velocity,
            length=length,
            missing=np.zeros(len(points), int),
        )

    def expected(self) -> Expected:
        """Where the trajectories should be in the next frame."""
        return Expected(self.points + self.velocity * (1 + self.missing)[:, None], self._reach())

    def _reach(self) -> np.ndarray:
        """(N,) m, how far from there a point may be and still be of the trajectory."""
        seconds = (1 + self.missing) / self.rate
        reach = MARKER_LIMITS.max_noise_m + MARKER_LIMITS.max_push_m_s2 / 2 * seconds**2
        return np.where(self.length < 2, self.options.max_reach_m, np.minimum(reach, self.options.max_reach_m))

    def link(self, points: np.ndarray) -> np.ndarray:
        """(Q,) the numbers of the trajectories that the next frame's points (Q, 3) belong to; new ones begin."""
        if not len(points) and not len(self.number):
            return np.zeros(0, int)
        expected = self.expected()
        old, new = _nearest_pairs(expected, points)
        numbers = np.full(len(points), -1)
        numbers[new] = self.number[old]
        step = (points[new] - self.points[old]) / (1 + self.missing[old])[:, None]
        self.velocity[old] = step
        self.points[old] = points[new]
        self.length[old] += 1
        self.missing += 1
        self.missing[old] = 0
        fresh = np.flatnonzero(numbers < 0)
        numbers[fresh] = self.begun + np.arange(len(fresh))
        self._keep(self.missing <= max(self.options.max_gap_s * self.rate, 2))
        self._begin(points[fresh], numbers[fresh])
        return numbers

    def _keep(self, kept: np.ndarray):
        for name in ("number", "points", "velocity", "length", "missing"):
            setattr(self, name, getattr(self, name)[kept])

    def _begin(self, points: np.ndarray, numbers: np.ndarray):
        ones, still = np.ones(len(points), int), np.zeros_like(points)
        added = {"number": numbers, "points": points, "velocity": still, "length": ones, "missing": 0 * ones}
        for name, values in added.items():
            setattr(self, name, np.concatenate([getattr(self, name), values]))
        self.begun += len(points)


def _nearest_pairs(expected: Expected, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of expected and real points within reach, nearest first by their reach, each in one pair."""
    distance = np.linalg.norm(expected.points[:, None] - points, axis=2) / expected.radius[:, None]
    old, new = np.nonzero(distance < 1)
    pairs: list[tuple[int, int]] = []
    for index in np.argsort(distance[old, new], kind="stable"):
        one, two = int(old[index]), int(new[index])
        if all(one != first and two != second for first, second in pairs):
            pairs.append((one, two))
    found = np.array(pairs, dtype=int).reshape(-1, 2)
    return found[:, 0], found[:, 1]
