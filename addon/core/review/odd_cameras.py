# SPDX-License-Identifier: GPL-3.0-or-later
"""Cameras that do not go with the others of a take: with another's name, moved since the calibration, or out of it.

Frames spread over the take are kept. What was named in them says of every camera how many of the markers in its image
have a blob, and how far its blobs are from the points of the other cameras. Where a camera stands out, the names of
cameras are tried in another order: blobs of two cameras that show the same thing lie on each other's epipolar lines.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, permutations

import numpy as np

from ..data.takes import NO_MARKER, Blobs, LabelledChunk, Suspect
from ..geometry.cameras import Cameras


@dataclass(frozen=True)
class StandOutOptions:
    """When a camera stands out from the others of a take; reckoned.

    frames            of a take that are looked at
    min_seen          markers in a camera's image before anything is said of it
    max_few           of the usual share of named markers, that is few, and
    max_almost_none   that is almost none
    min_sure          share of named markers below which a camera's name is not taken for granted
    min_moved_px      that all blobs of a camera are off together, and
    min_times_usual   as many times what is usual when it is left out
    min_cameras       of which one can be told from the others
    max_condition     of the normal equations of rays: beyond, they fix no depth
    """

    frames: int = 40
    min_seen: int = 100
    max_few: float = 0.5
    max_almost_none: float = 0.1
    min_sure: float = 0.3
    min_moved_px: float = 0.8
    min_times_usual: float = 3.0
    min_cameras: int = 5
    max_condition: float = 1e4


@dataclass(frozen=True)
class ReorderOptions:
    """When cameras are believed to have each other's names; reckoned.

    frames         with the most blobs in which names are tried in another order
    max_cameras    that are tried under each other's names
    seeds          pairs of cameras that are begun with
    near_px        from an epipolar line to what lies on it, where the focal length is
    focal_px       or less; more where a pixel is a smaller angle
    min_mends      times as many blobs must agree under other names,
    min_agreeing   and this share of them
    min_alike      of the best agreement: of such orders the one that changes least is right
    """

    frames: int = 10
    max_cameras: int = 12
    seeds: int = 12
    near_px: float = 1.5
    focal_px: float = 1500.0
    min_mends: float = 1.4
    min_agreeing: float = 0.4
    min_alike: float = 0.97


STANDING_OUT = StandOutOptions()
REORDERING = ReorderOptions()


@dataclass(frozen=True, eq=False)
class CameraFigures:
    """What the named blobs of a take say of C cameras.

    seen    (C,) markers of the fitted body that were in the image, hidden or not, in the frames that are looked at
    named   (C,) those that have a blob with their name
    offset  (C,) px by which all blobs of a camera are off together from the points of the others; NaN where unknown
    """

    seen: np.ndarray
    named: np.ndarray
    offset: np.ndarray

    @property
    def share(self) -> np.ndarray:
        """(C,) named / seen; NaN where nothing was in the image."""
        return self.named / np.where(self.seen > 0, self.seen, np.nan)


@dataclass(frozen=True, eq=False)
class _Frame:
    """One frame: the blobs' camera, place (px) and marker, and the markers (M, 3) m as the body carries them."""

    camera: np.ndarray
    xy: np.ndarray
    marker: np.ndarray
    expected: np.ndarray


class CameraCheck:
    """Keeps a few frames of a take while it is labelled; says at its end which cameras do not go with the others."""

    def __init__(self, cameras: Cameras):
        self.cameras = cameras
        self.frames: list[_Frame] = []
        self._first = self._last = None
        self._count, self._stride = 0, 1

    def add(self, blobs: Blobs, chunk: LabelledChunk):
        """Adds a chunk, which follows the last."""
        self._first = int(blobs.frames[0]) if self._first is None else self._first
        self._last = int(blobs.frames[-1])
        for index in range(len(blobs.frames)):
            if self._count % self._stride == 0:
                rows = blobs.frame == index
                kept = (blobs.camera[rows], blobs.xy[rows], chunk.labels.marker[rows])
                self.frames.append(_Frame(*kept, chunk.motion.expected[index]))
            self._count += 1
        while len(self.frames) > 2 * STANDING_OUT.frames:
            self.frames, self._stride = self.frames[::2], self._stride * 2

    @cached_property
    def figures(self) -> CameraFigures:
        """What the named blobs say of each camera; asked for when the take is at its end."""
        if not self.frames:
            count = len(self.cameras)
            return CameraFigures(np.zeros(count, int), np.zeros(count, int), np.full(count, np.nan))
        expected = np.array([frame.expected for frame in self.frames])
        pixels, ideal = self.cameras.project(expected), self.cameras.normalised(expected)
        with np.errstate(invalid="ignore"):
            inside = ((pixels >= 0) & (pixels < self.cameras.size[:, None, None])).all(axis=3)
            inside &= np.einsum("cfmi,cfmi->cfm", ideal, ideal) < self.cameras.reach[:, None, None] ** 2
        given = np.zeros(inside.shape, dtype=bool)
        for index, frame in enumerate(self.frames):
            mine = frame.marker != NO_MARKER
            given[frame.camera[mine], index, frame.marker[mine]] = True
        seen, named = inside.sum(axis=(1, 2)), (inside & given).sum(axis=(1, 2))
        return CameraFigures(seen, named, _offsets(self.cameras, self.frames))

    def of_cameras(self) -> dict[str, dict]:
        """For each camera: markers in its image, those with a blob, and by how many px its blobs are off together."""
        figures = self.figures
        return {
            name: {
                "in_image": int(figures.seen[index]),
                "named": int(figures.named[index]),
                "offset_px": float(f"{figures.offset[index]:.3g}") if np.isfinite(figures.offset[index]) else None,
            }
            for index, name in enumerate(self.cameras.names)
        }

    def suspects(self) -> tuple[Suspect, ...]:
        """What a person should look into, each over the whole take; nothing where all cameras go together."""
        if len(self.cameras) < 3 or not self.frames:
            return ()
        return tuple(Suspect(self._first, self._last, words) for words in self._sentences())

    def _sentences(self) -> Iterator[str]:
        figures, names = self.figures, self.cameras.names
        known = figures.seen >= STANDING_OUT.min_seen
        usual = float(np.median(figures.share[known])) if known.any() else 0.0
        with np.errstate(invalid="ignore"):
            sure = known & (figures.share > max(STANDING_OUT.max_few * usual, STANDING_OUT.min_sure))
            blank = known & (figures.share < STANDING_OUT.max_almost_none * usual) & (usual > STANDING_OUT.min_sure)
        order = None if (~sure).sum() < 2 else _best_order(self.cameras, self.frames, np.flatnonzero(sure))
        fixed = np.arange(len(names)) == (np.arange(len(names)) if order is None else order)
        if order is not None:
            yield from (_renamed([names[index] for index in cycle]) for cycle in _cycles(order))
        for index in np.flatnonzero(blank & fixed):
            yield (
                f"camera {names[index]} shows almost none of the markers in its image ({figures.share[index]:.0%} have "
                f"a blob, with the others {usual:.0%}): look at its name, place and threshold"
            )
        for index, offset in _moved(self.cameras, self.frames, figures.offset):
            if fixed[index]:
                yield (
                    f"camera {names[index]} seems to have moved since the calibration: its blobs are {offset:.1f} px "
                    "off the points of the other cameras"
                )


def _renamed(names: list[str]) -> str:
    """The sentence about cameras whose blobs each fit the calibration of the next."""
    if len(names) == 2:
        return f"cameras {' and '.join(sorted(names))} seem to have each other's names: exchanged, their blobs fit"
    pairs = [f"{one} fit the calibration of {other}" for one, other in zip(names, names[1:] + names[:1], strict=True)]
    return f"cameras seem to have the names of others: the blobs of {', those of '.join(pairs)}"


def _cycles(order: np.ndarray) -> Iterator[list[int]]:
    """The cycles of an order (C,), without what stays in place; each camera has the name of the next."""
    left = {index for index, other in enumerate(order) if index != other}
    while left:
        cycle = [min(left)]
        while order[cycle[-1]] != cycle[0]:
            cycle.append(int(order[cycle[-1]]))
        left -= set(cycle)
        yield cycle[:1] + cycle[:0:-1]


def _moved(cameras: Cameras, frames: list[_Frame], offsets: np.ndarray) -> Iterator[tuple[int, float]]:
    """Cameras that are off, the farthest first; each is left out before the next is looked at, as it pulls them."""
    without: list[int] = []
    while np.isfinite(offsets).sum() >= STANDING_OUT.min_cameras:
        worst = int(np.nanargmax(offsets))
        without.append(worst)
        others = _offsets(cameras, frames, without)
        known = others[np.isfinite(others)]
        if not len(known) or offsets[worst] < max(
            STANDING_OUT.min_moved_px, STANDING_OUT.min_times_usual * np.median(known)
        ):
            return
        yield worst, float(offsets[worst])
        offsets = others


def _offsets(cameras: Cameras, frames: list[_Frame], without: list[int] = ()) -> np.ndarray:
    """(C,) px: the median way from where the other cameras have a marker to its blob; NaN with too few blobs."""
    parts = [(frame, np.flatnonzero((frame.marker != NO_MARKER) & ~np.isin(frame.camera, without))) for frame in frames]
    number = np.repeat(np.arange(len(frames)), [len(rows) for _, rows in parts])
    camera = np.concatenate([frame.camera[rows] for frame, rows in parts])
    marker = np.concatenate([frame.marker[rows] for frame, rows in parts])
    xy = np.concatenate([frame.xy[rows] for frame, rows in parts])
    _, point, count = np.unique(np.stack([number, marker]), axis=1, return_inverse=True, return_counts=True)
    points = _met_by_others(cameras, camera, xy, point.ravel(), len(count))
    points[count[point.ravel()] < 3] = np.nan
    offsets = np.full(len(cameras), np.nan)
    for index in np.unique(camera):
        mine = camera == index
        off = xy[mine] - cameras.select([index]).project(points[mine])[0]
        off = off[np.isfinite(off).all(axis=1)]
        if len(off) >= STANDING_OUT.min_seen:
            offsets[index] = np.linalg.norm(np.median(off, axis=0))
    return offsets


def _met_by_others(cameras: Cameras, camera: np.ndarray, xy: np.ndarray, point: np.ndarray, count: int) -> np.ndarray:
    """(N, 3) m: for every blob the point nearest to the rays of the other blobs with the same number `point`."""
    ahead = np.column_stack([cameras.undistort(xy, camera), np.ones(len(xy))])
    ahead = np.einsum("nji,nj->ni", cameras.rotation[camera], ahead)
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    across = np.eye(3) - ahead[:, :, None] * ahead[:, None, :]
    centres = cameras.centres[camera]
    weight = np.ones(len(xy))
    across[~np.isfinite(ahead).all(axis=1)] = 0
    for others in (False, True):  # all rays first, which says how long each is
        part = across * weight[:, None, None]
        normal, right = np.zeros((count, 3, 3)), np.zeros((count, 3))
        np.add.at(normal, point, part)
        np.add.at(right, point, np.einsum("nij,nj->ni", part, centres))
        normal, right = normal[point], right[point]
        if others:
            normal, right = normal - part, right - np.einsum("nij,nj->ni", part, centres)
        size = np.einsum("nii->n", normal)[:, None, None] + 1e-12
        inverse = np.linalg.inv(normal / size + 1e-9 * np.eye(3))
        found = np.einsum("nij,nj->ni", inverse, right / size[:, 0])
        found[np.einsum("nii->n", inverse) > STANDING_OUT.max_condition] = np.nan
        weight = 1 / np.maximum(np.nan_to_num(np.linalg.norm(found - centres, axis=1), nan=1e3), 1e-2) ** 2
    return found


def _best_order(cameras: Cameras, frames: list[_Frame], sure: np.ndarray) -> np.ndarray | None:
    """(C,) the name that the blobs of each calibration go by, None where other names mend nothing.

    `sure` are cameras that go together as they are; without two of them the pairs that agree best are begun with. Of
    many cameras that are not sure nothing is tried.
    """
    if len(cameras) - len(sure) > REORDERING.max_cameras:
        return None
    richest = sorted(frames, key=lambda frame: len(frame.camera), reverse=True)[: REORDERING.frames]
    agreement = _Agreement(cameras, richest)
    own = np.arange(len(cameras))
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


class _Agreement:
    """Which part of the blobs of two cameras lie on each other's epipolar lines, whatever their names."""

    def __init__(self, cameras: Cameras, frames: list[_Frame]):
        self.cameras = cameras
        self.near = REORDERING.near_px * np.maximum(1.0, cameras.focal / REORDERING.focal_px) / cameras.focal
        self.blobs = [[frame.xy[frame.camera == name] for frame in frames] for name in range(len(cameras))]
        self.rays: dict[tuple[int, int], list[np.ndarray]] = {}
        self.known: dict[tuple[int, int, int, int], float] = {}

    def of(self, one: int, other: int, first: int, second: int) -> float:
        """The part of agreeing blobs where those named `first` are calibration `one`'s and `second` are `other`'s."""
        key = (one, other, first, second)
        if key not in self.known:
            turn = self.cameras.rotation[other] @ self.cameras.rotation[one].T
            shift = self.cameras.translation[other] - turn @ self.cameras.translation[one]
            x, y, z = shift
            essential = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]]) @ turn
            near, total = 0, 0
            for a, b in zip(self._seen(one, first), self._seen(other, second), strict=True):
                if len(a) and len(b):
                    there, back = a @ essential.T, b @ essential
                    off = np.abs(there @ b.T)
                    near += (off / np.hypot(*there.T[:2])[:, None] < self.near[other]).any(axis=1).sum()
                    near += (off / np.hypot(*back.T[:2])[None] < self.near[one]).any(axis=0).sum()
                total += len(a) + len(b)
            self.known[key] = near / max(total, 1)
        return self.known[key]

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


def _through(cameras: Cameras, calibration: int, xy: np.ndarray) -> np.ndarray:
    """(N, 3) the rays of pixels (N, 2) through a calibration, 1 ahead; without those that no light reaches."""
    image = cameras.undistort(xy, np.full(len(xy), calibration))
    return np.column_stack([image, np.ones(len(xy))])[np.isfinite(image).all(axis=1)]
