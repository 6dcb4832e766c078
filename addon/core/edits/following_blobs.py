# SPDX-License-Identifier: GPL-3.0-or-later
"""The labels of a take of blobs while a person corrects them: only blocks of frames whose edits changed are redone.

The counterpart of `following` for blobs. No image has to do with another, so what comes of all blocks is what
`applying.apply_to_blobs` makes of the whole take.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..data.takes import Blobs, EditOutcome, Labels, touched_samples
from .applying import BLOB_EDITING, BlobCells, apply_to_blobs, both, found_outside
from .blob_tracks import BlobTracks
from .kinds import BlobEdit, Edit, Edits


@dataclass(frozen=True)
class BlobFollowingOptions:
    """How a take is cut.

    block_frames  measured: one more edit of a frame looks at one block again, one of the whole take at all. Behind 20
                  edits of 20,000 frames of 40 blobs in each of 8 cameras one of a frame takes 0.05 s, of a track of 500
                  frames 0.14, of a marker throughout 0.5, of a track throughout 1.2 (of a processor)
    """

    block_frames: int = 500


BLOB_FOLLOWING = BlobFollowingOptions()


@dataclass(frozen=True, eq=False)
class BlobGroup:
    """What edits make of a block of frames.

    frames    which frames, by their index
    rows      which rows
    labels    (N,) of these
    touched   (T, M) True for markers that have other blobs than the program gave them, or were placed
    markers   (K,) those that are touched in some frame
    places    markers that a person placed, by frame index and marker, (3,) m
    outcomes  what became of each edit
    """

    frames: slice
    rows: slice
    labels: Labels
    touched: np.ndarray
    markers: np.ndarray
    places: Mapping[tuple[int, int], np.ndarray]
    outcomes: tuple[EditOutcome, ...]


@dataclass(frozen=True, eq=False)
class FollowedBlobs:
    """A take of N blobs as its edits have it: labels (N,), what says so, and what became of each edit."""

    labels: Labels
    groups: tuple[BlobGroup, ...]
    outcomes: tuple[EditOutcome, ...]

    @property
    def places(self) -> dict[tuple[int, int], np.ndarray]:
        """The markers that a person placed, by frame index and marker, (3,) m."""
        return {key: xyz for group in self.groups for key, xyz in group.places.items()}


class BlobFollowing:
    """A take of blobs with the labels that the program gave, ready to be edited again and again."""

    def __init__(self, blobs: Blobs, labels: Labels, names: Mapping[str, int], count: int, cameras: tuple[str, ...]):
        """Names are the indices of the `count` markers, aliases too."""
        narrow = Labels(labels.marker.astype(np.int32), labels.step.astype(np.int8), labels.confidence)
        self.blobs, self.labels, self.names, self.count, self.cameras = blobs, narrow, names, count, cameras
        self.tracks = BlobTracks(blobs, cameras, BLOB_EDITING.max_distance_px)
        self._cells: dict[int, BlobCells] = {}
        self._groups: dict[tuple[int, tuple[Edit, ...]], BlobGroup] = {}

    def apply(self, edits: Edits) -> FollowedBlobs:
        """The take with the edits applied in their order; blocks that the last call had are not worked out again."""
        edits = self.tracks.followed(edits)
        spans = [self._span(edit) for edit in edits]
        outcomes: list[EditOutcome | None] = [None] * len(edits)
        known, self._groups = self._groups, {}
        for start in range(0, len(self.blobs.frames), BLOB_FOLLOWING.block_frames):
            stop = min(start + BLOB_FOLLOWING.block_frames, len(self.blobs.frames))
            part = [index for index, span in enumerate(spans) if span.start < stop and start < span.stop]
            if not part:
                continue
            key = start, tuple(edits[index] for index in part)
            group = self._groups[key] = known.get(key) or self._group(slice(start, stop), Edits(key[1]))
            for index, outcome in zip(part, group.outcomes, strict=True):
                before = outcomes[index]
                outcomes[index] = outcome if before is None else both(before, outcome)
        whole = [found_outside(edit) if one is None else one for edit, one in zip(edits, outcomes, strict=True)]
        return FollowedBlobs(self._joined(), tuple(self._groups.values()), tuple(whole))

    def _joined(self) -> Labels:
        """The labels of all blocks."""
        whole = self.labels[np.arange(len(self.blobs))]
        for group in self._groups.values():
            whole.put(group.rows, group.labels)
        return whole

    def _span(self, edit: Edit) -> slice:
        """The frames, by their index, that an edit may change; none outside of the take."""
        first, count = int(self.blobs.frames[0]), len(self.blobs.frames)
        begin, last = edit.span or (first, first + count - 1)
        if isinstance(edit, BlobEdit) and edit.trail is not None:
            number = [edit.frame, *edit.trail[:, 0].astype(int).tolist()]
            begin, last = min(number), max(number)
        return slice(max(begin - first, 0), min(last - first + 1, count))

    def _group(self, frames: slice, edits: Edits) -> BlobGroup:
        """What edits make of a block of frames."""
        rows = slice(*np.searchsorted(self.blobs.frame, [frames.start, frames.stop]).tolist())
        cells = self._cells_of(frames, rows)
        before = self.labels[rows]
        applied = apply_to_blobs(before, edits, cells)
        touched = touched_samples(cells.blobs, before, applied.labels, (frames.stop - frames.start, self.count))
        for at in applied.places:
            touched[at] = True
        places = {(frames.start + frame, marker): xyz for (frame, marker), xyz in applied.places.items()}
        markers = np.flatnonzero(touched.any(axis=0))
        return BlobGroup(frames, rows, applied.labels, touched, markers, places, applied.outcomes)

    def _cells_of(self, frames: slice, rows: slice) -> BlobCells:
        """What the edits of a block go by, made once."""
        if frames.start not in self._cells:
            blobs = self.blobs.part(frames, rows)
            self._cells[frames.start] = BlobCells.named(blobs, self.cameras, self.names, self.count)
        return self._cells[frames.start]
