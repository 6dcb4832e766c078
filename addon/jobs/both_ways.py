# SPDX-License-Identifier: GPL-3.0-or-later
"""Blobs named both ways at once: by a body that is fitted to them, and by the points that they make.

The two papers' methods share nothing but the blobs, so where they agree a name is surely right, and where they do not a
person should look. The fitted body has the say; where it finds nobody, the points have.
"""

from collections.abc import Iterable, Iterator
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from ..core.data.takes import NO_MARKER, STEPS, Blobs, LabelledChunk, Labels, Motion, Suspect
from . import by_points

# How the label of a blob came about, by index into `Labels.step`: the fitted body's steps, then those of the points.
ALL_STEPS = (*STEPS, *by_points.STEPS[1:])
BRIDGED = 10  # frames between two disagreements that are one
LEAST_CAMERAS = 2  # that must show one; a single blob may be two markers' at once


@dataclass
class Agreement:
    """How many blobs both ways named alike and otherwise, and how many only one of them named."""

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


def label_both_ways(
    chunks: Iterable[Blobs],
    fitted: Iterator[LabelledChunk],
    pointed: Iterator[LabelledChunk],
    markers: tuple[str, ...],
    agreement: Agreement,
) -> Iterator[LabelledChunk]:
    """One `LabelledChunk` for each of `chunks` from what the two ways say of it; `agreement` is added to."""
    for blobs, body, points in zip(chunks, fitted, pointed, strict=True):
        agreement.add(body.labels.marker, points.labels.marker)
        doubts = _disagreements(blobs, body.labels.marker, points.labels.marker, markers)
        nobody = body.motion.confidence == 0
        labels, motion = _filled(blobs, body, points, nobody)
        found = [suspect for suspect in body.suspects if not _is_filled(suspect, blobs.frames, nobody, motion)]
        found += [suspect for suspect in points.suspects if nobody.any()]
        seconds = {
            key: body.seconds.get(key, 0.0) + points.seconds.get(key, 0.0) for key in {**body.seconds, **points.seconds}
        }
        suspects = tuple(sorted([*found, *doubts], key=lambda suspect: suspect.first))
        yield LabelledChunk(labels, motion, suspects, seconds)


def _filled(blobs: Blobs, body: LabelledChunk, points: LabelledChunk, nobody: np.ndarray) -> tuple[Labels, Motion]:
    """What the body says, and in frames (F,) where it found nobody what the points say."""
    rows = nobody[blobs.frame]
    offset = np.where(points.labels.step > 0, len(STEPS) - 1, 0)
    other = Labels(points.labels.marker, points.labels.step + offset, points.labels.confidence)
    labels = Labels(*(np.where(rows, getattr(other, f.name), getattr(body.labels, f.name)) for f in fields(Labels)))
    values = {}
    for field in fields(Motion):
        ours, theirs = getattr(body.motion, field.name), getattr(points.motion, field.name)
        values[field.name] = np.where(nobody.reshape(-1, *[1] * (ours.ndim - 1)), theirs, ours)
    return labels, Motion(**values)


def _is_filled(suspect: Suspect, frames: np.ndarray, nobody: np.ndarray, motion: Motion) -> bool:
    """Whether a suspect tells only of frames in which nobody was found and somebody now is."""
    here = (frames >= suspect.first) & (frames <= suspect.last)
    return bool(here.any() and (nobody[here] & (motion.confidence[here] > 0)).all())


def _disagreements(blobs: Blobs, fitted: np.ndarray, pointed: np.ndarray, markers: tuple[str, ...]) -> list[Suspect]:
    """Ranges of frames in which the two ways gave a blob different names, by the names."""
    rows = np.flatnonzero((fitted != NO_MARKER) & (pointed != NO_MARKER) & (fitted != pointed))
    cases, count = np.unique(np.stack([fitted[rows], pointed[rows], blobs.frame[rows]]), axis=1, return_counts=True)
    cases = cases[:, count >= LEAST_CAMERAS]
    found = []
    for one, two in np.unique(cases[:2], axis=1).T.tolist():
        at = cases[2, (cases[0] == one) & (cases[1] == two)]
        edges = [0, *(np.flatnonzero(np.diff(at) > BRIDGED) + 1), len(at)]
        reason = f"{markers[one]} by the fitted body is {markers[two]} by the points in space"
        for first, after in pairwise(edges):
            found.append(Suspect(int(blobs.frames[at[first]]), int(blobs.frames[at[after - 1]]), reason))
    return found
