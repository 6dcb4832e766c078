# SPDX-License-Identifier: GPL-3.0-or-later
"""What edits of blobs say of the points that these make: then a naming by points hears of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..data.markersets import Worn
from ..data.takes import Blobs
from .applying import BlobCells, blobs_of
from .kinds import AssignBlob, AssignPoint, BlobEdit, Edit, Edits, Swap, UnlabelMarker, frames_of

Key = tuple[int, int]  # a trajectory, and the source's number of a frame


class NamedThroughBlobs:
    """Which points a person named by naming a blob of theirs, chunk by chunk.

    Edits are heard in their order, so what is said of a point, or of a marker, last holds. Only names are passed on:
    that a blob is not what it is called says nothing of the point, which others may make as well; but a name that was
    given through that blob alone is gone with it. Markers that are not of `worn` are nobody's.
    """

    def __init__(self, edits: Edits, cameras: tuple[str, ...], worn: Worn):
        self.cameras, self.worn = cameras, worn
        self.edits = [edit for edit in edits if isinstance(edit, BlobEdit | Swap | UnlabelMarker)]
        self.named: dict[Key, int] = {}

    def add(self, blobs: Blobs, rows: np.ndarray, frame: np.ndarray, trajectory: np.ndarray):
        """Hears of a chunk, whose points are made of the blobs `rows` (Q, C), -1 where a camera has none of them.

        frame (Q,) are the source's numbers of their frames, and trajectory (Q,) is the one of each.
        """
        first, last = int(blobs.frames[0]), int(blobs.frames[-1])
        edits = [edit for edit in self.edits if _touches(edit, first, last)]
        if not any(isinstance(edit, AssignBlob) for edit in edits):
            return
        point_of = np.full(len(blobs), -1)
        point, camera = np.nonzero(rows >= 0)
        point_of[rows[point, camera]] = point
        cells = BlobCells.of(blobs, self.cameras, self.worn)
        heard = _Heard(self.worn.by_name)
        for edit in edits:
            if isinstance(edit, BlobEdit):
                points = point_of[blobs_of(edit, cells)[0]]
                points = points[points >= 0]
                for key in zip(trajectory[points].tolist(), frame[points].tolist(), strict=True):
                    heard.of_blob(edit, key)
            else:
                heard.of_marker(edit)
        self.named |= heard.named

    def edits_of(self, place: np.ndarray) -> Edits:
        """The same as edits of points, where each trajectory (N,) has a place among those of the take, -1 for none."""
        found: list[AssignPoint] = []
        for (trajectory, frame), index in sorted(self.named.items()):
            point, marker = int(place[trajectory]), self.worn.markers[index]
            last = found[-1] if found else None
            if point < 0:
                continue
            if last and (last.point, last.marker, last.frames[1]) == (point, marker, frame - 1):
                found[-1] = AssignPoint(point, marker, frames=(last.frames[0], frame))
            else:
                found.append(AssignPoint(point, marker, frames=(frame, frame)))
        return Edits(tuple(found))


@dataclass
class _Heard:
    """What is said of the points of a chunk.

    names    index of each marker by its name, aliases too
    named    the marker of each point
    points   the trajectory of each marker in a frame: one has it
    cameras  in which a point was named
    """

    names: Mapping[str, int]
    named: dict[Key, int] = field(default_factory=dict)
    points: dict[tuple[int, int], int] = field(default_factory=dict)
    cameras: dict[Key, set[str]] = field(default_factory=dict)

    def of_blob(self, edit: BlobEdit, key: Key):
        """Hears of a point's blob in a camera."""
        if isinstance(edit, AssignBlob) and edit.marker in self.names:
            marker = self.names[edit.marker]
            same = self.cameras.get(key, set()) if self.named.get(key) == marker else set()
            self._name(key, marker, same | {edit.camera})
        elif edit.camera in self.cameras.get(key, ()):
            marker, others = self.named[key], self.cameras[key] - {edit.camera}
            self._forget(key)
            if others:
                self._name(key, marker, others)

    def of_marker(self, edit: Swap | UnlabelMarker):
        """Hears of a marker's name, or of two."""
        first, last = edit.frames or (-np.inf, np.inf)
        meant = [self.names.get(name) for name in (edit.markers if isinstance(edit, Swap) else (edit.marker,))]
        found = [key for key, marker in self.named.items() if marker in meant and first <= key[1] <= last]
        before = {key: (self.named[key], self.cameras[key]) for key in found}
        for key in found:
            self._forget(key)
        if isinstance(edit, Swap):
            for key, (marker, cameras) in before.items():
                self._name(key, meant[1 - meant.index(marker)], cameras)

    def _name(self, key: Key, marker: int | None, cameras: set[str]):
        """Names a point; the one that had the name has none."""
        self._forget(key)
        if marker is None:
            return
        if (marker, key[1]) in self.points:
            self._forget((self.points[marker, key[1]], key[1]))
        self.named[key], self.cameras[key], self.points[marker, key[1]] = marker, cameras, key[0]

    def _forget(self, key: Key):
        if key in self.named:
            del self.points[self.named.pop(key), key[1]], self.cameras[key]


def _touches(edit: Edit, first: int, last: int) -> bool:
    """Whether an edit is about some frames."""
    own = frames_of(edit)
    return own is None or (own[0] <= last and own[1] >= first)
