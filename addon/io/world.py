# SPDX-License-Identifier: GPL-3.0-or-later
"""Units and axes of a take whose file does not say, told from how people stand: upright, on the floor."""

import warnings

import numpy as np

from .rig import Z_UP_FROM_Y_UP

# Metres in one of each unit that files name.
UNITS = {
    "mm": 1e-3,
    "millimeters": 1e-3,
    "cm": 1e-2,
    "centimeters": 1e-2,
    "m": 1.0,
    "meters": 1.0,
    "in": 0.0254,
    "inches": 0.0254,
}

# A standing person's markers reach from the floor, or a little off it, at least this far up, m.
FLOOR = (-0.3, 0.4)
LEAST_HEIGHT = 0.5

# How much longer than wide the points of one frame are when they can only stand that way.
UPRIGHT = 1.3

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


def guess_unit(xyz: np.ndarray) -> str:
    """mm, cm or m, whichever makes the points (T, P, 3) reach as far as people and rooms do."""
    reach = float(np.median(_extent(xyz).max(axis=1), axis=0)) if np.isfinite(xyz).any() else 0.0
    return "m" if reach < 12 else "cm" if reach < 500 and _travel(xyz) < 1500 else "mm"


def guess_up(xyz: np.ndarray, likely: str = "+Z") -> str:
    """+Y or +Z: the axis that the points (T, P, 3) m stand along; `likely` where they do not tell."""
    extent = _extent(xyz)
    if not len(extent):
        return likely
    reach = np.median(extent, axis=0)
    other = "+Y" if likely == "+Z" else "+Z"
    stands, lies = (2, 1) if other == "+Z" else (1, 2)
    values = xyz[..., stands]
    low = float(np.percentile(values[np.isfinite(values)], 1))
    upright = reach[stands] > UPRIGHT * reach[lies] and reach[stands] > LEAST_HEIGHT and FLOOR[0] < low < FLOOR[1]
    return other if upright else likely


def _extent(xyz: np.ndarray) -> np.ndarray:
    """(F, 3) how far the points of a frame reach along each axis, over up to 200 frames that have any."""
    frames = xyz[np.isfinite(xyz).any(axis=(1, 2))]
    frames = frames[:: max(1, len(frames) // 200)]
    if not len(frames):
        return np.zeros((0, 3))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)
        return np.nan_to_num(np.nanmax(frames, axis=1) - np.nanmin(frames, axis=1))


def _travel(xyz: np.ndarray) -> float:
    """The farthest that any point is from the origin."""
    return float(np.nanmax(np.abs(xyz)))
