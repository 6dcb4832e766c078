# SPDX-License-Identifier: GPL-3.0-or-later
"""Which way is up for a rig of cameras: they stand upright around what they look at, and look level or down on it."""

from dataclasses import replace

import numpy as np

from .cameras import Cameras

AXIS_NAMES = ("x", "y", "z", "-x", "-y", "-z")


class UPRIGHT_CAMERAS:
    """When cameras tell which way is up."""

    # mean of how far the upper edges of the pictures point along an axis, 1 being all the way; cameras on tripods and
    # walls stand upright, some are turned by a quarter
    min_upright: float = 0.6  # physical
    # cosine of the angle about the axis between some two views; cameras stand around a room
    max_alike: float = 0.5  # physical
    # mean sine of how far views point upwards, and downwards before all cameras are believed to hang head down; they
    # look level or down on people
    max_rise: float = 0.1  # physical


def guess_up(cameras: Cameras) -> str:
    """The one of AXIS_NAMES that points up in the world of `cameras`; empty where they do not tell.

    Few cameras, or cameras on one side that are all turned by a quarter, tell nothing.
    """
    if len(cameras) < 2:
        return ""
    mean = -cameras.rotation[:, 1].mean(axis=0)
    index = int(np.argmax(np.abs(mean)))
    up = np.zeros(3)
    up[index] = np.sign(mean[index])
    ahead = cameras.rotation[:, 2]
    rise = ahead @ up
    about = ahead - rise[:, None] * up
    about /= np.maximum(np.linalg.norm(about, axis=1), 1e-9)[:, None]
    clear = mean @ up > UPRIGHT_CAMERAS.min_upright
    around = (about @ about.T).min() < UPRIGHT_CAMERAS.max_alike
    highest = -UPRIGHT_CAMERAS.max_rise if up[2] < 0 else UPRIGHT_CAMERAS.max_rise
    return ("-" if up[index] < 0 else "") + "xyz"[index] if clear and around and rise.mean() < highest else ""


def turned(cameras: Cameras, turn: np.ndarray) -> Cameras:
    """The same cameras in a world that is turned by the rotation `turn` (3, 3): what was at p is at turn @ p."""
    return replace(cameras, rotation=cameras.rotation @ turn.T)
