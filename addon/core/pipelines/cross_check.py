# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs named by both methods at once: by a body that is fitted to them, and by the points that they make.

The two papers' methods share nothing but the blobs, so where they agree a name is surely right, and where they do not a
person should look. The fitted body has the say; where it finds nobody, the points have.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields

import numpy as np

from ..data.takes import NO_MARKER, Blobs, LabelledChunk, Labels, Motion, Suspect, summed
from ..review.suspects import suspect_ranges


@dataclass(frozen=True)
class DisagreementOptions:
    """What counts as a disagreement. Both reckoned.

    max_break_frames  between two that are one
    min_cameras       that must show one; a single blob may be two markers' at once
    """

    max_break_frames: int = 10
    min_cameras: int = 2


DISAGREEMENT = DisagreementOptions()


@dataclass
class MethodAgreement:
    """How many blobs both methods named alike and otherwise, and how many only one of them named."""

    same: int = 0
    different: int = 0
    only_fit: int = 0
    only_points: int = 0

    def add(self, fitted: np.ndarray, pointed: np.ndarray):
        """Counts the markers (N,) that the body and the points gave the same blobs."""
        both = (fitted != NO_MARKER) & (pointed != NO_MARKER)
        self.same += int((both & (fitted == pointed)).sum())
        self.different += int((both & (fitted != pointed)).sum())
        self.only_fit += int(((fitted != NO_MARKER) & ~both).sum())
        self.only_points += int(((pointed != NO_MARKER) & ~both).sum())

    def as_dict(self) -> dict[str, int]:
        """The counts as a report has them."""
        return {field.name: getattr(self, field.name) for field in fields(self)}


def label_by_both(
    chunks: Iterable[Blobs],
    fitted: Iterator[LabelledChunk],
    pointed: Iterator[LabelledChunk],
    markers: tuple[str, ...],
    agreement: MethodAgreement,
) -> Iterator[LabelledChunk]:
    """One `LabelledChunk` for each of `chunks` from what the two methods say of it; `agreement` is added to."""
    for blobs, body, points in zip(chunks, fitted, pointed, strict=True):
        agreement.add(body.labels.marker, points.labels.marker)
        doubts = _disagreements(blobs, body.labels.marker, points.labels.marker, markers)
        nobody = body.motion.confidence == 0
        labels, motion = _filled(blobs, body, points, nobody)
        found = [suspect for suspect in body.suspects if not _is_filled(suspect, blobs.frames, nobody, motion)]
        found += [suspect for suspect in points.suspects if nobody.any()]
        seconds = summed(body.seconds, points.seconds)
        suspects = tuple(sorted([*found, *doubts], key=lambda suspect: suspect.first))
        yield LabelledChunk(labels, motion, suspects, seconds, _unedited(blobs, body, points, nobody))


def _filled(blobs: Blobs, body: LabelledChunk, points: LabelledChunk, nobody: np.ndarray) -> tuple[Labels, Motion]:
    """What the body says, and in frames (F,) where it found nobody what the points say."""
    labels = body.labels.replaced(nobody[blobs.frame], points.labels)
    values = {}
    for field in fields(Motion):
        ours, theirs = getattr(body.motion, field.name), getattr(points.motion, field.name)
        values[field.name] = np.where(nobody.reshape(-1, *[1] * (ours.ndim - 1)), theirs, ours)
    return labels, Motion(**values)


def _unedited(blobs: Blobs, body: LabelledChunk, points: LabelledChunk, nobody: np.ndarray) -> Labels | None:
    """The same of what was said without edits, where there are some."""
    if body.unedited is None and points.unedited is None:
        return None
    ours, theirs = (chunk.labels if chunk.unedited is None else chunk.unedited for chunk in (body, points))
    return ours.replaced(nobody[blobs.frame], theirs)


def _is_filled(suspect: Suspect, frames: np.ndarray, nobody: np.ndarray, motion: Motion) -> bool:
    """Whether a suspect tells only of frames in which nobody was found and somebody now is."""
    here = (frames >= suspect.first) & (frames <= suspect.last)
    return bool(here.any() and (nobody[here] & (motion.confidence[here] > 0)).all())


def _disagreements(blobs: Blobs, fitted: np.ndarray, pointed: np.ndarray, markers: tuple[str, ...]) -> list[Suspect]:
    """Ranges of frames in which the two methods gave a blob different names, by the names."""
    rows = np.flatnonzero((fitted != NO_MARKER) & (pointed != NO_MARKER) & (fitted != pointed))
    cases, count = np.unique(np.stack([fitted[rows], pointed[rows], blobs.frame[rows]]), axis=1, return_counts=True)
    cases = cases[:, count >= DISAGREEMENT.min_cameras]
    found = []
    for one, two in np.unique(cases[:2], axis=1).T.tolist():
        here = np.isin(np.arange(len(blobs.frames)), cases[2, (cases[0] == one) & (cases[1] == two)])
        words = f"{markers[one]} by the fitted body is {markers[two]} by the points in space"
        found += suspect_ranges(blobs.frames, here, words, DISAGREEMENT.max_break_frames)
    return found
