# SPDX-License-Identifier: GPL-3.0-or-later
"""The first paper's own steps that the labelling takes otherwise: the fit from a given start, and the bounding box."""

from dataclasses import replace

import numpy as np

from addon.core.blobs.search import FINDING, fit_blobs, picked, visible_pull
from addon.core.blobs.subject import Setup
from addon.core.body.bodies import Bodies
from addon.core.body.prior import Prior
from addon.core.geometry import rotations
from addon.core.geometry.views import View
from addon.core.papers.virtual_occlusions.cloud import Cloud
from addon.core.papers.virtual_occlusions.cost import Pull
from addon.core.papers.virtual_occlusions.fit import Fit, State, fit_placement
from addon.core.papers.virtual_occlusions.placement import Guess, extent, stature

QUARTERS = 4
# Softness in m, reach in m, iterations.
PLACEMENT_STAGES = ((0.20, 0.60, 5), (0.10, 0.30, 5))


def stages(iterations: int) -> tuple[tuple[float, float, int], ...]:
    """`PLACEMENT_STAGES` with another number of iterations, half of them, rounded up, in the first stage."""
    half = -(-iterations // 2)
    return tuple((*stage[:2], steps) for stage, steps in zip(PLACEMENT_STAGES, (half, iterations - half), strict=True))


def fit_from(view: View, start: Bodies, setup: Setup, quarters: int = QUARTERS) -> Fit:
    """The paper's whole fit from a given start of B bodies: nine parameters first, then joints and shape as well.

    Visible markers only, visibility renewed at every stage. The nine-parameter fit does not turn a body round, so every
    start is also tried turned by a quarter, a half and three quarters, and the best of the four is kept; with
    `quarters` 1 it is not.
    """
    prior = Prior(setup.model, upright_sd=FINDING.upright_sd_rad)
    fit = fit_blobs(fit_nine(view, _turned_about(start, setup, quarters), setup).bodies, view, setup, prior)
    best = fit.cost.reshape(quarters, -1).argmin(axis=0) * len(start) + np.arange(len(start))
    return Fit(picked(fit.state, best), fit.trace[:, best])


def fit_nine(view: View, start: Bodies, setup: Setup, stages=PLACEMENT_STAGES) -> State:
    """Ten iterations of the nine-parameter fit, visible markers only, visibility renewed in between."""
    bodies, posed = start, setup.model.pose(start)
    for softness, reach, steps in stages:
        pull = visible_pull(bodies, posed, view, setup, softness, reach)
        state = fit_placement(setup.model, bodies, pull, steps, setup.prior).state
        bodies, posed = state.bodies, state.posed
    return state


def _turned_about(start: Bodies, setup: Setup, quarters: int) -> Bodies:
    """The bodies, then all of them turned by a quarter about the upright through their markers' middle, and so on."""
    count = len(start)
    middle = setup.model.pose(start).markers.mean(axis=1)
    bodies = start.pick(np.tile(np.arange(count), quarters))
    angle = np.repeat(np.arange(quarters), count) * (2 * np.pi / QUARTERS)
    turn = rotations.about_z(angle)
    arm = bodies.translation - middle[np.tile(np.arange(count), quarters)]
    swung = (rotations.quaternion_to_matrix(turn) @ arm[..., None])[..., 0]
    return replace(
        bodies,
        quaternion=rotations.quaternion_product(turn, bodies.quaternion),
        translation=bodies.translation + swung - arm,
    )


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
