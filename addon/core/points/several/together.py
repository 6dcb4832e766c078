# SPDX-License-Identifier: GPL-3.0-or-later
"""What is said of each subject put together: labels that count the markers of all in a row, what to look at, motion."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Self

import numpy as np

from ...data.lanes import blocks
from ...data.progress import finished
from ...data.takes import NO_MARKER, Labels, Points, Suspect, Verdict
from ..motion import by_marker, take_motion
from ..refusals import refuse_unlike, refuse_unrecognised
from ..whole_take.pipeline import PointOptions, decided_of
from .bodies import NamedBody
from .identification import UnidentifiedPresence
from .motion import SubjectsMotion
from .wearers import SetsWorn, Wearer


@dataclass(frozen=True, eq=False)
class FoundSubject:
    """A subject, the body, the tracklets (N,) that it may have, and what is said of it alone."""

    subject: Wearer
    body: NamedBody
    may: np.ndarray
    verdict: Verdict


@dataclass(frozen=True, eq=False)
class Everybody:
    """Who is in a take, the verdict on all of them, labels (T, L) by `worn`; and presences that may be anybody's."""

    found: tuple[FoundSubject, ...]
    worn: SetsWorn
    verdict: Verdict
    unidentified: tuple[UnidentifiedPresence, ...] = ()

    @classmethod
    def of(cls, found: Sequence[FoundSubject], unidentified: tuple[UnidentifiedPresence, ...] = ()) -> Self:
        """Those who were found, in their order."""
        worn = SetsWorn(tuple(one.subject for one in found))
        return cls(tuple(found), worn, joined(worn, [one.verdict for one in found]), unidentified)


def verdict_on(one: NamedBody, target: float) -> Verdict:
    """What is said of one; UnsuitedError where the model is not for it."""
    frames = one.frames
    if one.solution is not None:
        refuse_unlike(frames.model, frames.namer, frames.take.xyz, one.solution.fit)
    verdict = decided_of(frames, frames.labels, frames.tracklet, one.solution, target)
    refuse_unrecognised(frames.model, frames.namer, frames.take.xyz, verdict.labels)
    return verdict


def joined(worn: SetsWorn, verdicts: Sequence[Verdict]) -> Verdict:
    """What is said of all of them; what two have is nobody's. Those whom nobody asked for have nothing to look at."""
    whole = Labels.none(*verdicts[0].labels.marker.shape)
    suspects: list[Suspect] = []
    for part in blocks(*whole.marker.shape):
        taken = np.sum([verdict.labels.marker[part] != NO_MARKER for verdict in verdicts], axis=0)
        for first, verdict in zip(worn.firsts, verdicts, strict=True):
            own = verdict.labels[part]
            at = own.named & (taken == 1)
            whole.marker[part][at] = own.marker[at] + first
            whole.step[part][at], whole.confidence[part][at] = own.step[at], own.confidence[at]
    for subject, verdict in zip(worn.asked.subjects, verdicts, strict=False):
        suspects += [_of(suspect, subject) for suspect in verdict.suspects]
    return Verdict(whole, tuple(suspects))


def _of(suspect: Suspect, subject: Wearer) -> Suspect:
    """What is said of a subject, with whom it is said of."""
    markers = tuple(f"{subject.name}:{marker}" for marker in suspect.markers)
    return replace(suspect, words=f"{subject.name}: {suspect.words}", markers=markers)


def own_labels(labels: Labels, first: int, size: int) -> Labels:
    """The labels (T, L) of one subject of all, whose `size` markers begin at `first`, by the subject's own markers."""
    own = labels.kept((labels.marker >= first) & (labels.marker < first + size))
    return replace(own, marker=np.where(own.named, own.marker - first, NO_MARKER))


def motion_of_all(
    take: Points, labels: Labels, worn: SetsWorn, options: PointOptions, places: Mapping[tuple[int, int], np.ndarray]
) -> SubjectsMotion:
    """Everybody's markers and body, by the labels (T, L) of all; `places` are where a person placed markers of all."""
    parts = []
    for subject, first in zip(worn.subjects, worn.firsts, strict=True):
        size = len(subject.model.markerset)
        own = own_labels(labels, first, size)
        put = {(at, marker - first): xyz for (at, marker), xyz in places.items() if first <= marker < first + size}
        markers = by_marker(take.xyz, own, size, put)
        residual = by_marker(take.residual, own, size, dict.fromkeys(put, 0.0))  # not measured
        given = markers, residual, own, subject.model.markerset, take.frames, options.room
        parts.append(finished(take_motion(*given)))
    return SubjectsMotion.of(parts)
