# SPDX-License-Identifier: GPL-3.0-or-later
"""The points of some frames from their unnamed blobs: what goes on as expected, then epipolar matching of the rest.

Every set of blobs, at most one a camera, whose rays meet is a hypothesis: one marker made them all. It is weighed
against the other story, that each of them is a ghost, and the hypotheses that hold share no blob.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ..data.physical import MARKER_LIMITS
from ..geometry.triangulation import Rays, passing
from ..geometry.views import VIEWING, Sight, View
from ..papers.virtual_occlusions.labelling import Rules

MAX_RAY_PAIRS = 20_000  # of rays in a frame; more is a room full of reflections, of which the closest pairs are tried
CELLS = 32  # along each axis of an image, over and over: what shares a cell may be far, which costs a look
CHOOSING_ROUNDS = 40  # of choosing hypotheses; few are left after five


class MATCHING:
    """Which blobs are taken to be one marker's, beside how far `Rules` lets them be off.

    Measured on walks in 4 to 8 cameras: half or twice of each number changes 1 % of the points at most.
    """

    room_m3: float = 10.0  # physical: about the space in which a marker may be
    min_distance_m: float = 0.006  # physical: between two markers; nearer, two points are one
    max_blur_m: float = 0.02  # measured: standard deviation along its worst axis of a point; one less certain is none
    # log likelihood by which a point of two rays must lead any other use of its blobs, as half a square does
    min_lead: float = Rules.min_lead / 2


@dataclass(frozen=True)
class Circumstances:
    """What a capture is like; learned from the capture itself."""

    pixel: float  # px, standard deviation of a blob's position, calibration included
    seen: float  # how likely a camera that has a marker in its image shows a blob of it
    ghosts: np.ndarray  # (C,) how many blobs a frame are no marker's, in each camera


@dataclass(frozen=True, eq=False)
class Expected:
    """Where N points should be by their past: frame (N,), points (N, 3) m and radius (N,) m, three deviations."""

    frame: np.ndarray
    points: np.ndarray
    radius: np.ndarray

    @classmethod
    def nothing(cls) -> "Expected":
        """No past."""
        return cls(np.zeros(0, int), np.zeros((0, 3)), np.zeros(0))


@dataclass(frozen=True, eq=False)
class FramePoints:
    """The Q points of some frames, one frame after the other."""

    frame: np.ndarray  # (Q,) which of the frames they are of
    points: np.ndarray  # (Q, 3) m
    slots: np.ndarray  # (Q, C) which blob of each camera is the point's, -1 where none
    residual: np.ndarray  # (Q,) m, root mean square distance of the point from its rays
    squares: np.ndarray  # (Q,) px², sum of the squared reprojection errors
    watching: np.ndarray  # (Q,) how many cameras have the point in their image

    @classmethod
    def nothing(cls, cameras: int) -> "FramePoints":
        """No points, of so many cameras."""
        none, number = np.zeros(0), np.zeros(0, int)
        return cls(number, np.zeros((0, 3)), np.zeros((0, cameras), int), none, none, number)

    @property
    def support(self) -> np.ndarray:
        """(Q,) number of cameras whose blobs make the point."""
        return (self.slots >= 0).sum(axis=1)

    def of(self, some: np.ndarray) -> "FramePoints":
        """Some of the points (Q,)."""
        return FramePoints(*(values[some] for values in vars(self).values()))


class Matcher:
    """The blobs of some frames, ready to be matched: of each camera those of one frame after the other, L of them.

    row   (C, L) the blobs' rows in their chunk, -1 where there is none
    ends  the first of each frame's blobs, and the last one's end
    """

    def __init__(self, views: Sequence[View], sight: Sight, size: np.ndarray, circumstances: Circumstances):
        self.sight, self.size = sight, size
        self.pixel, self.seen, self.ghosts = circumstances.pixel, circumstances.seen, circumstances.ghosts
        self.image, self.real, self.row = (
            np.concatenate([getattr(view, name) for view in views], axis=1) for name in ("image", "real", "row")
        )
        self.free = np.zeros_like(self.real)
        widths = [view.real.shape[1] for view in views]
        self.ends, self.frame_of = np.cumsum([0, *widths]), np.repeat(np.arange(len(views)), widths)
        self.rays = Rays(View(self.image, self.real, self.row), sight)
        self.cameras = np.arange(len(self.real))
        self.tolerance = Rules.max_miss * self.pixel / sight.focal[:, None]

    def continued(self, frame: int, expected: Expected) -> tuple[np.ndarray, np.ndarray, int]:
        """What goes on as the past expects it: sets of blobs (Q, C) of which three or more can be nothing else's.

        Also where these meet (Q, 3) m, and how many blobs of the frame are left.
        """
        begin, end = self.ends[frame : frame + 2]
        blobs, points, radius = self.image[:, None, begin:end], expected.points, expected.radius
        count = int(self.real[:, begin:end].sum())
        wide = np.ones((len(points), len(self.cameras)), bool)
        for last in (False, True):
            if not count or not len(points):
                return np.full((0, len(self.cameras)), -1), points[:0], count
            local = self.sight.local(points[None])[0]
            image = self.sight.image(local)
            reach = self.tolerance + radius / np.maximum(local[..., 2], VIEWING.min_depth_m)
            # Axis by axis: NumPy is slow to add up two of something.
            square = (blobs[..., 0] - image[..., :1]) ** 2
            square += (blobs[..., 1] - image[..., 1:]) ** 2
            near = square < reach[..., None] ** 2
            nearest = square.argmin(axis=2)
            at = self.cameras[:, None], nearest
            mutual = (square.argmin(axis=1)[at] == np.arange(len(points))) & near.any(axis=2)
            slots = self.agreeing(np.where(mutual, begin + nearest, -1).T)
            clear = (slots >= 0) & ((near.sum(axis=2) == 1) & (near.sum(axis=1)[at] == 1)).T
            if not last:
                points = self.rays.meet(slots.T).points
                known = np.isfinite(points[:, 0])
                points, wide, radius = points[known], clear[known], 0.0 * radius[known]
        rays = (slots >= 0).sum(axis=1)
        sure = (clear.sum(axis=1) >= 3) | ((rays == 2) & ((clear & wide).sum(axis=1) == 2))
        slots = slots[sure]
        return slots, self.rays.meet(slots.T).points, count - int((slots >= 0).sum())

    @property
    def count(self) -> int:
        """Frames."""
        return len(self.ends) - 1

    def rows(self, slots: np.ndarray) -> np.ndarray:
        """(Q, C) the rows of blobs (Q, C) in their chunk, -1 where there is none."""
        return np.where(slots >= 0, self.row[self.cameras, np.maximum(slots, 0)], -1)

    def match(
        self, first: int, end: int, expected: Expected | None = None, continued: np.ndarray | None = None
    ) -> FramePoints:
        """The points of frames `first` … `end` - 1: those `continued` (Q, C), then whatever the other blobs make."""
        if expected is None or continued is None:
            expected, continued = Expected.nothing(), np.full((0, len(self.cameras)), -1)
        within = slice(self.ends[first], self.ends[end])
        self.free[:] = False
        self.free[:, within] = self.real[:, within]
        every = _Hypotheses.of(self, continued, expected)
        taken = [every.points_of(self)]
        self._use(every.slots)
        left = self._hypotheses(expected)
        for _ in range(CHOOSING_ROUNDS):
            winners = left.winners(joined(taken))
            if not winners.any():
                break
            taken.append(left.pick(winners).points_of(self))
            self._use(taken[-1].slots)
            left = left.without(self, winners, expected)
        return _not_alone(joined(taken))

    def _use(self, slots: np.ndarray):
        point, camera = np.nonzero(slots >= 0)
        self.free[camera, slots[point, camera]] = False

    def _hypotheses(self, expected: Expected) -> "_Hypotheses":
        """The sets of blobs, of those that are free, that pairs of rays which pass each other closely begin."""
        slot, camera = np.nonzero(self.free.T)
        frame = self.frame_of[slot]
        one, two = pairs_within(frame)
        other = camera[one] != camera[two]
        one, two, middle = self._crossings(camera, slot, one[other], two[other])
        slots = self._nearest_blobs(middle, frame[one], Rules.max_off_point)
        for blob in (one, two):
            slots[np.arange(len(one)), camera[blob]] = slot[blob]
        return _Hypotheses.of(self, self._completed(slots), expected)

    def _crossings(self, camera: np.ndarray, slot: np.ndarray, first: np.ndarray, second: np.ndarray):
        """Of pairs of blobs those whose rays pass each other closely, and the points (Q, 3) between."""
        direction, origin = self.rays.direction[camera, slot], self.sight.centres[camera]
        focal, parts = self.sight.focal[camera], []
        for begin in range(0, max(len(first), 1), MAX_RAY_PAIRS):  # at a time, which stays near the processor
            one, two = first[begin : begin + MAX_RAY_PAIRS], second[begin : begin + MAX_RAY_PAIRS]
            near, far, gap, fixed = passing(direction, origin, one, two)
            gap2 = gap[0] ** 2 + gap[1] ** 2 + gap[2] ** 2
            allowed2 = Rules.max_square * self.pixel**2 * ((near / focal[one]) ** 2 + (far / focal[two]) ** 2)
            kept = np.flatnonzero(fixed & (gap2 < allowed2))
            middle = origin[one[kept]] + near[kept, None] * direction[one[kept]] + gap[:, kept].T / 2
            parts.append((one[kept], two[kept], middle, gap2[kept] / allowed2[kept]))
        one, two, middle, off = map(np.concatenate, zip(*parts, strict=True))
        closest = np.argsort(off)[:MAX_RAY_PAIRS] if len(off) > MAX_RAY_PAIRS else slice(None)
        return one[closest], two[closest], middle[closest]

    def _nearest_blobs(self, points: np.ndarray, frame: np.ndarray, deviations: float) -> np.ndarray:
        """(Q, C) the free blob nearest to each point's image, -1 where it is farther than `deviations`."""
        camera, slot = np.nonzero(self.free)
        if not len(slot) or not len(points):
            return np.full((len(points), len(self.cameras)), -1)
        blobs, reach = self.image[camera, slot], deviations * self.pixel / self.sight.focal
        # Cells are twice as wide as `reach`: of the blobs, each in the four around it, a point's own has all near ones.
        around = np.array([(-0.5, -0.5), (-0.5, 0.5), (0.5, -0.5), (0.5, 0.5)])[:, None]
        cells = _cells(blobs / (2 * reach[camera, None]) + around, camera * self.count + self.frame_of[slot]).ravel()
        begin = np.cumsum(np.bincount(cells + 1, minlength=len(self.cameras) * self.count * CELLS**2 + 1))
        blob = np.argsort(cells, kind="stable") % len(blobs)
        local = points @ self.sight.all_turned + self.sight.all_translated
        image = self.sight.image(local.reshape(len(points), -1, 3))
        cell = _cells(image / (2 * reach[:, None]), self.cameras * self.count + frame[:, None]).ravel()
        place = np.flatnonzero(begin[cell] < begin[cell + 1])
        at, end = begin[cell[place]], begin[cell[place] + 1]
        image, least = image.reshape(-1, 2)[place], (reach**2)[place % len(reach)]
        found = np.full(len(cell), -1)
        while len(place):
            off = blobs[blob[at]] - image
            square = off[:, 0] ** 2 + off[:, 1] ** 2
            near = square < least
            found[place[near]] = slot[blob[at[near]]]
            more = at + 1 < end
            place, at, end, image = place[more], at[more] + 1, end[more], image[more]
            least = np.minimum(least, square)[more]
        return found.reshape(len(points), -1)

    def _completed(self, slots: np.ndarray) -> np.ndarray:
        """Sets of blobs (Q, C) whose rays meet in one point, and to which no other near blob belongs; each once."""
        for _ in range(2):
            slots = self.agreeing(each_once(slots))
            met = self.rays.meet(slots.T)
            known = np.isfinite(met.points[:, 0])
            slots = slots[known]
            more = self._nearest_blobs(met.points[known], self.frames(slots), Rules.max_miss)
            slots = np.where(slots >= 0, slots, more)
        return self.agreeing(each_once(slots))

    def agreeing(self, slots: np.ndarray) -> np.ndarray:
        """Sets of blobs (Q, C) less their worst rays, until all that are left meet; none where less than two do."""
        slots, rows = slots.copy(), np.arange(len(slots))
        while len(rows):
            slots[rows[(slots[rows] >= 0).sum(axis=1) < 2]] = -1
            miss = self.deviations(slots[rows])
            bad = miss.max(axis=0) > Rules.max_miss
            rows = rows[bad]
            slots[rows, miss[:, bad].argmax(axis=0)] = -1
        return slots

    def deviations(self, slots: np.ndarray) -> np.ndarray:
        """(C, Q) how far the rays of sets of blobs (Q, C) miss their points, standard deviations."""
        met = self.rays.meet(slots.T)
        return met.miss / self.metres(met.points)

    def metres(self, points: np.ndarray) -> np.ndarray:
        """(C, Q) m, standard deviation of a blob's position at the points (Q, 3)."""
        depth = self.sight.local(points[None])[0, ..., 2]
        return self.pixel / self.sight.focal[:, None] * np.fmax(depth, VIEWING.min_depth_m)

    def frames(self, slots: np.ndarray) -> np.ndarray:
        """(Q,) the frames of sets of blobs (Q, C), of one or more."""
        return self.frame_of[slots.max(axis=1)]


@dataclass(frozen=True, eq=False)
class _Hypotheses:
    """Q sets of blobs that may each be one marker, one frame after the other, and of each the likeliest first."""

    frame: np.ndarray  # (Q,)
    slots: np.ndarray  # (Q, C)
    points: np.ndarray  # (Q, 3) m
    residual: np.ndarray  # (Q,) m
    miss: np.ndarray  # (Q, C) deviations
    score: np.ndarray  # (Q,) log of how much likelier a marker is than ghosts

    @classmethod
    def of(cls, matcher: Matcher, slots: np.ndarray, expected: Expected) -> "_Hypotheses":
        met = matcher.rays.meet(slots.T)
        metres = matcher.metres(met.points)
        seen = (slots >= 0).T
        precision = np.where(seen, 1 / metres**2, 0)
        across = matcher.rays.across[matcher.cameras[:, None], np.maximum(slots.T, 0)]
        normal = np.einsum("cq,cqij->qij", precision, across)
        curvature = np.linalg.eigvalsh(normal)
        sharp = np.isfinite(met.residual) & (curvature[:, 0] > MATCHING.max_blur_m**-2)
        miss = met.miss / metres
        area = matcher.size.prod(axis=1)
        # One ray of a marker against one ghost somewhere in the image, and a camera that looks and sees nothing.
        gain = np.log(matcher.seen * area / (2 * np.pi * matcher.pixel**2 * matcher.ghosts))[:, None] - miss**2 / 2
        watching = _watching(matcher, met.points)
        score = np.where(seen, gain, np.where(watching, np.log(1 - matcher.seen), 0)).sum(axis=0)
        # The point may be anywhere in the room: what three unknowns make of any rays says nothing.
        cell = (2 * np.pi) ** 1.5 / np.sqrt(np.maximum(curvature, 1e-3).prod(axis=1))
        room = MATCHING.room_m3
        score += np.log(np.minimum(cell / room, 1)) + _familiarity(met.points, matcher.frames(slots), expected, room)
        kept = sharp & (score > 0)
        found = cls(matcher.frames(slots), slots, met.points, met.residual, miss.T, score)
        return found.pick(kept).in_order()

    def pick(self, chosen: np.ndarray) -> "_Hypotheses":
        return _Hypotheses(*(values[chosen] for values in vars(self).values()))

    def in_order(self) -> "_Hypotheses":
        return self.pick(np.lexsort((self.residual, -self.score, self.frame)))

    def points_of(self, matcher: Matcher) -> FramePoints:
        squares, watching = (self.miss**2).sum(axis=1) * matcher.pixel**2, _watching(matcher, self.points).sum(axis=0)
        return FramePoints(self.frame, self.points, self.slots, self.residual, squares, watching)

    def winners(self, taken: FramePoints) -> np.ndarray:
        """(Q,) those that are likelier than every other one that needs one of their blobs, or the same place."""
        better, worse = pairs_within(self.frame)
        shares = np.zeros(len(better), bool)
        for slot in np.where(self.slots < 0, -1 - np.arange(len(self.slots))[:, None], self.slots).T.copy():
            shares |= slot[better] == slot[worse]
        near = _near(self.points[better] - self.points[worse])
        first = np.ones(len(self.slots), bool)
        first[worse[shares | near]] = False
        there = padded(taken.points, taken.frame, int(max(self.frame.max(initial=0), taken.frame.max(initial=0))) + 1)
        first &= ~_near(self.points[:, None] - there[self.frame]).any(axis=1)
        thin = (self.slots >= 0).sum(axis=1) == 2
        # Where two rays are all, another partner for either blob must be clearly less likely.
        other, rival = np.full(len(self.slots), -np.inf), shares & ~near
        np.maximum.at(other, better[rival], self.score[worse[rival]])
        return first & (~thin | (self.score - other > MATCHING.min_lead))

    def without(self, matcher: Matcher, winners: np.ndarray, expected: Expected) -> "_Hypotheses":
        """The other hypotheses with the blobs that are still free."""
        left = self.pick(~winners)
        lost = (left.slots >= 0) & ~matcher.free[matcher.cameras, np.maximum(left.slots, 0)]
        touched = lost.any(axis=1)
        slots = np.where(lost, -1, left.slots)[touched]
        again = _Hypotheses.of(matcher, matcher.agreeing(each_once(slots)), expected)
        return joined([left.pick(~touched), again]).in_order()


def _cells(places: np.ndarray, image: np.ndarray) -> np.ndarray:
    """The numbers of the cells, one wide, in which places (..., 2) are, by the number of their image."""
    column, row = (np.floor(axis).astype(int) % CELLS for axis in (places[..., 0], places[..., 1]))
    return (image * CELLS + column) * CELLS + row


def each_once(slots: np.ndarray) -> np.ndarray:
    """The different ones of sets of blobs (Q, C), in order, by one number for each set."""
    base, number, most = int(slots.max(initial=0)) + 2, np.zeros(len(slots), np.int64), 1
    for slot in slots.T:
        if most * base >= 2**63:
            number, most = np.unique(number, return_inverse=True)[1], len(slots)
        number, most = number * base + slot + 1, most * base
    return slots[np.unique(number, return_index=True)[1]]


def pairs_within(frame: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Indices of all pairs of things of the same frame (N,), which are in order: the first ones and the second ones."""
    count = np.searchsorted(frame, frame, side="right") - np.arange(len(frame)) - 1
    first = np.repeat(np.arange(len(frame)), count)
    return first, np.arange(len(first)) - np.repeat(np.cumsum(count) - count, count) + first + 1


def padded(values: np.ndarray, frame: np.ndarray, frames: int, nothing: float = 1e9) -> np.ndarray:
    """(F, most, ...) the values (N, ...) of each of so many frames (N,), which are in any order; then `nothing`."""
    order = np.argsort(frame, kind="stable")
    counts = np.bincount(frame, minlength=frames)
    table = np.full((frames, counts.max(initial=0), *values.shape[1:]), nothing, values.dtype)
    place = np.arange(len(frame)) - np.repeat(np.cumsum(counts) - counts, counts)
    table[frame[order], place] = values[order]
    return table


def joined(parts):
    """All of several parts, each frame's together and as they are ordered: points, or hypotheses, of some frames."""
    every = [np.concatenate(values) for values in zip(*(vars(part).values() for part in parts), strict=True)]
    order = np.argsort(every[0], kind="stable")
    return type(parts[0])(*(values[order] for values in every))


def _not_alone(points: FramePoints) -> FramePoints:
    """The points less those of two rays that are far from all better ones: reflections that stay where they are."""
    sure = points.support >= 3
    frames = int(points.frame.max(initial=0)) + 1
    there = padded(points.points[sure], points.frame[sure], frames)
    offset = points.points[:, None] - there[points.frame]
    near = (np.einsum("qni,qni->qn", offset, offset) < (2 * MARKER_LIMITS.limb_m) ** 2).any(axis=1)
    near |= np.bincount(points.frame[sure], minlength=frames)[points.frame] < 3
    return points.of(near)


def _watching(matcher: Matcher, points: np.ndarray) -> np.ndarray:
    """(C, Q) which cameras have the points in their image."""
    local = matcher.sight.local(np.nan_to_num(points, nan=1e9)[None])
    return matcher.sight.inside(matcher.sight.image(local))[0]


def _familiarity(points: np.ndarray, frame: np.ndarray, expected: Expected, room: float) -> np.ndarray:
    """(Q,) log of how much likelier a point is where one is expected than anywhere in `room` m³; nought elsewhere."""
    if not len(expected.points) or not len(points):
        return np.zeros(len(points))
    frames = int(max(frame.max(), expected.frame.max())) + 1
    there, spread = (padded(one, expected.frame, frames)[frame] for one in (expected.points, expected.radius / 3))
    offset = np.nan_to_num(points, nan=1e9)[:, None] - there
    square = np.einsum("qni,qni->qn", offset, offset) / spread**2
    return np.maximum(np.log(room / ((2 * np.pi) ** 1.5 * spread**3)) - square / 2, 0).max(axis=1)


def _near(offset: np.ndarray) -> np.ndarray:
    """Which points, so far (..., 3) m apart, are too close together to be two markers."""
    return np.einsum("...i,...i->...", offset, offset) < MATCHING.min_distance_m**2
