# SPDX-License-Identifier: GPL-3.0-or-later
"""What edits of blobs say of the points that these make, for a naming by points."""

import numpy as np

from ..data.markersets import Worn
from ..data.takes import NO_POINT, Blobs, Labels
from .applying import apply_edit, cells_of_blobs
from .kinds import AssignBlob, AssignPoint, Edits


class NamedThroughBlobs:
    """Which points a person named by naming a blob of theirs, chunk by chunk; markers not of `worn` are nobody's."""

    def __init__(self, edits: Edits, cameras: tuple[str, ...], worn: Worn):
        self.edits, self.cameras, self.worn = edits, cameras, worn
        others = {name for edit in edits for name in edit.names} - set(worn.by_name)
        self.names = {**worn.by_name, **{name: len(worn) + index for index, name in enumerate(sorted(others))}}
        self.count = len(worn) + len(others)
        self.named: dict[tuple[int, int], int] = {}  # by trajectory, and the source's number of a frame

    def add(self, blobs: Blobs, rows: np.ndarray, trajectory: np.ndarray):
        """Looks at a chunk, whose points are made of the blobs `rows` (Q, C), -1 where a camera has none of them.

        trajectory (Q,) is the one of each.
        """
        for point, marker in self._named_in(blobs, rows).items():
            frame = blobs.frame[rows[point].max()]
            if marker < len(self.worn):
                self.named[int(trajectory[point]), int(blobs.frames[frame])] = marker

    def _named_in(self, blobs: Blobs, rows: np.ndarray) -> dict[int, int]:
        """The marker of each of the Q points of a chunk that a person named.

        What is said last of a point, or of a marker in a frame, is meant. That a blob is not what it is called says
        nothing of its point, which other cameras may name, too.
        """
        spans = [edit.span for edit in self.edits if isinstance(edit, AssignBlob)]
        if not any(first <= blobs.frames[-1] and last >= blobs.frames[0] for first, last in spans):
            return {}
        cells = cells_of_blobs(blobs, self.cameras, self.names, self.count)
        replay = cells.replay(Labels.none(len(blobs)))
        when = np.full(len(blobs), -1)
        for number, edit in enumerate(self.edits):
            before = replay.rule.copy()
            apply_edit(replay, edit, cells)
            when[replay.rule != before] = number
        point_of = np.full(len(blobs), NO_POINT)
        point, camera = np.nonzero(rows >= 0)
        point_of[rows[point, camera]] = point
        rule = replay.rule
        named = np.flatnonzero((rule >= 0) & (rule < self.count) & (point_of != NO_POINT))
        markers: dict[int, int] = {}
        points: dict[tuple[int, int], int] = {}
        for blob in named[np.argsort(when[named], kind="stable")].tolist():
            frame, marker, of = int(blobs.frame[blob]), int(rule[blob]), int(point_of[blob])
            if of in markers:
                points.pop((frame, markers[of]), None)
            markers.pop(points.get((frame, marker), NO_POINT), None)
            markers[of], points[frame, marker] = marker, of
        return markers

    def edits_of(self, place: np.ndarray) -> Edits:
        """The same as edits of points, where each trajectory (N,) has a place among those of the take, -1 for none."""
        found: list[tuple[int, str, int, int]] = []
        for (trajectory, frame), index in sorted(self.named.items()):
            point, marker = int(place[trajectory]), self.worn.markers[index]
            if point < 0:
                continue
            if found and (found[-1][:2], found[-1][3]) == ((point, marker), frame - 1):
                found[-1] = (point, marker, found[-1][2], frame)
            else:
                found.append((point, marker, frame, frame))
        return Edits(tuple(AssignPoint(point, marker, frames=(first, last)) for point, marker, first, last in found))
