# SPDX-License-Identifier: GPL-3.0-or-later
"""Which blobs of two cameras meet, whatever their names: cameras under each other's names, or of another room.

Blobs of two cameras that show the same thing lie on each other's epipolar lines. So do some others by chance, more of
them the denser blobs lie: what lies a little beside the lines says how many. The share of a camera's blobs that meet
others beyond chance is the one statistic of calibration health, and `min_meeting` its one limit.
"""

from collections.abc import Iterator
from itertools import combinations, permutations

import numpy as np

from ..data.physical import MARKER_LIMITS, SIGMAS
from ..geometry.cameras import Cameras


class CAMERA_HEALTH:
    """When something is said of cameras. Virtual rooms have ghosts, dropouts and errors of calibration."""

    enough: int = 100  # measured: blobs or markers before anything is said of them: of 100 a share is known to 5 %
    # times what counts as on an epipolar line, from where to where blobs are there by chance
    beside: tuple[float, float] = (3.0, 13.0)  # measured
    # share of a camera's blobs, beyond chance, that meet those of the camera it goes best with: 0.11 at most for the
    # median camera in 15 wrong rooms, 0.43 at least for any in 9 sound ones
    min_meeting: float = 0.2  # measured
    # share of named markers that meet, where they usually are, those of the camera it goes best with, of the usual
    # camera: 0.94 to 1 in 4 rooms with noise of 0.3 to 3 px, 0.99 where all cameras are 3 px off, 0.79 at most by 12 px
    min_same_name: float = 0.8  # measured
    # of the usual share of named markers, with which a camera is looked for beside where it was: one that was turned
    # by 2° has less, one by 0.3° keeps all
    max_lacking: float = 0.8  # measured
    # cameras that are tried under each other's names: 12 take seconds, 24 would take minutes
    max_tried: int = 12  # measured
    frames: int = 40  # memory: of a take that are looked at, spread over it


def near_image(cameras: Cameras) -> np.ndarray:
    """(C,) how far from where it should be a blob still counts as there, normalised image."""
    return SIGMAS * MARKER_LIMITS.noise_px / cameras.focal


class CameraAgreement:
    """Which part of the blobs of two cameras lie on each other's epipolar lines, whatever their names.

    blobs are of each of F frames the cameras (N,) and places (N, 2) px.
    """

    def __init__(self, cameras: Cameras, blobs: list[tuple[np.ndarray, np.ndarray]]):
        self.cameras, self.near = cameras, near_image(cameras)
        self.own, self.frame_count = np.arange(len(cameras)), len(blobs)
        self.blobs = [[xy[camera == name] for camera, xy in blobs] for name in self.own]
        self.counts = [sum(map(len, own)) for own in self.blobs]
        self.rays: dict[tuple[int, int], list[np.ndarray]] = {}
        self.known: dict[tuple[int, int, int, int], float] = {}

    def of(self, one: int, other: int, first: int, second: int) -> float:
        """The part of blobs that agree, beyond chance, where those named `first` are calibration `one`'s, and so on."""
        key = (one, other, first, second)
        if key not in self.known:
            near, chance, total = 0.0, 0.0, 1e-9
            for a, b, there, back in self.beside(*key):
                if len(a) and len(b):
                    near += (there < 1).any(axis=1).sum() + (back < 1).any(axis=0).sum()
                    chance += _by_chance(there).sum() + _by_chance(back.T).sum()
                total += len(a) + len(b)
            self.known[key] = (near - chance) / max(total - chance, 1e-9)
        return self.known[key]

    def meeting(self, order: np.ndarray | None = None) -> np.ndarray:
        """(C,) share of each camera's blobs, beyond chance, that meet those of the camera it goes best with.

        The blobs of a calibration go by the name that `order` (C,) has for it, its own without. NaN where there are too
        few blobs to say: a camera that saw nothing meets nobody in a sound room either.
        """
        order = self.own if order is None else order
        best = np.full(len(order), np.nan)
        for one, other in combinations(range(len(order)), 2):
            first, second = order[one], order[other]
            if 2 * min(self.counts[first], self.counts[second]) >= CAMERA_HEALTH.enough:
                best[[one, other]] = np.fmax(best[[one, other]], self.of(one, other, first, second))
        return best

    def beside(self, one: int, other: int, first: int, second: int) -> Iterator[tuple[np.ndarray, ...]]:
        """Frame by frame the rays of blobs named `first` and `second`, (A, 3) and (B, 3), 1 ahead, and how they pass.

        That is twice (A, B), in the second image and in the first; 1 is as far as counts.
        """
        for a, b in zip(self._seen(one, first), self._seen(other, second), strict=True):
            yield a, b, *map(np.abs, _passing(self.cameras, one, other, a[:, None], b))

    def _seen(self, calibration: int, name: int) -> list[np.ndarray]:
        """The rays of the blobs that go by `name` through a calibration, frame by frame; those that light takes."""
        key = (calibration, name)
        if key not in self.rays:
            rays = [_ahead(self.cameras.undistort(xy, np.full(len(xy), calibration))) for xy in self.blobs[name]]
            self.rays[key] = [part[np.isfinite(part).all(axis=1)] for part in rays]
        return self.rays[key]

    def total(self, order: np.ndarray) -> float:
        """How all calibrations agree, mean over pairs."""
        return float(np.mean([self.of(a, b, order[a], order[b]) for a, b in combinations(self.own.tolist(), 2)]))

    def best_pairs(self) -> list[dict[int, int]]:
        """Pairs of calibrations with the names of the blobs that agree best with them, as many as cameras."""
        found = [
            (self.of(one, other, first, second), one, other, first, second)
            for one, other in combinations(self.own.tolist(), 2)
            for first, second in permutations(self.own.tolist(), 2)
        ]
        best = sorted(found, reverse=True)[: len(self.own)]
        return [{one: first, other: second} for _, one, other, first, second in best]

    def completed(self, known: dict[int, int]) -> np.ndarray:
        """(C,) the order that goes on from `known` with the names that agree best with those that are given."""
        from scipy.optimize import linear_sum_assignment

        while len(known) < len(self.own):
            left = [index for index in self.own.tolist() if index not in known]
            names = [name for name in self.own.tolist() if name not in known.values()]
            agree = np.array(
                [
                    [np.mean([self.of(one, other, name, known[other]) for other in known]) for name in names]
                    for one in left
                ]
            )
            rows, columns = linear_sum_assignment(-agree)
            best = int(np.argmax(agree[rows, columns]))
            known = {**known, left[rows[best]]: names[columns[best]]}
        return np.array([known[index] for index in self.own.tolist()])


def same_names_meet(cameras: Cameras, image: np.ndarray) -> np.ndarray:
    """(C,) share of a camera's named markers that meet those of the same name in the camera it goes best with.

    `image` (C, F, M, 2) is where each camera has each of M markers in each of F frames, normalised; NaN where it has
    none. A marker meets where it usually does: blobs that are off by chance are so on either side. NaN where too few
    have a blob in two cameras to say.
    """
    best, rays = np.full(len(cameras), np.nan), _ahead(image)
    seen = np.isfinite(image).all(axis=3)
    for one, other in combinations(range(len(cameras)), 2):
        both = seen[one] & seen[other]
        if 2 * both.sum() >= CAMERA_HEALTH.enough:
            some = both.any(axis=0)
            passing = _passing(cameras, one, other, rays[one][:, some], rays[other][:, some])
            off = (np.where(both[:, some] & np.isnan(part), np.inf, part) for part in passing)
            there, back = (np.abs(np.nanmedian(part, axis=0)) for part in off)
            share = np.average((there < 1) & (back < 1), weights=both.sum(axis=0)[some])
            best[[one, other]] = np.fmax(best[[one, other]], share)
    return best


def best_order(agreement: CameraAgreement, sure: np.ndarray) -> np.ndarray | None:
    """(C,) the name that the blobs of each calibration go by, None where other names mend nothing.

    `sure` are cameras that go together as they are; without two of them the pairs that agree best are begun with. Of
    many cameras that are not sure nothing is tried.
    """
    if len(agreement.own) - len(sure) > CAMERA_HEALTH.max_tried:
        return None
    begun = [{int(index): int(index) for index in sure}] if len(sure) >= 2 else agreement.best_pairs()
    order = max((agreement.completed(known) for known in begun), key=agreement.total)
    moved = order != agreement.own
    before, after = agreement.meeting(), agreement.meeting(order)
    with np.errstate(invalid="ignore"):
        better = (before < CAMERA_HEALTH.min_meeting) & (after >= CAMERA_HEALTH.min_meeting)
    return order if moved.any() and better[moved].all() else None


def cycles_of(order: np.ndarray) -> list[tuple[int, ...]]:
    """The groups that a permutation (C,) moves round, each in the order in which it does."""
    left, found = set(np.flatnonzero(order != np.arange(len(order))).tolist()), []
    while left:
        group = [min(left)]
        while int(order[group[-1]]) != group[0]:
            group.append(int(order[group[-1]]))
        found.append(tuple(group))
        left -= set(group)
    return found


def _passing(cameras: Cameras, one: int, other: int, a: np.ndarray, b: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """How far rays (..., 3) of two cameras are beside each other's lines, in the second image and in the first.

    1 is as far as counts; on the other side of a line it is negative.
    """
    turn = cameras.rotation[other] @ cameras.rotation[one].T
    x, y, z = cameras.translation[other] - turn @ cameras.translation[one]
    essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
    there, back, near = a @ essential.T, b @ essential, near_image(cameras)
    off = (there * b).sum(axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):  # two cameras in one place have no lines
        return (
            off / (np.hypot(there[..., 0], there[..., 1]) * near[other]),
            off / (np.hypot(back[..., 0], back[..., 1]) * near[one]),
        )


def _by_chance(part: np.ndarray) -> np.ndarray:
    """(N,) how likely it is that a line has a blob on it by chance; part (N, K) is how far blobs are beside lines."""
    low, high = CAMERA_HEALTH.beside
    return 1 - np.exp(-((part > low) & (part < high)).sum(axis=1) / (high - low))


def _ahead(image: np.ndarray) -> np.ndarray:
    """(..., 3) the rays of normalised image points (..., 2), 1 ahead."""
    return np.concatenate([image, np.ones((*image.shape[:-1], 1))], axis=-1)
