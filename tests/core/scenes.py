# SPDX-License-Identifier: GPL-3.0-or-later
"""Virtual people in virtual rooms for tests: a few calls from a marker set to blobs whose names are known."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from addon.core.body.bodies import Bodies, BodyModel
from addon.core.data.markersets import MarkerSet
from addon.core.data.takes import Blobs, Motion, Points
from addon.core.geometry.cameras import Cameras
from addon.core.geometry.views import View, split_views
from addon.core.papers.virtual_occlusions.occlusion import CapsuleOcclusion
from addon.core.simulation.simulate import BodiesTogether, Capture, CaptureOptions, PosedBody, capture
from addon.core.simulation.virtual import Act, draw_person, perform
from addon.io.markersets import open_markerset

RATE = 60.0
CLEAN = CaptureOptions(noise=0.2, dropout=0.0, reflections=0, flicker=0.0)
FLAWLESS = CaptureOptions(noise=0.0, dropout=0.0, reflections=0, flicker=0.0)


def joined(captures: Iterator[Capture]) -> Capture:
    chunks = list(captures)
    return Capture(Blobs.join(chunk.blobs for chunk in chunks), np.concatenate([chunk.truth for chunk in chunks]))


@cache
def built_in(name: str) -> MarkerSet:
    return open_markerset(name)


@dataclass(frozen=True, eq=False)
class Scene:
    """What the cameras saw of a person, and who and where the person really was (bodies, one a frame)."""

    markerset: MarkerSet
    cameras: Cameras
    bodies: Bodies
    blobs: Blobs
    truth: np.ndarray

    @property
    def points(self) -> np.ndarray:
        """(T, M, 3) m, where the markers really were."""
        return BodyModel(self.markerset).pose(self.bodies).markers

    def views(self) -> list[View]:
        return split_views(self.blobs, self.cameras)

    def given(self, view: View, naming) -> tuple[np.ndarray, np.ndarray]:
        """Which rows of the blobs have a name in a frame (K,), marker by marker, and whether it is theirs."""
        camera, marker = np.nonzero(naming.slot >= 0)
        row = view.row[camera, naming.slot[camera, marker]]
        truth = zip(self.names(marker), self.truth[row], strict=True)
        return row, np.array([name in true.split("|") for name, true in truth], bool)

    def right(self, names) -> np.ndarray:
        """(N,) whether each blob has a name that is right; a ghost is right without one."""
        return np.array([name in truth.split("|") for name, truth in zip(names, self.truth, strict=True)])

    def names(self, marker: np.ndarray) -> np.ndarray:
        """(N,) the names of marker indices, "" where negative."""
        return np.array([*self.markerset.markers, ""], dtype=object)[marker]


def person_of(markerset: MarkerSet, seed: int, height: float | None = None) -> Bodies:
    """A person drawn from the marker set's spread, of the given stature if any."""
    person = draw_person(markerset, np.random.default_rng(seed))
    return person if height is None else replace(person, scale=np.full((1, 3), float(height)))


def walker(name: str, seed: int, acts, rate: float = RATE, noise: float = 0.0005) -> np.ndarray:
    """(T, M, 3) m: the markers of a virtual person in a built-in set who performs, measured with noise."""
    markerset, generator = built_in(name), np.random.default_rng(seed)
    model = BodyModel(markerset)
    markers = model.pose(perform(model, draw_person(markerset, generator), acts, rate=rate)).markers
    return markers + generator.normal(0, noise, markers.shape)


def anonymous(xyz: np.ndarray, rate: float = RATE) -> Points:
    """A take of points (T, P, 3) m without names, from frame 1 on."""
    residual = np.where(np.isfinite(xyz[..., 0]), 0.0005, np.nan)
    return Points(("",) * xyz.shape[1], xyz, residual, rate, 1)


def in_pieces(markers: np.ndarray, generator: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """A trajectory (T, P, 3) for each time that a marker (T, M, 3) is there, in any order; and which each is (P,)."""
    there = np.isfinite(markers[..., 0])
    time = np.cumsum(np.diff(there, axis=0, prepend=False) & there, axis=0)
    pieces = [
        (there[:, of] & (time[:, of] == one), of) for of in range(there.shape[1]) for one in range(1, time[-1, of] + 1)
    ]
    tracks = np.stack([np.where(own[:, None], markers[:, of], np.nan) for own, of in pieces], axis=1)
    order = generator.permutation(len(pieces))
    return tracks[:, order], np.array([of for _, of in pieces])[order]


def motion_of(markers: np.ndarray, expected: np.ndarray, first: int = 1) -> Motion:
    """A motion of markers (T, M, 3) m, and where a body that stays upright has them; nothing else of it matters."""
    count, residual = len(markers), np.where(np.isfinite(markers[..., 0]), 0.001, np.nan)
    pose = expected[:, :1], np.tile(np.eye(3), (count, 1, 1, 1)), np.ones((count, 3)), np.ones(count)
    return Motion(first + np.arange(count), markers, residual, residual, np.zeros(residual.shape, int), expected, *pose)


def film(markerset: MarkerSet, cameras: Cameras, bodies: Bodies, options: CaptureOptions = CLEAN) -> Scene:
    """A virtual capture of posed bodies, one a frame, with the body in the way."""
    posed = BodyModel(markerset).pose(bodies)
    pose = posed.rotations, posed.joints, bodies.scale
    body = PosedBody(CapsuleOcclusion(markerset), np.asarray(markerset.attachment), *pose)
    seen = joined(capture(posed.markers, markerset.markers, cameras, options, body))
    return Scene(markerset, cameras, bodies, seen.blobs, seen.truth)


def stand(markerset: MarkerSet, cameras: Cameras, seed=0, facing=0.0, height=None, options=CLEAN) -> Scene:
    """One frame of a standing person, up to 0.2 m off the middle."""
    bodies = perform(BodyModel(markerset), person_of(markerset, seed, height), [Act(0.1)], RATE, seed, facing).pick([0])
    place = np.append(np.random.default_rng(seed).uniform(-0.2, 0.2, 2), 0)
    return film(markerset, cameras, replace(bodies, translation=bodies.translation + place), options)


def act(markerset: MarkerSet, cameras: Cameras, acts, seed=0, options=CLEAN, rate=RATE) -> Scene:
    bodies = perform(BodyModel(markerset), person_of(markerset, seed), acts, rate, seed)
    return film(markerset, cameras, bodies, options)


def abreast(markerset: MarkerSet, seeds, frames: int, rate: float, apart: float, cameras: Cameras, options) -> Capture:
    """What cameras see of people, by their seeds, who walk side by side, so many m from each other."""
    model, bodies, markers = BodyModel(markerset), [], []
    for place, seed in enumerate(seeds):
        moves = perform(model, person_of(markerset, seed), [Act(frames / rate)], rate=rate)
        posed = model.pose(moves)
        shift = np.array([0.0, apart * (place - 0.5), 0.0]) - posed.joints[:frames, 0].mean(axis=0) * [1.0, 1.0, 0.0]
        turns, joints = posed.rotations[:frames], posed.joints[:frames] + shift
        volume = CapsuleOcclusion(markerset)
        bodies.append(PosedBody(volume, markerset.attachment, turns, joints, moves.scale[:frames]))
        markers.append(posed.markers[:frames] + shift)
    together = BodiesTogether(tuple(bodies), (len(markerset),) * len(bodies))
    names = [f"{seed}:{name}" for seed in seeds for name in markerset.markers]
    return joined(capture(np.concatenate(markers, axis=1), names, cameras, options, together))


def cut(blobs: Blobs, size: int) -> list[Blobs]:
    return [blobs.between(first, first + size - 1) for first in blobs.frames[::size]]


def parts_of(blobs: Blobs, size: int) -> list[tuple[Blobs, float]]:
    """The same with the share of the frames before each, and its first."""
    return [(part, part.frames[0] / len(blobs.frames)) for part in cut(blobs, size)]


def keep(blobs: Blobs, rows: np.ndarray) -> Blobs:
    return blobs.part(slice(0, len(blobs.frames)), rows)


def blobs_at(pixels: list[np.ndarray]) -> Blobs:
    """One frame: a list of (K, 2) px for every camera."""
    camera = np.repeat(np.arange(len(pixels)), [len(rows) for rows in pixels])
    xy = np.concatenate([np.reshape(rows, (-1, 2)) for rows in pixels])
    return Blobs(np.array([1]), np.zeros(len(xy), int), camera, xy, np.full(len(xy), np.nan))
