# SPDX-License-Identifier: GPL-3.0-or-later
"""Points named by a fitted body: as if cameras all around saw every point, and the first paper's method named them."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..blobs.pipeline import Options, label_take
from ..data.markersets import MarkerSet
from ..data.takes import BY_FIT, NO_MARKER, NO_STEP, Blobs, Labels
from ..geometry.cameras import Cameras
from ..simulation.rigs import ring_rig


@dataclass(frozen=True)
class VirtualViews:
    """The cameras that see the points. All reckoned.

    count         around the points
    distance_m    of the cameras from the volume that they see,
    height_m      above its floor,
    margin_m      and what that is wider than the points
    size_px       of an image
    min_agreed    share of the cameras that must give a point the same name
    chunk_frames  seen at once
    """

    count: int = 6
    distance_m: float = 6.0
    height_m: float = 2.0
    margin_m: float = 1.5
    size_px: tuple[int, int] = (2000, 2000)
    min_agreed: float = 0.5
    chunk_frames: int = 256


VIEWS = VirtualViews()


@dataclass(frozen=True, eq=False)
class FittedBodyNamer:
    """Names points frame after frame by the body of a marker set; see `naming.Namer`."""

    markerset: MarkerSet
    options: Options
    step: int = BY_FIT

    def name(self, points: np.ndarray, rate: float) -> Iterator[Labels]:
        """See `naming.Namer`."""
        cameras = _around(points)
        present = np.isfinite(points).all(axis=2)

        def seen() -> Iterator[Blobs]:
            for first in range(0, len(points), VIEWS.chunk_frames):
                yield _blobs(points, present, first, cameras)

        first = 0
        for chunk in label_take(seen(), cameras, self.markerset, rate, self.options, NothingInTheWay()):
            frames = slice(first, first + len(chunk.motion.frames))
            yield _agreed(chunk.labels, present[frames], len(self.markerset))
            first = frames.stop


class NothingInTheWay:
    """The occlusion of cameras that see through everything."""

    def hidden(self, rotations, joints, scale, markers, centres) -> np.ndarray:  # noqa: ARG002 - as Occlusion has it
        """See `papers.virtual_occlusions.occlusion.Occlusion`."""
        return np.zeros((len(markers), len(centres), markers.shape[1]), dtype=bool)


def _around(points: np.ndarray) -> Cameras:
    """Cameras in a ring that have all points (T, P, 3) in their images."""
    low, high = (np.nanpercentile(points.reshape(-1, 3), end, axis=0) for end in (0, 100))
    reach = float(np.linalg.norm((high - low)[:2]) / 2) + VIEWS.margin_m
    rig = ring_rig(VIEWS.count, VIEWS.size_px, reach + VIEWS.distance_m, VIEWS.height_m, reach)
    middle = np.append((low + high)[:2] / 2, min(low[2], 0.0))
    shifted = rig.translation - np.einsum("cij,j->ci", rig.rotation, middle)
    return Cameras(rig.names, rig.size, rig.matrix, np.zeros_like(rig.distortion), rig.rotation, shifted)


def _blobs(points: np.ndarray, present: np.ndarray, first: int, cameras: Cameras) -> Blobs:
    """The chunk that begins with frame `first` as blobs, camera after camera, each in the order of the points."""
    frames = slice(first, first + VIEWS.chunk_frames)
    here = present[frames]
    frame, _ = np.nonzero(here)
    xy = cameras.project(points[frames][here]).reshape(-1, 2)
    camera = np.repeat(np.arange(len(cameras)), len(frame))
    numbers = np.arange(first, first + len(here))
    return Blobs(numbers, np.tile(frame, len(cameras)), camera, xy, np.full(len(xy), np.nan))


def _agreed(labels: Labels, present: np.ndarray, markers: int) -> Labels:
    """For each point the name that most of its blobs have."""
    said = labels.marker.reshape(VIEWS.count, -1)
    votes = np.zeros((said.shape[1], markers + 1))
    np.add.at(
        votes, (np.broadcast_to(np.arange(said.shape[1]), said.shape), said), labels.confidence.reshape(said.shape)
    )
    best = votes[:, :markers].argmax(axis=1)
    share = votes[np.arange(len(best)), best] / VIEWS.count
    marker, confidence = np.full(present.shape, NO_MARKER), np.zeros(present.shape)
    marker[present] = np.where(share > VIEWS.min_agreed, best, NO_MARKER)
    confidence[present] = np.where(share > VIEWS.min_agreed, share, 0)
    named = marker != NO_MARKER
    return Labels(marker, np.where(named, BY_FIT, NO_STEP), confidence, named * 1.0)
