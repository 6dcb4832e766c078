# SPDX-License-Identifier: GPL-3.0-or-later
"""The first paper's own steps that the labelling takes otherwise: the fit from a given start, and the bounding box."""

import numpy as np

from addon.core.blobs.search import FINDING, fit_blobs, visible_pull
from addon.core.blobs.subject import Setup
from addon.core.body.bodies import Bodies
from addon.core.body.prior import Prior
from addon.core.geometry.views import View
from addon.core.papers.virtual_occlusions.cloud import Cloud
from addon.core.papers.virtual_occlusions.cost import Pull
from addon.core.papers.virtual_occlusions.fit import Fit, State, fit_placement
from addon.core.papers.virtual_occlusions.placement import Guess, extent, stature

# Softness in m, reach in m, iterations.
PLACEMENT_STAGES = ((0.20, 0.60, 5), (0.10, 0.30, 5))


def fit_from(view: View, start: Bodies, setup: Setup) -> Fit:
    """The paper's whole fit from a given start of B bodies: nine parameters first, then joints and shape as well.

    Visible markers only, visibility renewed at every stage.
    """
    prior = Prior(setup.model, upright_sd=FINDING.upright_sd_rad)
    return fit_blobs(fit_nine(view, start, setup).bodies, view, setup, prior)


def fit_nine(view: View, start: Bodies, setup: Setup) -> State:
    """Ten iterations of the nine-parameter fit, visible markers only, visibility renewed in between."""
    bodies, posed = start, setup.model.pose(start)
    for softness, reach, steps in PLACEMENT_STAGES:
        pull = visible_pull(bodies, posed, view, setup, softness, reach)
        state = fit_placement(setup.model, bodies, pull, steps, setup.prior).state
        bodies, posed = state.bodies, state.posed
    return state


def bounding_box_guess(cloud: Cloud, tallest_marker: float) -> Guess:
    """Height and facing from the cloud's upright bounding box: a body is wider than it is deep.

    `tallest_marker` is the height of the model's highest marker, heights. The narrowest of boxes turned about the
    vertical says along which line the subject faces, not in which of two directions.
    """
    angles = np.arange(0, np.pi, np.pi / 36)
    across = cloud.points[:, :2] @ np.stack([np.cos(angles), np.sin(angles)])
    width = extent(across, cloud.weight)
    narrowest = int(np.argmin(width))
    return Guess(stature(cloud, tallest_marker), float(angles[narrowest]))


def point_pull(markers: np.ndarray, targets: np.ndarray, deviation: np.ndarray) -> Pull:
    """Named points in space: targets (B, M, 3) m, NaN where unknown, with standard deviations (B, M) m."""
    known = np.isfinite(targets[..., 0])
    offset = np.where(known[..., None], markers - np.where(known[..., None], targets, 0), 0)
    weight = known / deviation**2
    cost = (weight * np.einsum("bmi,bmi->bm", offset, offset)).sum(axis=1)
    return Pull(cost, weight[..., None] * offset, weight[..., None, None] * np.eye(3))
