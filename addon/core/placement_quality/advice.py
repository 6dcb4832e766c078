# SPDX-License-Identifier: GPL-3.0-or-later
"""What would make a marker set less ambiguous: for its worst pairs, one marker to move on its segment, or to add.

Left and right are never moved alike, as laboratories do with their thigh markers: what is not the same on both sides
tells the sides apart.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from threadpoolctl import threadpool_limits

from ..data.markersets import MarkerSet
from .judging import TRIALS, Ambiguity, judged, separation
from .layout import Worn
from .renamings import renamings
from .surface import all_over, nearby

GOAL = 4.0  # standard deviations
STEPS = 3
STRIDE, FARTHEST = 0.01, 0.06  # m between places tried, and the farthest of them
PROMISING = 2  # directions that are followed up
SMALL = 0.0025  # m; a part of a move that is smaller goes without saying
WAYS = (("forward", "back"), ("to the left", "to the right"), ("up", "down"))
WORTH = 0.25  # standard deviations of the pair's separation for which it is worth to move anything
LOSS = 0.1  # standard deviations that another pair, short of the goal, may lose
MOST_PAIRS = 12  # that are looked at
MOVE, ADD = "move", "add"
EXTRA = "NEW"


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
        """What to do, as half a sentence: the way as the mean person stands at rest."""
        shift = self.shift(markerset)
        parts = [
            f"{1000 * abs(part):.0f} mm {ways[int(part < 0)]}"
            for part, ways in zip(shift, WAYS, strict=True)
            if abs(part) >= SMALL
        ]
        segment, way = markerset.skeleton.segments[self.segment], ", ".join(parts)
        if self.kind == MOVE:
            return f"move {self.marker} on {segment} by {1000 * np.linalg.norm(shift):.0f} mm: {way}"
        return f"add a marker on {segment}, from {self.anchor} {way}"


@dataclass(frozen=True, eq=False)
class _Try:
    """A marker set with one change, and what became of it."""

    kind: str
    marker: int
    worn: Worn
    found: Ambiguity

    def apart(self, pair: tuple[int, int]) -> float:
        """The pair's separation; no more than the added marker's own, for it is no use if it is ambiguous itself."""
        overlap = self.found.hidden[pair]
        if self.kind == ADD:
            overlap = max(overlap, self.found.hidden[self.marker].max())
        return float(separation(overlap))


def advise(
    worn: Worn, goal: float = GOAL, steps: int = STEPS, keep: Sequence[str] = ()
) -> Iterator[tuple[Advice, Worn]]:
    """Up to `steps` changes, each on top of those before it, and the set with it; ends when all pairs reach `goal`.

    Markers that `keep` names stay where they are: those on bones that something else is measured by.
    """
    tried: set[tuple[str, str]] = set()
    for _ in range(steps):
        with threadpool_limits(1, user_api="blas"):
            found = _next(worn, goal, set(keep), tried)
        if found is None:
            return
        yield found
        worn = found[1]


def _next(worn: Worn, goal: float, keep: set[str], tried: set[tuple[str, str]]) -> tuple[Advice, Worn] | None:
    """What to do about the worst pair for which something can be done; `tried` are those that had their turn."""
    whole = renamings(worn.markerset, worn.shape)
    now = judged(worn, TRIALS, 0, whole)
    for pair in now.worst():
        names = now.markers[pair[0]], now.markers[pair[1]]
        if separation(now.hidden[pair]) >= goal or len(tried) >= MOST_PAIRS:
            return None
        if names in tried:
            continue
        tried.add(names)
        found = _Search(worn, now, pair, keep).best(goal)
        if found is not None:
            return _as_advice(worn, now, found, pair), found.worn
    return None


class _Search:
    """All that can be done about one pair of a worn set."""

    def __init__(self, worn: Worn, now: Ambiguity, pair: tuple[int, int], keep: set[str]):
        self.worn, self.now, self.pair = worn, now, pair
        self.free = [marker for marker in pair if now.markers[marker] not in keep]

    def best(self, goal: float) -> _Try | None:
        """The nearest place that reaches the goal, else the change that does most."""
        moves = [found for marker in self.free for found in self._moves(marker) if not self._spoils(found, goal)]
        enough = [found for found in moves if found.apart(self.pair) >= goal]
        if enough:
            return min(enough, key=lambda found: (round(self._length(found), 4), found.found.total))
        best = max([*moves, *self._additions()], key=lambda found: found.apart(self.pair), default=None)
        before = separation(self.now.hidden[self.pair])
        return best if best is not None and best.apart(self.pair) >= before + WORTH else None

    def _spoils(self, found: _Try, goal: float) -> bool:
        """Whether a change mends the pair at the cost of another that then is short of the goal, or of the whole."""
        before, after = separation(self.now.hidden), separation(found.found.hidden)
        worse = after < np.minimum(before, goal) - LOSS
        worse[self.pair] = worse[self.pair[::-1]] = False
        return bool(worse.any()) or found.found.total >= self.now.total

    def _moves(self, marker: int) -> Iterator[_Try]:
        """A marker in all directions, and then at all distances in the directions that help most."""
        old, size = self.worn.markerset.offsets[marker], self.worn.markerset.spread.height
        first = [
            self._moved(marker, place)
            for distance in (FARTHEST, FARTHEST / 2)
            for place in nearby(self.worn.markerset, marker, distance / size)
        ]
        yield from first
        for found in sorted(first, key=lambda found: -found.apart(self.pair))[:PROMISING]:
            way = found.worn.markerset.offsets[marker] - old
            for distance in np.arange(STRIDE, FARTHEST - STRIDE / 2, STRIDE) / size:
                places = nearby(self.worn.markerset, marker, distance)
                if len(places):
                    yield self._moved(marker, places[((places - old) @ way).argmax()])

    def _moved(self, marker: int, place: np.ndarray) -> _Try:
        changed = self.worn.moved(marker, place)
        return _Try(MOVE, marker, changed, judged(changed, TRIALS, 0, self.now.whole))

    def _additions(self) -> Iterator[_Try]:
        """One more marker anywhere on the segments of the pair."""
        markerset = self.worn.markerset
        name = next(f"{EXTRA}{n}" for n in range(1, 1000) if f"{EXTRA}{n}" not in markerset.markers)
        whole = [renaming.widened() for renaming in self.now.whole]
        for segment in sorted({int(markerset.attachment[marker]) for marker in self.pair}):
            for place in all_over(markerset, segment):
                wider = self.worn.added(name, segment, place)
                yield _Try(ADD, len(markerset), wider, judged(wider, TRIALS, 0, whole))

    def _length(self, found: _Try) -> float:
        return float(
            np.linalg.norm(found.worn.markerset.offsets[found.marker] - self.worn.markerset.offsets[found.marker])
        )


def _as_advice(worn: Worn, now: Ambiguity, found: _Try, pair: tuple[int, int]) -> Advice:
    markerset = found.worn.markerset
    segment, new = int(markerset.attachment[found.marker]), markerset.offsets[found.marker]
    anchor = found.marker if found.kind == MOVE else worn.anchor(segment, new)
    return Advice(
        found.kind,
        markerset.markers[found.marker],
        segment,
        worn.markerset.offsets[anchor],
        new,
        worn.markerset.markers[anchor],
        (now.markers[pair[0]], now.markers[pair[1]]),
        float(separation(now.hidden[pair])),
        found.apart(pair),
    )
