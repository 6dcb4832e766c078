# SPDX-License-Identifier: GPL-3.0-or-later
"""Points without a name that stay on the body for a while, and the missing marker that each of them may be."""

from dataclasses import dataclass, replace

import numpy as np

from ..data.takes import Labels, Motion, PointRows, evenly_spread
from .suspects import MOMENT_S

# physical: m, from the body's nearest part, or where a missing marker should be; half a limb's length
BESIDE_BODY_M = 0.15  # physical
# measured: frames of each point that are looked at, spread evenly; most of them must say the same
LEFT_SAMPLES = 7  # measured


@dataclass(frozen=True)
class Leftover:
    """A part of a trajectory that is on the body and has no name, from frame `first` to `last` of the source's."""

    trajectory: int  # its index in the file
    first: int
    last: int
    frames: int  # in how many of them it has a point without a name
    beside: int | None  # the marker (an index) that is missing there and should be where it is, None where none is
    distance: float  # how far it is from there, m; NaN without one


def find_leftovers(rows: PointRows, labels: Labels, motion: Motion, rate: float) -> tuple[Leftover, ...]:
    """The points of a take that are left over on the body for more than a moment.

    labels (N,) are row for row, and rate is in frames a second.
    """
    moment = MOMENT_S * rate
    left = np.flatnonzero(~labels.named)
    # Rows are in the order of frames, which a stable sort keeps within each trajectory.
    left = left[np.argsort(rows.trajectory[left].astype(np.int32), kind="stable")]
    new = (np.diff(rows.trajectory[left]) != 0) | (np.diff(rows.frame[left]) > moment)
    parts = [part for part in np.split(left, np.flatnonzero(new) + 1) if len(part) >= moment]
    return tuple(one for one in (_leftover(part, rows, motion) for part in parts) if one is not None)


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


def _leftover(part: np.ndarray, rows: PointRows, motion: Motion) -> Leftover | None:
    """A part of a trajectory as what is left over; None where it is not on the body."""
    some = part[evenly_spread(len(part), LEFT_SAMPLES)]
    own = rows.frame[some]
    expected, found = motion.expected[own], motion.markers[own]
    body = np.concatenate([expected, found, motion.joints[own]], axis=1)
    off = _distances(rows.xyz[some], body).min(axis=1, initial=np.inf)
    if 2 * (off <= BESIDE_BODY_M).sum() <= len(some):
        return None
    away = _distances(rows.xyz[some], expected)
    away[np.isfinite(found).all(axis=2)] = np.inf
    near = (away <= BESIDE_BODY_M) & (away == away.min(axis=1, keepdims=True, initial=np.inf))
    often = near.sum(axis=0)
    who, distance = None, float("nan")
    if 2 * often.max(initial=0) > len(some):
        who = int(often.argmax())
        distance = float(np.median(away[near[:, who], who]))
    first, last = (int(rows.frames[rows.frame[row]]) for row in (part[0], part[-1]))
    return Leftover(int(rows.trajectory[part[0]]), first, last, len(part), who, distance)


def _distances(xyz: np.ndarray, others: np.ndarray) -> np.ndarray:
    """(K, B) m from points (K, 3) to others (K, B, 3); inf where these are not there."""
    return np.nan_to_num(np.linalg.norm(others - xyz[:, None], axis=2), nan=np.inf)
