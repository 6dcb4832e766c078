# SPDX-License-Identifier: GPL-3.0-or-later
"""Fills constrained by the ray of the one camera that still sees the marker.

Two cameras make a point, one a line: across it the marker is known to a millimetre or so, along it as before. What a
method says of a gap is off by an error that comes and goes in some tenths of a second and is nothing at the gap's ends,
where the marker was measured. The rays tell two of its three coordinates in their frames; the likeliest error given
those (a Gaussian process) is taken from the fill, so that it is smooth, also where rays come and go.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from typing import Self

import numpy as np

from ..data.physical import MARKER_LIMITS, SIGMAS
from ..data.takes import NO_MARKER, Blobs, Labels
from ..geometry.cameras import Cameras
from .gaps import Gap
from .regression import MEAN_OF_DISTANCE


class RAY_LIMITS:
    """How rays constrain a fill, beside how exactly `MARKER_LIMITS` says that blobs and points are known."""

    # s in which the error of a fill becomes another, on virtual rooms with takes that are not among those of the
    # table
    lasts_s: float = 0.15  # measured
    # m, error of a fill of which nothing is known, and what a ray may always pass it by: `auto` is off by less over 2
    # s, however many are missing
    usual_m: float = 0.02  # measured
    window: int = 300  # memory: frames of a gap that are worked out together, at a cost of their number's cube


@dataclass(frozen=True, eq=False)
class MarkerRays:
    """K rays, each of a marker in a frame in which one camera alone has a blob of it, sorted by marker and frame."""

    marker: np.ndarray  # (K,) index
    frame: np.ndarray  # (K,) 0-based
    origin: np.ndarray  # (K, 3) m
    direction: np.ndarray  # (K, 3) of length 1
    spread: np.ndarray  # (K,) m that the ray is off for each metre from its camera

    def __len__(self) -> int:
        return len(self.marker)

    @classmethod
    def join(cls, parts: Iterable[tuple[int, "MarkerRays"]]) -> Self:
        """Those of several parts of a take, each with the index of its first frame."""
        parts = [(0, NO_RAYS), *parts]
        names = ("marker", "origin", "direction", "spread")
        marker, *rest = (np.concatenate([getattr(part, name) for _, part in parts]) for name in names)
        frame = np.concatenate([first + part.frame for first, part in parts])
        order = np.lexsort((frame, marker))
        return cls(marker[order], frame[order], *(column[order] for column in rest))

    def of(self, gap: Gap) -> Self:
        """Those of a gap."""
        low, high = np.searchsorted(self.marker, [gap.marker, gap.marker + 1])
        begin, end = low + np.searchsorted(self.frame[low:high], [gap.start, gap.stop])
        return self.pick(slice(begin, end))

    def pick(self, index: slice | np.ndarray) -> Self:
        """Some of them, by any index that arrays take."""
        return type(self)(*(getattr(self, one.name)[index] for one in fields(self)))


NO_RAYS = MarkerRays(np.empty(0, int), np.empty(0, int), np.empty((0, 3)), np.empty((0, 3)), np.empty(0))


def rays_of(blobs: Blobs, labels: Labels, cameras: Cameras, missing: np.ndarray) -> MarkerRays:
    """The rays of markers that are `missing` (T, M) in frames in which one blob alone has their name."""
    rows = np.flatnonzero(labels.marker != NO_MARKER)
    cell = blobs.frame[rows] * missing.shape[1] + labels.marker[rows]
    alone = (np.bincount(cell, minlength=missing.size)[cell] == 1) & missing.ravel()[cell]
    rows = rows[alone]
    image = cameras.undistort(blobs.xy[rows], blobs.camera[rows])
    usable = np.isfinite(image).all(axis=1)
    rows, image = rows[usable], image[usable]
    camera = blobs.camera[rows]
    ahead, spread = cameras.directions(image, camera), MARKER_LIMITS.noise_px / cameras.focal[camera]
    marker, frame = labels.marker[rows].astype(int), blobs.frame[rows]
    return MarkerRays.join([(0, MarkerRays(marker, frame, cameras.centres[camera], ahead, spread))])


def constrained(
    path: np.ndarray, gap: Gap, off: float, rays: MarkerRays, own: np.ndarray, rate: float
) -> tuple[np.ndarray, float, int]:
    """A fill (L, 3) m of a gap as rays constrain it, what to expect that it is off then, and by how many rays.

    off m is the mean error that was expected, NaN where it is not known; own (T,) where the marker was measured.
    """
    rays = rays.of(gap)
    if not len(rays):
        return path, off, 0
    known = bool(np.isfinite(off) and off > 0)
    deviation = (off if known else RAY_LIMITS.usual_m) / MEAN_OF_DISTANCE
    rays, passing, noise = _believed(path, gap, rays, deviation)
    if not len(rays):
        return path, off, 0
    after, left = path.copy(), np.empty(len(gap))
    for part, around in _windows(len(gap), round(2 * SIGMAS * RAY_LIMITS.lasts_s * rate)):
        some = (rays.frame >= gap.start + around.start) & (rays.frame < gap.start + around.stop)
        prior = _prior(gap, around, own, rate, deviation)
        error, spread = _likeliest(
            prior, rays.frame[some] - gap.start - around.start, passing[some], rays.direction[some], noise[some]
        )
        inner = slice(part.start - around.start, part.stop - around.start)
        after[part] += error[inner]
        left[part] = np.sqrt(spread[inner])
    share = float(left.mean()) / (np.sqrt(3) * deviation)
    return after, off * min(share, 1.0) if known else off, len(rays)


def _believed(
    path: np.ndarray, gap: Gap, rays: MarkerRays, deviation: float
) -> tuple[MarkerRays, np.ndarray, np.ndarray]:
    """The rays that may be the marker's, (K, 3) m from the fill to where each passes it, and (K,) m its own error."""
    arm = path[rays.frame - gap.start] - rays.origin
    along = np.einsum("ki,ki->k", arm, rays.direction)
    passing = along[:, None] * rays.direction - arm
    noise = rays.spread * np.maximum(along, 0.0)
    # Nothing checks a blob that one camera alone named, and errors to expect are themselves off.
    limit = np.maximum(SIGMAS**2 * np.hypot(deviation, noise), RAY_LIMITS.usual_m)
    kept = (along > 0) & (np.linalg.norm(passing, axis=1) <= limit)
    return rays.pick(kept), passing[kept], noise[kept]


def _windows(length: int, margin: int) -> Iterator[tuple[slice, slice]]:
    """Parts of a gap, and what is looked at for each: long ones at once would take time by the cube of their length."""
    for start in range(0, length, RAY_LIMITS.window):
        stop = min(start + RAY_LIMITS.window, length)
        yield slice(start, stop), slice(max(start - margin, 0), min(stop + margin, length))


def _prior(gap: Gap, around: slice, own: np.ndarray, rate: float, deviation: float) -> np.ndarray:
    """(L, L) m², how the error of one coordinate goes together over frames of a gap: Matérn, nothing at its ends."""
    time = np.arange(around.start, around.stop) / rate
    ends = (np.array(gap.ends(own)) - gap.start) / rate
    whole = np.concatenate([time, ends])
    apart = np.sqrt(3) * np.abs(whole[:, None] - whole) / RAY_LIMITS.lasts_s
    alike = (1 + apart) * np.exp(-apart)
    inner, beside = alike[: len(time), : len(time)], alike[: len(time), len(time) :]
    if len(ends):
        at_ends = alike[len(time) :, len(time) :] + (MARKER_LIMITS.noise_m / deviation) ** 2 * np.eye(len(ends))
        inner = inner - beside @ np.linalg.solve(at_ends, beside.T)
    # The error that is expected is the mean over the gap, ends and middle.
    return inner * (deviation**2 / np.diag(inner).mean())


def _likeliest(
    prior: np.ndarray, at: np.ndarray, passing: np.ndarray, direction: np.ndarray, noise: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """(L, 3) m the likeliest error, and (L,) m² its variance that is left, all coordinates together.

    at (K,) are the frames of rays along `direction` (K, 3), which pass the fill by `passing` (K, 3) m and are off by
    `noise` (K,) m.
    """
    variance = 3 * np.diag(prior)
    if not len(at):
        return np.zeros((len(prior), 3)), variance
    sides = _across(direction)
    seen = np.einsum("kji,ki->kj", sides, passing).ravel()
    together = np.einsum("kai,lbi->kalb", sides, sides) * prior[at][:, at][:, None, :, None]
    together = together.reshape(len(seen), len(seen))
    together[np.diag_indices(len(seen))] += np.repeat(noise**2, 2)
    reach = np.einsum("fk,kai->fika", prior[:, at], sides).reshape(3 * len(prior), len(seen))
    solved = np.linalg.solve(together, np.concatenate([seen[:, None], reach.T], axis=1))
    error = (reach @ solved[:, 0]).reshape(-1, 3)
    gone = np.einsum("fk,kf->f", reach, solved[:, 1:]).reshape(-1, 3).sum(axis=1)
    return error, np.maximum(variance - gone, 0.0)


def _across(direction: np.ndarray) -> np.ndarray:
    """(K, 2, 3) two directions of length 1 across each of `direction` (K, 3), and across each other."""
    least = np.eye(3)[np.abs(direction).argmin(axis=1)]
    one = np.cross(direction, least)
    one /= np.linalg.norm(one, axis=1)[:, None]
    return np.stack([one, np.cross(direction, one)], axis=1)
