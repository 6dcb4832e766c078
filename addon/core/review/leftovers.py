# SPDX-License-Identifier: GPL-3.0-or-later
"""Points without a name that stay on the body for a while, and the missing marker that each of them may be."""

from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import Labels, Motion, PointRows, evenly_spread


@dataclass(frozen=True)
class LeaveOptions:
    """When a point is left over on the body; reckoned.

    min_s           that it has to be there without a name: a reflection seldom lasts longer
    max_break_s     between two parts of a trajectory that are one
    max_off_m       from the body's nearest part that is still on it: markers stand off skin and clothes by less
    max_beside_m    from where a missing marker should be: farther than markers of one limb are from each other
    min_share       of its frames in which it is on the body, or nearest to that marker
    samples         frames of each part that are looked at, spread evenly
    max_samples     of all points that are there for a moment only
    points_once     whose distances from the body are held in memory
    """

    min_s: float = 0.25
    max_break_s: float = 0.1
    max_off_m: float = 0.15
    max_beside_m: float = 0.15
    min_share: float = 0.6
    samples: int = 7
    max_samples: int = 4000
    points_once: int = 2000


LEAVING = LeaveOptions()


@dataclass(frozen=True)
class Leftover:
    """A part of a trajectory that is on the body and has no name.

    trajectory   its index in the file
    first, last  the source's numbers of its frames, and `frames` how many of them have a point without a name
    beside       the marker (an index) that is missing there and should be where it is, None where none is
    distance     how far it is from there, m; NaN without one
    """

    trajectory: int
    first: int
    last: int
    frames: int
    beside: int | None
    distance: float


def find_leftovers(
    rows: PointRows, labels: Labels, motion: Motion, rate: float, options: LeaveOptions = LEAVING
) -> tuple[tuple[Leftover, ...], int]:
    """The points of a take that are left over on the body, and how many more are there for a moment only.

    labels (N,) are row for row, and rate is in frames a second. Of parts that last, some frames are looked at.
    """
    parts = _parts(rows, labels, max(options.max_break_s * rate, 1.0))
    lasting = [part for part in parts if len(part) >= options.min_s * rate]
    found = tuple(one for one in (_leftover(part, rows, motion, options) for part in lasting) if one is not None)
    brief = [part for part in parts if len(part) < options.min_s * rate]
    short = np.sort(np.concatenate(brief)) if brief else np.empty(0, int)
    chosen = short[evenly_spread(len(short), options.max_samples)] if len(short) else short
    near = _nearest(rows.xyz[chosen], rows.frame[chosen], motion)[0] <= options.max_off_m
    return found, round(len(short) * float(near.mean())) if len(short) else 0


def joined_leftovers(before: tuple[Leftover, ...], after: tuple[Leftover, ...]) -> tuple[Leftover, ...]:
    """Those of a take so far and of its next frames: what goes on from one to the other is one."""
    ends = {(one.trajectory, one.last): place for place, one in enumerate(before)}
    joined, new = list(before), []
    for one in after:
        place = ends.get((one.trajectory, one.first - 1))
        if place is None:
            new.append(one)
        else:
            old = joined[place]
            longer = max(old, one, key=lambda part: part.frames)
            joined[place] = replace(longer, first=old.first, last=one.last, frames=old.frames + one.frames)
    return tuple(sorted((*joined, *new), key=lambda one: (one.trajectory, one.first)))


def _parts(rows: PointRows, labels: Labels, max_break: float) -> list[np.ndarray]:
    """The rows without a name, as parts of trajectories without a long break in time."""
    left = np.flatnonzero(~labels.named)
    # Rows are in the order of frames, which a stable sort keeps within each trajectory.
    left = left[np.argsort(rows.trajectory[left].astype(np.int32), kind="stable")]
    new = (np.diff(rows.trajectory[left]) != 0) | (np.diff(rows.frame[left]) > max_break)
    return np.split(left, np.flatnonzero(new) + 1) if len(left) else []


def _leftover(part: np.ndarray, rows: PointRows, motion: Motion, options: LeaveOptions) -> Leftover | None:
    """A part of a trajectory as what is left over; None where it is not on the body."""
    some = part[evenly_spread(len(part), options.samples)]
    off, marker, beside = _nearest(rows.xyz[some], rows.frame[some], motion)
    if (off <= options.max_off_m).mean() < options.min_share:
        return None
    first, last = (int(rows.frames[rows.frame[row]]) for row in (part[0], part[-1]))
    near = beside <= options.max_beside_m
    who, distance = None, float("nan")
    if near.any():
        often = np.bincount(marker[near])
        if often.max() >= options.min_share * len(some):
            who = int(often.argmax())
            distance = float(np.median(beside[near & (marker == who)]))
    return Leftover(int(rows.trajectory[part[0]]), first, last, len(part), who, distance)


def _nearest(xyz: np.ndarray, frame: np.ndarray, motion: Motion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """(K,) m from points (K, 3) to the body, (K,) the missing marker that should be nearest, and (K,) m from there.

    inf where there is no body, or no marker is missing.
    """
    off, marker, beside = np.full(len(xyz), np.inf), np.zeros(len(xyz), int), np.full(len(xyz), np.inf)
    for start in range(0, len(xyz), LEAVING.points_once):
        rows = slice(start, start + LEAVING.points_once)
        own = frame[rows]
        expected, found = motion.expected[own], motion.markers[own]
        body = np.concatenate([expected, found, motion.joints[own]], axis=1)
        off[rows] = _distances(xyz[rows], body).min(axis=1, initial=np.inf)
        away = _distances(xyz[rows], expected)
        away[np.isfinite(found).all(axis=2)] = np.inf
        if away.shape[1]:
            marker[rows], beside[rows] = away.argmin(axis=1), away.min(axis=1)
    return off, marker, beside


def _distances(xyz: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(K, B) m from points (K, 3) to others (K, B, 3); inf where these are not there."""
    return np.nan_to_num(np.linalg.norm(others - xyz[:, None], axis=2), nan=np.inf)
