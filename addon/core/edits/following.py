# SPDX-License-Identifier: GPL-3.0-or-later
"""The labels of a take of points while a person corrects them: what no changed edit is about is not worked out again.

The take is cut into blocks of frames, as no frame has to do with another. In a block, edits that share a marker or a
trajectory make a group. What a group says depends on its own edits alone, so it is kept until one of these changes; and
it needs a table of its own frames, trajectories and markers, where the take has tens of thousands and many hundred.
What comes of it is what `applying.apply_to_points` makes of all edits at once.
"""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from ..data.takes import NO_MARKER, NO_POINT, EditOutcome, Labels, PointRows
from .applying import OF_POINTS, AppliedEdits, PointCells, apply_to_points, both
from .kinds import Edit, Edits, frames_of, markers_of
from .replay import FREE


@dataclass(frozen=True)
class FollowingOptions:
    """How a take is cut.

    block_frames  of each block: one more edit of a few frames looks at one or two blocks again, one of the whole take
                  at all. Behind 100 edits of 20,000 frames of 62 markers the two take 20 and 63 ms with 1000 frames,
                  22 and 58 with 2000, 44 and 75 with 4000, 266 and 302 uncut (of a processor)
    """

    block_frames: int = 2000


FOLLOWING = FollowingOptions()


@dataclass(frozen=True, eq=False)
class Group:
    """What edits that go together make of T frames of a take.

    frames    which frames, by their index
    markers   (K,) the markers that they are about
    right     (T, K) True where these were looked at
    xyz       (T, K, 3) m where they are; NaN where nothing is
    residual  (T, K) m, of their points; 0 where a person placed one
    rows      (N,) rows of the take of which the edits say something, or whose labels change, and
    labels    (N,) these
    said      (N,) True where the edits say something
    places    markers that a person placed, by frame index and marker, (3,) m
    outcomes  what became of each edit
    """

    frames: slice
    markers: np.ndarray
    right: np.ndarray
    xyz: np.ndarray
    residual: np.ndarray
    rows: np.ndarray
    labels: Labels
    said: np.ndarray
    places: Mapping[tuple[int, int], np.ndarray]
    outcomes: tuple[EditOutcome, ...]


@dataclass(frozen=True, eq=False)
class FollowedEdits:
    """A take of N points in T frames as its edits have it.

    labels    of the points (N,)
    groups    what says so
    said      (N,) True where the edits say something of a point
    right     (T, M) True where a marker was looked at
    outcomes  of each edit
    """

    labels: Labels
    groups: tuple[Group, ...]
    said: np.ndarray
    right: np.ndarray
    outcomes: tuple[EditOutcome, ...]

    @property
    def places(self) -> dict[tuple[int, int], np.ndarray]:
        """The markers that a person placed, by frame index and marker, (3,) m."""
        return {key: xyz for group in self.groups for key, xyz in group.places.items()}


class Following:
    """A take of points with the labels that the program gave, ready to be edited again and again."""

    def __init__(self, rows: PointRows, labels: Labels, names: Mapping[str, int], count: int):
        """Names are the indices of the `count` markers, aliases too."""
        # Narrow columns, as each edit makes new ones of the whole take.
        narrow = Labels(labels.marker.astype(np.int32), labels.step.astype(np.int8), labels.confidence)
        self.rows, self.labels, self.names, self.count = rows, narrow, names, count
        named = np.flatnonzero(labels.named)
        self._row_of = np.full((len(rows.frames), count), NO_POINT, np.int32)
        self._row_of[rows.frame[named], labels.marker[named]] = named
        self._own: dict[int, np.ndarray] = {}
        self._names: dict[int, list[int]] = {}
        self._groups: dict[tuple[int, tuple[Edit, ...]], Group] = {}
        self._reach: dict[Edit, tuple[set[tuple[str, int]], slice]] = {}

    def rows_of(self, point: int) -> np.ndarray:
        """(K,) the rows of a trajectory, in the order of the frames."""
        if point not in self._own:
            self._own[point] = np.flatnonzero(self.rows.trajectory == point)
        return self._own[point]

    def apply(self, edits: Edits) -> FollowedEdits:
        """The take with the edits applied in their order; groups that the last call had are not worked out again."""
        outcomes: list[EditOutcome | None] = [None] * len(edits)
        known, self._groups = self._groups, {}
        for block, part in self._parted(edits):
            key = block.start, tuple(edits[index] for index in part)
            group = self._groups[key] = known.get(key) or self._group(key[1], block)
            for index, outcome in zip(part, group.outcomes, strict=True):
                before = outcomes[index]
                outcomes[index] = outcome if before is None else both(before, outcome)
        marker, step, confidence = (
            column.copy() for column in (self.labels.marker, self.labels.step, self.labels.confidence)
        )
        said = np.zeros(len(marker), bool)
        right = np.zeros((len(self.rows.frames), self.count), bool)
        for group in self._groups.values():
            marker[group.rows], step[group.rows] = group.labels.marker, group.labels.step
            confidence[group.rows], said[group.rows] = group.labels.confidence, group.said
            right[group.frames, group.markers] = group.right
        labels = Labels(marker, step, confidence)
        return FollowedEdits(labels, tuple(self._groups.values()), said, right, tuple(outcomes))

    def _parted(self, edits: Edits) -> Iterator[tuple[slice, list[int]]]:
        """Blocks of frames, each with edits, by their index, that share a marker or a trajectory in it."""
        known, self._reach = self._reach, {}
        for edit in edits:
            self._reach[edit] = known.get(edit) or (self._about(edit), self._span(edit))
        about = [(*self._reach[edit], index) for index, edit in enumerate(edits)]
        size = FOLLOWING.block_frames
        for start in range(0, len(self.rows.frames), size):
            groups: list[tuple[set, list[int]]] = []
            for own, span, index in about:
                if span.start < start + size and start < span.stop:
                    meets = [group for group in groups if not group[0].isdisjoint(own)]
                    groups = [group for group in groups if group[0].isdisjoint(own)]
                    parts = sorted(number for _, parts in meets for number in parts)
                    groups.append((own.union(*(one for one, _ in meets)), [*parts, index]))
            block = slice(start, min(start + size, len(self.rows.frames)))
            yield from ((block, parts) for _, parts in groups)

    def _about(self, edit: Edit) -> set[tuple[str, int]]:
        """The markers and the trajectory that an edit may change, with the markers that the program calls this."""
        about = {("marker", self.names[name]) for name in markers_of(edit)}
        if isinstance(edit, OF_POINTS):
            about |= {("point", edit.point)} | {("marker", marker) for marker in self._names_of(edit.point)}
        return about

    def _span(self, edit: Edit) -> slice:
        """The frames, by their index, that an edit may change; some of the take even where it changes none."""
        first, count = int(self.rows.frames[0]), len(self.rows.frames)
        begin, last = frames_of(edit) or (first, first + count - 1)
        begin, end = max(begin - first, 0), min(last - first + 1, count)
        if begin >= end:
            return slice(0, 1)
        if isinstance(edit, OF_POINTS) and len(rows := self.rows_of(edit.point)):
            own = self.rows.frame[rows[[0, -1]]]
            if max(begin, own[0]) < min(end, own[1] + 1):
                return slice(int(max(begin, own[0])), int(min(end, own[1] + 1)))
        return slice(begin, end)

    def _names_of(self, point: int) -> list[int]:
        """The markers that the program calls a trajectory."""
        if point not in self._names:
            named = self.labels.marker[self.rows_of(point)]
            self._names[point] = np.flatnonzero(np.bincount(named + 1)[1:]).tolist()
        return self._names[point]

    def _group(self, edits: Sequence[Edit], block: slice) -> Group:
        """What edits make of a block of frames that nothing else is about."""
        about, spans = set().union(*map(self._about, edits)), [self._span(edit) for edit in edits]
        begin, end = min(span.start for span in spans), max(span.stop for span in spans)
        frames = slice(max(begin, block.start), min(end, block.stop))
        markers = np.array(sorted(number for kind, number in about if kind == "marker"), int)
        points = sorted(number for kind, number in about if kind == "point")
        table = self._table(frames, points, markers)
        cells = self._cells(table, frames, points, markers)
        labels = self._labels_in(table, markers)
        return self._result(frames, table, markers, labels, apply_to_points(labels, Edits(tuple(edits)), cells))

    def _table(self, frames: slice, points: list[int], markers: np.ndarray) -> np.ndarray:
        """(T, P + K) the row of each of P trajectories, and of whatever else the program calls each of K markers."""
        own = np.full((frames.stop - frames.start, len(points)), NO_POINT, np.int32)
        for column, point in enumerate(points):
            rows = self.rows_of(point)
            rows = rows[slice(*np.searchsorted(self.rows.frame[rows], [frames.start, frames.stop]).tolist())]
            own[self.rows.frame[rows] - frames.start, column] = rows
        others = self._row_of[frames, markers]
        there = others >= 0
        listed = np.zeros(others.shape, bool)
        listed[there] = np.isin(self.rows.trajectory[others[there]], points)
        return np.concatenate([own, np.where(listed, NO_POINT, others)], axis=1)

    def _labels_in(self, table: np.ndarray, markers: np.ndarray) -> Labels:
        """The program's labels of a table of rows, with the markers called by their place in `markers`."""
        there = table >= 0
        local = np.full(self.count + 1, NO_MARKER)
        local[markers] = np.arange(len(markers))
        rows = table[there]
        own = Labels(local[self.labels.marker[rows]], self.labels.step[rows], self.labels.confidence[rows])
        return own.spread(np.nonzero(there), *table.shape)

    def _cells(self, table: np.ndarray, frames: slice, points: list[int], markers: np.ndarray) -> PointCells:
        """What the edits of a table of rows go by; columns that are no trajectory have numbers that none has."""
        local = {marker: place for place, marker in enumerate(markers.tolist())}
        names = {name: local[marker] for name, marker in self.names.items() if marker in local}
        columns = np.concatenate([np.array(points, int), -2 - np.arange(len(markers))])
        return PointCells(names, len(markers), int(self.rows.frames[frames.start]), table >= 0, columns)

    def _result(
        self, frames: slice, table: np.ndarray, markers: np.ndarray, before: Labels, applied: AppliedEdits
    ) -> Group:
        after, edited = applied.labels, applied.edited
        said = edited.rule != FREE
        differs = said | (after.marker != before.marker) | (after.step != before.step)
        chosen = (differs | (after.confidence != before.confidence)) & (table >= 0)
        rows = table[chosen]
        kept = after[chosen]
        names = np.append(markers, NO_MARKER)  # NO_MARKER is -1, the last of them
        xyz = np.full((*edited.right.shape, 3), np.nan)
        residual = np.full(edited.right.shape, np.nan)
        frame, column = np.nonzero(after.named)
        at, of = (frame, after.marker[frame, column]), table[frame, column]
        xyz[at] = self.rows.xyz[of]
        if self.rows.residual is not None:
            residual[at] = self.rows.residual[of]
        for place, where in applied.places.items():
            xyz[place], residual[place] = where, 0.0
        places = {
            (frames.start + place, int(markers[marker])): where for (place, marker), where in applied.places.items()
        }
        labels = Labels(names[kept.marker], kept.step, kept.confidence)
        return Group(frames, markers, edited.right, xyz, residual, rows, labels, said[chosen], places, applied.outcomes)


def changed_frames(before: Iterable[Group], after: Iterable[Group]) -> dict[int, slice]:
    """The markers that groups are about which are not among both, with the frames, by their index, that these have."""
    before, after = list(before), list(after)
    kept = {id(group) for group in before} & {id(group) for group in after}
    spans: dict[int, slice] = {}
    for group in (group for group in (*before, *after) if id(group) not in kept):
        for marker in group.markers.tolist():
            own = spans.get(marker, group.frames)
            spans[marker] = slice(min(own.start, group.frames.start), max(own.stop, group.frames.stop))
    return spans
