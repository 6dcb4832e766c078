# SPDX-License-Identifier: GPL-3.0-or-later
"""Where a trajectory that is lost goes on: it goes along with those around it, whatever they are called."""

import numpy as np

from ...data.physical import MARKER_LIMITS
from ...geometry.rigid import MIN_POINTS, best_turns
from .likeness import LIKENESS


class ALONG:
    """How exactly what is lost goes along."""

    # m/s, standard deviation by which it moves against what is around it; with 0.15 five of 1,331 trajectories of an
    # actor are joined to another's, with 0.4 a fifth fewer are joined
    speed_m_s: float = 0.2  # measured


def carried_along(places: np.ndarray, then: np.ndarray, now: np.ndarray) -> np.ndarray:
    """Where what was at places (L, 3) m would be now, if all around moved as one rigid body; NaN where too little is.

    Of each that is what was at then (L, N, 3) m, NaN where missing, and is at now (N, 3) m. What is twice as far bends
    away four times as far, and counts for as much less.
    """
    seen = np.isfinite(then[..., 0])
    apart = np.linalg.norm(np.nan_to_num(then) - places[:, None], axis=2)
    weight = np.where(seen, np.maximum(apart, MARKER_LIMITS.noise_m) ** -4.0, 0.0)
    weight /= np.maximum(weight.sum(axis=1, keepdims=True), np.finfo(float).tiny)
    old, new = np.einsum("ln,lni->li", weight, np.nan_to_num(then)), weight @ now
    away = np.where(seen[..., None], then - old[:, None], 0.0)
    turn, _ = best_turns(np.einsum("ln,lni,lnj->lij", weight, now - new[:, None], away))
    found = np.einsum("lij,lj->li", turn, places - old) + new
    return np.where(seen.sum(axis=1)[:, None] < MIN_POINTS, np.nan, found)


def going_on_odds(expected: np.ndarray, seconds: np.ndarray, points: np.ndarray) -> np.ndarray:
    """(L, P) log odds that new points (P, 3) m are what was lost, against ghosts.

    That is expected (L, 3) m now, and was lost for some seconds (L,); minus infinity where nobody knows.
    """
    variance = (MARKER_LIMITS.noise_m + ALONG.speed_m_s * seconds)[:, None] ** 2
    square = ((expected[:, None] - points) ** 2).sum(axis=2) / variance
    odds = -1.5 * np.log(2 * np.pi * variance) - 0.5 * square - np.log(LIKENESS.ghost_density)
    return np.where(np.isnan(odds), -np.inf, odds)
