# SPDX-License-Identifier: GPL-3.0-or-later
"""What a person said of a take of blobs, and the take as it follows from that: names, markers in space, what is open.

The counterpart of `corrections` for blobs. A marker whose blobs are others is where these meet, so one that was named
in two cameras is there at once; the body follows by `reposing`.
"""

from dataclasses import fields, replace

from ..core.data.takes import Motion
from ..core.edits.blob_tracks import BlobTracks
from ..core.edits.following_blobs import BlobFollowing, BlobGroup
from ..core.edits.kinds import Edits
from ..core.geometry.measuring import measured_at, put_places
from ..core.review.answering import unanswered_of_blobs, without_accepted
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
    return without_accepted(unanswered_of_blobs(stored.suspects, edits, stored.words), edits)
