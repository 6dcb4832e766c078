# SPDX-License-Identifier: GPL-3.0-or-later
"""A chunk of blobs with what a person said of it: the edits hold in its labels, its markers in space and its doubts."""

from collections.abc import Iterable, Iterator
from dataclasses import fields, replace

import numpy as np

from ..data.markersets import MarkerSet
from ..data.takes import NO_MARKER, Blobs, LabelledChunk, Labels, Motion
from ..edits.applying import BlobCells, apply_to_blobs, names_of
from ..edits.kinds import Edits
from ..geometry.cameras import Cameras
from ..geometry.triangulation import Rays
from ..geometry.views import VIEWING, Sight, View, split_views
from ..review.answering import unanswered_of_blobs, without_accepted


def with_edits_of_blobs(
    chunks: Iterable[Blobs], labelled: Iterator[LabelledChunk], edits: Edits, cameras: Cameras, markerset: MarkerSet
) -> Iterator[LabelledChunk]:
    """The labelled chunks with the edits applied; what these mean, a chunk's `unedited` labels tell where it has some.

    A marker whose blobs are others then is where these meet, and one that was placed is there; the body stays.
    """
    sight, names = Sight(cameras), names_of(markerset)
    for blobs, chunk in zip(chunks, labelled, strict=True):
        cells = BlobCells.of(blobs, cameras.names, markerset)
        before, first = chunk.labels, None
        if chunk.unedited is not None:
            before = chunk.unedited
            first = apply_to_blobs(before, edits, cells)
            before = cells.rows(first.edited.below(cells.table(before), cells.table(chunk.labels)))
        applied = apply_to_blobs(before, edits, cells)
        motion = _measured_again(chunk, blobs, applied.labels, cameras, sight)
        for at, place in applied.places.items():
            motion.markers[at], motion.residual[at], motion.residual_px[at] = place, 0.0, np.nan
        yield replace(
            chunk,
            labels=applied.labels,
            motion=motion,
            suspects=without_accepted(unanswered_of_blobs(chunk.suspects, edits, names), edits),
            unedited=before,
            outcomes=(first or applied).outcomes,
        )


def _measured_again(chunk: LabelledChunk, blobs: Blobs, labels: Labels, cameras: Cameras, sight: Sight) -> Motion:
    """The motion of a chunk, with the markers where the blobs meet that are theirs now."""
    motion = Motion(**{one.name: getattr(chunk.motion, one.name).copy() for one in fields(Motion)})
    touched = _touched(blobs, chunk.labels, labels, motion.residual.shape)
    frames = np.flatnonzero(touched.any(axis=1))
    views = split_views(blobs, cameras) if len(frames) else []
    for frame in frames.tolist():
        marker = np.flatnonzero(touched[frame])
        slot = _slots(views[frame], labels, marker)
        met = Rays(views[frame], sight).meet(slot)
        motion.markers[frame, marker], motion.residual[frame, marker] = met.points, met.residual
        depth = np.maximum(sight.local(np.nan_to_num(met.points)[None])[0, ..., 2], VIEWING.min_depth_m)
        seen = slot >= 0
        scale = (sight.focal[:, None] / depth * seen).sum(axis=0) / np.maximum(seen.sum(axis=0), 1)
        motion.residual_px[frame, marker] = met.residual * scale
    return motion


def _touched(blobs: Blobs, before: Labels, after: Labels, shape: tuple[int, int]) -> np.ndarray:
    """(F, M) True where a marker has other blobs than before."""
    found = np.zeros(shape, bool)
    changed = np.flatnonzero(before.marker != after.marker)
    for labels in (before, after):
        named = changed[labels.marker[changed] != NO_MARKER]
        found[blobs.frame[named], labels.marker[named]] = True
    return found


def _slots(view: View, labels: Labels, markers: np.ndarray) -> np.ndarray:
    """(C, K) the blobs of a view that are some markers (K,), -1 where a camera has none."""
    own = np.where(view.real, labels.marker[view.row], NO_MARKER)
    same = own[:, None, :] == markers[None, :, None]
    return np.where(same.any(axis=2), same.argmax(axis=2), -1)
