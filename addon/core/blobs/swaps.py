# SPDX-License-Identifier: GPL-3.0-or-later
"""Second thoughts on a frame's names: neighbours that changed names.

The three steps decide blob by blob. Here the whole body judges: two neighbours are tried with each other's names, whole
fit and all.
"""

from dataclasses import dataclass, replace

import numpy as np

from ..geometry.rigid import pairwise_distances
from ..papers.virtual_occlusions.fit import State, fit_body
from ..papers.virtual_occlusions.labelling import Naming, doubles
from ..posing.posing import POSING
from .subject import Setup, Subject, refit, slots_pull


class SWAPS:
    """When names are thought over."""

    # squared deviations that an exchange must gain before a track is doubted; with 4 walks in five noisy cameras
    # (`body26`) have 1,230 wrong labels for 992
    min_gain: float = 5.0  # measured


MAX_FITS = 10  # of exchanges, those that promise most
MAX_EXCHANGES = 3  # of names in a frame; with more the placement is wrong
SWAP_STEPS = 4  # of a whole fit, from one that is near: Gauss-Newton has settled by then


@dataclass(frozen=True, eq=False)
class Swaps:
    """Exchanges of names that were tried on a frame."""

    orders: np.ndarray  # (B, M) marker m got the blobs that had the name of marker orders[b, m]
    loss: np.ndarray  # (B,) how much worse the body explains the blobs then; below zero: better


def try_swaps(naming: Naming, subject: Subject, state: State, setup: Setup, prior) -> Swaps:
    """Fits the body for the likeliest exchanges of names: of neighbours, of limbs, around a segment.

    `subject` has no offsets of its own, `state` is its fit to the names as they are. How far a first step would get
    says which exchanges are worth a whole fit.
    """
    orders, slots = _exchanges(naming, state, setup)
    if not len(orders) or (slots[0] >= 0).any(axis=0).sum() < POSING.min_markers:  # fewer hold no body
        return Swaps(orders[:0], np.zeros(0))
    worth = np.argsort(_first_steps(naming, slots, subject, state, setup, prior))[:MAX_FITS]
    return Swaps(orders[worth], _losses(naming, slots[np.append(0, 1 + worth)], subject, setup, prior))


def _losses(naming: Naming, slots: np.ndarray, subject: Subject, setup: Setup, prior) -> np.ndarray:
    """(B,) how much worse the body explains the blobs under each exchange, whole fits compared."""
    bodies = subject.bodies.pick(np.zeros(len(slots), dtype=int))
    fit = fit_body(setup.model, bodies, slots_pull(naming.frame, slots, subject, setup), SWAP_STEPS, prior)
    return fit.cost[1:] - fit.cost[0]


def _exchanges(naming: Naming, state: State, setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """The exchanges (B, M) that change this frame's names, each once, and the slots (1 + B, C, M) that they make."""
    pairs = _neighbours(naming, state)
    orders = np.tile(np.arange(naming.slot.shape[1]), (len(pairs), 1))
    each = np.arange(len(pairs))[:, None]
    orders[each, pairs] = pairs[:, ::-1]
    orders = np.concatenate([orders, setup.exchanges])
    slots = _exchanged_slots(naming, orders)
    changed = (slots[1:] != naming.rays).any(axis=(1, 2))
    _, first = np.unique(slots[1:].reshape(len(orders), naming.slot.size), axis=0, return_index=True)
    kept = np.array([index for index in np.sort(first) if changed[index]], dtype=int)
    return orders[kept], slots[np.append(0, 1 + kept)]


def _exchanged_slots(naming: Naming, orders: np.ndarray) -> np.ndarray:
    """(1 + B, C, M) the slots of the named blobs as they are, and under each exchange.

    Doubles are left out: as witnesses they would forbid the exchange that puts names right.
    """
    orders = np.concatenate([np.arange(naming.slot.shape[1])[None], orders])
    return np.where(doubles(naming), -1, naming.rays)[:, orders].swapaxes(0, 1)


def _first_steps(naming: Naming, slots: np.ndarray, subject: Subject, state: State, setup: Setup, prior) -> np.ndarray:
    """(B,) the cost that one undamped step from the fit as it is would promise each exchange.

    An exchange changes what a few markers say, so the normal equations are solved once, for the names as they are, and
    each exchange corrects their solution by its own markers alone (the matrix inversion lemma).
    """
    data = slots_pull(naming.frame, slots, subject, setup)(np.repeat(state.posed.markers, len(slots), axis=0))
    flat = state.columns.reshape(-1, state.columns.shape[-1])
    cost, slope, curve = prior.terms(state.bodies)
    normal = flat.T @ (data.hessian[0] @ state.columns[0]).reshape(flat.shape) + curve + 1e-6 * np.eye(flat.shape[1])
    gradient = data.gradient[0].ravel() @ flat + slope[0]
    solved = np.linalg.solve(normal, np.column_stack([flat.T, gradient]))
    spread, along = flat @ solved[:, :-1], flat @ solved[:, -1]
    promised = data.cost[1:] + cost - gradient @ solved[:, -1]
    changed = (slots[1:] != slots[0]).any(axis=1)
    count = changed.sum(axis=1)
    for size in np.unique(count):
        some = np.flatnonzero(count == size)
        marker = np.nonzero(changed[some])[1].reshape(len(some), size)
        promised[some] -= _corrections(data, some + 1, marker, spread, along)
    return promised


def _corrections(data, index: np.ndarray, marker: np.ndarray, spread: np.ndarray, along: np.ndarray) -> np.ndarray:
    """(N,) by how much more the step gains where markers (N, K) say what set `index` (N,) of `data` has them say.

    `spread` (3 M, 3 M) is the covariance of all markers as set 0 has it, `along` (3 M,) how far its step moves them.
    """
    count, size = marker.shape
    rows = (3 * marker[..., None] + np.arange(3)).reshape(count, 3 * size)
    slope = (data.gradient[index[:, None], marker] - data.gradient[0, marker]).reshape(count, -1)
    blocks, each = np.zeros((count, size, 3, size, 3)), np.arange(size)
    blocks[:, each, :, each] = (data.hessian[index[:, None], marker] - data.hessian[0, marker]).swapaxes(0, 1)
    curve = blocks.reshape(count, 3 * size, 3 * size)
    spread, along = spread[rows[:, :, None], rows[:, None]], along[rows]
    moved = along + (spread @ slope[..., None])[..., 0]
    bent = np.linalg.solve(np.eye(3 * size) + curve @ spread, curve @ moved[..., None])[..., 0]
    return np.einsum("ni,ni->n", slope, along + moved) - np.einsum("ni,ni->n", moved, bent)


def swap_names(naming: Naming, order: np.ndarray):
    """Exchanges names in every camera: marker m gets the blobs of marker order[m]. Doubles among them lose theirs."""
    naming.withdraw(*np.nonzero(doubles(naming) & (order != np.arange(len(order)))))
    for array in (naming.slot, naming.step, naming.partner):
        array[:] = array[:, order]
    camera, marker = np.nonzero(naming.slot >= 0)
    naming.give(camera, marker, naming.slot[camera, marker], naming.step[camera, marker])


def exchanged(naming: Naming, subject: Subject, setup: Setup) -> list[tuple[int, ...]]:
    """Exchanges that would put one frame's names right, the best first, whatever the frames before it said."""
    fresh, state = refit(naming, without_own(subject, setup), setup, SWAP_STEPS, setup.prior)
    swaps = try_swaps(naming, fresh, state, setup, setup.prior)
    order = np.argsort(swaps.loss)
    return [tuple(map(int, swaps.orders[index])) for index in order if swaps.loss[index] < -SWAPS.min_gain]


def exchange_loss(naming: Naming, subject: Subject, setup: Setup, order: tuple[int, ...]) -> float:
    """How much worse one frame's body would be for an exchange, whatever the frames before it said."""
    fresh, _ = refit(naming, without_own(subject, setup), setup, SWAP_STEPS, setup.prior)
    slots = _exchanged_slots(naming, np.array([order]))
    return float(_losses(naming, slots, fresh, setup, setup.prior)[0])


def _neighbours(naming: Naming, state: State) -> np.ndarray:
    """(B, 2) pairs of markers of which at least one is named and that are near enough to be taken for each other."""
    points = np.where(np.isfinite(naming.meeting.points), naming.meeting.points, state.posed.markers[0])
    named = (naming.slot >= 0).any(axis=0)
    return np.argwhere(
        np.triu((pairwise_distances(points) < naming.frame.rules.max_distance_m) & (named[:, None] | named[None]), 1)
    )


def without_own(subject: Subject, setup: Setup) -> Subject:
    """The subject as if nothing were known of its own marker layout."""
    bodies = replace(subject.bodies, own=np.zeros_like(subject.bodies.own))
    return replace(subject, bodies=bodies, own_sd=setup.marker_sd * float(bodies.scale.mean()))
