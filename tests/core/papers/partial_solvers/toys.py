# SPDX-License-Identifier: GPL-3.0-or-later
"""Small lopsided clouds that move, for the tests of the ensemble."""

import numpy as np

from addon.core.papers.partial_solvers.boosting import learn_intervals
from addon.core.papers.partial_solvers.features import all_features, tables
from addon.core.papers.partial_solvers.model import FUNCTIONS


def moving(markers: int = 6, frames: int = 200, sway: float = 0.04, seed: int = 0) -> np.ndarray:
    """(T, M, 3) m: one shape that turns about the vertical, walks about and wobbles."""
    generator = np.random.default_rng(seed)
    shape = generator.uniform(-0.5, 0.5, (markers, 3))
    wobble = shape + generator.normal(scale=sway, size=(frames, markers, 3))
    yaw = generator.uniform(0, 2 * np.pi, frames)
    turned = wobble.copy()
    turned[..., 0] = np.cos(yaw)[:, None] * wobble[..., 0] - np.sin(yaw)[:, None] * wobble[..., 1]
    turned[..., 1] = np.sin(yaw)[:, None] * wobble[..., 0] + np.cos(yaw)[:, None] * wobble[..., 1]
    return turned + generator.uniform(-2, 2, (frames, 1, 3)) * [1, 1, 0]


def pool_of(points: np.ndarray, functions=FUNCTIONS):
    """All weak classifiers of labelled frames."""
    return learn_intervals(tables(points), *all_features(points.shape[1], functions))
