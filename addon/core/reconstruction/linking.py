# SPDX-License-Identifier: GPL-3.0-or-later
"""Points of one frame after the other joined into trajectories: the nearest to where each should be, one to one."""

from dataclasses import dataclass

import numpy as np

from ..data.physical import MARKER_LIMITS
from ..papers.virtual_occlusions.labelling import Rules
from .matching import Expected


class LINKING:
    """How markers move, so far as it links points, beside what `MARKER_LIMITS` says."""

    # by which the velocity of a trajectory that has just begun may differ from its neighbours'
    max_start_m_s: float = 3.0  # measured
    # without a point, after which a trajectory ends; half of it breaks three times as many
    max_gap_s: float = 0.12  # measured
    # of the newest step in the velocity; without the older steps and the neighbours one of two who walk one behind
    # the other (`blobs of several behind`) has 520 wrong labels for 11
    velocity_share: float = 0.6  # measured
    settled_points: int = 6  # measured: of a trajectory after which its velocity counts for others, on the same take
    # within which a trajectory that begins moves as those around it do, on the same take
    neighbour_m: float = 0.4  # measured


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

    @classmethod
    def at(cls, rate: float) -> "Links":
        """No trajectories yet, `rate` frames a second."""
        none = np.zeros(0, int)
        return cls(rate, none, np.zeros((0, 3)), np.zeros((0, 3)), none, none, begun=0)

    def expected(self, frame: int) -> Expected:
        """Where the trajectories should be in the next frame, which has a number."""
        points = self.points + self.velocity * (1 + self.missing)[:, None]
        return Expected(np.full(len(points), frame), points, self._reach())

    def _reach(self) -> np.ndarray:
        """(N,) m, how far from there a point may be and still be of the trajectory."""
        seconds = (1 + self.missing) / self.rate
        start = np.where(self.length < 2, LINKING.max_start_m_s * seconds, 0)
        # No blob is farther from where its marker is expected; twice of it exchanges trajectories.
        return np.minimum(MARKER_LIMITS.reach_m(seconds) + start, Rules.max_distance_m)

    def link(self, points: np.ndarray) -> np.ndarray:
        """(Q,) the numbers of the trajectories that the next frame's points (Q, 3) belong to; new ones begin."""
        if not len(points) and not len(self.number):
            return np.zeros(0, int)
        expected = self.expected(0)
        old, new = _nearest_pairs(expected, points)
        numbers = np.full(len(points), -1)
        numbers[new] = self.number[old]
        step = (points[new] - self.points[old]) / (1 + self.missing[old])[:, None]
        share = np.where(self.length[old] < 2, 1.0, LINKING.velocity_share)[:, None]
        self.velocity[old] += share * (step - self.velocity[old])
        self.points[old] = points[new]
        self.length[old] += 1
        self.missing += 1
        self.missing[old] = 0
        fresh = np.flatnonzero(numbers < 0)
        numbers[fresh] = self.begun + np.arange(len(fresh))
        self._keep(self.missing <= max(LINKING.max_gap_s * self.rate, 2))
        self._begin(points[fresh], numbers[fresh])
        return numbers

    def _keep(self, kept: np.ndarray):
        for name in ("number", "points", "velocity", "length", "missing"):
            setattr(self, name, getattr(self, name)[kept])

    def _begin(self, points: np.ndarray, numbers: np.ndarray):
        velocity = self._around(points)
        ones = np.ones(len(points), int)
        added = {"number": numbers, "points": points, "velocity": velocity, "length": ones, "missing": 0 * ones}
        for name, values in added.items():
            setattr(self, name, np.concatenate([getattr(self, name), values]))
        self.begun += len(points)

    def _around(self, points: np.ndarray) -> np.ndarray:
        """(Q, 3) m a frame: how the trajectories around points move, nearer ones counting more."""
        known = self.length >= LINKING.settled_points
        if not known.any() or not len(points):
            return np.zeros((len(points), 3))
        distance = np.linalg.norm(points[:, None] - self.points[known], axis=2)
        weight = np.maximum(1 - distance / LINKING.neighbour_m, 0) ** 4
        return weight @ self.velocity[known] / np.maximum(weight.sum(axis=1, keepdims=True), 1e-9)


def _nearest_pairs(expected: Expected, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Pairs of expected and real points within reach, the nearest by their reach before others, each in one pair."""
    off = expected.points[:, None] - points
    distance = np.sqrt(np.einsum("eqi,eqi->eq", off, off)) / expected.radius[:, None]
    distance = np.where(distance < 1, distance, np.inf)
    found = [np.zeros((2, 0), int)]
    while np.isfinite(distance).any():
        nearest = distance.argmin(axis=1)  # of any two that are nearest to each other none is nearer to another
        old = np.flatnonzero(distance.argmin(axis=0)[nearest] == np.arange(len(nearest)))
        old = old[np.isfinite(distance[old, nearest[old]])]
        found.append(np.stack([old, nearest[old]]))
        distance[old], distance[:, nearest[old]] = np.inf, np.inf
    every = np.concatenate(found, axis=1)
    return every[0], every[1]
