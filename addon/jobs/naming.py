# SPDX-License-Identifier: GPL-3.0-or-later
"""Naming the points of a take, frame by frame, by whichever method the model and the user allow."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..core.blobs.pipeline import Options, label_take
from ..core.data.errors import InputError
from ..core.data.models import Model
from ..core.data.takes import NO_MARKER, Blobs, Suspect
from ..core.geometry.cameras import Cameras
from ..core.points.consistency import stray_suspects, strays
from ..core.points.likelihood import Likelihood
from ..core.points.tracklets import vote_tracklets
from ..core.simulation.rigs import ring_rig

CHUNK = 256
VIEWS = 6  # virtual cameras around the points, when a body is fitted to them
RADIUS, MARGIN = 6.0, 1.5  # m
SIZE = (2000, 2000)  # px
CROWD = 2.0  # times as many points as markers are a crowd, where
BACKED = 0.5  # of a tracklet's frames must be sure of its name on their own,
BACKED_ALONE = 0.25  # and so many where one subject is all that the model has seen
AGREED = 0.5  # share of the virtual cameras that must give a point the same name


@dataclass(frozen=True, eq=False)
class NamedFrames:
    """F frames of P points, each frame named on its own.

    marker, confidence  (F, P), NO_MARKER and 0 where unnamed
    rate                (F, P) the part of labels like this one that is right
    """

    marker: np.ndarray
    confidence: np.ndarray
    rate: np.ndarray


def chosen_method(model: Model, wanted: str) -> str:
    """The method that "auto" stands for, or the one that was wanted; InputError where the model cannot do it."""
    if wanted == "auto":
        return (
            "evidence"
            if model.markerset.likelihood is not None
            else "fit"
            if model.partial_solvers is None
            else "ensemble"
        )
    if wanted == "evidence" and model.markerset.likelihood is None:
        raise InputError(f"model {model.markerset.name} has no evidence; expected one made by train")
    if wanted == "ensemble" and model.partial_solvers is None:
        raise InputError(f"model {model.markerset.name} has no ensemble; expected one that was trained with --search")
    return wanted


def name_frames(model: Model, method: str, points: np.ndarray, rate: float, options: Options) -> Iterator[NamedFrames]:
    """Names points (T, P, 3) m, z up, NaN where missing, some frames at a time."""
    if method == "evidence":
        yield from _by_evidence(model, points)
    elif method == "ensemble":
        yield from _by_partial_solvers(model, points)
    else:
        yield from _by_fit(model, points, rate, options)


@dataclass(frozen=True, eq=False)
class Decided:
    """What is said of points in the end.

    marker, confidence  (T, P), NO_MARKER and 0 where unnamed
    alone               (T, P) True where the frame itself said so, False where the trajectory overruled it
    suspects            trajectories that changed names or were of two minds
    """

    marker: np.ndarray
    confidence: np.ndarray
    alone: np.ndarray
    suspects: tuple[Suspect, ...]


def decide(named: NamedFrames, tracklet: np.ndarray, model: Model, target: float, first_frame: int) -> Decided:
    """Lets the tracklets (T, P) of trajectories vote and keeps what is sure enough that a part `target` of it is right."""
    markers = model.markerset.markers
    voted = vote_tracklets(named.marker, named.confidence, tracklet, markers, first_frame)
    alone = voted.marker == named.marker
    chance = np.where(alone, np.maximum(voted.confidence, named.confidence), voted.confidence)
    sure = alone & (named.rate >= target)
    backed = _part_sure(sure, tracklet) >= _needed(model, tracklet)
    marker = np.where((voted.confidence >= target) & backed | sure, voted.marker, NO_MARKER)
    marker = once(marker, chance, len(markers))
    return Decided(marker, np.where(marker == NO_MARKER, 0.0, chance), alone, voted.suspects)


def _needed(model: Model, tracklet: np.ndarray) -> float:
    """The part of a tracklet's frames that must be sure of its name for its vote to count.

    A vote takes frames for so many witnesses. They are not where they err together: among many more points than
    markers one that is no marker sits like one through the whole take, and a model of one subject knows nothing of how
    the next one differs.
    """
    likelihood, markers = model.markerset.likelihood, len(model.markerset)
    if (tracklet >= 0).sum() >= CROWD * markers * len(tracklet):
        return BACKED
    few = likelihood is not None and likelihood.subjects == 1 and likelihood.rigid_bodies is None
    return BACKED_ALONE if few else 0.0


def _part_sure(sure: np.ndarray, tracklet: np.ndarray) -> np.ndarray:
    """(T, P) of each point the part of its tracklet's frames that are sure (T, P) of its name; 0 where there is none."""
    present = tracklet >= 0
    frames = np.bincount(tracklet[present])
    part = np.bincount(tracklet[present], weights=sure[present]) / np.maximum(frames, 1)
    return np.where(present, np.append(part, 0.0)[tracklet], 0.0)


def consistent(decided: Decided, points: np.ndarray, likelihood: Likelihood | None, first_frame: int) -> Decided:
    """Takes back names of points (T, P, 3) that contradict the rest of the take, and says so."""
    if likelihood is None:
        return decided
    frame, column = np.nonzero(decided.marker != NO_MARKER)
    marker = decided.marker[frame, column]
    placed = np.full((len(points), len(likelihood), 3), np.nan)
    placed[frame, marker] = points[frame, column]
    stray = strays(placed, likelihood.constraints)
    wrong = stray[frame, marker]
    kept, sure = decided.marker.copy(), decided.confidence.copy()
    kept[frame[wrong], column[wrong]], sure[frame[wrong], column[wrong]] = NO_MARKER, 0.0
    suspects = decided.suspects + stray_suspects(stray, likelihood.markers, first_frame)
    return Decided(kept, sure, decided.alone, suspects)


def joined(parts: Sequence[NamedFrames]) -> NamedFrames:
    """All frames of several parts."""
    return NamedFrames(*(np.concatenate([getattr(part, name) for part in parts]) for name in vars(parts[0])))


def once(marker: np.ndarray, sure: np.ndarray, markers: int) -> np.ndarray:
    """Labels (T, P) of which each frame has every marker once: the surest."""
    kept = np.full(marker.shape, NO_MARKER)
    for index in range(markers):
        worth = np.where(marker == index, sure, -1.0)
        best = worth.argmax(axis=1)
        frames = np.flatnonzero(worth[np.arange(len(worth)), best] >= 0)
        kept[frames, best[frames]] = index
    return kept


def _by_evidence(model: Model, points: np.ndarray) -> Iterator[NamedFrames]:
    from ..core.points.likelihood import label_frames

    for named in label_frames(model.markerset.likelihood, points):
        yield NamedFrames(named.marker, named.confidence, named.rate)


def _by_partial_solvers(model: Model, points: np.ndarray) -> Iterator[NamedFrames]:
    from ..core.points.partial_solvers.label import Labeller

    parts = (points[first : first + CHUNK] for first in range(0, len(points), CHUNK))
    for marker, confidence in Labeller(model.partial_solvers).chunks(parts):
        yield NamedFrames(marker, confidence, (marker != NO_MARKER) * 1.0)


def _by_fit(model: Model, points: np.ndarray, rate: float, options: Options) -> Iterator[NamedFrames]:
    """As if cameras all around saw every point: the body that is fitted to blobs names their points."""
    cameras = _around(points)
    present = np.isfinite(points).all(axis=2)

    def seen() -> Iterator[Blobs]:
        for first in range(0, len(points), CHUNK):
            yield _blobs(points, present, first, cameras)

    first = 0
    for chunk in label_take(seen(), cameras, model.markerset, rate, options, NothingInTheWay()):
        frames = slice(first, first + len(chunk.motion.frames))
        yield _agreed(chunk.labels, present[frames], len(model.markerset))
        first = frames.stop


class NothingInTheWay:
    """The occlusion of cameras that see through everything."""

    def hidden(self, rotations, joints, scale, markers, centres) -> np.ndarray:  # noqa: ARG002 - as Occlusion has it
        """See `core.occlusion.Occlusion`."""
        return np.zeros((len(markers), len(centres), markers.shape[1]), dtype=bool)


def _around(points: np.ndarray) -> Cameras:
    """Cameras in a ring that have all points (T, P, 3) in their images."""
    low, high = (np.nanpercentile(points.reshape(-1, 3), end, axis=0) for end in (0, 100))
    reach = float(np.linalg.norm((high - low)[:2]) / 2) + MARGIN
    rig = ring_rig(VIEWS, SIZE, reach + RADIUS, 2.0, reach)
    middle = np.append((low + high)[:2] / 2, min(low[2], 0.0))
    shifted = rig.translation - np.einsum("cij,j->ci", rig.rotation, middle)
    return Cameras(rig.names, rig.size, rig.matrix, np.zeros_like(rig.distortion), rig.rotation, shifted)


def _blobs(points: np.ndarray, present: np.ndarray, first: int, cameras: Cameras) -> Blobs:
    """The chunk that begins with frame `first` as blobs, camera after camera, each in the order of the points."""
    here = present[first : first + CHUNK]
    frame, _ = np.nonzero(here)
    xy = cameras.project(points[first : first + CHUNK][here]).reshape(-1, 2)
    camera = np.repeat(np.arange(len(cameras)), len(frame))
    numbers = np.arange(first, first + len(here))
    return Blobs(numbers, np.tile(frame, len(cameras)), camera, xy, np.full(len(xy), np.nan))


def _agreed(labels, present: np.ndarray, markers: int) -> NamedFrames:
    """For each point the name that most of its blobs have."""
    said = labels.marker.reshape(VIEWS, -1)
    votes = np.zeros((said.shape[1], markers + 1))
    np.add.at(
        votes, (np.broadcast_to(np.arange(said.shape[1]), said.shape), said), labels.confidence.reshape(said.shape)
    )
    best = votes[:, :markers].argmax(axis=1)
    share = votes[np.arange(len(best)), best] / VIEWS
    marker, confidence = np.full(present.shape, NO_MARKER), np.zeros(present.shape)
    marker[present] = np.where(share > AGREED, best, NO_MARKER)
    confidence[present] = np.where(share > AGREED, share, 0)
    return NamedFrames(marker, confidence, (marker != NO_MARKER) * 1.0)
