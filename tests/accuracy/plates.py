# SPDX-License-Identifier: GPL-3.0-or-later
"""Two takes of one person in 62 markers on plates; the one is learned from, the other cut to anonymous tracklets."""

import numpy as np

from .people import PEOPLE
from .whole_takes import track

TRAINED, TESTED = (PEOPLE / "clouthier" / f"{name}.c3d" for name in ("KneeltoProne01", "PronetoRun01"))
# Tracklets that the take is cut into, markers hidden at once at most, and ghosts.
CUTS = ((62, 0, 0), (278, 5, 30), (453, 10, 60))
SEED = 1
HIDDEN_FRAMES = (10, 60)  # that a marker is hidden for
GHOST_FRAMES = 20  # that a ghost lasts at least
MARGIN = 5  # frames at either end that no tracklet is cut in


def cut_up(labelled: np.ndarray, tracklets: int, hidden: int, ghosts: int, rng) -> tuple[np.ndarray, np.ndarray]:
    """Anonymous trajectories (T, P, 3) m of a labelled take (T, M, 3), and the marker (P,) of each, -1 for ghosts."""
    frames, markers = labelled.shape[:2]
    cuts = rng.multinomial(max(tracklets - markers, 0), np.full(markers, 1 / markers))
    seen = np.isfinite(labelled[..., 0]) & ~_hidden(frames, markers, hidden, rng)
    columns, truth = [], []
    for marker in range(markers):
        inside = np.sort(rng.choice(np.arange(MARGIN, frames - MARGIN), cuts[marker], replace=False))
        for first, after in zip([0, *inside], [*inside, frames], strict=True):
            here = seen[:, marker] & (np.arange(frames) >= first) & (np.arange(frames) < after)
            if here.any():
                columns.append(np.where(here[:, None], labelled[:, marker], np.nan))
                truth.append(marker)
    columns += [_ghost(labelled, rng) for _ in range(ghosts)]
    truth += [-1] * ghosts
    order = rng.permutation(len(columns))
    return np.stack([columns[index] for index in order], axis=1), np.array(truth)[order]


def _hidden(frames: int, markers: int, most: int, rng: np.random.Generator) -> np.ndarray:
    gone = np.zeros((frames, markers), dtype=bool)
    first = 0
    while most and first < frames:
        length = rng.integers(*HIDDEN_FRAMES)
        many = rng.integers(0, most + 1)
        gone[first : first + length, rng.permutation(markers)[:many]] = True
        first += length
    return gone


def _ghost(labelled: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """A point that wanders about near the subject for a while, every other one along with it."""
    frames = len(labelled)
    length = rng.integers(GHOST_FRAMES, frames // 3)
    first = rng.integers(0, frames - length)
    here, middle = slice(first, first + length), first + length // 2
    start = rng.uniform(np.nanmin(labelled[middle], axis=0) - 0.2, np.nanmax(labelled[middle], axis=0) + 0.2)
    path = start + np.cumsum(rng.normal(0, 0.002, (length, 3)), axis=0)
    if rng.random() < 0.5:
        path = path + np.nanmean(labelled[here], axis=1) - np.nanmean(labelled[middle], axis=0)
    return track(frames, first, path)
