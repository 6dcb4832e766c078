# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person said of a take of 3D points: kept with it as text, and the take as it follows from that.

The file keeps the program's own labels and the edits, never what comes of the two: so undo, save and another version
of the extension need to know of nothing else.
"""

import json
from dataclasses import fields, replace

import bpy
import numpy as np

from ..core.data.copies import Copies
from ..core.data.takes import Motion, PointRows
from ..core.edits.blob_tracks import BlobTracks
from ..core.edits.following import Following, Held, moved_frames
from ..core.edits.following_blobs import BlobFollowing, BlobGroup
from ..core.edits.kinds import Edits
from ..core.edits.rows import document_of, edits_of
from ..core.geometry.measuring import measured_at, put_places
from ..core.review.answering import unanswered, without_accepted
from .stored import Stored


class BlobCorrecting:
    """What works the edits of a take of blobs out; what no changed edit is about is not worked out again."""

    def __init__(self, stored: Stored):
        """Stored has the labels that the program gave."""
        self.following = BlobFollowing(
            stored.rows, stored.labels, stored.words, len(stored.names), stored.cameras.names
        )
        self._measured: dict[BlobGroup, Motion] = {}

    @property
    def tracks(self) -> BlobTracks:
        """The tracks of the take's blobs."""
        return self.following.tracks

    def apply(self, stored: Stored, edits: Edits) -> Stored:
        """The take with its edits applied; stored is as it was first given."""
        followed = self.following.apply(edits)
        known, self._measured = self._measured, {}
        motion = replace(
            stored.motion,
            **{name: getattr(stored.motion, name).copy() for name in ("markers", "residual", "residual_px")},
        )
        for group in followed.groups:
            part = self._measured[group] = known.get(group) or self._measure(stored, group)
            for name in ("markers", "residual", "residual_px"):
                getattr(motion, name)[group.frames][group.touched] = getattr(part, name)[group.touched]
        return replace(
            stored,
            labels=followed.labels,
            motion=motion,
            suspects=_open(stored, edits),
            edits=edits,
            outcomes=followed.outcomes,
            placed=tuple(followed.places),
        )

    def _measure(self, stored: Stored, group: BlobGroup) -> Motion:
        """The frames of a group, with the markers that it is about where their blobs meet, or were placed."""
        part = Motion(*(getattr(stored.motion, one.name)[group.frames] for one in fields(Motion)))
        if not group.touched.any():
            return part
        blobs = stored.rows.part(group.frames, group.rows)
        part = measured_at(part, blobs, group.labels, stored.cameras, group.touched)
        put_places(part, {(frame - group.frames.start, marker): xyz for (frame, marker), xyz in group.places.items()})
        return part


def _open(stored: Stored, edits: Edits) -> tuple:
    """The doubts that no edit answers."""
    return without_accepted(unanswered(stored.suspects, edits, stored.words), edits)


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


class PointCorrecting:
    """What works the edits of a take of points out, each from what the last ones made of it."""

    def __init__(self, stored: Stored):
        """Stored has the labels that the program gave."""
        self._following = Following(stored.rows, stored.labels, stored.words, len(stored.names))
        self._held: Held | None = None
        # Marker by marker: the scene's motions lie so in memory.
        of_marker = (values.swapaxes(0, 1) for values in (stored.motion.markers, stored.motion.residual))
        self._copies = Copies(*(np.array(values, order="C") for values in of_marker))

    def apply(self, stored: Stored, edits: Edits) -> Stored:
        """The take with its edits applied; stored is as it was first given."""
        followed = self._following.apply(edits)
        self._move(stored.rows, followed.held)
        xyz, off = (values.swapaxes(0, 1) for values in self._copies.copy())
        return replace(
            stored,
            labels=followed.labels,
            motion=replace(stored.motion, markers=xyz, residual=off),
            suspects=_open(stored, edits),
            edits=edits,
            outcomes=followed.outcomes,
            placed=tuple(followed.held.places),
            held=followed.held,
        )

    def _move(self, rows: PointRows, held: Held):
        """Puts the markers that are elsewhere than after the last edits where they are."""
        xyz, off = self._copies.arrays
        known = rows.residual is not None and len(rows)
        for marker, frames in moved_frames(self._held, held).items():
            of = held.rows[marker, frames]
            there = of >= 0
            xyz[marker, frames] = np.where(there[:, None], rows.xyz[of], np.nan) if len(rows) else np.nan
            off[marker, frames] = np.where(there, rows.residual[of], np.nan) if known else np.nan
            for which in (0, 1):
                self._copies.note(which, (marker, frames))
        for (frame, marker), place in held.places.items():
            xyz[marker, frame], off[marker, frame] = place, 0.0
            for which in (0, 1):
                self._copies.note(which, (marker, frame))
        self._held = held


def following_of(stored: Stored) -> PointCorrecting | BlobCorrecting:
    """What works the edits of a take out; stored has the labels that the program gave."""
    return PointCorrecting(stored) if isinstance(stored.rows, PointRows) else BlobCorrecting(stored)
