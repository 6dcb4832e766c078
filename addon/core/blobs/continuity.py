# SPDX-License-Identifier: GPL-3.0-or-later
"""Names that jump from one marker to another while the markers go on: what moves on smoothly keeps its name.

A marker goes behind the body, and a neighbour gets its name; it comes out again, and the name jumps back. The
neighbour's path does not break there, it only goes on under another name. Most of its frames know which is right.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from ..data.physical import MARKER_LIMITS
from ..papers.virtual_occlusions.labelling import Naming
from .image_tracklets import IMAGE_TRACKLETS
from .swaps import swap_names
from .tracking import FrameResult


@dataclass(frozen=True)
class ContinuityOptions:
    """How smoothly markers move, and when most frames of a path overrule the others.

    max_reach_m  from where a marker is expected, never farther; physical: half the way to its next neighbour
    other_share  measured: of what a name's own next place is off where it is expected: another name's place nearer than
                 that is the better next one; without, walks in five noisy cameras (`body26`) have 1,038 wrong labels
                 for 995
    max_gap_s    without a marker, over which its path goes on; physical: no limb turns round in less
    min_ratio    times as many as had any other; physical: two in three
    """

    max_reach_m: float = 0.03
    other_share: float = 0.7
    max_gap_s: float = 0.05
    min_ratio: float = 2.0


MIN_LENGTH = 3  # frames of a tracklet that show where it goes
CONTINUITY = ContinuityOptions()


# Tracklets, each smooth and under one name: the name; first and last frame, both included, and how many have a point;
# where they begin and end, m, and the velocity there, m a frame, NaN for those too short to show one.
NAMED_TRACKLETS = np.dtype(
    [(name, int) for name in ("marker", "first", "last", "count")]
    + [(name, float, 3) for name in ("begin", "end", "early", "late")]
)


def renamed(results: Mapping[int, FrameResult], rate: float) -> list[tuple[int, int, np.ndarray]]:
    """Gives paths that changed their name in labelled frames, by index, the one that they mostly had.

    Returns the first and last of frames that were changed alike, both included, and the markers (K,) concerned.
    """
    if not results:
        return []
    met = np.array([result.naming.meeting.points for result in results.values()])
    points = np.full((max(results) + 1, *met.shape[1:]), np.nan)
    points[list(results)] = met
    markers = points.shape[1]
    tracklets = _tracklets(points, rate)
    target = _targets(tracklets, _joined(tracklets, rate), markers)
    wanted = np.full(points.shape[:2], -1)
    for tracklet in range(len(target)):
        part = slice(tracklets.first[tracklet], tracklets.last[tracklet] + 1), tracklets.marker[tracklet]
        wanted[part] = np.where(np.isfinite(points[part][:, 0]), target[tracklet], -1)
    changed: list[tuple[int, int, np.ndarray]] = []
    for index in np.flatnonzero(((wanted != np.arange(markers)) & (wanted >= 0)).any(axis=1)).tolist():
        order = _order(wanted[index])
        if order is None:
            continue
        _rename(results[index].naming, order)
        moved = np.flatnonzero(order != np.arange(markers))
        if changed and changed[-1][1] == index - 1 and np.array_equal(changed[-1][2], moved):
            changed[-1] = (changed[-1][0], index, moved)
        else:
            changed.append((index, index, moved))
    return changed


def _tracklets(points: np.ndarray, rate: float) -> np.recarray:
    """The paths of all names (F, M, 3) m, cut where they are gone for long or do not go on smoothly."""
    found = []
    for marker in range(points.shape[1]):
        at = np.flatnonzero(np.isfinite(points[:, marker, 0]))
        for part in np.split(at, np.flatnonzero(_cuts(points, marker, at, rate)) + 1):
            if len(part):
                place = points[part, marker]
                early = late = np.full(3, np.nan)
                if len(part) >= MIN_LENGTH:
                    early, late = ((place[b] - place[a]) / (part[b] - part[a]) for a, b in ((0, 2), (-3, -1)))
                found.append((marker, part[0], part[-1], len(part), place[0], place[-1], early, late))
    return np.array(found, NAMED_TRACKLETS).view(np.recarray)


def _cuts(points: np.ndarray, marker: int, at: np.ndarray, rate: float) -> np.ndarray:
    """(N - 1,) True where a name does not go on from one of its N frames to the next, or another would do better."""
    place, gap = points[at, marker], np.diff(at)
    cut = gap > CONTINUITY.max_gap_s * rate + 1
    if len(gap) < 2:
        return cut
    speed = np.diff(place, axis=0) / gap[:, None]
    change = np.linalg.norm(np.diff(speed, axis=0), axis=1)
    off = np.full((2, len(gap)), np.inf)
    off[0, 1:], off[1, :-1] = change * gap[1:], change * gap[:-1]
    least = off.min(axis=0)
    cut |= least > _reach(gap, rate)
    for index in np.flatnonzero(~cut & (least > MARKER_LIMITS.max_noise_m)):
        here, there = at[index], at[index + 1]
        nearest = np.inf
        if index:
            nearest = _nearest_other(points, marker, place[index], speed[index - 1], here, range(here + 1, there + 1))
        if index + 1 < len(speed):
            back = _nearest_other(points, marker, place[index + 1], speed[index + 1], there, range(here, there))
            nearest = min(nearest, back)
        cut[index] = nearest < CONTINUITY.other_share * least[index]
    return cut


def _nearest_other(points, marker: int, place: np.ndarray, speed: np.ndarray, when: int, frames: range) -> float:
    """m, how near another name comes to where a marker would be in some frames, from its place and speed in one."""
    expected = place + speed * (np.arange(frames.start, frames.stop) - when)[:, None]
    away = points[frames.start : frames.stop] - expected[:, None]
    square = np.einsum("fmi,fmi->fm", away, away)
    square[:, marker] = np.nan
    return math.sqrt(np.fmin.reduce(square, axis=None, initial=np.inf))


def _reach(gap: np.ndarray, rate: float) -> np.ndarray:
    """(N,) m, how far from where it is expected a marker may be after some frames."""
    return np.minimum(MARKER_LIMITS.reach_m(gap / rate), CONTINUITY.max_reach_m)


def _joined(tracklets: np.recarray, rate: float) -> np.ndarray:
    """(N,) the path of each tracklet: it goes on in one that begins soon, where it would be, and moves alike."""
    gap = tracklets.first[None] - tracklets.last[:, None]
    soon = (gap > 0) & (gap <= CONTINUITY.max_gap_s * rate + 1)
    one, other = np.nonzero(soon)
    gap = gap[one, other]
    step = tracklets.begin[other] - tracklets.end[one]
    off = np.maximum(
        np.linalg.norm(step - tracklets.late[one] * gap[:, None], axis=1),
        np.linalg.norm(step - tracklets.early[other] * gap[:, None], axis=1),
    )
    path = np.arange(len(tracklets.marker))
    ended, begun = set(), set()
    for index in np.argsort(off, kind="stable"):
        a, b = int(one[index]), int(other[index])
        if off[index] <= _reach(gap[index], rate) and a not in ended and b not in begun:
            ended.add(a)
            begun.add(b)
            path[path == path[b]] = path[a]
    return path


def _targets(tracklets: np.recarray, path: np.ndarray, markers: int) -> np.ndarray:
    """(N,) the name that each tracklet should have."""
    target = tracklets.marker.copy()
    for own in np.unique(path):
        part = np.flatnonzero(path == own)
        count = np.bincount(tracklets.marker[part], weights=tracklets.count[part], minlength=markers)
        best = int(count.argmax())
        rest = np.delete(count, best).max(initial=0)
        if count[best] >= max(IMAGE_TRACKLETS.min_frames, CONTINUITY.min_ratio * rest):
            target[part] = best
    return target


def _order(wanted: np.ndarray) -> np.ndarray | None:
    """(M,) which marker's blobs each marker gets, so that all have the names wanted (M,); None where two want one."""
    source = np.flatnonzero(wanted >= 0)
    target = wanted[source]
    if len(np.unique(target)) < len(target):
        return None
    order = np.arange(len(wanted))
    order[target] = source
    order[np.setdiff1d(source, target)] = np.setdiff1d(target, source)
    return order


def _rename(naming: Naming, order: np.ndarray):
    """Makes the exchange; the blobs of markers that had no point lose their names in it."""
    pointless = np.isnan(naming.meeting.points[:, 0]) & (order != np.arange(len(order)))
    naming.withdraw(*np.nonzero((naming.slot >= 0) & pointless))
    swap_names(naming, order)
