# SPDX-License-Identifier: GPL-3.0-or-later
"""Frames of anonymous points in, names and their confidence out; no frame knows of another."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..errors import InputError
from .assembling import assemble
from .latent import Latent
from .model import Evidence
from .naming import names_of_points
from .plates import Plates
from .solving import Solved, solve
from .starts import guess
from .ties import Ties
from .trust import chance, features

CHUNK = 64  # frames that are worked on at once; small enough for the processor's own memory
TARGET = 0.999


@dataclass(frozen=True, eq=False)
class Named:
    """The names of F frames of P points.

    marker      (F, P) the most likely marker, -1 where the point is more likely a ghost
    confidence  (F, P) the chance that it is right; 0 where unnamed
    misfit      (F,) how strange the named points are for the model: about 1 or less for subjects like those learned
    """

    marker: np.ndarray
    confidence: np.ndarray
    misfit: np.ndarray

    def sure(self, threshold: float) -> np.ndarray:
        """(F, P) the markers whose confidence reaches the threshold, -1 elsewhere."""
        return np.where(self.confidence >= threshold, self.marker, -1)


def label_frames(evidence: Evidence, points: np.ndarray, chunk: int = CHUNK) -> Iterator[Named]:
    """Names frames of points (T, P, 3) m, z up, NaN where there is none, `chunk` frames at a time.

    Each frame is named on its own. What to accept is for the caller: `evidence.trust.threshold(target)` is the
    confidence from which a part `target` of all labels is right.
    Raises InputError when the array is not one of points.
    """
    if points.ndim != 3 or points.shape[2] != 3:
        raise InputError(f"points have the shape {points.shape}; expected frames × points × 3")
    for first in range(0, len(points), chunk):
        yield label_some(evidence, points[first : first + chunk])


def label_some(evidence: Evidence, points: np.ndarray) -> Named:
    """The names of a few frames of points (F, P, 3) m at once."""
    packed, place = _packed(points)
    solved = solve_frames(evidence.coarse, evidence.fine, evidence.ties, evidence.plates, packed)
    described, frame, slot = described_labels(solved, packed)
    marker = names_of_points(solved.naming, packed.shape[1])
    confidence = np.zeros(marker.shape)
    confidence[frame, slot] = chance(evidence.trust.weights, described)
    whole = np.full(points.shape[:2], -1)
    sure = np.zeros(points.shape[:2])
    np.put_along_axis(whole, place, marker, axis=1)
    np.put_along_axis(sure, place, confidence, axis=1)
    return Named(whole, sure, solved.misfit)


def solve_frames(coarse: Latent, fine: Latent, ties: Ties, plates: Plates | None, points: np.ndarray) -> Solved:
    """The best naming of frames of points (F, P, 3) m, NaN where there is none; by plates where the set has them."""
    if plates is not None:
        return assemble(plates, points)
    return solve(fine, ties, guess(coarse, fine, points), np.isfinite(points[..., 0]))


def described_labels(solved: Solved, points: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """For each label given its `trust.features` (N, 7), its frame (N,) and its point (N,)."""
    named = solved.naming >= 0
    strays = np.isfinite(points[..., 0]).sum(axis=1) - named.sum(axis=1)
    frame, marker = np.nonzero(named)
    described = features(solved.margin[frame, marker], strays[frame], named.mean(axis=1)[frame], solved.misfit[frame])
    return described, frame, solved.naming[frame, marker]


def _packed(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The points of each frame moved together (F, Q, 3), and where they came from (F, Q).

    Most trajectories of a long take are empty most of the time.
    """
    present = np.isfinite(points).all(axis=2)
    width = max(int(present.sum(axis=1).max(initial=0)), 1)
    if points.shape[1] < width or points.shape[1] == 0:
        raise InputError("frames have no points; expected at least one trajectory")
    place = np.argsort(~present, axis=1, kind="stable")[:, :width]
    packed = np.take_along_axis(points, place[..., None], axis=1)
    return np.where(np.take_along_axis(present, place, axis=1)[..., None], packed, np.nan), place
