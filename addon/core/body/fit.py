# SPDX-License-Identifier: GPL-3.0-or-later
"""Levenberg-Marquardt over many bodies at once: nine parameters for the paper's placement, all of them afterwards.

The data reaches a body only through its markers (`cost.Pull`), so normal equations are built from one 3 × 3 block a
marker however many cameras there are.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from .bodies import Bodies, BodyModel, Posed
from .cost import Pull


@dataclass(frozen=True)
class DampingOptions:
    """How steps are damped, as a share of the normal matrix' diagonal; reckoned, as usual for Levenberg-Marquardt.

    first     of the first step: nearly undamped, as starts are near
    smaller   factor after a step that lowered the cost
    larger    factor after one that did not
    lowest    below it the step is Gauss-Newton's
    highest   above it nothing moves
    ridge     share of the trace that keeps the covariance of parameters without data finite; the same of the
              largest diagonal entry in a step
    """

    first: float = 1e-3
    smaller: float = 0.2
    larger: float = 10.0
    lowest: float = 1e-7
    highest: float = 1e7
    ridge: float = 1e-9


DAMPING = DampingOptions()


@dataclass(frozen=True, eq=False)
class State:
    """B bodies and everything the next step asks for.

    cost (B,), gradient (B, P) and normal (B, P, P) are those of the data and the prior together; posed is where the
    bodies have their parts and columns (B, M, 3, P) how their markers move.
    """

    bodies: Bodies
    cost: np.ndarray
    gradient: np.ndarray
    normal: np.ndarray
    posed: Posed
    columns: np.ndarray

    def covariance(self) -> np.ndarray:
        """(B, M, 3, 3) m²: how uncertain data and prior leave each marker, from the curvature of the cost."""
        width = self.normal.shape[-1]
        ridge = DAMPING.ridge * np.einsum("bii->b", self.normal)[:, None, None] * np.eye(width)
        spread = np.linalg.inv(self.normal + ridge)
        flat = self.columns.reshape(len(self.columns), -1, width)
        wide = (flat @ spread).reshape(self.columns.shape)
        return wide @ self.columns.swapaxes(-1, -2)


@dataclass(frozen=True, eq=False)
class Fit:
    """The outcome of a fit.

    state  the last one
    trace  (steps + 1, B) the cost at the start and after every step; it never rises
    """

    state: State
    trace: np.ndarray

    @property
    def bodies(self) -> Bodies:
        """Where the bodies ended."""
        return self.state.bodies

    @property
    def cost(self) -> np.ndarray:
        """(B,) their final cost."""
        return self.state.cost


PullOf = Callable[[np.ndarray], Pull]


def fit_placement(model: BodyModel, start: Bodies, pull: PullOf, steps: int, prior=None) -> Fit:
    """The paper's fit: scale, rotation and translation (equation 6), joints and shape at rest.

    `pull(markers (B, M, 3))` is the data; `prior`, if any, has `placement_terms(bodies)` as `prior.Prior` has.
    """
    return _descend(start, lambda bodies: placement_state(model, bodies, pull, prior), steps)


def fit_body(model: BodyModel, start: Bodies, pull: PullOf, steps: int, prior) -> Fit:
    """The same fit with joints and shape freed, held by the prior as far as the data does not carry."""
    return _descend(start, lambda bodies: body_state(model, bodies, pull, prior), steps)


def placement_state(model: BodyModel, bodies: Bodies, pull: PullOf, prior=None) -> State:
    """The nine-parameter normal equations at `bodies`."""
    posed, columns = model.placement_derivatives(bodies)
    return _state(bodies, posed, columns, pull, prior and prior.placement_terms)


def body_state(model: BodyModel, bodies: Bodies, pull: PullOf, prior) -> State:
    """The normal equations of every parameter at `bodies`."""
    posed, columns = model.derivatives(bodies)
    return _state(bodies, posed, columns, pull, prior.terms)


def _state(bodies: Bodies, posed: Posed, columns: np.ndarray, pull: PullOf, prior_terms) -> State:
    data = pull(posed.markers)
    flat = columns.reshape(len(columns), -1, columns.shape[-1])
    weighted = (data.hessian @ columns).reshape(flat.shape)
    cost, normal = data.cost, flat.transpose(0, 2, 1) @ weighted
    gradient = (data.gradient.reshape(len(flat), 1, -1) @ flat)[:, 0]
    if prior_terms:
        prior_cost, slope, curve = prior_terms(bodies)
        cost, gradient, normal = cost + prior_cost, gradient + slope, normal + curve
    return State(bodies, cost, gradient, normal, posed, columns)


def _descend(start: Bodies, state_at: Callable[[Bodies], State], steps: int, options: DampingOptions = DAMPING) -> Fit:
    """Damped Gauss-Newton steps, each body with a damping of its own; a step that raises a body's cost is undone."""
    state = state_at(start)
    damping = np.full(len(start), options.first)
    trace = [state.cost]
    for _ in range(steps):
        tried = state_at(state.bodies.moved(-_damped_step(state.normal, state.gradient, damping)))
        better = tried.cost <= state.cost
        damping = damping * np.where(better, options.smaller, options.larger)
        damping = np.minimum(np.maximum(damping, options.lowest), options.highest)
        if better.all():
            state = tried
        elif better.any():
            state = _merged(state, tried, better)
        trace.append(state.cost)
    return Fit(state, np.array(trace))


def _damped_step(normal: np.ndarray, gradient: np.ndarray, damping: np.ndarray) -> np.ndarray:
    diagonal = np.einsum("bii->bi", normal)
    floor = DAMPING.ridge * diagonal.max(axis=1, keepdims=True) + 1e-12
    damped = normal.copy()
    np.einsum("bii->bi", damped)[...] += diagonal * damping[:, None] + floor
    return np.linalg.solve(damped, gradient[..., None])[..., 0]


def _merged(old, new, take: np.ndarray):
    """The dataclass of arrays `new` where `take` (B,), `old` elsewhere."""
    if isinstance(old, np.ndarray):
        return np.where(take.reshape(-1, *[1] * (old.ndim - 1)), new, old)
    return type(old)(*(_merged(getattr(old, name), getattr(new, name), take) for name in old.__dataclass_fields__))
