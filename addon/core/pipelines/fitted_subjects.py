# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs of several subjects read by a body that is fitted to each, as a take of one is, once their points are named.

Points say who is who, but a marker that one or two cameras see makes none, and nothing in a point's name speaks of the
body. So each subject's own blobs, and whatever is nobody's, are labelled as a take of that subject alone: by itself the
body says which of the points' names are right, and held by these it names what is left. In between it looks at somebody
else's points beside markers that it lacks: one may be its own, if it is nearer to where it has that. A body that is not
clear by itself is fitted to them first.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Self

import numpy as np

from ..blobs.pipeline import TakeLabeller
from ..blobs.search import FINDING
from ..blobs.subject import Setup
from ..data.takes import NO_MARKER, Blobs, Labels, Motion
from ..geometry.cameras import Cameras
from ..papers.virtual_occlusions.labelling import Rules
from ..papers.virtual_occlusions.occlusion import Occlusion
from ..points.several.pipeline import is_prop
from ..points.several.wearers import SetsWorn

# measured: for as many names as points give a subject in a chunk, the share that its body by itself must give, these or
# others, or the points alone decide: blobs of several who return get 276 wrong labels, and 2,031 where so many of the
# names must be the same.
EXPLAINED_SHARE = 0.9


@dataclass(frozen=True, eq=False)
class _Reading:
    """What a body says of a chunk: labels (N,) by the markers of all, and the motion of its own, from `first` on."""

    labels: Labels
    motion: Motion
    first: int

    def off(self, blobs: Blobs, rows: np.ndarray) -> np.ndarray:
        """(R,) m, how far the markers of some of its names are from where it has them; NaN where no two rays meet."""
        off = np.linalg.norm(self.motion.markers - self.motion.expected, axis=2)
        return off[blobs.frame[rows], self.labels.marker[rows] - self.first]


class FollowedSubject:
    """One subject of a take, whose markers are from `first` on, with its body by itself and its body held by names."""

    def __init__(self, first: int, setup: Setup):
        self.first, self.size, self.setup = first, setup.model.marker_count, setup
        self.free, self.held = (TakeLabeller(setup) for _ in range(2))
        self.trusted = True

    @property
    def clear(self) -> bool:
        """Whether its body by itself is clear, however it is named."""
        return self.free.placement > FINDING.clear_confidence

    def owns(self, labels: Labels) -> np.ndarray:
        """(N,) True for the blobs that are named as its own."""
        return (labels.marker >= self.first) & (labels.marker < self.first + self.size)

    def alone(self, blobs: Blobs, labels: Labels) -> _Reading:
        """What its body says by itself; whether it is trusted depends on how many blobs that explains.

        Not on how many names it shares with the points: these may be another's, or those of another side.
        """
        own = self.owns(labels)
        reading = self._read_by(self.free, blobs, labels, own | ~labels.named, held=False)
        judged = own & (reading.motion.confidence[blobs.frame] > 0)
        self.trusted = bool(reading.labels.named.sum() >= EXPLAINED_SHARE * judged.sum())
        return reading

    def agreeing(self, blobs: Blobs, labels: Labels, alone: _Reading) -> np.ndarray:
        """(N,) True for its own names that its body gives by itself, or does not judge: there is none in that frame."""
        unjudged = (alone.motion.confidence[blobs.frame] == 0) | (not self.trusted)
        return self.owns(labels) & (unjudged | (alone.labels.marker == labels.marker))

    def tempted(self, blobs: Blobs, labels: Labels, others: np.ndarray) -> _Reading:
        """What its body says, held by its names, with somebody else's blobs (N,) among its own and nobody's.

        It is looked for again in every chunk, as few have such blobs.
        """
        return self._read_by(TakeLabeller(self.setup), blobs, labels, self.owns(labels) | ~labels.named | others)

    def reading(self, blobs: Blobs, labels: Labels) -> _Reading:
        """What its body says of its own blobs and nobody's, held by its names."""
        return self._read_by(self.held, blobs, labels, self.owns(labels) | ~labels.named)

    def _read_by(
        self, labeller: TakeLabeller, blobs: Blobs, labels: Labels, among: np.ndarray, held: bool = True
    ) -> _Reading:
        """What one of its bodies says of the blobs that it is to be found `among` (N,).

        Nothing where it is not trusted, which what the body by itself says shows.
        """
        rows = np.flatnonzero(among)
        seeds = np.where(self.owns(labels), labels.marker - self.first, NO_MARKER)[rows] if held else None
        # Where it is clear by itself, names say nothing new of where it is, or was.
        known, labeller.person = self.free.found if held and self.clear else None, not self.clear
        chunk = labeller.label(blobs.part(slice(0, len(blobs.frames)), rows), seeds, known)
        found, named = Labels.none(len(blobs)), chunk.labels.named
        if not held or self.trusted:
            found.marker[rows] = np.where(named, chunk.labels.marker + self.first, NO_MARKER)
            found.step[rows], found.confidence[rows] = chunk.labels.step, chunk.labels.confidence
        return _Reading(found, chunk.motion, self.first)


@dataclass(frozen=True, eq=False)
class FollowedSubjects:
    """Those of a take who have a body, chunk by chunk in their order; props are known by their form alone."""

    subjects: tuple[FollowedSubject, ...]
    markers: int

    @classmethod
    def of(cls, worn: SetsWorn, cameras: Cameras, rate: float, bodies: Sequence[Occlusion]) -> Self:
        """Nobody followed yet; `bodies` are what is in the way, a volume for each subject."""
        found = []
        for one, first, body in zip(worn.subjects, worn.firsts, bodies, strict=True):
            if not is_prop(one.model):
                setup = Setup.of(cameras, one.model.markerset, body, rate=rate)
                found.append(FollowedSubject(first, setup))
        return cls(tuple(found), len(worn))

    def read(self, blobs: Blobs, labels: Labels) -> tuple[Labels, Labels]:
        """The labels (N,) of the next chunk's blobs by points, without those that bodies deny, and with what they add.

        Also what bodies say by themselves. A blob that two of them name is nobody's.
        """
        if not self.subjects:
            return labels, labels
        alone = [one.alone(blobs, labels) for one in self.subjects]
        kept = ~np.any([one.owns(labels) for one in self.subjects], axis=0)
        for one, own in zip(self.subjects, alone, strict=True):
            kept |= one.agreeing(blobs, labels, own)
        agreed = labels.kept(kept)
        agreed = agreed.kept(~self._contested(blobs, agreed, alone))
        readings = [one.reading(blobs, agreed) for one in self.subjects]
        return _added(agreed, readings), _added(Labels.none(len(blobs)), alone)

    def _contested(self, blobs: Blobs, agreed: Labels, alone: Sequence[_Reading]) -> np.ndarray:
        """(N,) True for the names of points that a marker of somebody else's body is nearer to than their own body's.

        A name of a point that the points alone gave is as near to its body as that could be bent.
        """
        found, off = np.zeros(len(blobs), bool), np.full(len(blobs), np.nan)
        for one, own in zip(self.subjects, alone, strict=True):
            rows = np.flatnonzero(one.owns(agreed) & (own.labels.marker == agreed.marker))
            off[rows] = own.off(blobs, rows)
        for one, own in zip(self.subjects, alone, strict=True):
            away = self._away(blobs, agreed, one, own, alone)
            beside = away < Rules.max_distance_m
            if beside.any() and not one.clear:
                reading = one.tempted(blobs, agreed, beside)
                beside &= reading.labels.named
                rows = np.flatnonzero(beside)
                away[rows] = reading.off(blobs, rows)
            found |= beside & (away < off)
        return found

    def _away(
        self, blobs: Blobs, agreed: Labels, one: FollowedSubject, own: _Reading, alone: Sequence[_Reading]
    ) -> np.ndarray:
        """(N,) m, how far the blobs' points are, where they are others', from where a marker that one lacks may be.

        By its body alone; infinite where nothing is there.
        """
        there = np.zeros((len(blobs.frames), self.markers), bool)
        there[blobs.frame[agreed.named], agreed.marker[agreed.named]] = True
        mine = slice(one.first, one.first + one.size)
        expected = np.where(there[:, mine, None], np.nan, own.motion.expected)
        least = np.full(there.shape, np.inf)
        for other, theirs in zip(self.subjects, alone, strict=True):
            if other is not one:
                away = np.linalg.norm(theirs.motion.markers[:, :, None] - expected[:, None], axis=3)
                least[:, other.first : other.first + other.size] = np.fmin.reduce(away, axis=2, initial=np.inf)
        return np.where(agreed.named, least[blobs.frame, np.maximum(agreed.marker, 0)], np.inf)


def _added(labels: Labels, readings: Sequence[_Reading]) -> Labels:
    """The labels (N,) with what readings say of blobs that have no name, where one alone does."""
    readers, whole = np.sum([reading.labels.named & ~labels.named for reading in readings], axis=0), labels
    for reading in readings:
        whole = whole.replaced(reading.labels.named & (readers == 1), reading.labels)
    return whole
