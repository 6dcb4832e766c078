# SPDX-License-Identifier: GPL-3.0-or-later
"""Points a person to the frames that are worth a look: markers that leave the body, or move as no marker moves."""

import numpy as np

from .takes import Motion, Suspect

ASTRAY = 0.07  # m between a marker and where the fitted body has it
JERK = 600.0  # m/s², more than a marker on a person is ever accelerated
APART = 5  # frames between two findings that are one


def find_suspects(motion: Motion, names: tuple[str, ...], rate: float) -> tuple[Suspect, ...]:
    """Ranges of frames in which a marker is doubtful, marker by marker.

    `names` are the M markers' names and `rate` the frames a second of `motion`.
    """
    astray = np.linalg.norm(motion.markers - motion.expected, axis=-1) > ASTRAY
    jumps = _jumps(motion.markers, rate)
    found = []
    for index, name in enumerate(names):
        found += _ranges(motion.frames, astray[:, index], f"{name} is far from where the body has it")
        found += _ranges(motion.frames, jumps[:, index], f"{name} jumps")
    return tuple(sorted(found, key=lambda suspect: suspect.first))


def _jumps(markers: np.ndarray, rate: float) -> np.ndarray:
    """(F, M) True where a marker is accelerated beyond JERK: the middle one of three frames in a row."""
    jumps = np.zeros(markers.shape[:2], dtype=bool)
    if len(markers) > 2:
        change = np.linalg.norm(np.diff(markers, 2, axis=0), axis=-1) * rate**2
        jumps[1:-1] = change > JERK
    return jumps


def _ranges(frames: np.ndarray, doubtful: np.ndarray, reason: str) -> list[Suspect]:
    """The doubtful frames (F,) as ranges of the source's numbers; short interruptions are bridged."""
    at = np.flatnonzero(doubtful)
    if not len(at):
        return []
    breaks = np.flatnonzero(np.diff(at) > APART)
    firsts, lasts = np.append(at[0], at[breaks + 1]), np.append(at[breaks], at[-1])
    return [Suspect(int(frames[a]), int(frames[b]), reason) for a, b in zip(firsts, lasts, strict=True)]
