# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the subject in one frame from nothing but its blobs, and says how sure it is of the placement."""

from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from ..body.bodies import Bodies, Posed
from ..body.prior import Prior
from ..data.errors import JobError
from ..geometry import rotations
from .cloud import Cloud, build_cloud
from .cost import blob_pull, cloud_pull
from .fit import Fit, State, body_state, fit_body, fit_placement
from .labelling import MISS, Expectation, Naming
from .placement import blob_centre, make_starts, principal_guess
from .subject import Setup, Subject, expect, learn_noise, learn_own, name, named_pull, refit
from .swaps import Swaps, swap_names, try_swaps, withdraw_strangers_to_body, without_own
from .views import View

FACINGS = 8
QUARTERS = 4
CLOUD_STAGES = ((0.20, 0.60, 3, False), (0.10, 0.30, 3, True), (0.05, 0.15, 4, True))
PLACEMENT_STAGES = ((0.20, 0.60, 5), (0.10, 0.30, 5))
BLOB_STAGES = ((0.06, 0.25, 3), (0.03, 0.12, 3), (0.02, 0.08, 3))
FINALISTS = 3
ROUNDS = 2
MOST_EXCHANGES = 3
UPRIGHT = 0.35  # rad, how far a subject who is looked for leans, standard deviation
HINTED_FACING = np.radians(60)  # how far off a user's idea of the facing may be
HANDICAP = 60.0  # squared deviations that a placement against the hint must be better by
HINTED_HEIGHT = 0.08  # m, how well a user knows the subject's height
FEWEST_POINTS = 4
RIVAL = 0.10  # m: two fits whose markers lie farther apart than this on average are rivals, not one solution
CLEAR_WIN = 0.98  # a placement surer than this needs no second opinion
UNNAMED = 12.0  # squared deviations that an unnamed blob counts for
CROWD = 0.4  # share of a frame's blobs that a subject should have
LUCK = 2.0  # how much better than chance the third rays of a crowd may come out by trying many placements
CONFIRMED = 0.5  # third rays a marker that show a subject in a crowd
TEMPER = 12.0  # by how much costs overstate their differences: blobs share their errors


@dataclass(frozen=True)
class Hints:
    """What the user knows of the subject: height in m, facing in rad from world +x; None where unknown."""

    height: float | None = None
    facing: float | None = None


@dataclass(frozen=True, eq=False)
class Found:
    """A subject found in a frame, with the names that follow from it.

    confidence  0 to 1, against the best rival placement
    trace       cost per step of the last fit, (steps + 1,)
    swaps       what exchanging neighbours would cost
    cost        of the last fit to the names, and of the blobs that it leaves unnamed
    """

    subject: Subject
    naming: Naming
    expected: Expectation
    confidence: float
    trace: np.ndarray
    swaps: Swaps
    cost: float

    @property
    def named(self) -> float:
        """Share of the markers that have a place in space, a single blob counting half."""
        views = (self.naming.slot >= 0).sum(axis=0)
        return float(np.minimum(views, 2).mean() / 2)

    @property
    def by_chance(self) -> bool:
        """True when a crowd of ghosts would do as well: most blobs unnamed, and few markers that a third ray confirms.

        A body bends until two rays meet in nearly every marker, whatever the blobs; third rays meet there by chance
        as often as blobs lie that densely.
        """
        frame = self.naming.frame
        rays = (self.naming.rays >= 0).sum(axis=0)
        if (self.naming.owner >= 0).sum() >= CROWD * frame.view.count:
            return False
        low, high = frame.sight.corners
        density = frame.view.real.sum(axis=1) / (high - low).prod(axis=1)
        chance = (density[:, None] * np.pi * (MISS * frame.metres / frame.depth) ** 2).sum()
        return bool(np.maximum(rays - 2, 0).sum() < CONFIRMED * len(rays) + LUCK * chance)

    @property
    def misfit(self) -> float:
        """How badly the names suit a body, a marker: for choosing among frames of one take. Missing markers count."""
        return self.cost / self.naming.slot.shape[1] + UNNAMED * (1 - self.named)


def find_subject(view: View, setup: Setup, hints: Hints) -> Found | None:
    """The subject in this frame, or None when the blobs hold nobody.

    Raises JobError when the cameras cannot fix a position at all.
    """
    cloud = build_cloud(view, setup.sight)
    if (cloud.weight > 0).sum() < FEWEST_POINTS:
        return None
    prior = _prior_for(hints, setup)
    starts = first_starts(view, cloud, setup, hints)
    bodies, cost = fit_cloud(starts, cloud, setup, prior)
    finalists = bodies.pick(_distinct(bodies, cost, setup)[:FINALISTS])
    fit = fit_blobs(finalists, view, setup, prior)
    best, rival, confidence = _judged(fit, _handicap(fit.bodies, hints))
    found = name_found(view, picked(fit.state, [best]), setup, prior, confidence, fit.trace[:, best])
    if rival is None or confidence > CLEAR_WIN:
        return found
    other = name_found(view, picked(fit.state, [rival]), setup, prior, confidence, fit.trace[:, rival])
    return _better_named(found, other)


def _better_named(first: Found, second: Found) -> Found:
    """Of two placements that the blobs could not tell apart, the one whose names make the better body."""
    lead = second.cost - first.cost
    better = first if lead >= 0 else second
    return replace(better, confidence=_chance(abs(lead)))


def _prior_for(hints: Hints, setup: Setup) -> Prior:
    """The marker set's prior for somebody who stands, and who is as tall as the user says."""
    if hints.height is None:
        return Prior(setup.model, upright_sd=UPRIGHT)
    return Prior(setup.model, upright_sd=UPRIGHT, height=hints.height, height_sd=HINTED_HEIGHT)


def _handicap(bodies: Bodies, hints: Hints) -> np.ndarray:
    """(B,) what it costs a body to face another way than the user says."""
    if hints.facing is None:
        return np.zeros(len(bodies))
    ahead = rotations.quaternion_to_matrix(bodies.quaternion)[:, :2, 0]
    agreement = ahead @ np.array([np.cos(hints.facing), np.sin(hints.facing)])
    return np.where(agreement < np.cos(HINTED_FACING), HANDICAP, 0.0)


def first_starts(view: View, cloud: Cloud, setup: Setup, hints: Hints) -> Bodies:
    """Rest bodies all around the blobs' centre, and one that faces as hinted."""
    guess = principal_guess(cloud, float(setup.model.markerset.rest_markers[:, 2].max()))
    try:
        point = blob_centre(view, setup.cameras.extrinsics)
    except JobError:
        point = np.average(cloud.points, axis=0, weights=cloud.weight)
    facings = guess.facing + np.arange(FACINGS) * 2 * np.pi / FACINGS
    if hints.facing is not None:
        facings = np.append(facings, hints.facing)
    return make_starts(setup.model, point, hints.height or guess.height, facings)


def fit_cloud(starts: Bodies, cloud: Cloud, setup: Setup, prior) -> tuple[Bodies, np.ndarray]:
    """All starts against the cloud, from coarse to fine; returns the bodies and their costs (B,)."""
    bodies = starts
    for softness, reach, steps, free in CLOUD_STAGES:
        pull = partial(_cloud_pull, cloud=cloud, softness=softness, reach=reach)
        fit_some = fit_body if free else fit_placement
        fit = fit_some(setup.model, bodies, pull, steps, prior)
        bodies = fit.bodies
    return bodies, fit.cost


def _cloud_pull(markers: np.ndarray, cloud: Cloud, softness: float, reach: float):
    return cloud_pull(markers, cloud.points, cloud.weight, softness, reach)


def fit_from(view: View, start: Bodies, setup: Setup) -> Fit:
    """The paper's whole fit from a given start of B bodies: nine parameters first, then joints and shape as well.

    Visible markers only, visibility renewed at every stage. The nine-parameter fit does not turn a body round, so every
    start is also tried turned by a quarter, a half and three quarters, and the best of the four is kept.
    """
    prior = Prior(setup.model, upright_sd=UPRIGHT)
    fit = fit_blobs(fit_nine(view, _turned_about(start, setup), setup).bodies, view, setup, prior)
    best = fit.cost.reshape(QUARTERS, -1).argmin(axis=0) * len(start) + np.arange(len(start))
    return Fit(picked(fit.state, best), fit.trace[:, best])


def fit_nine(view: View, start: Bodies, setup: Setup) -> State:
    """Ten iterations of the nine-parameter fit, visible markers only, visibility renewed in between."""
    bodies, posed = start, setup.model.pose(start)
    for softness, reach, steps in PLACEMENT_STAGES:
        pull = _visible_pull(bodies, posed, view, setup, softness, reach)
        state = fit_placement(setup.model, bodies, pull, steps, setup.prior).state
        bodies, posed = state.bodies, state.posed
    return state


def _turned_about(start: Bodies, setup: Setup) -> Bodies:
    """The bodies, then all of them turned by a quarter about the upright through their markers' middle, and so on."""
    count = len(start)
    middle = setup.model.pose(start).markers.mean(axis=1)
    bodies = start.pick(np.tile(np.arange(count), QUARTERS))
    angle = np.repeat(np.arange(QUARTERS), count) * (2 * np.pi / QUARTERS)
    turn = rotations.about_z(angle)
    arm = bodies.translation - middle[np.tile(np.arange(count), QUARTERS)]
    swung = (rotations.quaternion_to_matrix(turn) @ arm[..., None])[..., 0]
    return replace(
        bodies,
        quaternion=rotations.quaternion_product(turn, bodies.quaternion),
        translation=bodies.translation + swung - arm,
    )


def fit_blobs(bodies: Bodies, view: View, setup: Setup, prior):
    """Bodies against the blobs themselves, visible markers only, visibility renewed at every stage."""
    posed = setup.model.pose(bodies)
    for softness, reach, steps in BLOB_STAGES:
        pull = _visible_pull(bodies, posed, view, setup, softness, reach)
        fit = fit_body(setup.model, bodies, pull, steps, prior)
        bodies, posed = fit.bodies, fit.state.posed
    return fit


def _visible_pull(bodies: Bodies, posed: Posed, view: View, setup: Setup, softness: float, reach: float):
    """Equation 7 with the markers that are visible where the bodies are now."""
    visible = setup.visible(bodies.scale, posed)
    return lambda markers: blob_pull(markers, visible, view, setup.sight, softness, reach)


def name_found(view: View, state: State, setup: Setup, prior, confidence: float, trace: np.ndarray) -> Found:
    """Names the blobs of a placed body, learns from the names where this subject wears the markers, names again."""
    subject = Subject(state.bodies, setup.marker_sd * float(state.bodies.scale.mean()), setup.rules.pixel)
    expected = expect(subject, state, setup)
    for round_ in range(ROUNDS):
        naming = name(view, expected, subject, setup)
        subject = learn_noise(naming, without_own(subject, setup), setup, 0.7)
        subject, state = refit(view, naming, subject, setup, 3, prior)
        if round_ == ROUNDS - 1:
            swaps = settle(view, naming, subject, state, setup, prior)
            subject, state = refit(view, naming, subject, setup, 2, prior)
        withdraw_strangers_to_body(naming, state, subject, setup)
        subject = learn_own(naming.meeting.points, subject, state.posed, setup, 0.9)
        expected = expect(
            subject, body_state(setup.model, subject.bodies, named_pull(view, naming, subject, setup), prior), setup
        )
    naming = name(view, expected, subject, setup)
    unnamed = int((view.real & (naming.owner < 0)).sum())
    return Found(subject, naming, expected, confidence, trace, swaps, float(state.cost[0]) + UNNAMED * unnamed)


def settle(view: View, naming: Naming, subject: Subject, state: State, setup: Setup, prior) -> Swaps:
    """Gives neighbours each other's names for as long as that makes a better body; returns the last trial."""
    swaps = try_swaps(view, naming, subject, state, setup, prior)
    for _ in range(MOST_EXCHANGES):
        if not len(swaps.loss) or swaps.loss.min() >= 0:
            break
        swap_names(naming, swaps.orders[swaps.loss.argmin()])
        swaps = try_swaps(view, naming, subject, state, setup, prior)
    return swaps


def picked(state: State, index) -> State:
    """Some bodies of a state, at `index` (whole numbers)."""
    posed = Posed(*(getattr(state.posed, name)[index] for name in Posed.__dataclass_fields__))
    parts = (state.cost, state.gradient, state.normal)
    return State(state.bodies.pick(index), *(part[index] for part in parts), posed, state.columns[index])


def _distinct(bodies: Bodies, cost: np.ndarray, setup: Setup) -> np.ndarray:
    """Indices of the bodies, best first, without those that ended where a better one did."""
    markers = setup.model.pose(bodies).markers
    kept = []
    for index in np.argsort(cost):
        apart = np.linalg.norm(markers[kept] - markers[index], axis=-1).mean(axis=-1)
        if (apart > RIVAL / 2).all():
            kept.append(int(index))
    return np.array(kept)


def _judged(fit: Fit, handicap: np.ndarray) -> tuple[int, int | None, float]:
    """The best fit, its nearest rival in cost that puts the markers elsewhere (None: no rival), and how sure it is."""
    cost = fit.cost + handicap
    best = int(np.argmin(cost))
    markers = fit.state.posed.markers
    apart = np.linalg.norm(markers - markers[best], axis=-1).mean(axis=-1)
    rivals = np.flatnonzero(apart > RIVAL)
    if not len(rivals):
        return best, None, 1.0
    rival = int(rivals[np.argmin(cost[rivals])])
    return best, rival, _chance(cost[rival] - cost[best])


def _chance(lead: float) -> float:
    """How sure a lead in cost makes."""
    return float(1 / (1 + np.exp(-np.clip(lead / TEMPER, -50, 50))))
