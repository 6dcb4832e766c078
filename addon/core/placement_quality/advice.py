# SPDX-License-Identifier: GPL-3.0-or-later
"""What would make a marker set less ambiguous: for its worst pairs, one marker to move on its segment.

Left and right are never moved alike, as laboratories do with their thigh markers: what is not the same on both sides
distinguishes the sides.
"""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..data.markersets import MarkerSet
from ..papers.virtual_occlusions.occlusion import CapsuleOcclusion
from .judging import Ambiguity, judge, separation
from .layout import MarkerLayout

PLACES_AROUND = 8  # places around a marker that are tried
# Heights, of two rings of cameras around the body, as they hang in a room.
CAMERA_RING_HEIGHTS, CAMERA_RING_RADIUS = (0.5, 1.2), 3.0
MIN_SEEN_SHARE = 0.45  # of the cameras that should see a marker; a convex body hides half
CAPSULE_END = 0.1  # of its length, by which places stay off its ends, and a marker may leave them: joints bend there
MIN_RADIUS = 0.005  # heights, of a capsule that is walked around: a finger's


def in_view(markerset: MarkerSet, segment: int, places: np.ndarray) -> np.ndarray:
    """(N,) the part of a ring of cameras that sees places (N, 3) on a segment of the body at rest."""
    ring = CAMERA_RING_RADIUS * _circle(2 * PLACES_AROUND)
    eyes = np.concatenate([np.column_stack([ring, np.full(len(ring), height)]) for height in CAMERA_RING_HEIGHTS])
    joints = markerset.skeleton.rest_joints
    turns = np.tile(np.eye(3), (1, len(joints), 1, 1))
    hidden = CapsuleOcclusion(markerset).hidden(
        turns, joints[None], np.ones((1, 3)), (joints[segment] + places)[None], eyes
    )
    return 1 - hidden[0].mean(axis=0)


def nearby(markerset: MarkerSet, marker: int, distance: float) -> np.ndarray:
    """(N, 3) places `distance` (heights) from a marker along its segment's surface, in the segment's axes.

    As far from the capsule's axis as the marker is; where the segment has no capsule, along the segment's own axes.
    Places that the body hides more than the marker's own, and from most sides, are left out.
    """
    places, segment = _nearby(markerset, marker, distance), int(markerset.attachment[marker])
    share = in_view(markerset, segment, np.concatenate([markerset.offsets[[marker]], places]))
    return places[share[1:] >= min(share[0], MIN_SEEN_SHARE)]


def _nearby(markerset: MarkerSet, marker: int, distance: float) -> np.ndarray:
    """All of them, around the capsule that the marker is nearest to."""
    own = markerset.offsets[marker]
    mine = np.flatnonzero(markerset.capsules.segment == markerset.attachment[marker])
    if not len(mine):
        return own + distance * np.concatenate([np.eye(3), -np.eye(3)])
    capsules = markerset.capsules
    starts, axes = capsules.start[mine], capsules.end[mine] - capsules.start[mine]
    share = np.clip(((own - starts) * axes).sum(axis=1) / np.maximum((axes**2).sum(axis=1), 1e-12), 0, 1)
    away = own - starts - share[:, None] * axes
    nearest = int((np.linalg.norm(away, axis=1) - capsules.radius[mine]).argmin())
    start, axis = starts[nearest], axes[nearest]
    length = max(np.linalg.norm(axis), 1e-9)
    along = axis / length if length > 1e-6 else np.array([0.0, 0.0, 1.0])
    height = float((own - start) @ along)
    out = own - start - height * along
    radius = max(np.linalg.norm(out), MIN_RADIUS)
    if np.linalg.norm(out) < 1e-9:  # on the axis: any direction across will do
        out = np.eye(3)[np.abs(along).argmin()]
        out = out - (out @ along) * along
    first = out / np.linalg.norm(out)
    second = np.cross(along, first)
    up, aside = _circle(PLACES_AROUND).T
    heights, turns = height + distance * up, distance * aside / radius
    low, high = min(height, -CAPSULE_END * length), max(height, (1 + CAPSULE_END) * length)
    on = (heights >= low - 1e-9) & (heights <= high + 1e-9) & (np.abs(turns) <= np.pi)
    ring = np.cos(turns)[:, None] * first + np.sin(turns)[:, None] * second
    return (start + heights[:, None] * along + radius * ring)[on]


def _circle(count: int) -> np.ndarray:
    """(count, 2) points around a circle of radius 1."""
    angle = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(angle), np.sin(angle)], axis=1)


AXIS_WORDS = (("forward", "back"), ("to the left", "to the right"), ("up", "down"))


class ADVICE:
    """What is looked for, and where."""

    # standard deviations by which every pair of markers should be separate
    goal: float = 4.0  # physical: at 4 one is taken for the other in 2.3 % of all cases
    steps: int = 3  # changes that are advised; format: `quality --advice`
    stride_m: float = 0.01  # between places that are tried; physical: as exactly as markers are put on
    max_move_m: float = 0.06  # and the farthest of them; physical: farther is another place on the body
    # standard deviations of a separation that count
    noticed: float = 0.1  # physical: at 4 they change how often by a ninth


@dataclass(frozen=True, eq=False)
class Advice:
    """One change of a marker set."""

    marker: str  # the marker to move
    segment: int  # index of the segment that carries it
    old: np.ndarray  # (3,) heights, in the segment's axes, and
    new: np.ndarray  # (3,) the same
    pair: tuple[str, str]  # the two markers that it is for
    before: float  # the pair's separation, standard deviations, when earlier advice has been taken, and
    after: float  # with this as well

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
        segment, length = markerset.skeleton.segments[self.segment], 1000 * np.linalg.norm(shift)
        return f"move {self.marker} on {segment} by {length:.0f} mm: {', '.join(parts)}"


def advise(
    layout: MarkerLayout, goal: float = ADVICE.goal, steps: int = ADVICE.steps, keep: Sequence[str] = ()
) -> Iterator[tuple[Advice, MarkerLayout]]:
    """Up to `steps` changes, each on top of those before it, and the set with it; ends when all pairs reach `goal`.

    Markers that `keep` names stay where they are: those on bones that something else is measured by.
    """
    tried: set[tuple[str, str]] = set()
    for _ in range(steps):
        found = _next(layout, goal, keep, tried)
        if found is None:
            return
        yield found
        layout = found[1]


def _next(
    layout: MarkerLayout, goal: float, keep: Sequence[str], tried: set[tuple[str, str]]
) -> tuple[Advice, MarkerLayout] | None:
    """What to do about the worst pair for which something can be done; `tried` are those that had their turn."""
    now, names = judge(layout), layout.markerset.markers
    for one, other in now.worst():
        pair, before = (names[one], names[other]), float(separation(now.hidden[one, other]))
        if before >= goal:
            return None
        if pair in tried:
            continue
        tried.add(pair)
        free = [marker for marker in (one, other) if names[marker] not in keep]
        found = _best_move(layout, now, (one, other), free, goal)
        if found is not None:
            marker, moved, after = found
            segment = int(layout.markerset.attachment[marker])
            old, new = (each.markerset.offsets[marker] for each in (layout, moved))
            return Advice(names[marker], segment, old, new, pair, before, after), moved
    return None


def _best_move(
    layout: MarkerLayout, now: Ambiguity, pair: tuple[int, int], free: Sequence[int], goal: float
) -> tuple[int, MarkerLayout, float] | None:
    """A marker of a pair, the set with it in the nearest place that reaches the goal, and the pair's separation.

    Else in the place that separates the pair most; None where that is hardly noticed.
    """
    old = layout.markerset
    tries: list[tuple[float, float, int, MarkerLayout, float]] = []
    for marker in free:
        for distance in np.arange(ADVICE.stride_m, ADVICE.max_move_m + ADVICE.stride_m / 2, ADVICE.stride_m):
            for place in nearby(old, marker, distance / old.spread.height):
                moved = layout.moved(marker, place)
                found = judge(moved, now.whole)
                if not _spoils(now, found, pair, goal):
                    length = round(float(np.linalg.norm(place - old.offsets[marker])), 4)
                    tries.append((length, found.total, marker, moved, float(separation(found.hidden[pair]))))
    enough = [one for one in tries if one[-1] >= goal]
    if enough:
        return min(enough, key=lambda one: one[:2])[2:]
    best = max(tries, key=lambda one: one[-1], default=None)
    before = separation(now.hidden[pair])
    return best[2:] if best is not None and best[-1] >= before + ADVICE.noticed else None


def _spoils(now: Ambiguity, then: Ambiguity, pair: tuple[int, int], goal: float) -> bool:
    """Whether a change mends the pair at the cost of another that then is short of the goal, or of the whole."""
    before, after = separation(now.hidden), separation(then.hidden)
    worse = after < np.minimum(before, goal) - ADVICE.noticed
    worse[pair] = worse[pair[::-1]] = False
    return bool(worse.any()) or then.total >= now.total
