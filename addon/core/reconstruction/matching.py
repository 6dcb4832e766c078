# SPDX-License-Identifier: GPL-3.0-or-later
"""The points of one frame from its unnamed blobs: epipolar matching over all cameras at once.

Every set of blobs, at most one a camera, whose rays meet is a hypothesis: one marker made them all. It is weighed
against the other story, that each of them is a ghost, and the hypotheses that hold share no blob.
"""

from dataclasses import dataclass

import numpy as np

from ..geometry.triangulation import Rays, passing
from ..geometry.views import VIEWING, Sight, View
from ..papers.virtual_occlusions.labelling import Rules

MAX_RAY_PAIRS = 20_000  # of rays in a frame; more is a room full of reflections, of which the closest pairs are tried
CHOOSING_ROUNDS = 40  # of choosing hypotheses; few are left after five


@dataclass(frozen=True)
class MatchingOptions:
    """Which blobs are taken to be one marker's, beside how far `Rules` lets them be off.

    Measured on walks in 4 to 8 cameras: half or twice of each number changes 1 % of the points at most.

    room_m3  physical: about the space in which a marker may be
    min_distance_m  physical: between two markers; nearer, two points are one
    max_blur_m  measured: standard deviation along its worst axis of a point; one less certain is none
    min_lead  measured: log likelihood by which a point of two rays must lead any other use of its blobs
    max_alone_m  physical: from all other markers, as they are on one subject
    """

    room_m3: float = 10.0
    min_distance_m: float = 0.006
    max_blur_m: float = 0.02
    min_lead: float = 1.5
    max_alone_m: float = 1.0


MATCHING = MatchingOptions()


@dataclass(frozen=True)
class Circumstances:
    """What a capture is like; learned from the capture itself.

    pixel  px, standard deviation of a blob's position, calibration included
    seen   how likely a camera that has a marker in its image shows a blob of it
    ghosts (C,) how many blobs a frame are no marker's, in each camera
    """

    pixel: float
    seen: float
    ghosts: np.ndarray


@dataclass(frozen=True, eq=False)
class Expected:
    """Where N points should be by their past: points (N, 3) m and radius (N,) m, three standard deviations."""

    points: np.ndarray
    radius: np.ndarray

    @classmethod
    def nothing(cls) -> "Expected":
        """No past."""
        return cls(np.zeros((0, 3)), np.zeros(0))


@dataclass(frozen=True, eq=False)
class FramePoints:
    """The Q points of one frame.

    points    (Q, 3) m
    slots     (Q, C) which blob of each camera is the point's, -1 where none
    residual  (Q,) m, root mean square distance of the point from its rays
    squares   (Q,) px², sum of the squared reprojection errors
    watching  (Q,) how many cameras have the point in their image
    """

    points: np.ndarray
    slots: np.ndarray
    residual: np.ndarray
    squares: np.ndarray
    watching: np.ndarray

    @classmethod
    def nothing(cls, cameras: int) -> "FramePoints":
        """No points, of so many cameras."""
        none = np.zeros(0)
        return cls(np.zeros((0, 3)), np.zeros((0, cameras), int), none, none, np.zeros(0, int))

    @property
    def support(self) -> np.ndarray:
        """(Q,) number of cameras whose blobs make the point."""
        return (self.slots >= 0).sum(axis=1)


class FrameMatcher:
    """One frame's blobs, ready to be matched."""

    def __init__(self, view: View, sight: Sight, size: np.ndarray, circumstances: Circumstances):
        self.view, self.sight, self.size = view, sight, size
        self.pixel, self.seen, self.ghosts = circumstances.pixel, circumstances.seen, circumstances.ghosts
        self.rays = Rays(view, sight)
        self.cameras = np.arange(len(view.real))
        self.camera, self.slot = np.nonzero(view.real)
        self.direction = self.rays.direction[self.camera, self.slot]
        self.origin = sight.centres[self.camera]
        self.free = view.real.copy()

    def match(self, expected: Expected) -> FramePoints:
        """The frame's points: those that the past expects first, then whatever else the blobs left over make."""
        found = []
        if len(expected.points):
            found.append(self._choose(self._pairs_near(expected), expected, []))
        found.append(self._choose(self._free_pairs(), expected, found))
        return _not_alone(joined(found))

    def _pairs_near(self, expected: Expected) -> tuple[np.ndarray, np.ndarray]:
        """Pairs of blobs in different cameras that both lie where the same point is expected."""
        local = self.sight.local(expected.points[None])[0]
        image = self.sight.image(local)
        reach = expected.radius / np.maximum(local[..., 2], VIEWING.min_depth_m)
        reach = reach + Rules.max_miss * self.pixel / self.sight.focal[:, None]
        offset = self.view.image[self.camera, self.slot][:, None] - image[self.camera]
        near = np.einsum("bni,bni->bn", offset, offset) < reach[self.camera] ** 2
        together = near.astype(np.float32) @ near.T.astype(np.float32) > 0
        return np.nonzero(together & (self.camera[:, None] < self.camera))

    def _free_pairs(self) -> tuple[np.ndarray, np.ndarray]:
        """All pairs of blobs in different cameras that are not a point's yet."""
        blobs = np.flatnonzero(self.free[self.camera, self.slot])
        first, second = np.nonzero(self.camera[blobs][:, None] < self.camera[blobs])
        return blobs[first], blobs[second]

    def _crossings(self, first: np.ndarray, second: np.ndarray):
        """Of pairs of blobs those whose rays pass each other closely, and the points (Q, 3) between."""
        near, far, gap, fixed = passing(self.direction, self.origin, first, second)
        gap2 = gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2
        focal = self.sight.focal[self.camera]
        allowed2 = Rules.max_square * self.pixel**2 * ((near / focal[first]) ** 2 + (far / focal[second]) ** 2)
        kept = np.flatnonzero(fixed & (gap2 < allowed2))
        if len(kept) > MAX_RAY_PAIRS:
            kept = kept[np.argsort(gap2[kept] / allowed2[kept])[:MAX_RAY_PAIRS]]
        middle = self.origin[first[kept]] + near[kept, None] * self.direction[first[kept]] + gap[:, kept].T / 2
        return first[kept], second[kept], middle

    def _nearest_blobs(self, points: np.ndarray, deviations: float) -> np.ndarray:
        """(Q, C) the free blob nearest to each point's image, -1 where it is farther than `deviations`."""
        image = self.sight.image(self.sight.local(points[None])[0])
        # Axis by axis: NumPy is slow to add up two of something.
        square = (np.where(self.free, self.view.image[..., 0], np.inf)[:, None] - image[..., :1]) ** 2
        square += (self.view.image[..., 1][:, None] - image[..., 1:]) ** 2
        nearest = square.argmin(axis=2)
        least = np.take_along_axis(square, nearest[..., None], axis=2)[..., 0]
        return np.where(least < (deviations * self.pixel / self.sight.focal[:, None]) ** 2, nearest, -1).T

    def _choose(self, pairs, expected: Expected, before: list[FramePoints]) -> FramePoints:
        """The hypotheses from pairs of blobs that hold, best first; their blobs are not free any more."""
        first, second, middle = self._crossings(*pairs)
        slots = self._nearest_blobs(middle, Rules.max_off_point)
        slots[np.arange(len(first)), self.camera[first]] = self.slot[first]
        slots[np.arange(len(first)), self.camera[second]] = self.slot[second]
        left = _Hypotheses.of(self, self._completed(slots), expected)
        taken = [part.points for part in before]
        chosen = []
        for _ in range(CHOOSING_ROUNDS):
            winners = left.winners(taken)
            if not winners.any():
                break
            chosen.append(left.pick(winners).points_of(self))
            taken.append(chosen[-1].points)
            for camera in self.cameras:
                slot = chosen[-1].slots[:, camera]
                self.free[camera, slot[slot >= 0]] = False
            left = left.without(self, winners, expected)
        chosen.append(left.pick(np.zeros(len(left.slots), bool)).points_of(self))
        return joined(chosen)

    def _completed(self, slots: np.ndarray) -> np.ndarray:
        """Sets of blobs (Q, C) whose rays meet in one point, and to which no other near blob belongs; each once."""
        for _ in range(2):
            slots = self.agreeing(each_once(slots))
            met = self.rays.meet(slots.T)
            known = np.isfinite(met.points[:, 0])
            more = self._nearest_blobs(met.points[known], Rules.max_miss)
            slots = np.where(slots[known] >= 0, slots[known], more)
        return self.agreeing(each_once(slots))

    def agreeing(self, slots: np.ndarray) -> np.ndarray:
        """Sets of blobs (Q, C) less their worst rays, until all rays that are left meet; those with two or more."""
        slots = slots[(slots >= 0).sum(axis=1) >= 2]
        for _ in self.cameras:
            miss = self.deviations(slots)
            bad = miss.max(axis=0, initial=0) > Rules.max_miss
            if not bad.any():
                break
            slots = slots.copy()
            slots[bad, miss[:, bad].argmax(axis=0)] = -1
            slots = slots[(slots >= 0).sum(axis=1) >= 2]
        return slots

    def deviations(self, slots: np.ndarray) -> np.ndarray:
        """(C, Q) how far the rays of sets of blobs (Q, C) miss their points, standard deviations."""
        met = self.rays.meet(slots.T)
        return met.miss / np.maximum(self.metres(met.points), 1e-9)

    def metres(self, points: np.ndarray) -> np.ndarray:
        """(C, Q) m, standard deviation of a blob's position at the points (Q, 3)."""
        depth = np.nan_to_num(self.sight.local(points[None])[0, ..., 2], nan=1.0)
        return self.pixel / self.sight.focal[:, None] * np.maximum(depth, VIEWING.min_depth_m)


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """Q sets of blobs that may each be one marker.

    slots  (Q, C); points (Q, 3) m; residual (Q,) m; miss (C, Q) deviations
    score  (Q,) log of how much likelier a marker is than ghosts
    """

    slots: np.ndarray
    points: np.ndarray
    residual: np.ndarray
    miss: np.ndarray
    score: np.ndarray

    @classmethod
    def of(cls, frame: FrameMatcher, slots: np.ndarray, expected: Expected) -> "_Hypotheses":
        met = frame.rays.meet(slots.T)
        metres = frame.metres(met.points)
        seen = (slots >= 0).T
        precision = np.where(seen, 1 / metres**2, 0)
        across = frame.rays.across[frame.cameras[:, None], np.maximum(slots.T, 0)]
        normal = np.einsum("cq,cqij->qij", precision, across)
        curvature = np.linalg.eigvalsh(normal)
        sharp = np.isfinite(met.residual) & (curvature[:, 0] > MATCHING.max_blur_m**-2)
        miss = met.miss / metres
        area = frame.size.prod(axis=1)
        # One ray of a marker against one ghost somewhere in the image, and a camera that looks and sees nothing.
        gain = np.log(frame.seen * area / (2 * np.pi * frame.pixel**2 * frame.ghosts))[:, None] - miss**2 / 2
        watching = _watching(frame, met.points)
        score = np.where(seen, gain, np.where(watching, np.log(1 - frame.seen), 0)).sum(axis=0)
        # The point may be anywhere in the room: what three unknowns make of any rays says nothing.
        cell = (2 * np.pi) ** 1.5 / np.sqrt(np.maximum(curvature, 1e-3).prod(axis=1))
        room = MATCHING.room_m3
        score += np.log(np.minimum(cell / room, 1)) + _familiarity(met.points, expected, room)
        kept = sharp & (score > 0)
        return cls(slots[kept], met.points[kept], met.residual[kept], miss[:, kept], score[kept])

    def pick(self, chosen: np.ndarray) -> "_Hypotheses":
        parts = self.slots[chosen], self.points[chosen], self.residual[chosen]
        return _Hypotheses(*parts, self.miss[:, chosen], self.score[chosen])

    def points_of(self, frame: FrameMatcher) -> FramePoints:
        squares = (self.miss**2).sum(axis=0) * frame.pixel**2
        return FramePoints(self.points, self.slots, self.residual, squares, _watching(frame, self.points).sum(axis=0))

    def winners(self, taken: list[np.ndarray]) -> np.ndarray:
        """(Q,) those that are likelier than every other one that needs one of their blobs, or the same place."""
        count = len(self.slots)
        if not count:
            return np.zeros(0, bool)
        order = np.lexsort((self.residual, -self.score))
        rank = np.empty(count, int)
        rank[order] = np.arange(count)
        shares = self._shared()
        near = _near(self.points, self.points)
        first = ~((shares | near) & (rank[None] < rank[:, None])).any(axis=1)
        for points in taken:
            first &= ~_near(self.points, points).any(axis=1)
        thin = (self.slots >= 0).sum(axis=1) == 2
        # Where two rays are all, another partner for either blob must be clearly less likely.
        other = np.where(shares & ~near, self.score[None], -np.inf).max(axis=1, initial=-np.inf)
        return first & (~thin | (self.score - other > MATCHING.min_lead))

    def _shared(self) -> np.ndarray:
        """(Q, Q) whether two sets have a blob in common."""
        shared = np.zeros((len(self.slots), len(self.slots)), bool)
        for slot in self.slots.T:
            shared |= (slot[:, None] == slot) & (slot >= 0)
        np.fill_diagonal(shared, False)
        return shared

    def without(self, frame: FrameMatcher, winners: np.ndarray, expected: Expected) -> "_Hypotheses":
        """The other hypotheses with the blobs that are still free."""
        slots = self.slots[~winners]
        lost = (slots >= 0) & ~frame.free[frame.cameras, np.maximum(slots, 0)]
        touched = lost.any(axis=1)
        rest = self.pick(np.flatnonzero(~winners)[~touched])
        slots = np.where(lost, -1, slots)[touched]
        again = _Hypotheses.of(frame, frame.agreeing(each_once(slots)), expected)
        fields = {
            name: np.concatenate([getattr(rest, name), getattr(again, name)]) for name in vars(rest) if name != "miss"
        }
        return _Hypotheses(miss=np.concatenate([rest.miss, again.miss], axis=1), **fields)


def each_once(slots: np.ndarray) -> np.ndarray:
    """The different ones of sets of blobs (Q, C), in order; with few cameras by one number for each set."""
    base = int(slots.max(initial=0)) + 2
    if base ** slots.shape[1] >= 2**63:
        return np.unique(slots, axis=0)
    number = np.zeros(len(slots), np.int64)
    for slot in slots.T:
        number = number * base + slot + 1
    return slots[np.unique(number, return_index=True)[1]]


def joined(parts: list[FramePoints]) -> FramePoints:
    """All points of several parts of a frame."""
    return FramePoints(*(np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])))


def _not_alone(points: FramePoints) -> FramePoints:
    """The points less those of two rays that are far from all better ones: reflections that stay where they are."""
    sure = points.support >= 3
    if sure.sum() < 3:
        return points
    offset = points.points[:, None] - points.points[sure]
    near = np.einsum("qni,qni->qn", offset, offset).min(axis=1) < MATCHING.max_alone_m**2
    return FramePoints(*(getattr(points, name)[near] for name in vars(points)))


def _watching(frame: FrameMatcher, points: np.ndarray) -> np.ndarray:
    """(C, Q) which cameras have the points in their image."""
    local = frame.sight.local(np.nan_to_num(points, nan=1e9)[None])
    return frame.sight.inside(frame.sight.image(local))[0]


def _familiarity(points: np.ndarray, expected: Expected, room: float) -> np.ndarray:
    """(Q,) log of how much likelier a point is where one is expected than anywhere in `room` m³; nought elsewhere."""
    if not len(expected.points) or not len(points):
        return np.zeros(len(points))
    spread = expected.radius / 3
    offset = np.nan_to_num(points, nan=1e9)[:, None] - expected.points
    square = np.einsum("qni,qni->qn", offset, offset) / spread**2
    return np.maximum(np.log(room / ((2 * np.pi) ** 1.5 * spread**3)) - square / 2, 0).max(axis=1)


def _near(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    """(Q, N) which points are too close together to be two markers; never a point and itself."""
    offset = first[:, None] - second
    near = np.einsum("qni,qni->qn", offset, offset) < MATCHING.min_distance_m**2
    if first is second:
        np.fill_diagonal(near, False)
    return near
