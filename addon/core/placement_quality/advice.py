# SPDX-License-Identifier: GPL-3.0-or-later
"""What would make a marker set less ambiguous: for its worst pairs, one marker to move on its segment, or to add.

Left and right are never moved alike, as laboratories do with their thigh markers: what is not the same on both sides
distinguishes the sides.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..data.markersets import MarkerSet
from .judging import Ambiguity, judge, separation
from .layout import MarkerLayout
from .surface import all_over, nearby

MOVE, ADD = "move", "add"
ADDED_NAME = "NEW"  # of a marker that is added, with a number
AXIS_WORDS = (("forward", "back"), ("to the left", "to the right"), ("up", "down"))


@dataclass(frozen=True)
class AdviceOptions:
    """What is looked for, and where.

    goal         standard deviations by which every pair of markers should be separate; physical: at 4 one is taken for
                 the other in 2.3 % of all cases
    steps        changes that are advised; format: `quality --advice`
    stride_m     between places that are tried; physical: as exactly as markers are put on
    max_move_m   and the farthest of them; physical: farther is another place on the body
    noticed      standard deviations of a separation that count; physical: at 4 they change how often by a ninth
    """

    goal: float = 4.0
    steps: int = 3
    stride_m: float = 0.01
    max_move_m: float = 0.06
    noticed: float = 0.1


ADVICE = AdviceOptions()


@dataclass(frozen=True, eq=False)
class Advice:
    """One change of a marker set.

    kind     MOVE or ADD
    marker   the marker to move, or a name for the one to add
    segment  index of the segment that carries it
    old, new (3,) heights, in the segment's axes; `old` is the anchor's
    anchor   the marker that `old` is the place of
    pair     the two markers that it is for
    before, after  the pair's separation, standard deviations, when earlier advice has been taken
    """

    kind: str
    marker: str
    segment: int
    old: np.ndarray
    new: np.ndarray
    anchor: str
    pair: tuple[str, str]
    before: float
    after: float

    def shift(self, markerset: MarkerSet) -> np.ndarray:
        """(3,) m from the old to the new place on a mean person: forward, left and up of the body at rest."""
        return (self.new - self.old) * markerset.spread.height

    def in_words(self, markerset: MarkerSet) -> str:
        """What to do, as half a sentence: the direction as the mean person stands at rest."""
        shift = self.shift(markerset)
        parts = [
            f"{1000 * abs(part):.0f} mm {words[int(part < 0)]}"
            for part, words in zip(shift, AXIS_WORDS, strict=True)
            if round(1000 * abs(part)) > 0
        ]
        segment, direction = markerset.skeleton.segments[self.segment], ", ".join(parts)
        if self.kind == MOVE:
            return f"move {self.marker} on {segment} by {1000 * np.linalg.norm(shift):.0f} mm: {direction}"
        return f"add a marker on {segment}, from {self.anchor} {direction}"


@dataclass(frozen=True, eq=False)
class _Try:
    """A marker set with one change, and what became of it."""

    kind: str
    marker: int
    layout: MarkerLayout
    found: Ambiguity

    def separation_of(self, pair: tuple[int, int]) -> float:
        """The pair's separation; no more than the added marker's own, for it is no use if it is ambiguous itself."""
        overlap = self.found.hidden[pair]
        if self.kind == ADD:
            overlap = max(overlap, self.found.hidden[self.marker].max())
        return float(separation(overlap))


def advise(
    layout: MarkerLayout, goal: float = ADVICE.goal, steps: int = ADVICE.steps, keep: Sequence[str] = ()
) -> Iterator[tuple[Advice, MarkerLayout]]:
    """Up to `steps` changes, each on top of those before it, and the set with it; ends when all pairs reach `goal`.

    Markers that `keep` names stay where they are: those on bones that something else is measured by.
    """
    tried: set[tuple[str, str]] = set()
    for _ in range(steps):
        found = _next(layout, goal, set(keep), tried)
        if found is None:
            return
        yield found
        layout = found[1]


def _next(
    layout: MarkerLayout, goal: float, keep: set[str], tried: set[tuple[str, str]]
) -> tuple[Advice, MarkerLayout] | None:
    """What to do about the worst pair for which something can be done; `tried` are those that had their turn."""
    now = judge(layout)
    for pair in now.worst():
        names = now.markers[pair[0]], now.markers[pair[1]]
        if separation(now.hidden[pair]) >= goal:
            return None
        if names in tried:
            continue
        tried.add(names)
        found = _Search(layout, now, pair, keep).best(goal)
        if found is not None:
            return _as_advice(layout, now, found, pair), found.layout
    return None


class _Search:
    """All that can be done about one pair of a set."""

    def __init__(self, layout: MarkerLayout, now: Ambiguity, pair: tuple[int, int], keep: set[str]):
        self.layout, self.now, self.pair = layout, now, pair
        self.free = [marker for marker in pair if now.markers[marker] not in keep]

    def best(self, goal: float) -> _Try | None:
        """The nearest place that reaches the goal, else the change that does most."""
        moves = [found for marker in self.free for found in self._moves(marker) if not self._spoils(found, goal)]
        enough = [found for found in moves if found.separation_of(self.pair) >= goal]
        if enough:
            return min(enough, key=lambda found: (round(self._length(found), 4), found.found.total))
        best = max([*moves, *self._additions()], key=lambda found: found.separation_of(self.pair), default=None)
        before = separation(self.now.hidden[self.pair])
        return best if best is not None and best.separation_of(self.pair) >= before + ADVICE.noticed else None

    def _spoils(self, found: _Try, goal: float) -> bool:
        """Whether a change mends the pair at the cost of another that then is short of the goal, or of the whole."""
        before, after = separation(self.now.hidden), separation(found.found.hidden)
        worse = after < np.minimum(before, goal) - ADVICE.noticed
        worse[self.pair] = worse[self.pair[::-1]] = False
        return bool(worse.any()) or found.found.total >= self.now.total

    def _moves(self, marker: int) -> Iterator[_Try]:
        """A marker in all directions and at all distances along its segment's surface."""
        old, stride = self.layout.markerset, ADVICE.stride_m
        for distance in np.arange(stride, ADVICE.max_move_m + stride / 2, stride) / old.spread.height:
            for place in nearby(old, marker, distance):
                changed = self.layout.moved(marker, place)
                yield _Try(MOVE, marker, changed, judge(changed, self.now.whole))

    def _additions(self) -> Iterator[_Try]:
        """One more marker anywhere on the segments of the pair."""
        markerset = self.layout.markerset
        name = next(f"{ADDED_NAME}{n}" for n in range(1, 1000) if f"{ADDED_NAME}{n}" not in markerset.markers)
        whole = [renaming.widened() for renaming in self.now.whole]
        for segment in sorted({int(markerset.attachment[marker]) for marker in self.pair}):
            for place in all_over(markerset, segment):
                wider = self.layout.added(name, segment, place)
                yield _Try(ADD, len(markerset), wider, judge(wider, whole))

    def _length(self, found: _Try) -> float:
        before, after = (layout.markerset.offsets[found.marker] for layout in (self.layout, found.layout))
        return float(np.linalg.norm(after - before))


def _as_advice(layout: MarkerLayout, now: Ambiguity, found: _Try, pair: tuple[int, int]) -> Advice:
    markerset = found.layout.markerset
    segment, new = int(markerset.attachment[found.marker]), markerset.offsets[found.marker]
    anchor = found.marker if found.kind == MOVE else layout.anchor(segment, new)
    return Advice(
        found.kind,
        markerset.markers[found.marker],
        segment,
        layout.markerset.offsets[anchor],
        new,
        layout.markerset.markers[anchor],
        (now.markers[pair[0]], now.markers[pair[1]]),
        float(separation(now.hidden[pair])),
        found.separation_of(pair),
    )
