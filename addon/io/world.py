# SPDX-License-Identifier: GPL-3.0-or-later
"""Units and up axes of worlds: what a file says of them and, where that says little, one look at the take."""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..core.data.lanes import Lanes, blocks, trajectories_at
from ..core.data.made import Scaled
from ..core.geometry.camera_up import guess_up, turned
from ..core.geometry.cameras import Cameras

# A world with y up into ours with z up: x stays, y becomes z, z becomes -y.
Z_UP_FROM_Y_UP = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])

# Metres in one of each unit that files name.
UNITS = {
    "mm": 1e-3,
    "millimeters": 1e-3,
    "cm": 1e-2,
    "centimeters": 1e-2,
    "m": 1.0,
    "meters": 1.0,
    "in": 0.0254,
    "inch": 0.0254,
    "inches": 0.0254,
    "ft": 0.3048,
    "feet": 0.3048,
}

_ROTATIONS = {
    "+Z": np.eye(3),
    "-Z": np.diag([1.0, -1.0, -1.0]),
    "+Y": Z_UP_FROM_Y_UP,
    "-Y": Z_UP_FROM_Y_UP.T,
    "+X": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]),
    "-X": np.array([[0.0, 1.0, 0.0], [0.0, 0.0, -1.0], [-1.0, 0.0, 0.0]]),
}


def up_rotation(up: str) -> np.ndarray:
    """The rotation (3, 3) that turns a world whose up axis is `up`, such as "+Y", into ours with z up."""
    return _ROTATIONS[up]


def turns_from(up: str) -> dict[str, np.ndarray]:
    """The rotations (3, 3) of points that were read with the axis `up`, such as "+Y", up, by the axis up after it."""
    others = {axis: rotation @ up_rotation(up).T for axis, rotation in _ROTATIONS.items() if axis != up}
    return {axis.lower().removeprefix("+"): rotation for axis, rotation in others.items()}


def guess_unit(xyz: np.ndarray | Scaled) -> str:
    """mm, cm or m, whichever makes the points (T, P, 3) reach as far as people and rooms do."""
    extent = _extent(xyz)
    reach = float(np.median(extent.max(axis=1), axis=0)) if len(extent) else 0.0
    return "m" if reach < 12 else "cm" if reach < 500 and _travel(xyz) < 1500 else "mm"


def _extent(xyz: np.ndarray | Scaled) -> np.ndarray:
    """(F, 3) how far the points of a frame reach along each axis, over up to 200 frames that have any."""
    some = [np.isfinite(xyz[part]).any(axis=(1, 2)) for part in blocks(*xyz.shape[:2])]
    there = np.flatnonzero(np.concatenate([np.zeros(0, bool), *some]))
    frames = xyz[there[:: max(1, len(there) // 200)]]
    if not len(frames):
        return np.zeros((0, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nan_to_num(np.nanmax(frames, axis=1) - np.nanmin(frames, axis=1))


def _travel(xyz: np.ndarray | Scaled) -> float:
    """The farthest that any point is from the origin."""
    parts = [xyz[part] for part in blocks(*xyz.shape[:2])]
    return float(max(np.nanmax(np.abs(part), initial=0.0) for part in parts))


def z_up(cameras: Cameras, up: str = "") -> Cameras:
    """The cameras of a file whose world has the axis `up`, such as "y" or "-x", pointing up; turned to z up.

    Where nobody says (`up` is empty), the cameras themselves tell; a turn that was decided so is among the `remarks`.
    """
    axis = up or guess_up(cameras) or "z"
    if axis == "z":
        return cameras
    cameras = turned(cameras, up_rotation(axis.upper() if axis[0] == "-" else "+" + axis.upper()))
    if up:
        return cameras
    remark = f"the cameras stand with {axis} up in the calibration, which does not say: turned to z up"
    return replace(cameras, remarks=(*cameras.remarks, remark))


SIGNED_AXES = ("+Z", "+Y", "+X", "-Z", "-Y", "-X")

# Programs write these of worlds with another axis up: Qualisys -Z of those with z up, and others +Y by default.
UNSURE_WORDS = {"-Z": "+Z", "+Y": "+Y"}  # each with what is most likely meant


# How a standing person's points lie; nearly all takes at hand that stand along an axis by this have it up.
STANDING_FRAMES = 400  # that are looked at, evenly spread: memory, 400 of 10,000 points are 96 MB
HIGHEST_FLOOR_M = 0.4  # of the lowest marker above nought: physical, half a shank
MIN_HEIGHT_M = 0.5  # that markers reach up from it: physical, half the legs of an adult
MIN_LONGER = 1.3  # times as long as wide who surely stands: measured, who kneels down from a run was 1.0 to 1.2
# of the height, that the lowest marker moves, or is buried by a poor origin: physical, a jump and a step are less than
# a shank; who sits with the origin in the chest is buried by more
MAX_WANDER = 0.25
# of the points at either end, which may be ghosts where nothing stands otherwise: measured, three of 118 takes stand
# so; with 0.05 a serve of 22 points is read with another axis up
GHOSTS = 0.02


@dataclass(frozen=True)
class Upright:
    """The axis that points up, such as "+Z", and what to say of it: a sentence where the file says otherwise."""

    axis: str
    notes: tuple[str, ...] = ()


def find_up(
    word: str, xyz: np.ndarray | Scaled, names: Sequence[str], usual: str = "+Z", lanes: Lanes | None = None
) -> Upright:
    """The axis that points up in points (T, L, 3) m with `names`.

    word    the axis that the file names, empty where it names none
    usual   what is likely where the file names none
    lanes   which of the names stands where; None where each has a lane of its own
    """
    word = word if word in SIGNED_AXES else ""
    base = UNSURE_WORDS.get(word, word or usual)
    frames = _some_frames(xyz, names, lanes)
    seen = _stands_along(frames, base) or _stands_along(frames, base, GHOSTS)
    up = seen if seen and (not word or word in UNSURE_WORDS) else base
    says = f"says that {word} is up" if word else "does not say which axis is up"
    what = ""
    if up != (word or usual):
        why = "by how the points stand" if up == seen else "as programs write that of such worlds"
        what = f"but {up} was taken {why}"
    elif seen not in ("", up):
        what = f"but its points stand along {seen}"
    elif not (word or seen):
        what = f"nor do its points tell: {up} was taken, as is usual"
    return Upright(up, (f"the file {says}, {what} (an up axis that is given overrules this)",) if what else ())


def _some_frames(xyz: np.ndarray | Scaled, names: Sequence[str], lanes: Lanes | None) -> np.ndarray:
    """(F, L, 3) some frames with points of the subject with most names: two people are as wide as they are tall.

    Frames in which less than half of these points are there say nothing: of who leaves the head may be seen last.
    """
    owners = [name.rpartition(":")[0] for name in names]
    largest = max(dict.fromkeys(owners), key=owners.count)
    chosen = np.array([owner == largest for owner in owners])
    frames = np.unique(np.linspace(0, len(xyz) - 1, STANDING_FRAMES).astype(int))
    some = np.array(xyz[frames], float)
    frame, lane = np.nonzero(np.isfinite(some).all(axis=2))
    other = ~chosen[trajectories_at(lanes, frames[frame], lane)]
    some[frame[other], lane[other]] = np.nan
    there = np.isfinite(some).all(axis=2).sum(axis=1)
    return some[(there > 0) & (2 * there >= there.max(initial=0))]


def _stands_along(frames: np.ndarray, base: str, ghosts: float = 0.0) -> str:
    """The one axis along which the points stand on a floor at nought, and are not much shorter than wide; else empty.

    In a T-pose they are as wide as tall, but of the two one has half of them far below the floor.
    Only of axes that files mean: the one called `base` and its opposite, y and z. The part `ghosts` of the points is
    left out at either end.
    """
    if not len(frames):
        return ""
    # Of no ghosts the quantiles are the least and the most, which are found sooner: every file that is read is asked.
    if ghosts:
        low, high = np.nanquantile(frames, [ghosts, 1 - ghosts], axis=1)
    else:
        low, high = np.nanmin(frames, axis=1), np.nanmax(frames, axis=1)
    reach = np.median(high - low, axis=0)
    axes = sorted({1, 2, "XYZ".index(base[1])})
    found = []
    for axis in axes:
        if reach[axis] < max(MIN_HEIGHT_M, reach[axes].max() / MIN_LONGER):
            continue
        for sign, ground in (("+", low[:, axis]), ("-", -high[:, axis])):
            tenth, last_tenth = np.percentile(ground, [10, 90])
            on_floor = -MAX_WANDER * reach[axis] < tenth < HIGHEST_FLOOR_M
            steady = last_tenth - tenth < MAX_WANDER * reach[axis]
            if on_floor and steady and (sign == "+" or base[1] == "XYZ"[axis]):
                found.append(sign + "XYZ"[axis])
    return found[0] if len(found) == 1 else ""
