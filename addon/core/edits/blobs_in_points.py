# SPDX-License-Identifier: GPL-3.0-or-later
"""What edits of blobs say of the points that these make: then a naming by points hears of them."""

from collections.abc import Mapping

import numpy as np

from ..data.takes import Blobs
from .applying import BlobCells, blobs_of
from .kinds import AssignBlob, AssignPoint, BlobEdit, Edits, RangeEdit, Swap, UnlabelMarker

NO_NAMES: Mapping[str, int] = {}


class NamedThroughBlobs:
    """Which points a person named by naming a blob of theirs, chunk by chunk.

    Edits are heard in their order, so what is said of a point last holds. Only names are passed on: that a blob is not
    what it is called says nothing of the point, which others may make as well.
    """

    def __init__(self, edits: Edits, cameras: tuple[str, ...]):
        self.edits, self.cameras = edits, cameras
        self.named: dict[tuple[int, int], str] = {}

    def add(self, blobs: Blobs, rows: np.ndarray, frame: np.ndarray, trajectory: np.ndarray):
        """Hears of a chunk, whose points are made of the blobs `rows` (Q, C), -1 where a camera has none of them.

        frame (Q,) are the source's numbers of their frames, and trajectory (Q,) is the one of each.
        """
        own = [edit for edit in self.edits if isinstance(edit, BlobEdit | Swap | UnlabelMarker)]
        if not any(isinstance(edit, AssignBlob) for edit in own):
            return
        point_of = np.full(len(blobs), -1)
        point, camera = np.nonzero(rows >= 0)
        point_of[rows[point, camera]] = point
        cells = BlobCells.named(blobs, self.cameras, NO_NAMES, 0)
        for edit in own:
            if isinstance(edit, BlobEdit):
                points = point_of[blobs_of(edit, cells)[0]]
                points = points[points >= 0]
                for key in zip(trajectory[points].tolist(), frame[points].tolist(), strict=True):
                    self.named.pop(key, None)
                    if isinstance(edit, AssignBlob):
                        self.named[key] = edit.marker
            else:
                self._renamed(edit, int(blobs.frames[0]), int(blobs.frames[-1]))

    def _renamed(self, edit: RangeEdit, first: int, last: int):
        """Hears of a marker's name in the frames of a chunk, from first to last."""
        begin, end = edit.frames or (first, last)
        for key in [key for key in self.named if max(first, begin) <= key[1] <= min(last, end)]:
            if isinstance(edit, UnlabelMarker) and self.named[key] == edit.marker:
                del self.named[key]
            elif isinstance(edit, Swap) and self.named[key] in edit.markers:
                one, other = edit.markers
                self.named[key] = other if self.named[key] == one else one

    def edits_of(self, place: np.ndarray) -> Edits:
        """The same as edits of points, where each trajectory (N,) has a place among those of the take, -1 for none."""
        found: list[AssignPoint] = []
        for (trajectory, frame), marker in sorted(self.named.items()):
            point = int(place[trajectory])
            last = found[-1] if found else None
            if point < 0:
                continue
            if last and (last.point, last.marker, last.frames[1]) == (point, marker, frame - 1):
                found[-1] = AssignPoint(point, marker, frames=(last.frames[0], frame))
            else:
                found.append(AssignPoint(point, marker, frames=(frame, frame)))
        return Edits(tuple(found))
