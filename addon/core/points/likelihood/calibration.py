# SPDX-License-Identifier: GPL-3.0-or-later
"""From margins to chances: a logistic regression over labels given to subjects who were left out of the training."""

import numpy as np

from .model import Calibration

KNEES = (0.0, 2.0, 5.0)  # margins at which the line may bend
MOST = 12.0  # margins beyond are taken for this
RIDGE = 1e-2
STEPS = 30
CAUTION = 1.0  # wrong labels that are added, so that few trials promise little
LEVELS = 200
ERRORS = 1e-5, 0.3  # parts wrong between which the levels lie
FEATURES = 6 + len(KNEES)
HIDDEN = FEATURES - 2  # the feature that is the part of the markers without a name
PARTS = 0.7, 0.87  # of the markers that are named, between which frames are of one kind
ENOUGH = 3000  # labels that a kind of frame needs for a count of its own
SUREST, NEVER = 30.0, 100.0


def features(margin: np.ndarray, strays: np.ndarray, named: np.ndarray, misfit: np.ndarray) -> np.ndarray:
    """(N, FEATURES) what the chance of N labels depends on.

    margin (N,) as in `solving.Solved`; of the label's frame, the number of points left unnamed `strays`, the part of
    all markers `named`, and `misfit`.
    """
    margin = np.clip(margin, -MOST, MOST)
    bent = [np.minimum(margin - knee, 0) for knee in KNEES]
    return np.stack(
        [np.ones(len(margin)), margin, *bent, np.minimum(strays, 4), np.log1p(strays), 1 - named, np.log(misfit + 0.1)],
        axis=1,
    )


def log_odds(weights: np.ndarray, described: np.ndarray) -> np.ndarray:
    """(N,) the log odds that labels described by `features` are right."""
    return np.clip(described @ weights, -SUREST, SUREST)


def chance(odds: np.ndarray) -> np.ndarray:
    """(N,) the chance of log odds (N,)."""
    return 1 / (1 + np.exp(-odds))


def kinds(described: np.ndarray) -> np.ndarray:
    """(N,) the kind of frame of labels described (N, FEATURES): the more markers are named, the higher."""
    return np.searchsorted(PARTS, 1 - described[:, HIDDEN] + 1e-9, side="right")


def learn_calibration(described: np.ndarray, right: np.ndarray, usual: np.ndarray) -> Calibration:
    """Trust from labels described (N, FEATURES) that are known to be right or not (N,).

    All teach what the chance depends on; what part of the labels is right is counted among the usual ones (N,), for
    each kind of frame apart: else the many labels of easy frames would pay for wrong ones in hard frames.
    """
    weights = _logistic(described, right)
    described, right = described[usual], right[usual]
    odds, kind = log_odds(weights, described), kinds(described)
    rates = 1 - np.geomspace(*ERRORS, LEVELS)[::-1]
    least = []
    for index in range(len(PARTS) + 1):
        mine = kind == index if (kind == index).sum() >= ENOUGH else np.ones(len(kind), dtype=bool)
        least.append(_least(odds[mine], right[mine], rates))
    return Calibration(weights, rates, np.array(least))


def _least(odds: np.ndarray, right: np.ndarray, rates: np.ndarray) -> np.ndarray:
    """(K,) the least log odds of labels of which the parts `rates` (K,) are right; NEVER where none are."""
    order = np.argsort(-odds)
    count = np.arange(1, len(order) + 1)
    wrong = np.cumsum(~right[order]) + CAUTION * count / len(order)
    # Accepting less must never look worse than accepting more.
    reached = np.maximum.accumulate((1 - wrong / count)[::-1])[::-1]
    last = np.searchsorted(-reached, -rates, side="right") - 1
    return np.where(last >= 0, odds[order][np.maximum(last, 0)], NEVER)


def _logistic(described: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Weights by Newton's method with a small ridge."""
    weights = np.zeros(described.shape[1])
    for _ in range(STEPS):
        expected = chance(log_odds(weights, described))
        curve = (described * (expected * (1 - expected))[:, None]).T @ described
        slope = described.T @ (right - expected) - RIDGE * weights
        step = np.linalg.solve(curve + RIDGE * np.eye(len(weights)), slope)
        weights = weights + step * min(1.0, 5.0 / np.abs(step).max())
        if np.abs(step).max() < 1e-6:
            break
    return weights
