# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person said of a take: kept with it as text, and the take as it follows from that.

The file keeps the program's own labels and the edits, never what comes of the two: so undo, save and another version
of the extension need to know of nothing else.
"""

import json
from dataclasses import replace

import bpy
import numpy as np

from ..core.data.made import Copies
from ..core.data.takes import Labels, PointRows
from ..core.edits.applying import cells_of_blobs, cells_of_points
from ..core.edits.blob_tracks import BlobTracks
from ..core.edits.following import Following, Held, changed_frames
from ..core.edits.kinds import Edits
from ..core.edits.rows import document_of, edits_of
from ..core.geometry.measuring import measured_points
from ..core.review.answering import unanswered, without_accepted
from .stored import Stored

FOLLOWING_LABELS = ("markers", "residual", "residual_px")  # what of a motion follows the labels


EDITS = "mocap_edits"


def text_of(edits: Edits) -> str:
    """The edits as the text that the file keeps."""
    return json.dumps(document_of(edits), ensure_ascii=False)


def keep_edits(collection: bpy.types.Collection, edits: Edits):
    """Keeps the edits with the take that `collection` holds."""
    collection[EDITS] = text_of(edits)


def kept_text(collection: bpy.types.Collection) -> str | None:
    """The text of a take's edits; None where nobody ever said anything of it, which an empty list is not."""
    text = collection.get(EDITS)
    return None if text is None else str(text)


def kept_edits(collection: bpy.types.Collection) -> Edits | None:
    """The edits of a take; None where nobody ever said anything of it.

    Raises InputError where the text is none of ours.
    """
    text = kept_text(collection)
    return None if text is None else edits_of(json.loads(text))


class Correcting:
    """What works the edits of a take out, each from what the last ones made of it."""

    def __init__(self, stored: Stored):
        """Stored has the labels that the program gave."""
        rows, names = stored.rows, (stored.words, len(stored.names))
        self.tracks: BlobTracks | None = None
        if isinstance(rows, PointRows):
            cells = cells_of_points(rows, *names)
        else:
            cells = cells_of_blobs(rows, stored.cameras.names, *names)
            self.tracks = BlobTracks(rows, stored.cameras.names)
        self._following = Following(stored.labels, cells)
        self._held: Held | None = None
        # Marker by marker: the scene's motions lie so in memory.
        of_marker = (getattr(stored.motion, name).swapaxes(0, 1) for name in FOLLOWING_LABELS)
        self._copies = Copies(*(np.array(values, order="C") for values in of_marker))

    def apply(self, stored: Stored, edits: Edits) -> Stored:
        """The take with its edits applied; stored is as it was first given."""
        followed = self._following.apply(edits if self.tracks is None else self.tracks.followed(edits))
        held = followed.held
        self._move(stored, followed.labels, held)
        of_frame = (values.swapaxes(0, 1) for values in self._copies.copy())
        return replace(
            stored,
            labels=followed.labels,
            motion=replace(stored.motion, **dict(zip(FOLLOWING_LABELS, of_frame, strict=True))),
            suspects=without_accepted(unanswered(stored.suspects, edits, stored.words), edits),
            edits=edits,
            outcomes=followed.outcomes,
            placed=tuple(held.places),
            held=held,
        )

    def _move(self, stored: Stored, labels: Labels, held: Held):
        """Puts the markers that are elsewhere than after the last edits where they are."""
        moved = changed_frames(self._held, held, by_hand=False)
        if moved:
            put = self._put_points if isinstance(stored.rows, PointRows) else self._put_blobs
            put(stored, labels, held, moved)
        for (frame, marker), place in held.places.items():
            for values, value in zip(self._copies.arrays, (place, 0.0, np.nan), strict=True):
                values[marker, frame] = value
        for which in range(len(FOLLOWING_LABELS)):
            for at in moved.items():
                self._copies.note(which, at)
        self._held = held

    def _put_points(self, stored: Stored, _labels: Labels, held: Held, moved: dict[int, slice]):
        """Puts markers where their points are."""
        rows, (xyz, off, _) = stored.rows, self._copies.arrays
        known = rows.residual is not None and len(rows)
        for marker, frames in moved.items():
            of = held.cells[marker, frames]
            there = of >= 0
            xyz[marker, frames] = np.where(there[:, None], rows.xyz[of], np.nan) if len(rows) else np.nan
            off[marker, frames] = np.where(there, rows.residual[of], np.nan) if known else np.nan

    def _put_blobs(self, stored: Stored, labels: Labels, held: Held, moved: dict[int, slice]):
        """Puts markers where their blobs meet, and where these are the program's, where that had them."""
        span = slice(min(frames.start for frames in moved.values()), max(frames.stop for frames in moved.values()))
        rows = slice(*np.searchsorted(stored.rows.frame, [span.start, span.stop]).tolist())
        again = np.zeros((span.stop - span.start, len(held.cells)), bool)
        for marker, frames in moved.items():
            again[frames.start - span.start : frames.stop - span.start, marker] = True
        images = slice(span.start * held.images, span.stop * held.images)
        others = held.cells[:, images] != held.program[:, images]
        others = others.reshape(len(others), -1, held.images).any(axis=2).T
        of_frame = [values.swapaxes(0, 1)[span] for values in self._copies.arrays]
        for name, own in zip(FOLLOWING_LABELS, of_frame, strict=True):
            own[again] = getattr(stored.motion, name)[span][again]
        if (again & others).any():
            found = measured_points(stored.rows.part(span, rows), labels[rows], stored.cameras, again & others)
            for own, measured in zip(of_frame, found, strict=True):
                own[again & others] = measured
