# SPDX-License-Identifier: GPL-3.0-or-later
"""Which blobs of two cameras meet, whatever their names: cameras under each other's names, or of another room.

Blobs of two cameras that show the same thing lie on each other's epipolar lines. So do some others by chance, more of
them the denser blobs lie: what lies a little beside the lines says how many.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np

from ..geometry.cameras import Cameras


@dataclass(frozen=True)
class ReorderOptions:
    """When cameras are believed to have each other's names; reckoned.

    max_cameras    that are tried under each other's names
    seeds          pairs of cameras that are begun with
    near_px        from an epipolar line to what lies on it, where the focal length is
    focal_px       or less; more where a pixel is a smaller angle
    min_mends      times as many blobs must agree under other names,
    min_agreeing   and this share of them
    min_alike      of the best agreement: of such orders the one that changes least is right
    """

    max_cameras: int = 12
    seeds: int = 12
    near_px: float = 1.5
    focal_px: float = 1500.0
    min_mends: float = 1.4
    min_agreeing: float = 0.4
    min_alike: float = 0.97


@dataclass(frozen=True)
class ChanceOptions:
    """When blobs meet by chance only; chosen on virtual rooms under each other's calibrations.

    beside        from where to where beside an epipolar line blobs are counted that are there by chance, times what
                  counts as on it
    min_blobs     of two cameras in the frames that are looked at, before anything is said of them; half as many of
                  each: a camera that saw nothing meets nobody in a sound room either
    max_meeting   share of a camera's blobs, beyond chance, that meet those of the camera it goes best with, where
                  it goes with none: under calibrations of other rooms the median camera of 15 had 0.11 at most, in 9
                  sound rooms, recorded ones among them, the poorest camera 0.43
    min_same_name share of a camera's blobs that meet those of the same name in the camera it goes best with, of the
                  usual camera: measured as 0.97 to 1 in 10 sound rooms with ghosts, dropouts and errors of calibration,
                  as 0.71 where all cameras are 3 px off, and as 0.08 to 0.6 where blobs were moved by 25 to 40 px
    min_pairs     of blobs with one name in two cameras, before anything is said of these; reckoned
    """

    beside: tuple[float, float] = (3.0, 13.0)
    min_blobs: int = 100
    max_meeting: float = 0.2
    min_same_name: float = 0.66
    min_pairs: int = 50


REORDERING = ReorderOptions()
MEETING_BY_CHANCE = ChanceOptions()


def near_image(cameras: Cameras) -> np.ndarray:
    """(C,) how far from where it should be a blob still counts as there, normalised image."""
    return REORDERING.near_px * np.maximum(1.0, cameras.focal / REORDERING.focal_px) / cameras.focal


class CameraAgreement:
    """Which part of the blobs of two cameras lie on each other's epipolar lines, whatever their names.

    blobs are of each of F frames the cameras (N,) and places (N, 2) px.
    """

    def __init__(self, cameras: Cameras, blobs: list[tuple[np.ndarray, np.ndarray]]):
        self.cameras, self.near = cameras, near_image(cameras)
        self.frame_count = len(blobs)
        self.blobs = [[xy[camera == name] for camera, xy in blobs] for name in range(len(cameras))]
        self.rays: dict[tuple[int, int], list[np.ndarray]] = {}
        self.known: dict[tuple[int, int, int, int], tuple[float, float]] = {}

    def of(self, one: int, other: int, first: int, second: int) -> float:
        """The part of agreeing blobs where those named `first` are calibration `one`'s and `second` are `other`'s."""
        return self._counted(one, other, first, second)[0]

    def meeting(self) -> np.ndarray:
        """(C,) share of each camera's blobs, beyond chance, that meet those of the camera it goes best with.

        NaN where there are too few blobs to say.
        """
        best = np.full(len(self.cameras), np.nan)
        counts = [sum(map(len, blobs)) for blobs in self.blobs]
        for one, other in combinations(range(len(self.cameras)), 2):
            if 2 * min(counts[one], counts[other]) < MEETING_BY_CHANCE.min_blobs:
                continue
            share, chance = self._counted(one, other, one, other)
            beyond = (share - chance) / max(1 - chance, 1e-9)
            best[[one, other]] = np.fmax(best[[one, other]], beyond)
        return best

    def on_lines(self, one: int, other: int) -> Iterator[tuple[np.ndarray, np.ndarray, np.ndarray]]:
        """Frame by frame the rays of two cameras, (A, 3) and (B, 3), and (A, B) which lie on each other's lines."""
        for a, b, there, back in self._beside(one, other, one, other):
            yield a, b, (there < 1) & (back < 1)

    def _counted(self, one: int, other: int, first: int, second: int) -> tuple[float, float]:
        """The part of blobs on the other camera's lines, and the part that would be there by chance."""
        key = (one, other, first, second)
        if key not in self.known:
            near, chance, total = 0.0, 0.0, 0
            for a, b, there, back in self._beside(*key):
                if len(a) and len(b):
                    near += (there < 1).any(axis=1).sum() + (back < 1).any(axis=0).sum()
                    chance += _by_chance(there).sum() + _by_chance(back.T).sum()
                total += len(a) + len(b)
            self.known[key] = near / max(total, 1), chance / max(total, 1)
        return self.known[key]

    def _beside(self, one: int, other: int, first: int, second: int) -> Iterator[tuple[np.ndarray, ...]]:
        """Frame by frame the rays of blobs named `first` and `second`, (A, 3) and (B, 3), 1 ahead, and how they pass.

        That is twice (A, B): how far beside the line of the one the other is, in the second image and in the first; 1
        is as far as counts.
        """
        essential = _essential(self.cameras, one, other)
        for a, b in zip(self._seen(one, first), self._seen(other, second), strict=True):
            there, back = a @ essential.T, b @ essential
            off = np.abs(there @ b.T)
            with np.errstate(divide="ignore", invalid="ignore"):  # two cameras in one place have no lines
                yield (
                    a,
                    b,
                    off / (np.hypot(*there.T[:2])[:, None] * self.near[other]),
                    off / (np.hypot(*back.T[:2])[None] * self.near[one]),
                )

    def _seen(self, calibration: int, name: int) -> list[np.ndarray]:
        """The rays of the blobs that go by `name` through a calibration, frame by frame."""
        key = (calibration, name)
        if key not in self.rays:
            self.rays[key] = [_through(self.cameras, calibration, xy) for xy in self.blobs[name]]
        return self.rays[key]

    def of_camera(self, order: np.ndarray, index: int) -> float:
        """How one calibration agrees with all others, mean."""
        others = [other for other in range(len(order)) if other != index]
        return float(np.mean([self.of(index, other, order[index], order[other]) for other in others]))

    def total(self, order: np.ndarray) -> float:
        """How all calibrations agree, mean over pairs."""
        return float(np.mean([self.of(a, b, order[a], order[b]) for a, b in combinations(range(len(order)), 2)]))

    def seeds(self) -> list[dict[int, int]]:
        """Pairs of calibrations with the names of the blobs that agree best with them, the best first."""
        count = range(len(self.cameras))
        found = [
            (self.of(one, other, first, second), one, other, first, second)
            for one, other in combinations(count, 2)
            for first, second in permutations(count, 2)
        ]
        return [
            {one: first, other: second}
            for _, one, other, first, second in sorted(found, reverse=True)[: REORDERING.seeds]
        ]

    def completed(self, known: dict[int, int]) -> np.ndarray:
        """(C,) the order that goes on from `known` with the names that agree best with those that are given."""
        from scipy.optimize import linear_sum_assignment

        count = len(self.cameras)
        while len(known) < count:
            left = [index for index in range(count) if index not in known]
            names = [name for name in range(count) if name not in known.values()]
            agree = np.array(
                [
                    [np.mean([self.of(one, other, name, known[other]) for other in known]) for name in names]
                    for one in left
                ]
            )
            rows, columns = linear_sum_assignment(-agree)
            best = int(np.argmax(agree[rows, columns]))
            chosen = [best] if len(known) < 4 else range(len(rows))
            known = {**known, **{left[rows[at]]: names[columns[at]] for at in chosen}}
        return np.array([known[index] for index in range(count)])


def same_names_meet(cameras: Cameras, image: np.ndarray) -> np.ndarray:
    """(C,) share of a camera's named blobs that meet those of the same name in the camera it goes best with.

    `image` (C, N, 2) is where each camera has each of N markers, normalised; NaN where it has none. NaN where too few
    have a blob in two cameras to say.
    """
    best, near = np.full(len(cameras), np.nan), near_image(cameras)
    rays = np.concatenate([image, np.ones((*image.shape[:2], 1))], axis=2)
    seen = np.isfinite(image).all(axis=2)
    for one, other in combinations(range(len(cameras)), 2):
        both = seen[one] & seen[other]
        if both.sum() >= MEETING_BY_CHANCE.min_pairs:
            essential, a, b = _essential(cameras, one, other), rays[one, both], rays[other, both]
            there, back = a @ essential.T, b @ essential
            off = np.abs((there * b).sum(axis=1))
            with np.errstate(divide="ignore", invalid="ignore"):  # two cameras in one place have no lines
                meets = off / np.hypot(*there.T[:2]) < near[other]
                meets &= off / np.hypot(*back.T[:2]) < near[one]
            best[[one, other]] = np.fmax(best[[one, other]], meets.mean())
    return best


def best_order(agreement: CameraAgreement, sure: np.ndarray) -> np.ndarray | None:
    """(C,) the name that the blobs of each calibration go by, None where other names mend nothing.

    `sure` are cameras that go together as they are; without two of them the pairs that agree best are begun with. Of
    many cameras that are not sure nothing is tried.
    """
    count = len(agreement.cameras)
    if count - len(sure) > REORDERING.max_cameras:
        return None
    own = np.arange(count)
    if len(sure) >= 2:
        orders = [agreement.completed({int(index): int(index) for index in sure})]
    else:
        orders = [agreement.completed(seed) for seed in agreement.seeds()]
    totals = np.array([agreement.total(order) for order in orders])
    alike = [order for order, total in zip(orders, totals, strict=True) if total >= REORDERING.min_alike * totals.max()]
    order = max(alike, key=lambda one: (one == own).sum())
    moved = np.flatnonzero(order != own)
    if not len(moved):
        return None
    others = [agreement.of_camera(own, index) for index in moved]
    mended = [agreement.of_camera(order, index) for index in moved]
    better = all(
        after > max(REORDERING.min_mends * before, REORDERING.min_agreeing)
        for before, after in zip(others, mended, strict=True)
    )
    return order if better else None


def _essential(cameras: Cameras, one: int, other: int) -> np.ndarray:
    """(3, 3) what makes a ray of one camera the line on which the other sees it."""
    turn = cameras.rotation[other] @ cameras.rotation[one].T
    x, y, z = cameras.translation[other] - turn @ cameras.translation[one]
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn


def _by_chance(part: np.ndarray) -> np.ndarray:
    """(N,) how likely it is that a line has a blob on it by chance; part (N, K) is how far blobs are beside lines."""
    low, high = MEETING_BY_CHANCE.beside
    return 1 - np.exp(-((part > low) & (part < high)).sum(axis=1) / (high - low))


def _through(cameras: Cameras, calibration: int, xy: np.ndarray) -> np.ndarray:
    """(N, 3) the rays of pixels (N, 2) through a calibration, 1 ahead; without those that no light reaches."""
    image = cameras.undistort(xy, np.full(len(xy), calibration))
    return np.column_stack([image, np.ones(len(xy))])[np.isfinite(image).all(axis=1)]
