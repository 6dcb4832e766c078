# SPDX-License-Identifier: GPL-3.0-or-later
"""Calibration health: cameras that do not go with the others of a take, and rooms that do not go with the take.

Frames spread over the take are kept. What was named in them says of every camera how many of the markers in its image
have a blob, and how far its blobs are from the points of the other cameras. Where a camera stands out, the names of
cameras are tried in another order, and it is looked for beside where it was calibrated. Of a room it is asked whether
blobs meet at all, and how large what they show is: in the wrong unit it is a thousand times too large.
"""

from collections.abc import Iterator
from functools import cached_property
from itertools import combinations

import numpy as np

from ..data.errors import ForceableError
from ..data.markersets import MarkerSet
from ..data.physical import MARKER_LIMITS, SIGMAS
from ..data.takes import NO_MARKER, Blobs, Suspect
from ..geometry.cameras import Cameras
from ..geometry.triangulation import meet_rows
from .camera_order import CAMERA_HEALTH, CameraAgreement, best_order, cycles_of, same_names_meet
from .camera_places import CameraPlace, find_again
from .suspects import OF_ROOM

# measured: of the set's markers that must be seen in a frame; a lamp or two in the room have no size
MIN_SIZED = 0.3  # measured


def times_too_large(agreement: CameraAgreement, markerset: MarkerSet) -> tuple[float, float]:
    """By how many times a room is too large, the nearest power of ten; and m that is seen upwards, NaN where unknown.

    Units differ by powers of ten, people by less than two, whether they stand or crouch.
    """
    rest = _extents(markerset.rest_markers * markerset.spread.height).max()
    seen = [_extents(points) for points in sure_points(agreement) if len(points) >= MIN_SIZED * len(markerset)]
    if not seen:
        return 1.0, np.nan
    along = np.median(seen, axis=0)
    # More people lie beside each other and not above: too large is what is too high as well.
    times = along[2] / rest if along[2] > rest else min(along.max() / rest, 1.0)
    return float(10.0 ** np.round(np.log10(times))), float(along[2])


def sure_points(agreement: CameraAgreement) -> list[np.ndarray]:
    """Frame by frame points (N, 3) m of two blobs, in two cameras, that lie on each other's epipolar lines alone."""
    camera, image, number = [np.zeros(0, int)], [np.zeros((0, 2))], [np.zeros(0, int)]
    for one, other in combinations(range(len(agreement.cameras)), 2):
        for index, (a, b, there, back) in enumerate(agreement.beside(one, other, one, other)):
            near = (there < 1) & (back < 1)
            alone = near & (near.sum(axis=1, keepdims=True) == 1) & (near.sum(axis=0, keepdims=True) == 1)
            first, second = np.nonzero(alone)
            image.append(np.stack([a[first, :2], b[second, :2]], axis=1).reshape(-1, 2))
            camera.append(np.tile([one, other], len(first)))
            number.append(np.full(len(first), index))
    frame = np.concatenate(number)
    point = np.repeat(np.arange(len(frame)), 2)
    places = meet_rows(agreement.cameras, np.concatenate(camera), np.concatenate(image), point, len(frame))
    sound = np.isfinite(places).all(axis=1)
    return [places[sound & (frame == index)] for index in range(agreement.frame_count)]


def _extents(points: np.ndarray) -> np.ndarray:
    """(3,) how far points (N, 3) reach along each axis, from a tenth to nine: without ghosts and false crossings."""
    low, high = np.percentile(points, [10, 90], axis=0)
    return high - low


MIN_RAYS = 3  # that make a point which one of them can be measured against
OF_THIS_TAKE = "; expected the calibration that the take was recorded with, in metres"


class CameraCheck:
    """Keeps a few frames of a take while it is labelled; says at its end which of C cameras do not go with the others.

    `markerset` is what was looked for, which says how large it should be; None where nobody knows.

    frames  of each the blobs' cameras (N,), places (N, 2) px and markers (N,), and the markers (M, 3) m as the body
            carries them
    """

    def __init__(self, cameras: Cameras, markerset: MarkerSet | None = None):
        self.cameras, self.markerset = cameras, markerset
        self.frames: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]] = []
        self._first = self._last = self._count = 0
        self._stride = 1
        self._seen = np.zeros(len(cameras), bool)  # those that have a blob in any frame

    def add(self, blobs: Blobs, marker: np.ndarray, expected: np.ndarray):
        """Adds F frames, which follow the last, whose blobs are of markers (N,), which the body has at (F, M, 3) m."""
        self._first = self._first if self._count else int(blobs.frames[0])
        self._last = int(blobs.frames[-1])
        self._seen[blobs.camera] = True
        for index in range(len(blobs.frames)):
            if self._count % self._stride == 0:
                rows = blobs.frame == index
                self.frames.append((blobs.camera[rows], blobs.xy[rows], marker[rows], expected[index]))
            self._count += 1
        while len(self.frames) > 2 * CAMERA_HEALTH.frames:
            self.frames, self._stride = self.frames[::2], self._stride * 2

    @cached_property
    def counts(self) -> tuple[np.ndarray, np.ndarray]:
        """(C,) markers of the fitted body that were in the image, hidden or not, and (C,) those that have a blob."""
        if not self.frames:
            return np.zeros(len(self.cameras), int), np.zeros(len(self.cameras), int)
        expected = np.array([expected for *_, expected in self.frames])
        pixels, ideal = self.cameras.project(expected), self.cameras.normalised(expected)
        with np.errstate(invalid="ignore"):
            inside = ((pixels >= 0) & (pixels < self.cameras.size[:, None, None])).all(axis=3)
            inside &= np.einsum("cfmi,cfmi->cfm", ideal, ideal) < self.cameras.reach[:, None, None] ** 2
        given = np.zeros(inside.shape, dtype=bool)
        frame, camera, _, _, marker = self._named
        given[camera, frame, marker] = True
        return inside.sum(axis=(1, 2)), (inside & given).sum(axis=(1, 2))

    @property
    def _share(self) -> np.ndarray:
        """(C,) the part of the markers in the image that have a blob; NaN where nothing was in the image."""
        seen, named = self.counts
        return named / np.where(seen > 0, seen, np.nan)

    @cached_property
    def offset(self) -> np.ndarray:
        """(C,) px by which all blobs of a camera are off together from the points of the others; NaN where unknown."""
        return self._offsets(np.zeros(len(self.cameras), bool))

    def of_cameras(self) -> dict[str, dict]:
        """For each camera: markers in its image, those with a blob, and by how many px its blobs are off together."""
        figures = zip(self.cameras.names, *self.counts, self.offset, strict=True)
        return {
            name: {
                "in_image": int(seen),
                "named": int(named),
                "offset_px": float(f"{offset:.3g}") if np.isfinite(offset) else None,
            }
            for name, seen, named, offset in figures
        }

    def suspects(self) -> tuple[Suspect, ...]:
        """What a person should look into, each over the whole take; nothing where all cameras go together."""
        if len(self.cameras) < 2 or not self.frames:
            return ()
        words = filter(None, (self._lonely, *self._sentences()))
        return tuple(Suspect(self._first, self._last, one) for one in words)

    def refuse(self):
        """Raises ForceableError where the room as a whole is not the take's: names in it would be guesses."""
        if len(self.cameras) < 2 or not self.frames:
            return
        if self.names_apart:
            raise ForceableError(self.names_apart + OF_THIS_TAKE)
        if self.wrong_room or self._nothing_meets:
            expected = "" if self.wrong_room else "; expected each camera by the name that it was calibrated by"
            raise ForceableError("; ".join(self._sentences()) + expected)

    @cached_property
    def agreement(self) -> CameraAgreement:
        """Which blobs of the frames with the most of them meet."""
        richest = sorted(self.frames, key=lambda frame: len(frame[0]), reverse=True)[: CAMERA_HEALTH.frames // 4]
        return CameraAgreement(self.cameras, [(camera, xy) for camera, xy, _, _ in richest])

    @cached_property
    def order(self) -> np.ndarray | None:
        """(C,) the name that the blobs of each calibration go by, None where all have their own."""
        if len(self.cameras) < 3:
            return None
        if self._nothing_meets:
            return best_order(self.agreement, np.zeros(0, int))
        with np.errstate(invalid="ignore"):
            sure = ~(self.agreement.meeting() < CAMERA_HEALTH.min_meeting)
        return None if (~sure).sum() < 2 else best_order(self.agreement, np.flatnonzero(sure))

    @cached_property
    def wrong_room(self) -> str:
        """What is wrong with the room as a whole: another than the take's, or of another size; empty if nothing is."""
        if self._nothing_meets and self.order is None:
            return (
                f"{OF_ROOM} not to be this take's: by this calibration the blobs of no camera meet those of the "
                f"others ({np.nanmedian(self.agreement.meeting()):.0%} do beyond chance)"
            )
        if self.order is not None or self.markerset is None:
            return ""
        times, high = times_too_large(self.agreement, self.markerset)
        if times == 1:
            return ""
        size = f"about {times:g} times too large" if times > 1 else f"about {1 / times:g} times too small"
        unit = {1000: ", as if millimetres were read as metres", 100: ", as if centimetres were read as metres"}
        return f"{OF_ROOM} to be {size}{unit.get(round(times), '')}: what its cameras see is {_plain(high)} m high"

    @cached_property
    def names_apart(self) -> str:
        """That blobs of one name meet in few pairs of cameras, which says the same of a room; empty if they do.

        Bodies are found in a wrong room too, and names given to whatever is near them; adjusting cameras may mend it.
        """
        if self._nothing_meets or self.wrong_room or self.order is not None:
            return ""
        frame, camera, _, image, marker = self._named
        table = np.full((len(self.cameras), len(self.frames), len(self.frames[0][3]), 2), np.nan)
        table[camera, frame, marker] = image
        shares = same_names_meet(self.cameras, table)
        shares = shares[np.isfinite(shares)]
        if 2 * len(shares) < len(table) or np.median(shares) >= CAMERA_HEALTH.min_same_name:
            return ""
        return (
            f"{OF_ROOM} not to be this take's: by this calibration few blobs of one name meet in two cameras "
            f"({np.median(shares):.0%} do)"
        )

    @cached_property
    def moved(self) -> dict[int, CameraPlace]:
        """Cameras that are named too seldom, found again beside where the calibration has them."""
        lacking = self._lacking
        if (~lacking).sum() < 2:
            return {}
        points = self._points_of_others(lacking)
        least, places = CAMERA_HEALTH.max_lacking * self.usual, {}
        for index in np.flatnonzero(lacking).tolist():
            blobs = [xy[camera == index] for camera, xy, _, _ in self.frames]
            place = find_again(self.cameras.select([index]), points, blobs, least)
            places.update({} if place is None else {index: place})
        return places

    @cached_property
    def off(self) -> dict[int, float]:
        """Cameras whose blobs are all off together from the points of the others, px, the farthest first.

        Each is left out before the next is looked at, as it pulls them.
        """
        found, offset, without = {}, self.offset, np.zeros(len(self.cameras), bool)
        while np.isfinite(offset).sum() > MIN_RAYS:
            worst = int(np.nanargmax(offset))
            without[worst] = True
            others = self._offsets(without)
            known = others[np.isfinite(others)]
            if not len(known) or offset[worst] < max(MARKER_LIMITS.noise_px, SIGMAS * np.median(known)):
                break
            found[worst], offset = float(offset[worst]), others
        return found

    @property
    def _lacking(self) -> np.ndarray:
        """(C,) cameras under their own names that have clearly fewer names than usual."""
        with np.errstate(invalid="ignore"):
            few = (self.counts[0] >= CAMERA_HEALTH.enough) & (self._share < CAMERA_HEALTH.max_lacking * self.usual)
        return few & (np.arange(len(self.cameras)) == self._order_or_own)

    @property
    def usual(self) -> float:
        """The share of markers that have a blob in the usual camera; one that was off during the take is none."""
        cameras = np.concatenate([camera for camera, *_ in self.frames]) if self.frames else np.zeros(0, int)
        judged = (self.counts[0] >= CAMERA_HEALTH.enough) & (np.bincount(cameras, minlength=len(self.cameras)) > 0)
        return float(np.median(self._share[judged])) if judged.any() else 0.0

    @property
    def _lonely(self) -> str:
        """That only one camera has blobs, which places nobody; empty if more have."""
        seen = np.flatnonzero(self._seen)
        words = "alone has blobs, and nobody is found by one: look whether those of others are missing"
        return f"camera {self.cameras.names[seen[0]]} {words}" if len(seen) == 1 else ""

    @property
    def _order_or_own(self) -> np.ndarray:
        return np.arange(len(self.cameras)) if self.order is None else self.order

    @property
    def _nothing_meets(self) -> bool:
        """Whether most cameras' blobs meet those of others by chance only."""
        meeting = self.agreement.meeting()
        measured = np.isfinite(meeting)
        return bool(measured.sum() >= 2 and np.median(meeting[measured]) < CAMERA_HEALTH.min_meeting)

    @cached_property
    def _named(self) -> tuple[np.ndarray, ...]:
        """Of the N blobs that have a name: frame and camera (N,), place (N, 2) px and without the lens, marker (N,)."""
        camera, xy, marker = (np.concatenate(part) for part in list(zip(*self.frames, strict=True))[:3])
        frame = np.repeat(np.arange(len(self.frames)), [len(camera) for camera, *_ in self.frames])
        rows = marker != NO_MARKER
        image = self.cameras.undistort(xy[rows], camera[rows])
        return frame[rows], camera[rows], xy[rows], image, marker[rows]

    def _named_without(self, cameras: np.ndarray) -> tuple[np.ndarray, ...]:
        """The same but for the blobs of some cameras (C,)."""
        rows = ~cameras[self._named[1]]
        return tuple(column[rows] for column in self._named)

    def _offsets(self, without: np.ndarray) -> np.ndarray:
        """(C,) px: the median way from where the others of some cameras have a marker to its blob; NaN if too few."""
        offsets = np.full(len(self.cameras), np.nan)
        if not self.frames:
            return offsets
        frame, camera, xy, image, marker = self._named_without(without)
        _, point, count = np.unique(np.stack([frame, marker]), axis=1, return_inverse=True, return_counts=True)
        point = point.ravel()
        points = meet_rows(self.cameras, camera, image, point, len(count), others=True)
        points[count[point] < MIN_RAYS] = np.nan
        for index in np.unique(camera):
            mine = camera == index
            off = xy[mine] - self.cameras.select([index]).project(points[mine])[0]
            off = off[np.isfinite(off).all(axis=1)]
            if len(off) >= CAMERA_HEALTH.enough:
                offsets[index] = np.linalg.norm(np.median(off, axis=0))
        return offsets

    def _points_of_others(self, without: np.ndarray) -> np.ndarray:
        """(F, M, 3) m: the markers by their blobs in all cameras but some (C,); NaN with fewer than two."""
        frame, camera, _, image, marker = self._named_without(without)
        shape = len(self.frames), len(self.frames[0][3])
        points = meet_rows(self.cameras, camera, image, frame * shape[1] + marker, shape[0] * shape[1])
        return points.reshape(*shape, 3)

    def _sentences(self) -> Iterator[str]:
        if self.wrong_room:
            yield self.wrong_room + OF_THIS_TAKE
            return
        if self.names_apart:
            yield self.names_apart + OF_THIS_TAKE
        if len(self.cameras) < 3:
            return
        names = self.cameras.names
        fixed = np.arange(len(names)) == self._order_or_own
        if self.order is not None:
            yield from (_renamed([names[index] for index in cycle]) for cycle in cycles_of(np.argsort(self.order)))
        for index, place in self.moved.items():
            yield (
                f"camera {names[index]} seems to have moved since the calibration: its blobs fit with it turned by "
                f"{np.degrees(place.turned):.1f}° and shifted by {1000 * place.shifted:.0f} mm"
            )
        with np.errstate(invalid="ignore"):
            alone = ~(self.agreement.meeting() >= CAMERA_HEALTH.min_meeting)
        for index in np.flatnonzero(self._lacking & alone).tolist():
            if index not in self.moved:
                yield (
                    f"camera {names[index]} shows almost none of the markers in its image ({self._share[index]:.0%} "
                    f"have a blob, with the others {self.usual:.0%}): look at its name, place and threshold"
                )
        for index, offset in self.off.items():
            if fixed[index] and index not in self.moved:
                yield (
                    f"camera {names[index]} seems to have moved since the calibration: its blobs are {offset:.1f} px "
                    "off the points of the other cameras"
                )


def _plain(metres: float) -> str:
    """A length as people write it, without powers of ten."""
    return f"{metres:.0f}" if metres >= 10 else f"{metres:.2g}"


def _renamed(names: list[str]) -> str:
    """The sentence about cameras whose blobs each fit the calibration of the next."""
    if len(names) == 2:
        return f"cameras {' and '.join(sorted(names))} seem to have each other's names: exchanged, their blobs fit"
    pairs = [f"{one} fit the calibration of {other}" for one, other in zip(names, names[1:] + names[:1], strict=True)]
    return f"cameras seem to have the names of others: the blobs of {', those of '.join(pairs)}"
