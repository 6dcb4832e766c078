# SPDX-License-Identifier: GPL-3.0-or-later
"""From what frames say one by one to what is said of the take: tracklets vote."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Protocol, Self

import numpy as np

from ..data.lanes import PACKING, Lanes, blocks, trajectories_at
from ..data.takes import BY_TRAJECTORY, NO_MARKER, NO_STEP, Labels, Suspect, Verdict
from .models import Model
from .refusals import REFUSAL
from .tracklets import VOTE, are_lasting, gone_over_between, vote


@dataclass(frozen=True)
class WitnessOptions:
    """Where a vote needs frames that are sure on their own, as its frames may err together.

    min_sure  measured: part of a tracklet's frames that must be sure of its name alone, in a crowd, and where one
              subject is all that the model has seen; with half of it a prop that is not there is named
    """

    min_sure: float = 0.5


WITNESSES = WitnessOptions()


class FrameLabels(Protocol):
    """What frames say on their own: `Labels` (T, L) with their `rate`, or what works them out when it is asked."""

    def __getitem__(self, part: slice) -> Labels:
        """The labels of the frames from start to stop."""

    def whole(self) -> Labels:
        """All of them at once."""


@dataclass(frozen=True, eq=False)
class Votes:
    """What the tracklets (T, L) of a take were voted, window by window, and what a person should look at.

    marker   (T, L)
    windows  the frames of each window, with how sure its votes are: the different values (K,) and which of them each is
             (F, L), as there are few; where there are many the values are None, and these (F, L) are it
    """

    marker: np.ndarray
    windows: list[tuple[slice, np.ndarray | None, np.ndarray]]
    suspects: tuple[Suspect, ...]

    @classmethod
    def of(cls, named: FrameLabels, tracklet: np.ndarray, names: Sequence[str], first_frame: int) -> Self:
        """The votes of what frames of tracklets (T, L) say on their own; the same where they are too short to vote."""
        if not are_lasting(tracklet):
            labels = named.whole()
            return cls(labels.marker, [(slice(0, len(tracklet)), None, labels.confidence)], ())
        found = cls(np.full(tracklet.shape, NO_MARKER, np.int16), [], ())
        suspects: list[Suspect] = []
        size = VOTE.window_frames
        edges = [*range(0, max(len(tracklet) - size // 2, 1), size), len(tracklet)]
        for first, after in pairwise(edges):
            frames, border = slice(first, after), slice(first - 1, first + 1)
            part = vote(named[frames], tracklet[frames], names, first_frame + first)
            found.marker[frames] = part.labels.marker
            found.windows.append((frames, *_few(part.labels.confidence, tracklet.size)))
            suspects += part.suspects
            if first:
                suspects += gone_over_between(found.marker[border], tracklet[border], first + first_frame, names)
        return replace(found, suspects=tuple(sorted(suspects, key=lambda suspect: suspect.first)))

    def parts(self) -> Iterator[tuple[slice, np.ndarray]]:
        """Some frames at a time, and how sure their votes are (F, L)."""
        for frames, values, which in self.windows:
            for own in blocks(*which.shape):
                part = slice(frames.start + own.start, frames.start + own.stop)
                yield part, which[own].copy() if values is None else values[which[own]]


def _few(values: np.ndarray, cells: int) -> tuple[np.ndarray | None, np.ndarray]:
    """Values (F, L) as `Votes` keeps them: of a table of so many cells, where it is large and they are few, narrow."""
    if cells <= PACKING.whole_cells:
        return None, values
    some, which = np.unique(values, return_inverse=True)
    if len(some) > np.iinfo(np.uint16).max:
        return None, values
    return some, which.reshape(values.shape).astype(np.uint16)


def decide(
    named: FrameLabels, tracklet: np.ndarray, model: Model, target: float, first_frame: int, lanes: Lanes | None = None
) -> Verdict:
    """Lets the tracklets (T, P) vote and keeps what is sure enough that a part `target` of it is right.

    named are the labels (T, P) of frames on their own, with their `rate`. Where the vote says what the frame said, the
    frame's own step stays.
    """
    votes = Votes.of(named, tracklet, model.markerset.markers, first_frame)
    decided = Labels.none(*tracklet.shape)
    needed = _needed(model, tracklet)
    count = int(tracklet.max(initial=-1)) + 1
    backed = np.ones(count + 1, bool)
    if needed > 0:
        backed = np.append(_part_sure(votes.marker, named, tracklet, target, count) >= needed, False)
    for part, chance in votes.parts():
        own, marker = named[part], votes.marker[part].copy()
        enough = (chance >= target) & backed[tracklet[part]]
        alone = marker == own.marker
        np.maximum(chance, own.confidence, out=chance, where=alone)
        step = np.where(alone, own.step, BY_TRAJECTORY)
        marker[~(enough | (alone & (own.sure(target) != NO_MARKER)))] = NO_MARKER
        marker = once(marker, chance, len(model.markerset), lanes, part.start)
        nothing = marker == NO_MARKER
        step[nothing], chance[nothing] = NO_STEP, 0.0
        decided.marker[part], decided.step[part], decided.confidence[part] = marker, step, chance
    return Verdict(decided, votes.suspects)


def _needed(model: Model, tracklet: np.ndarray) -> float:
    """The part of a tracklet's frames that must be sure of its name for its vote to count.

    A vote takes frames for so many witnesses. They are not where they err together: among many more points than
    markers one that is no marker sits like one through the whole take, and a model of one subject knows nothing of how
    the next one differs.
    """
    likelihood, markers = model.likelihood, len(model.markerset)
    crowd = (tracklet >= 0).sum() >= REFUSAL.crowd * markers * len(tracklet)
    few = likelihood is not None and likelihood.subjects == 1 and likelihood.rigid_bodies is None
    return WITNESSES.min_sure if crowd or few else 0.0


def _part_sure(marker: np.ndarray, named: FrameLabels, tracklet: np.ndarray, target: float, count: int) -> np.ndarray:
    """(N,) the part of each of `count` tracklets' frames that are sure of the marker (T, L) that it was voted."""
    frames, sure = np.zeros((2, count))
    for part in blocks(*tracklet.shape):
        own, there, labels = tracklet[part], tracklet[part] >= 0, named[part]
        frames += np.bincount(own[there], minlength=count)
        there &= (marker[part] == labels.sure(target)) & (marker[part] != NO_MARKER)
        sure += np.bincount(own[there], minlength=count)
    return sure / np.maximum(frames, 1)


def once(marker: np.ndarray, sure: np.ndarray, markers: int, lanes: Lanes | None = None, start: int = 0) -> np.ndarray:
    """Labels (T, L) of which each frame has every marker once: the surest, of equals the first in the file.

    They begin with the frame `start` of the take.
    """
    kept = marker.copy()
    for part in blocks(*marker.shape):
        frame, lane = np.nonzero(marker[part] != NO_MARKER)
        key = frame * markers + marker[part][frame, lane]
        more = np.flatnonzero(np.bincount(key)[key] > 1)
        frame, lane, key = frame[more] + part.start, lane[more], key[more]
        number = trajectories_at(lanes, frame + start, lane)
        order = np.lexsort((number, -sure[frame, lane], key))
        again = order[1:][np.diff(key[order]) == 0]
        kept[frame[again], lane[again]] = NO_MARKER
    return kept
