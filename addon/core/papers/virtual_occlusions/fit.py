# SPDX-License-Identifier: GPL-3.0-or-later
"""Levenberg-Marquardt over many bodies at once: nine parameters for the paper's placement, all of them afterwards.

The data reaches a body only through its markers (`cost.Pull`), so normal equations are built from one 3 × 3 block a
marker however many cameras there are.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...body.bodies import PLACEMENT, Bodies, BodyModel, Posed
from ...kernels import calls, in_use, stands_for
from .cost import DataPull, Pull


@dataclass(frozen=True)
class DampingOptions:
    """How steps are damped, as a share of the normal matrix' diagonal."""

    first: float  # of the first step
    smaller: float  # factor after a step that lowered the cost
    larger: float  # factor after one that did not
    lowest: float  # below it the step is Gauss-Newton's
    highest: float  # above it nothing moves
    # share of the trace that keeps the covariance of parameters without data finite; the same of the largest diagonal
    # entry in a step
    ridge: float


# Levenberg-Marquardt's usual: nearly undamped, as starts are near; back by Marquardt's factor of ten, on by five; ends
# that only keep the damping a number.
DAMPING = DampingOptions(first=1e-3, smaller=0.2, larger=10.0, lowest=1e-7, highest=1e7, ridge=1e-9)


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
        return marker_covariance(self.normal, self.columns, DAMPING.ridge)


@dataclass(frozen=True, eq=False)
class Fit:
    """The outcome of a fit."""

    state: State  # the last one
    trace: np.ndarray  # (steps + 1, B) the cost at the start and after every step; it never rises

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
    return descend(model, start, pull, steps, prior, PLACEMENT) or _descend(
        start, lambda bodies: placement_state(model, bodies, pull, prior), steps
    )


def fit_body(model: BodyModel, start: Bodies, pull: PullOf, steps: int, prior) -> Fit:
    """The same fit with joints and shape freed, held by the prior as far as the data does not carry."""
    return descend(model, start, pull, steps, prior, model.parameters) or _descend(
        start, lambda bodies: body_state(model, bodies, pull, prior), steps
    )


def fit_until_still(
    model: BodyModel,
    start: Bodies,
    pull_on: Callable[[np.ndarray], PullOf],
    steps: int,
    prior,
    at_once: int,
    still: float,
) -> Bodies:
    """Bodies fitted as by `fit_body`, each until it is still, so many `steps` at most.

    That is when `at_once` steps ended with one that lowered its cost by no more than `still`. `pull_on(index)` is the
    data of some of the bodies (K,).
    """
    data = _compiled(model, start, pull_on(np.arange(len(start))), prior)
    if data is not None:
        rows = calls.fit_until_still(model, start, data, steps, at_once, still, prior, model.parameters, DAMPING)
        if rows is not None:
            return model.of_rows(rows, start.own)
    bodies, moving = Bodies.join([start]), np.arange(len(start))
    for done in range(0, steps, at_once):
        fit = fit_body(model, bodies.pick(moving), pull_on(moving), min(at_once, steps - done), prior)
        for name in Bodies.__dataclass_fields__:
            getattr(bodies, name)[moving] = getattr(fit.bodies, name)
        gained = fit.trace[-2] - fit.trace[-1]
        # A step that was undone gained nothing, and the next is a shorter one.
        moving = moving[(gained > still) | (gained == 0)]
        if not len(moving):
            break
    return bodies


def _compiled(model: BodyModel, start: Bodies, pull: PullOf, prior) -> calls.PullOfData | None:
    """The data as the compiled library takes it; None where there is none, or it does not know this pull or prior."""
    if in_use() and isinstance(pull, DataPull) and prior is not None:
        return pull.compiled(len(start), model.marker_count)
    return None


def descend(model: BodyModel, start: Bodies, pull: PullOf, steps: int, prior, width: int) -> Fit | None:
    """The fit by the compiled library, where there is one that knows this pull and this prior."""
    data = _compiled(model, start, pull, prior)
    done = None if data is None else calls.fit_body(model, start, data, steps, prior, width, DAMPING)
    if done is None:
        return None
    rows, gradient, normal, *posed, columns, trace = done
    return Fit(State(model.of_rows(rows, start.own), trace[-1], gradient, normal, Posed(*posed), columns), trace)


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
    cost, (count, width) = data.cost, (len(columns), columns.shape[-1])
    gradient, normal = np.zeros((count, width)), np.zeros((count, width, width))
    if prior_terms:
        prior_cost, gradient[:], normal[:] = prior_terms(bodies)
        cost = cost + prior_cost
    add_normal(columns, data.gradient, data.hessian, gradient, normal)
    return State(bodies, cost, gradient, normal, posed, columns)


def add_normal(columns, slopes, curves, gradient: np.ndarray, normal: np.ndarray):
    """Adds what the markers' pulls (B, M, 3) and (B, M, 3, 3) say to gradient (B, P) and normal (B, P, P), in place."""
    flat = columns.reshape(len(columns), -1, columns.shape[-1])
    normal += flat.transpose(0, 2, 1) @ (curves @ columns).reshape(flat.shape)
    gradient += (slopes.reshape(len(flat), 1, -1) @ flat)[:, 0]


@stands_for(calls.covariance)
def marker_covariance(normal: np.ndarray, columns: np.ndarray, ridge: float) -> np.ndarray:
    """See `State.covariance`; the normal gets `ridge` of its trace on its diagonal."""
    width = normal.shape[-1]
    spread = np.linalg.inv(normal + ridge * np.einsum("bii->b", normal)[:, None, None] * np.eye(width))
    flat = columns.reshape(len(columns), -1, width)
    return (flat @ spread).reshape(columns.shape) @ columns.swapaxes(-1, -2)


def _descend(start: Bodies, state_at: Callable[[Bodies], State], steps: int) -> Fit:
    """Damped Gauss-Newton steps, each body with a damping of its own; a step that raises a body's cost is undone."""
    state = state_at(start)
    damping = np.full(len(start), DAMPING.first)
    trace = [state.cost]
    for _ in range(steps):
        tried = state_at(state.bodies.moved(-damped_step(state.normal, state.gradient, damping, DAMPING.ridge)))
        better = tried.cost <= state.cost
        damping = damping * np.where(better, DAMPING.smaller, DAMPING.larger)
        damping = np.minimum(np.maximum(damping, DAMPING.lowest), DAMPING.highest)
        if better.all():
            state = tried
        elif better.any():
            state = _merged(state, tried, better)
        trace.append(state.cost)
    return Fit(state, np.array(trace))


def damped_step(normal: np.ndarray, gradient: np.ndarray, damping: np.ndarray, ridge: float) -> np.ndarray:
    """(B, P) solutions of the damped normal equations."""
    diagonal = np.einsum("bii->bi", normal)
    floor = ridge * diagonal.max(axis=1, keepdims=True) + 1e-12
    damped = normal.copy()
    np.einsum("bii->bi", damped)[...] += diagonal * damping[:, None] + floor
    return np.linalg.solve(damped, gradient[..., None])[..., 0]


def _merged(old, new, take: np.ndarray):
    """The dataclass of arrays `new` where `take` (B,), `old` elsewhere."""
    if isinstance(old, np.ndarray):
        return np.where(take.reshape(-1, *[1] * (old.ndim - 1)), new, old)
    return type(old)(*(_merged(getattr(old, name), getattr(new, name), take) for name in old.__dataclass_fields__))
