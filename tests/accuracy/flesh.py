# SPDX-License-Identifier: GPL-3.0-or-later
"""The body that is really in the way in the accuracy runs: built from the person's own markers, frame by frame.

It knows nothing of the marker set that is tested, so that the model's body is a guess here as it is in a lab.
Proportions to stature are rounded from common anthropometric tables.
"""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from addon.core.papers.virtual_occlusions.occlusion import OCCLUDING, capsules_hide

HEAD_BAND_TO_STATURE = 1.06
# The hip's centre from the middle of the front of the pelvis, in its own width: backward, to the side, down.
HIP = (0.30, 0.36, 0.30)
BLOCK = 16
_Part = tuple[np.ndarray, np.ndarray, float]  # a capsule's start, end, and radius in parts of the stature


@dataclass(frozen=True, eq=False)
class Flesh:
    """Capsules over T frames: start, end (T, K, 3) m and radius (K,) m; pelvis (T, 3, 3) its axes in the world."""

    start: np.ndarray
    end: np.ndarray
    radius: np.ndarray
    pelvis: np.ndarray
    stature: float

    def hidden(self, frames: slice, markers: np.ndarray, centres: np.ndarray) -> np.ndarray:
        """(F, C, M) as `addon.core.simulation.simulate.PosedBody` has it."""
        start, axis = self.start[frames], self.end[frames] - self.start[frames]
        found = np.empty((len(markers), len(centres), markers.shape[1]), dtype=bool)
        for first in range(0, len(markers), BLOCK):
            part = slice(first, first + BLOCK)
            radius = np.broadcast_to(self.radius, start[part].shape[:2])
            capsules = start[part], axis[part], radius
            standoff = np.full(len(start[part]), OCCLUDING.standoff * self.stature)
            found[part] = capsules_hide(*capsules, markers[part], centres, standoff, OCCLUDING.min_side_share)
        return found

    def carry(self, frames: slice, offsets: np.ndarray) -> np.ndarray:
        """(F, M, 3): markers that sit wrongly turn with the pelvis."""
        return np.einsum("fij,mj->fmi", self.pelvis[frames], offsets)


def flesh(names, xyz: np.ndarray) -> Flesh:
    """The flesh of a person whose markers `names` are at xyz (T, P, 3) m; a part without its markers hides nothing."""
    at = {name: xyz[:, index] for index, name in enumerate(names)}
    if "SACR" not in at:
        at["SACR"] = (at["LPSI"] + at["RPSI"]) / 2
    head = np.mean([at[n] for n in ("LFHD", "RFHD", "LBHD", "RBHD") if n in at], axis=0)
    stature = HEAD_BAND_TO_STATURE * float(np.nanmax(head[:, 2]))
    parts: list[_Part] = []
    axes = _pelvis_axes(at)
    ahead, left, up = np.moveaxis(axes, -1, 0)
    front = (at["LASI"] + at["RASI"]) / 2
    middle = (front + at["SACR"]) / 2
    width = np.linalg.norm(at["LASI"] - at["RASI"], axis=1)[:, None]
    depth = float(np.nanmedian(np.linalg.norm(front - at["SACR"], axis=1)))
    parts.append((middle - left * 0.03 * stature, middle + left * 0.03 * stature, 0.46 * depth / stature))

    neck = at["C7"] + (ahead * 0.045 - up * 0.03) * stature
    for side in (-1, 1):
        chest = neck + (left * side * 0.04 - up * 0.06) * stature
        parts.append((middle + left * side * 0.03 * stature, chest, 0.055))
    parts += (neck, head, 0.032), (head - up * 0.04 * stature, head + up * 0.01 * stature, 0.052)
    for letter, side in (("L", 1), ("R", -1)):
        hip = front - (ahead * HIP[0] - left * side * HIP[1] + up * HIP[2]) * width
        parts += _leg(at, stature, letter, hip, -left * side)
        parts += _arm(at, stature, letter, neck, -left * side, up)
    start, end, radius = zip(*parts, strict=True)
    return Flesh(np.stack(start, axis=1), np.stack(end, axis=1), np.array(radius) * stature, axes, stature)


class Move:
    """Turns a person by `yaw` rad, and sets what was at `middle` down at `place`."""

    def __init__(self, yaw: float, middle: np.ndarray, place: np.ndarray):
        cos, sin = np.cos(yaw), np.sin(yaw)
        self.turn = np.array([[cos, -sin, 0], [sin, cos, 0], [0, 0, 1]])
        self._middle, self._place = middle, place

    def __call__(self, points: np.ndarray) -> np.ndarray:
        return (points - self._middle) @ self.turn.T + self._place


def moved_flesh(body: Flesh, frames: slice, move: Move) -> Flesh:
    """The flesh of some frames, moved along with the person."""
    start, end = move(body.start[frames]), move(body.end[frames])
    return Flesh(start, end, body.radius, move.turn @ body.pelvis[frames], body.stature)


def _pelvis_axes(at) -> np.ndarray:
    """(T, 3, 3) columns: ahead, left, up."""
    left = at["LASI"] - at["RASI"]
    left = left / np.linalg.norm(left, axis=1, keepdims=True)
    ahead = (at["LASI"] + at["RASI"]) / 2 - at["SACR"]
    ahead = ahead * [1, 1, 0]
    ahead = ahead - np.einsum("ti,ti->t", ahead, left)[:, None] * left
    ahead = ahead / np.linalg.norm(ahead, axis=1, keepdims=True)
    return np.stack([ahead, left, np.cross(ahead, left)], axis=-1)


def _leg(at, size: float, letter: str, hip: np.ndarray, inward: np.ndarray) -> Iterator[_Part]:
    knee = at[letter + "KNE"] + inward * 0.030 * size
    ankle = at[letter + "ANK"] + inward * 0.020 * size
    yield hip, (hip + knee) / 2, 0.045
    yield (hip + knee) / 2, knee, 0.034
    yield knee, (knee + ankle) / 2, 0.030
    yield (knee + ankle) / 2, ankle, 0.020
    heel, toe = at[letter + "HEE"], at[letter + "TOE"]
    along = (toe - heel) / np.linalg.norm(toe - heel, axis=1, keepdims=True)
    yield heel + along * 0.02 * size, ankle, 0.017
    yield heel + along * 0.02 * size, toe - [0, 0, 0.015 * size], 0.016


def _arm(at, size: float, letter: str, neck: np.ndarray, inward: np.ndarray, up: np.ndarray) -> Iterator[_Part]:
    shoulder = at[letter + "SHO"] - up * 0.028 * size
    elbow = at[letter + "ELB"] + inward * 0.018 * size
    wrist = (at[letter + "WRA"] + at[letter + "WRB"]) / 2
    yield shoulder, neck - up * 0.02 * size, 0.028
    yield shoulder, elbow, 0.026
    yield elbow, wrist, 0.019
    yield wrist, at[letter + "FIN"], 0.012
