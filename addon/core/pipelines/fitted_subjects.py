# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs of several subjects read by a body that is fitted to each, as a take of one is, once their points are named.

Points say who is who, but a marker that one or two cameras see makes none, and nothing in a point's name speaks of the
body. So each subject's own blobs, and whatever is nobody's, are labelled as a take of that subject alone, twice: by
itself the body says which of the points' names are right, then it is held by these and names what is left.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ..blobs.pipeline import Options, TakeLabeller
from ..blobs.subject import Setup
from ..body.occlusion import Occlusion
from ..data.markersets import MarkerSet
from ..data.takes import NO_MARKER, Blobs, Labels, Motion
from ..geometry.cameras import Cameras
from ..points.several.props import is_prop
from ..points.several.wearers import SetsWorn

BodyOf = Callable[[MarkerSet], Occlusion]  # the volume of a subject
# (F, C, M) True where somebody else's body hides markers (F, M, 3) m of a subject, by its number.
HiddenByOthers = Callable[[int, np.ndarray], np.ndarray]


@dataclass(frozen=True)
class HearingOptions:
    """When a fitted body is heard. Reckoned.

    agreed  share of a subject's names in a chunk that its body by itself must give too; else the set's body does not
            suit the subject, and the points alone have the say
    """

    agreed: float = 0.9


HEARING = HearingOptions()


@dataclass(frozen=True, eq=False)
class _Said:
    """What a subject's body says of a chunk: labels (N,) by the markers of all, and the motion of its own markers."""

    labels: Labels
    motion: Motion


class FittedSubject:
    """One subject of a take, whose markers are from `first` on, with its body by itself and its body held by names."""

    def __init__(self, number: int, first: int, setups: tuple[Setup, Setup]):
        self.number, self.first, self.size = number, first, setups[0].model.marker_count
        self.free, self.held = (TakeLabeller(setup, Options()) for setup in setups)
        self.heard = True

    def owns(self, labels: Labels) -> np.ndarray:
        """(N,) True for the blobs that are named as its own."""
        return (labels.marker >= self.first) & (labels.marker < self.first + self.size)

    def agreeing(self, blobs: Blobs, labels: Labels) -> np.ndarray:
        """(N,) True for its own names that its body gives by itself, or cannot judge, as there is none in that frame.

        All of them, and its body is not heard, where that agrees with too few.
        """
        own = self.owns(labels)
        said = self._said(self.free, blobs, labels, False)
        judged = own & (said.motion.confidence[blobs.frame] > 0)
        same = own & (said.labels.marker == labels.marker)
        self.heard = not judged.any() or bool(same[judged].mean() >= HEARING.agreed)
        return same | (own & ~judged) if self.heard else own

    def reading(self, blobs: Blobs, labels: Labels) -> _Said:
        """What its body says, held by its names; nothing where it is not heard."""
        said = self._said(self.held, blobs, labels, True)
        return said if self.heard else replace(said, labels=Labels.none(len(blobs)))

    def _said(self, labeller: TakeLabeller, blobs: Blobs, labels: Labels, held: bool) -> _Said:
        """What one of its bodies says of its own blobs and of nobody's."""
        own = self.owns(labels)
        rows = np.flatnonzero(own | ~labels.named)
        seeds = np.where(own, labels.marker - self.first, NO_MARKER)[rows] if held else None
        chunk = labeller.label(blobs.part(slice(0, len(blobs.frames)), rows), seeds)
        found, named = Labels.none(len(blobs)), chunk.labels.named
        found.marker[rows] = np.where(named, chunk.labels.marker + self.first, NO_MARKER)
        found.step[rows], found.confidence[rows] = chunk.labels.step, chunk.labels.confidence
        return _Said(found, chunk.motion)


@dataclass(frozen=True, eq=False)
class FittedSubjects:
    """Those of a take who have a body, chunk by chunk in their order; props are known by their form alone."""

    subjects: tuple[FittedSubject, ...]
    markers: int

    @classmethod
    def of(
        cls, worn: SetsWorn, cameras: Cameras, rate: float, body_of: Callable[[MarkerSet], Occlusion] | None
    ) -> Self:
        """Nobody followed yet; `body_of` makes the volume of a subject, None for the marker set's capsules."""
        found = []
        for number, (one, first) in enumerate(zip(worn.subjects, worn.firsts, strict=True)):
            if not is_prop(one.model):
                worn_set = one.model.markerset
                body = body_of(worn_set) if body_of else None
                setups = tuple(Setup.of(cameras, worn_set, body, rate=rate) for _ in range(2))
                found.append(FittedSubject(number, first, setups))
        return cls(tuple(found), len(worn))

    def read(self, blobs: Blobs, labels: Labels, hidden: HiddenByOthers) -> Labels:
        """The labels (N,) of the next chunk's blobs by points, without those that bodies deny, and with what they add.

        A blob that two bodies claim is nobody's. A marker that one camera alone has seen is not named where somebody
        else hides it.
        """
        agreeing = [one.agreeing(blobs, labels) for one in self.subjects]
        judged = np.any([one.owns(labels) for one in self.subjects], axis=0)
        agreed = labels.kept(~judged | np.any(agreeing, axis=0))
        said = [one.reading(blobs, agreed) for one in self.subjects]
        claims = np.sum([one.labels.named & ~agreed.named for one in said], axis=0)
        whole = agreed
        for one in said:
            whole = whole.replaced(one.labels.named & (claims == 1), one.labels)
        return whole.kept(~self._unseen(blobs, agreed, whole, said, hidden))

    def _rays(self, blobs: Blobs, labels: Labels) -> np.ndarray:
        """(N,) how many blobs of its frame have the same name as each."""
        sample = blobs.frame * self.markers + np.maximum(labels.marker, 0)
        count = np.bincount(sample[labels.named], minlength=len(blobs.frames) * self.markers)
        return np.where(labels.named, count[sample], 0)

    def _unseen(
        self, blobs: Blobs, agreed: Labels, whole: Labels, said: Sequence[_Said], hidden: HiddenByOthers
    ) -> np.ndarray:
        """(N,) True for new names of markers that no other camera sees, and that somebody else hides from this one."""
        found = np.zeros(len(blobs), bool)
        lone = whole.named & ~agreed.named & (self._rays(blobs, whole) == 1)
        for subject, one in zip(self.subjects, said, strict=True):
            rows = np.flatnonzero(lone & subject.owns(whole))
            if len(rows):
                by_others = hidden(subject.number, one.motion.expected)
                found[rows] = by_others[blobs.frame[rows], blobs.camera[rows], whole.marker[rows] - subject.first]
        return found
