# SPDX-License-Identifier: GPL-3.0-or-later
"""Levenberg-Marquardt over many bodies at once: nine parameters for the paper's placement, all of them afterwards.

The data reaches a body only through its markers (`cost.Pull`), so normal equations are built from one 3 × 3 block a
marker however many cameras there are.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .body import Bodies, BodyModel
from .cost import Pull

FIRST_DAMPING = 1e-3
LEAST_DAMPING, MOST_DAMPING = 1e-7, 1e7


@dataclass(frozen=True, eq=False)
class Fit:
    """The outcome of a fit of B bodies.

    bodies  where they ended
    cost    (B,) their final cost
    trace   (steps + 1, B) the cost at the start and after every step; it never rises
    damping (B,) the last damping, to go on from
    """

    bodies: Bodies
    cost: np.ndarray
    trace: np.ndarray
    damping: np.ndarray


def fit_placement(model: BodyModel, start: Bodies, pull: Callable[[np.ndarray], Pull], steps: int, prior=None) -> Fit:
    """The paper's fit: scale, rotation and translation (equation 6), joints and shape at rest.

    `pull(markers (B, M, 3))` is the data; `prior`, if any, has `terms(bodies)` as `prior.Prior` has.
    """
    return _descend(start, lambda bodies: _normal_equations(*model.placement_derivatives(bodies), bodies, pull, prior), steps)


def fit_body(model: BodyModel, start: Bodies, pull: Callable[[np.ndarray], Pull], steps: int, prior, damping=None) -> Fit:
    """The same fit with joints and shape freed, held by the prior as far as the data does not carry."""

    def equations(bodies):
        posed, columns = model.derivatives(bodies)
        return _normal_equations(posed.markers, columns, bodies, pull, prior)

    return _descend(start, equations, steps, damping)


def _normal_equations(markers, columns, bodies, pull, prior):
    data = pull(markers)
    width = columns.shape[-1]
    flat = columns.reshape(len(columns), -1, width)
    weighted = (data.hessian @ columns).reshape(flat.shape)
    normal = flat.transpose(0, 2, 1) @ weighted
    gradient = (data.gradient.reshape(len(flat), 1, -1) @ flat)[:, 0]
    if prior is None:
        return data.cost, gradient, normal
    cost, slope, curve = prior.terms(bodies)
    return data.cost + cost, gradient + slope[:, :width], normal + curve[..., :width, :width]


def _descend(start: Bodies, equations, steps: int, damping=None) -> Fit:
    """Damped Gauss-Newton steps, each body with a damping of its own; a step that raises a body's cost is undone."""
    bodies = start
    cost, gradient, normal = equations(bodies)
    damping = np.full(len(start), FIRST_DAMPING) if damping is None else damping.copy()
    trace = [cost]
    for _ in range(steps):
        tried = bodies.moved(-_damped_step(normal, gradient, damping))
        new_cost, new_gradient, new_normal = equations(tried)
        better = new_cost <= cost
        damping = np.clip(np.where(better, damping / 5, damping * 10), LEAST_DAMPING, MOST_DAMPING)
        if better.all():
            bodies, cost, gradient, normal = tried, new_cost, new_gradient, new_normal
        elif better.any():
            bodies = _merged(bodies, tried, better)
            cost = np.where(better, new_cost, cost)
            gradient = np.where(better[:, None], new_gradient, gradient)
            normal = np.where(better[:, None, None], new_normal, normal)
        trace.append(cost)
    return Fit(bodies, cost, np.array(trace), damping)


def _damped_step(normal: np.ndarray, gradient: np.ndarray, damping: np.ndarray) -> np.ndarray:
    width = normal.shape[-1]
    diagonal = np.einsum("bii->bi", normal)
    floor = 1e-9 * diagonal.max(axis=1, keepdims=True) + 1e-12
    damped = normal + np.eye(width) * (diagonal * damping[:, None] + floor)[:, None, :]
    return np.linalg.solve(damped, gradient[..., None])[..., 0]


def _merged(old: Bodies, new: Bodies, take: np.ndarray) -> Bodies:
    """The new bodies where `take` (B,), the old ones elsewhere."""
    fields = {}
    for name in old.__dataclass_fields__:
        before, after = getattr(old, name), getattr(new, name)
        fields[name] = np.where(take.reshape(-1, *[1] * (before.ndim - 1)), after, before)
    return Bodies(**fields)


def covariance(model: BodyModel, bodies: Bodies, pull: Pull, prior) -> np.ndarray:
    """(B, M, 3, 3) m²: how uncertain the body leaves each marker, from the curvature of the cost at the solution."""
    _, columns = model.derivatives(bodies)
    flat = columns.reshape(len(columns), -1, columns.shape[-1])
    normal = flat.transpose(0, 2, 1) @ (pull.hessian @ columns).reshape(flat.shape) + prior.terms(bodies)[2]
    normal = normal + 1e-9 * np.einsum("bii->b", normal)[:, None, None] * np.eye(columns.shape[-1])
    spread = np.linalg.inv(normal)
    return columns @ spread[:, None] @ columns.swapaxes(-1, -2)
