# SPDX-License-Identifier: GPL-3.0-or-later
"""Virtual people in virtual rooms for tests: a few calls from a marker set to blobs whose names are known."""

from dataclasses import dataclass, replace
from functools import cache

import numpy as np

from addon.core.body.bodies import Bodies, BodyModel
from addon.core.data.markersets import MarkerSet
from addon.core.data.takes import Blobs
from addon.core.geometry.cameras import Cameras
from addon.core.geometry.views import View, split_views
from addon.core.papers.virtual_occlusions.occlusion import CapsuleOcclusion
from addon.core.simulation.simulate import CaptureOptions, PosedBody, capture, joined
from addon.core.simulation.virtual import Act, draw_person, perform
from addon.io.markersets import open_markerset

RATE = 60.0
CLEAN = CaptureOptions(noise=0.2, dropout=0.0, reflections=0, flicker=0.0)
FLAWLESS = CaptureOptions(noise=0.0, dropout=0.0, reflections=0, flicker=0.0)


@cache
def built_in(name: str) -> MarkerSet:
    """A marker set that ships with the project."""
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
        """The frames, ready to be labelled."""
        return split_views(self.blobs, self.cameras)

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


def film(markerset: MarkerSet, cameras: Cameras, bodies: Bodies, options: CaptureOptions = CLEAN) -> Scene:
    """A virtual capture of posed bodies, one a frame, with the body in the way."""
    posed = BodyModel(markerset).pose(bodies)
    body = PosedBody(
        CapsuleOcclusion(markerset), np.asarray(markerset.attachment), posed.rotations, posed.joints, bodies.scale
    )
    seen = joined(capture(posed.markers, markerset.markers, cameras, options, body))
    return Scene(markerset, cameras, bodies, seen.blobs, seen.truth)


def stand(
    markerset: MarkerSet,
    cameras: Cameras,
    seed: int = 0,
    facing: float = 0.0,
    height: float | None = None,
    options: CaptureOptions = CLEAN,
) -> Scene:
    """One frame of a standing person, up to 0.2 m off the middle."""
    bodies = perform(BodyModel(markerset), person_of(markerset, seed, height), [Act(0.1)], RATE, seed, facing).pick([0])
    place = np.append(np.random.default_rng(seed).uniform(-0.2, 0.2, 2), 0)
    return film(markerset, cameras, replace(bodies, translation=bodies.translation + place), options)


def act(
    markerset: MarkerSet, cameras: Cameras, acts, seed: int = 0, options: CaptureOptions = CLEAN, rate: float = RATE
) -> Scene:
    """A person who performs."""
    return film(
        markerset, cameras, perform(BodyModel(markerset), person_of(markerset, seed), acts, rate, seed), options
    )


def abreast(markerset: MarkerSet, seeds, frames: int, rate: float, apart: float) -> tuple[list, list]:
    """Bodies and markers (T, M, 3) m of people, by their seeds, who walk side by side, so many m from each other."""
    model, bodies, markers = BodyModel(markerset), [], []
    for place, seed in enumerate(seeds):
        moves = perform(model, person_of(markerset, seed), [Act(frames / rate)], rate=rate)
        posed = model.pose(moves)
        shift = np.array([0.0, apart * (place - 0.5), 0.0]) - posed.joints[:frames, 0].mean(axis=0) * [1.0, 1.0, 0.0]
        turns, joints = posed.rotations[:frames], posed.joints[:frames] + shift
        volume = CapsuleOcclusion(markerset)
        bodies.append(PosedBody(volume, markerset.attachment, turns, joints, moves.scale[:frames]))
        markers.append(posed.markers[:frames] + shift)
    return bodies, markers


def cut(blobs: Blobs, size: int) -> list[Blobs]:
    """The same frames in chunks of `size` frames."""
    return [blobs.between(first, first + size - 1) for first in blobs.frames[::size]]


def keep(blobs: Blobs, rows: np.ndarray) -> Blobs:
    """The same frames with some of their blobs."""
    return blobs.part(slice(0, len(blobs.frames)), rows)


def blobs_at(pixels: list[np.ndarray]) -> Blobs:
    """One frame: a list of (K, 2) px for every camera."""
    camera = np.repeat(np.arange(len(pixels)), [len(rows) for rows in pixels])
    xy = np.concatenate([np.reshape(rows, (-1, 2)) for rows in pixels])
    return Blobs(np.array([1]), np.zeros(len(xy), int), camera, xy, np.full(len(xy), np.nan))
