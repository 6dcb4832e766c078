# SPDX-License-Identifier: GPL-3.0-or-later
"""Second thoughts on a frame's names: a marker that does not belong to the body, and neighbours that changed names.

The three steps decide blob by blob. Here the whole body judges: a name is dropped when the body without it would not
have expected the marker there, and two neighbours are tried with each other's names, whole fit and all.
"""

from dataclasses import dataclass, replace

import numpy as np

from .fit import State, fit_body
from .labelling import Naming
from .subject import Setup, Subject, refit, slots_pull
from .views import View

STRANGER = 12.0  # squared deviations (three of them) beyond which two blobs that meet are somebody else's
NEIGHBOURS = 0.12  # m between markers that may have changed names
STEPS = 4
MOST_SWAPS = 24
CERTAIN = 8.0  # squared deviations that an exchange must gain before a track is doubted
ROOM = 1.25  # how much wider than the recorded people's a new subject's placement of markers is taken to be


def withdraw_strangers_to_body(naming: Naming, state: State, subject: Subject, setup: Setup):
    """Takes back the names of markers that only two cameras gave and that the rest of the body would not have expected.

    `state` is the fit to all names of a subject without offsets of its own. What the body would say without a marker
    follows from the marker's share in the fit: with residual r, covariance of the fit P and noise R, the squared
    deviation of the prediction without it is rᵀ (R - P)⁻¹ r.
    """
    points = naming.meeting.points
    doubtful = np.isfinite(points[:, 0]) & ((naming.rays >= 0).sum(axis=0) == 2)
    if not doubtful.any():
        return
    noise = ((ROOM * subject.own_sd) ** 2 + setup.rules.slack**2)[:, None, None] * np.eye(3)
    spread = state.covariance()[0]
    rest = noise - np.minimum(1, 0.9 * noise[:, :1, :1] / np.einsum("mii->m", spread)[:, None, None]) * spread
    residual = np.where(doubtful[:, None], points - state.posed.markers[0], 0)
    square = np.einsum("mi,mi->m", residual, np.linalg.solve(rest, residual[..., None])[..., 0])
    camera, marker = np.nonzero((naming.slot >= 0) & (doubtful & (square > STRANGER))[None])
    if len(camera):
        naming.withdraw(camera, marker)


@dataclass(frozen=True, eq=False)
class Swaps:
    """Pairs of markers that were tried with each other's names.

    pairs  (B, 2) markers
    loss   (B,) how much worse the body explains the blobs then; below zero: better
    """

    pairs: np.ndarray
    loss: np.ndarray


def try_swaps(view: View, naming: Naming, subject: Subject, state: State, setup: Setup, prior) -> Swaps:
    """Fits the body once for every pair of neighbours with their names exchanged.

    `subject` has no offsets of its own, `state` is its fit to the names as they are.
    """
    pairs = _neighbours(naming, state)
    if not len(pairs):
        return Swaps(pairs, np.zeros(0))
    slots = np.repeat(naming.rays[None], len(pairs) + 1, axis=0)
    each = np.arange(len(pairs)) + 1
    slots[each, :, pairs[:, 0]] = naming.rays[:, pairs[:, 1]].T
    slots[each, :, pairs[:, 1]] = naming.rays[:, pairs[:, 0]].T
    bodies = subject.bodies.pick(np.zeros(len(slots), dtype=int))
    fit = fit_body(
        setup.model, bodies, slots_pull(view, slots, naming.frame.metres, subject.own_sd, setup), STEPS, prior
    )
    return Swaps(pairs, fit.cost[1:] - fit.cost[0])


def swap_names(naming: Naming, first: int, second: int):
    """Exchanges two markers' names in every camera."""
    for array in (naming.slot, naming.step, naming.partner):
        array[:, [first, second]] = array[:, [second, first]]
    for marker in (first, second):
        camera = np.flatnonzero(naming.slot[:, marker] >= 0)
        naming.give(camera, marker, naming.slot[camera, marker], naming.step[camera, marker])


def exchanged(view: View, naming: Naming, subject: Subject, setup: Setup) -> list[tuple[int, int]]:
    """Pairs of markers that one frame says have each other's names, whatever the frames before it said."""
    fresh, state = refit(view, naming, without_own(subject, setup), setup, STEPS, setup.prior)
    swaps = try_swaps(view, naming, fresh, state, setup, setup.prior)
    return [(int(first), int(second)) for first, second in swaps.pairs[swaps.loss < -CERTAIN]]


def _neighbours(naming: Naming, state: State) -> np.ndarray:
    """(B, 2) pairs of markers of which at least one is named and that are near enough to be taken for each other."""
    points = np.where(np.isfinite(naming.meeting.points), naming.meeting.points, state.posed.markers[0])
    apart = np.linalg.norm(points[:, None] - points[None], axis=-1)
    named = (naming.slot >= 0).any(axis=0)
    near = np.triu((apart < NEIGHBOURS) & (named[:, None] | named[None]), 1)
    pairs = np.argwhere(near)
    return pairs[np.argsort(apart[near])[:MOST_SWAPS]]


def without_own(subject: Subject, setup: Setup) -> Subject:
    """The subject as if nothing were known of where it wears its markers."""
    bodies = replace(subject.bodies, own=np.zeros_like(subject.bodies.own))
    return replace(subject, bodies=bodies, own_sd=setup.marker_sd * float(bodies.scale.mean()))
