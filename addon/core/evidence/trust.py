# SPDX-License-Identifier: GPL-3.0-or-later
"""From margins to chances: a logistic regression over labels given to subjects who were left out of the training."""

import numpy as np

from .model import Trust

KNEES = (0.0, 2.0, 5.0)  # margins at which the line may bend
MOST = 12.0  # margins beyond are taken for this
RIDGE = 1e-2
STEPS = 30
CAUTION = 1.0  # wrong labels that are added, so that few trials promise little
LEVELS = 200
ERRORS = 1e-5, 0.3  # parts wrong between which the levels lie
FEATURES = 5 + len(KNEES)


def features(margin: np.ndarray, strays: np.ndarray, named: np.ndarray, misfit: np.ndarray) -> np.ndarray:
    """(N, FEATURES) what the chance of N labels depends on.

    margin (N,) as in `solving.Solved`; of the label's frame, the number of points left unnamed `strays`, the part of
    all markers `named`, and `misfit`.
    """
    margin = np.clip(margin, -MOST, MOST)
    bent = [np.minimum(margin - knee, 0) for knee in KNEES]
    return np.stack(
        [np.ones(len(margin)), margin, *bent, np.minimum(strays, 4), 1 - named, np.log(misfit + 0.1)], axis=1
    )


def chance(weights: np.ndarray, described: np.ndarray) -> np.ndarray:
    """(N,) the chance that labels described by `features` are right."""
    return 1 / (1 + np.exp(-np.clip(described @ weights, -30, 30)))


def learn_trust(described: np.ndarray, right: np.ndarray) -> Trust:
    """Trust from labels described (N, FEATURES) that are known to be right or not (N,)."""
    weights = _logistic(described, right)
    confidence = chance(weights, described)
    order = np.argsort(-confidence)
    count = np.arange(1, len(order) + 1)
    wrong = np.cumsum(~right[order]) + CAUTION * count / len(order)
    # Accepting less must never look worse than accepting more.
    rates = np.maximum.accumulate((1 - wrong / count)[::-1])[::-1]
    # Levels where the part that is wrong changes, not where labels are many: almost all labels are almost sure.
    wanted = 1 - np.geomspace(*ERRORS, LEVELS)
    places = np.unique(np.append(np.searchsorted(-rates, -wanted, side="right") - 1, len(order) - 1))
    places = places[places >= 0]
    return Trust(weights, confidence[order][places][::-1], rates[places][::-1])


def _logistic(described: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Weights by Newton's method with a small ridge."""
    weights = np.zeros(described.shape[1])
    for _ in range(STEPS):
        expected = chance(weights, described)
        curve = (described * (expected * (1 - expected))[:, None]).T @ described
        slope = described.T @ (right - expected) - RIDGE * weights
        step = np.linalg.solve(curve + RIDGE * np.eye(len(weights)), slope)
        weights = weights + step * min(1.0, 5.0 / np.abs(step).max())
        if np.abs(step).max() < 1e-6:
            break
    return weights
