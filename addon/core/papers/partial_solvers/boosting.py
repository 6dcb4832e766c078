# SPDX-License-Identifier: GPL-3.0-or-later
"""From labelled frames to weak and strong classifiers: intervals, wrong labellings, and the paper's tailored AdaBoost.

Every weak classifier accepts every frame it learned from, so all that boosting has to do is to choose few of them that
together reject wrong labellings. Nothing depends on chance but the wrong labellings, and those only on a seed.
"""

from dataclasses import dataclass

import numpy as np

from . import features
from .features import Tables
from .model import FUNCTIONS, Classifiers, Strong

VALUES_ONCE = 4_000_000  # of features in memory at once


@dataclass(frozen=True)
class Boosting:
    """How strong classifiers are chosen."""

    # share of the wrong labellings that the strong classifier must reject before it is done
    accuracy: float = 0.9999  # paper, 3.3
    period: int = 16  # paper, 3.3: wrong labellings presented between two additions to it


@dataclass(frozen=True, eq=False)
class WrongLabellings:
    """K labellings of whole frames with some markers exchanged."""

    frame: np.ndarray  # (K,) the frame
    labelling: np.ndarray  # (K, M) the point that each marker is given; right where it is the marker's own index

    def __len__(self) -> int:
        return len(self.frame)

    @property
    def moved(self) -> np.ndarray:
        """(K, M) True where a marker is given a wrong point; the row's sum is the severity."""
        return self.labelling != np.arange(self.labelling.shape[1])


def learn_intervals(clouds: Tables, kind: np.ndarray, points: np.ndarray) -> Classifiers:
    """The weak classifiers of features over labelled frames: from the least to the greatest value seen.

    clouds: tables of (T, M) labelled frames. Features that no frame shows (markers never seen together) are left out.
    The interval is closed: the paper's equation 1 prints it open, which would reject the very frames it came from.
    """
    low, high = np.full(len(kind), np.inf), np.full(len(kind), -np.inf)
    for index in range(len(FUNCTIONS)):
        rows = np.flatnonzero(kind == index)
        step = max(VALUES_ONCE // max(len(rows), 1), 1)
        for first in range(0, len(clouds.present), step):
            frame = np.arange(first, min(first + step, len(clouds.present)))[:, None]
            seen = features.values(index, frame, points[rows][None], clouds)
            low[rows] = np.fmin(low[rows], np.fmin.reduce(seen, axis=0))
            high[rows] = np.fmax(high[rows], np.fmax.reduce(seen, axis=0))
    shown = low <= high
    return Classifiers(kind[shown], points[shown], low[shown], high[shown])


def wrong_labellings(frames: np.ndarray, markers: int, count: int, generator: np.random.Generator) -> WrongLabellings:
    """`count` wrong labellings: 2 to `markers` labels go round among each other's points; severities equally likely.

    frames: indices of those to draw from. In one that lacks a marker fewer classifiers can be evaluated.
    """
    frame = generator.choice(frames, count)
    severity = generator.integers(2, markers + 1, count)
    order = generator.random((count, markers)).argsort(axis=1)
    labelling = np.tile(np.arange(markers), (count, 1))
    for row in range(count):
        chosen = order[row, : severity[row]]
        labelling[row, chosen] = np.roll(chosen, 1)
    return WrongLabellings(frame, labelling)


def rejections(classifiers: Classifiers, frame: np.ndarray, labelling: np.ndarray, clouds: Tables) -> np.ndarray:
    """(F, K) True where a weak classifier rejects a labelling (K, M) of a frame (K,).

    A classifier that cannot be evaluated, because a point is missing, rejects nothing.
    """
    rejected = np.zeros((len(classifiers), len(frame)), dtype=bool)
    for kind in range(len(FUNCTIONS)):
        rows = np.flatnonzero(classifiers.kind == kind)
        step = max(VALUES_ONCE // max(len(frame), 1), 1)
        for part in (rows[first : first + step] for first in range(0, len(rows), step)):
            points = labelling.T[classifiers.points[part]].transpose(0, 2, 1)
            seen = features.values(kind, frame, points, clouds)
            low, high = classifiers.low[part, None], classifiers.high[part, None]
            rejected[part] = (seen < low) | (seen > high)
    return rejected


def boost(rejected: np.ndarray, severity: np.ndarray, options: Boosting, start: Strong | None = None) -> Strong:
    """The tailored AdaBoost over a table of which weak classifier rejects which wrong labelling.

    rejected (F, K), severity (K,) number of wrong labels in each. Labellings are presented in order, over and over: one
    that φ rejects is passed over; otherwise every unselected classifier that rejects it gains the severity in weight.
    After each `period` labellings the heaviest joins φ. Done when φ rejects the share `accuracy` of all labellings, or
    when no unselected classifier rejects any that it accepts. `start` continues from an earlier φ.
    """
    count = rejected.shape[1]
    chosen = list(start.chosen) if start else []
    gained = list(start.weights) if start else []
    weights = np.zeros(len(rejected))
    unselected = np.ones(len(rejected), dtype=bool)
    unselected[chosen] = False
    caught = rejected[chosen].any(axis=0)
    # What no classifier rejects cannot be learned from; it stays in the share.
    useful = rejected.any(axis=0)
    first = 0
    while caught.sum() < options.accuracy * count and (useful & ~caught).any():
        batch = np.arange(first, first + options.period) % count
        first = (first + options.period) % count
        through = batch[useful[batch] & ~caught[batch]]
        if not len(through):
            continue
        weights += rejected[:, through] @ severity[through].astype(float)
        heaviest = int(np.where(unselected, weights, -1.0).argmax())
        unselected[heaviest] = False
        chosen.append(heaviest)
        gained.append(weights[heaviest])
        caught |= rejected[heaviest]
    return Strong(np.array(chosen, dtype=int), np.array(gained))
