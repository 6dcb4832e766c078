# SPDX-License-Identifier: GPL-3.0-or-later
"""What edits of blobs say of the points that these make: then a naming by points hears of them."""

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from ..data.markersets import Worn
from ..data.takes import NO_POINT, Blobs
from .applying import BlobCells, blobs_of
from .kinds import AssignBlob, AssignPoint, BlobEdit, Edit, Edits, Swap, UnlabelMarker, frames_of

Key = tuple[int, int]  # a trajectory, and the source's number of a frame


class NamedThroughBlobs:
    """Which points a person named by naming a blob of theirs, chunk by chunk.

    Edits are heard in their order, so what is said of a point, or of a marker, last holds. Only names are passed on:
    that a blob is not what it is called says nothing of the point, which others may make as well; but a name that was
    given through that blob alone is gone with it, also where another blob of its image, which may make no point, has
    the name then. Markers that are not of `worn` are nobody's.
    """

    def __init__(self, edits: Edits, cameras: tuple[str, ...], worn: Worn):
        self.cameras, self.worn = cameras, worn
        self.edits = [edit for edit in edits if isinstance(edit, BlobEdit | Swap | UnlabelMarker)]
        self.named: dict[Key, int] = {}

    def add(self, blobs: Blobs, rows: np.ndarray, trajectory: np.ndarray):
        """Hears of a chunk, whose points are made of the blobs `rows` (Q, C), -1 where a camera has none of them.

        trajectory (Q,) is the one of each.
        """
        first, last = int(blobs.frames[0]), int(blobs.frames[-1])
        edits = [edit for edit in self.edits if _touches(edit, first, last)]
        if not any(isinstance(edit, AssignBlob) for edit in edits):
            return
        own = np.full(len(blobs), NO_POINT)
        point, camera = np.nonzero(rows >= 0)
        own[rows[point, camera]] = trajectory[point]
        cells = BlobCells.of(blobs, self.cameras, self.worn)
        heard = _Heard(self.worn.by_name)
        for edit in edits:
            if isinstance(edit, BlobEdit):
                found = blobs_of(edit, cells)[0]
                numbers = blobs.frames[blobs.frame[found]]
                for key in zip(own[found].tolist(), numbers.tolist(), strict=True):
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
        """Hears of a blob in a camera, which a point is made of, or none."""
        trajectory, frame = key
        marker = self.names.get(edit.marker) if isinstance(edit, AssignBlob) else None
        if marker is None:
            self._give_up(key, edit.camera)
        elif trajectory != NO_POINT:
            same = self.cameras.get(key, set()) if self.named.get(key) == marker else set()
            self._name(key, marker, same | {edit.camera})
        else:
            # An image has a marker once, so the blob that had it has not; in other images this may be its marker, too.
            self._give_up((self.points.get((marker, frame), NO_POINT), frame), edit.camera)

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

    def _give_up(self, key: Key, camera: str):
        """A point's name is not borne out by its blob in a camera, where it was."""
        if camera in self.cameras.get(key, ()):
            marker, others = self.named[key], self.cameras[key] - {camera}
            self._forget(key)
            if others:
                self._name(key, marker, others)

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
