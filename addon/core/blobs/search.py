# SPDX-License-Identifier: GPL-3.0-or-later
"""Finds the subject in one frame from nothing but its blobs, and says how sure it is of the placement."""

from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import Bodies, BodyModel, Posed
from ..body.prior import Prior
from ..data.errors import JobError
from ..geometry import rotations
from ..geometry.views import VIEWING, View
from ..papers.virtual_occlusions.cloud import Cloud, build_cloud
from ..papers.virtual_occlusions.cost import BlobPull, CloudPull
from ..papers.virtual_occlusions.fit import Fit, State, body_state, fit_body, fit_placement
from ..papers.virtual_occlusions.labelling import Expectation, Frame, Naming, give_nearer, name_merged
from ..papers.virtual_occlusions.placement import blob_centre, make_starts, principal_guess
from ..posing.posing import POSING
from .jointly import JOINTLY, name_jointly
from .subject import SUBJECT, Setup, Subject, expect, learn_noise, learn_own, name, named_pull, refit
from .swaps import MAX_EXCHANGES, Swaps, swap_names, try_swaps, without_own


class FINDING:
    """How a subject is looked for in one frame."""

    facings: int = 8  # paper, 6: a start is good within 20° of the subject; of eight all around one is within 23°
    # how far a subject who is looked for leans, somebody who walks, stands or bends
    upright_sd_rad: float = 0.35  # physical
    # for each blob, and each image of a marker that should be seen; a body that costs more may hold its arms
    # otherwise. On people with their arms set (`tests.accuracy.strangers`) right bodies and wrong ones overlap
    # between 2.5 and 2.7
    good_cost: float = 2.3  # measured
    # two fits whose markers are farther from each other than this on average are two solutions, as limbs are that
    # thick; the finalists differ by half as much
    min_distance_m: float = 0.10  # physical
    temper: float = 12.0  # physical: by how much costs overstate their differences, as a marker's blobs share its error
    # a placement surer than this needs no second opinion, one in fifty is wrong
    clear_confidence: float = 0.98  # physical
    noise_rate: float = 0.7  # physical: share of the noise that a round shows which is taken over, and
    # share of what a marker is off that its own offset takes over; nearly all, as little is known yet
    own_rate: float = 0.9  # physical
    max_facing_error_rad: float = float(np.radians(60))  # how far off a user's idea of the facing may be
    # squared deviations that a placement against a hint, or against a blob that a person named, must be better by;
    # people err less often than fits do
    hint_cost: float = 60.0  # physical
    height_sd_m: float = 0.08  # physical: standard deviation of a height, with shoes or without, measured or remembered
    # third rays a marker that show a subject in a crowd, beyond those that meet by chance
    min_confirmed: float = 0.5  # physical
    # how much better than chance third rays may come out by trying many placements
    chance_factor: float = 2.0  # physical


# Softness and reach of each fit in m, from a step's length down to how far a layout varies that nobody has seen, and on
# to that of blobs. Measured: with stages of 0.08, 0.04 and 0.02 m and four times their reach 201 labels of walks in
# five noisy cameras (`gait15`) are wrong, with these 141.
CLOUD_STAGES = ((0.20, 0.60), (0.10, 0.30), (0.05, 0.15))
BLOB_STAGES = ((0.06, 0.25), (0.03, 0.12), (0.02, 0.08))
MAX_FINALISTS = 3  # of the fits to the cloud, best first, that are fitted to blobs
STAGE_STEPS = 3  # iterations of each stage, and of a fit to names: the first ones gain most (section 6)
SETTLED_STEPS = 2  # iterations once exchanges of names are settled
NAMING_ROUNDS = 2  # of naming: names show how the markers sit on this subject, which sharpens the next round
JOINT_ROUNDS = 3  # of naming a frame that is alone all at once; names hardly ever change in a fourth
# Turns of the left upper arm and forearm about the model's axes (ahead, left, up), rad; the right arm is the mirror
# image. At rest arms hang at 40° from the body, so an arm is raised to the side, overhead or ahead, and an elbow is
# bent or folded.
HELD = 1.1 * np.array(
    [
        [[1, 0, 0], [0, 0, 0]],
        [[2, 0, 0], [0, 0, 0]],
        [[0, -1, 0], [0, 0, 0]],
        [[0, 0, 0], [0, -1, 0]],
        [[0, 0, 0], [0, -2, 0]],
    ]
)
OTHER_ARM = np.array([-1.0, 1.0, -1.0])  # a rotation vector, mirrored


@dataclass(frozen=True)
class Hints:
    """What the user knows of the subject: height in m, facing in rad from world +x; None where unknown."""

    height: float | None = None
    facing: float | None = None


NO_HINTS = Hints()


@dataclass(frozen=True, eq=False)
class Found:
    """A subject found in a frame, with the names that follow from it."""

    subject: Subject
    naming: Naming
    expected: Expectation
    confidence: float  # 0 to 1, against the next best placement
    swaps: Swaps  # what exchanging neighbours would cost
    cost: float  # of the last fit to the names, and of the blobs that it leaves unnamed

    @property
    def named(self) -> float:
        """Share of the markers that have a place in space, a single blob counting half."""
        views = (self.naming.slot >= 0).sum(axis=0)
        return float(np.minimum(views, 2).mean() / 2)

    @property
    def complete(self) -> float:
        """The same as a share of what the cameras can see of the body: two cameras see half of its markers once."""
        views, due = (seen.sum(axis=0) for seen in (self.naming.slot >= 0, self.expected.visible))
        return float(np.minimum(views, 2).sum() / max(np.minimum(due, 2).sum(), 1))

    @property
    def by_chance(self) -> bool:
        """True when a crowd of ghosts would do as well: most blobs unnamed, and few markers that a third ray confirms.

        A body bends until two rays meet in nearly every marker, whatever the blobs; third rays meet there by chance
        as often as blobs lie that densely.
        """
        frame = self.naming.frame
        rays = (self.naming.rays >= 0).sum(axis=0)
        if (self.naming.owner >= 0).sum() >= SUBJECT.min_named * frame.view.count:
            return False
        low, high = frame.sight.corners
        density = frame.view.real.sum(axis=1) / (high - low).prod(axis=1)
        chance = (density[:, None] * np.pi * (frame.rules.max_miss * frame.metres / frame.depth) ** 2).sum()
        expected = FINDING.min_confirmed * len(rays) + FINDING.chance_factor * chance
        return bool(np.maximum(rays - 2, 0).sum() < expected)

    @property
    def marker_cost(self) -> float:
        """How badly the names suit a body, a marker: for choosing among frames of one take. Missing markers count."""
        return self.cost / self.naming.slot.shape[1] + self.naming.frame.rules.max_square * (1 - self.named)


def find_subject(
    view: View, setup: Setup, hints: Hints, fixed: np.ndarray | None = None, alone: bool = False
) -> Found | None:
    """The subject in this frame, or None when the blobs hold nobody.

    `fixed` (C, M) are the blobs that a person named, -1 where nobody did; they say which placement is right. A frame
    that is `alone` is not one of a take that will be followed from it, so all that it says of its names is used here.
    Raises JobError when the cameras cannot fix a position at all.
    """
    cloud = build_cloud(view, setup.sight)
    if (cloud.weight > 0).sum() < POSING.min_markers:
        return None
    told = {} if hints.height is None else {"height": hints.height, "height_sd": FINDING.height_sd_m}
    prior = Prior(setup.model, upright_sd=FINDING.upright_sd_rad, **told)
    starts = first_starts(view, cloud, setup, hints)
    fit = _fit_starts(starts, cloud, view, setup, prior)
    if _mean_cost(fit, view, setup) > FINDING.good_cost:
        fit = _fit_starts(starts, cloud, view, setup, prior, arms=True)
    cost = fit.cost + _against_facing(fit.bodies, hints) + _off_fixed(fit.state, view, setup, fixed)
    best, second, confidence = _judged(cost, fit.state.posed.markers)

    def named(index: int) -> Found:
        placed = picked(fit.state, [index])
        found = name_found(view, placed, setup, prior, confidence, fixed)
        return name_alone(found, placed, setup, prior, fixed) if alone else found

    found = named(best)
    if second is None or confidence > FINDING.clear_confidence:
        return found
    # The blobs could not decide between the two; whose names make the better body is right.
    other = named(second)
    lead = other.cost - found.cost
    return replace(found if lead >= 0 else other, confidence=_chance(abs(lead)))


def _fit_starts(starts: Bodies, cloud: Cloud, view: View, setup: Setup, prior, arms: bool = False) -> Fit:
    """The best of the starts against the cloud, against the blobs."""
    bodies, cost = fit_cloud(starts, cloud, setup, prior, arms)
    finalists = bodies.pick(_distinct(bodies, cost, setup)[:MAX_FINALISTS])
    return fit_blobs(finalists, view, setup, prior)


def _mean_cost(fit: Fit, view: View, setup: Setup) -> float:
    """What the best body costs for each blob, and each image of a marker that should have one."""
    best = int(np.argmin(fit.cost))
    state = picked(fit.state, [best])
    due = int(setup.visible(state.bodies.scale, state.posed).sum())
    return float(fit.cost[best]) / max(view.count + due, 1)


def _against_facing(bodies: Bodies, hints: Hints) -> np.ndarray:
    """(B,) what it costs a body to face elsewhere than the user says."""
    if hints.facing is None:
        return np.zeros(len(bodies))
    ahead = rotations.quaternion_to_matrix(bodies.quaternion)[:, :2, 0]
    agreement = ahead @ np.array([np.cos(hints.facing), np.sin(hints.facing)])
    return np.where(agreement < np.cos(FINDING.max_facing_error_rad), FINDING.hint_cost, 0.0)


def _off_fixed(state: State, view: View, setup: Setup, fixed: np.ndarray | None) -> np.ndarray:
    """(B,) what it costs bodies that the blobs which a person named (C, M) are far from where they have the markers."""
    if fixed is None:
        return np.zeros(len(state.bodies))
    camera, marker = np.nonzero(fixed >= 0)
    local = setup.sight.local(state.posed.markers)
    off = view.image[camera, fixed[camera, marker]] - setup.sight.image(local)[:, camera, marker]
    metres = np.linalg.norm(off, axis=-1) * np.maximum(local[:, camera, marker, 2], VIEWING.min_depth_m)
    return FINDING.hint_cost * np.minimum(metres / FINDING.min_distance_m, 1).sum(axis=1)


def first_starts(view: View, cloud: Cloud, setup: Setup, hints: Hints) -> Bodies:
    """Rest bodies all around the blobs' centre, and one that faces as hinted."""
    guess = principal_guess(cloud, float(setup.model.markerset.rest_markers[:, 2].max()))
    try:
        point = blob_centre(view, setup.cameras.extrinsics)
    except JobError:
        point = np.average(cloud.points, axis=0, weights=cloud.weight)
    facings = guess.facing + np.arange(FINDING.facings) * 2 * np.pi / FINDING.facings
    if hints.facing is not None:
        facings = np.append(facings, hints.facing)
    return make_starts(setup.model, point, hints.height or guess.height, facings)


def fit_cloud(starts: Bodies, cloud: Cloud, setup: Setup, prior, arms: bool = False) -> tuple[Bodies, np.ndarray]:
    """All starts against the cloud, from coarse to fine; returns the bodies and their costs (B,).

    With `arms`, also with their arms held otherwise.
    """
    first, *finer = (CloudPull(cloud.points, cloud.weight, *stage) for stage in CLOUD_STAGES)
    fit = fit_placement(setup.model, starts, first, STAGE_STEPS, prior)
    bodies = with_arms_held(fit.bodies, setup.model) if arms else fit.bodies
    for pull in finer:
        fit = fit_body(setup.model, bodies, pull, STAGE_STEPS, prior)
        bodies = fit.bodies
    return bodies, fit.cost


def with_arms_held(bodies: Bodies, model: BodyModel) -> Bodies:
    """The bodies as they are, and each once more for every way to hold the arms; only as they are without arms."""
    names = model.markerset.skeleton.segments
    arms = [(f"upper_arm.{side}", f"forearm.{side}") for side in "LR"]
    if not all(part in names for arm in arms for part in arm):
        return bodies
    parts = [bodies]
    for held in HELD:
        bends = bodies.bends.copy()
        for arm, mirrored in zip(arms, (np.ones(3), OTHER_ARM), strict=True):
            for part, turn in zip(arm, held, strict=True):
                bends[:, names.index(part)] = turn * mirrored
        parts.append(replace(bodies, bends=bends))
    return Bodies.join(parts)


def fit_blobs(bodies: Bodies, view: View, setup: Setup, prior) -> Fit:
    """Bodies against the blobs themselves, visible markers only, visibility renewed at every stage."""
    posed = setup.model.pose(bodies)
    for softness, reach in BLOB_STAGES:
        pull = visible_pull(bodies, posed, view, setup, softness, reach)
        fit = fit_body(setup.model, bodies, pull, STAGE_STEPS, prior)
        bodies, posed = fit.bodies, fit.state.posed
    return fit


def visible_pull(bodies: Bodies, posed: Posed, view: View, setup: Setup, softness: float, reach: float) -> BlobPull:
    """Equation 7 with the markers that are visible where the bodies are now."""
    return BlobPull(setup.visible(bodies.scale, posed), view, setup.sight, softness, reach)


def name_found(
    view: View, state: State, setup: Setup, prior, confidence: float, fixed: np.ndarray | None = None
) -> Found:
    """Names the blobs of a placed body, learns this subject's marker layout from the names, names again.

    `fixed` (C, M) are the blobs that a person named.
    """
    subject = Subject(state.bodies, setup.marker_sd * float(state.bodies.scale.mean()), setup.rules.pixel)
    expected = expect(subject, state, setup)
    for round_ in range(NAMING_ROUNDS):
        naming = name(view, expected, subject, setup, fixed=fixed)
        subject = learn_noise(naming, without_own(subject, setup), setup, FINDING.noise_rate)
        subject, state = refit(naming, subject, setup, STAGE_STEPS, prior)
        if round_ == NAMING_ROUNDS - 1:
            swaps = settle(naming, subject, state, setup, prior)
            subject, state = refit(naming, subject, setup, SETTLED_STEPS, prior)
        subject, expected = _with_own(naming, subject, state, setup, prior)
    naming = name(view, expected, subject, setup, fixed=fixed)
    return Found(subject, naming, expected, confidence, swaps, _cost(naming, state))


def _with_own(naming: Naming, subject: Subject, state: State, setup: Setup, prior) -> tuple[Subject, Expectation]:
    """The subject with what the names show of its own marker layout, and where its markers are expected then."""
    subject = learn_own(naming.meeting.points, subject, state.posed, setup, FINDING.own_rate)
    after = body_state(setup.model, subject.bodies, named_pull(naming, subject, setup), prior)
    return subject, expect(subject, after, setup)


def _cost(naming: Naming, state: State) -> float:
    """What a fit to names costs with the blobs that they leave unnamed."""
    unnamed = int((naming.frame.view.real & (naming.owner < 0)).sum())
    return float(state.cost[0]) + naming.frame.rules.max_square * unnamed


def name_alone(found: Found, placed: State, setup: Setup, prior, fixed: np.ndarray | None) -> Found:
    """The same for a frame that no others will tell more of: all names at once, from those found and from the body.

    `placed` is the body before anything was named. Of the two namings the one stays that suits a body better.
    """
    bodies, view = placed.bodies, found.naming.frame.view
    plain = Subject(bodies, setup.marker_sd * float(bodies.scale.mean()), found.subject.pixel)
    bare = name_jointly(_frame(view, expect(plain, placed, setup), found.subject.pixel, setup, fixed))[0]
    tried = [_joint(one, found.subject, setup, prior, fixed) for one in (found.naming, bare)]
    naming, fitted, state, cost = min(tried, key=lambda one: one[-1])
    swaps = settle(naming, fitted, state, setup, prior)
    loose, state = refit(naming, fitted, setup, SETTLED_STEPS, prior)
    subject = replace(loose, own_sd=without_own(loose, setup).own_sd)
    points = naming.meeting.points
    subject, expected = _with_own(naming, subject, state, setup, prior)
    met = np.isfinite(points[:, :1])
    expected = replace(expected, points=np.where(met, points, expected.points))
    frame = _frame(view, expected, subject.pixel, setup, fixed)
    naming = Naming(frame, naming.slot, naming.step, naming.owner, naming.partner, naming.conflicts)
    give_nearer(frame, naming)
    name_merged(frame, naming)
    return replace(found, subject=subject, naming=naming, expected=expected, swaps=swaps, cost=cost)


def _joint(
    naming: Naming, subject: Subject, setup: Setup, prior, fixed: np.ndarray | None
) -> tuple[Naming, Subject, State, float]:
    """All names once more, all at once, until they suit the body that they make; its state, and what it costs."""
    view, elsewhere = naming.frame.view, np.zeros(setup.model.marker_count, bool)
    plain = without_own(subject, setup)
    seen: list[np.ndarray] = []
    while True:
        # A marker that is placed elsewhere says little of where the body is.
        loose = replace(plain, own_sd=np.hypot(plain.own_sd, elsewhere * JOINTLY.elsewhere_m))
        loose, state = refit(naming, loose, setup, STAGE_STEPS, prior)
        plain = replace(plain, bodies=loose.bodies)
        if len(seen) == JOINT_ROUNDS or any((slot == naming.slot).all() for slot in seen):
            break
        seen.append(naming.slot.copy())
        frame = _frame(view, expect(plain, state, setup), subject.pixel, setup, fixed)
        naming, elsewhere = name_jointly(frame)
    return naming, loose, state, _cost(naming, state) + setup.rules.max_square * int(elsewhere.sum())


def _frame(view: View, expected: Expectation, pixel: float, setup: Setup, fixed: np.ndarray | None) -> Frame:
    return Frame(view, setup.sight, expected, replace(setup.rules, pixel=pixel), fixed)


def settle(naming: Naming, subject: Subject, state: State, setup: Setup, prior) -> Swaps:
    """Gives neighbours each other's names for as long as that makes a better body; returns the last trial.

    Needed by one walk of 20 in the round room (`body26`), of which 1,994 labels are not given without.
    """
    swaps = try_swaps(naming, subject, state, setup, prior)
    for _ in range(MAX_EXCHANGES):
        if not len(swaps.loss) or swaps.loss.min() >= 0:
            break
        swap_names(naming, swaps.orders[swaps.loss.argmin()])
        swaps = try_swaps(naming, subject, state, setup, prior)
    return swaps


def picked(state: State, index) -> State:
    """Some bodies of a state, at `index` (whole numbers)."""
    posed = Posed(*(getattr(state.posed, name)[index] for name in Posed.__dataclass_fields__))
    cost, gradient, normal = (part[index] for part in (state.cost, state.gradient, state.normal))
    return State(state.bodies.pick(index), cost, gradient, normal, posed, state.columns[index])


def _distinct(bodies: Bodies, cost: np.ndarray, setup: Setup) -> np.ndarray:
    """Indices of the bodies, best first, without those that ended where a better one did."""
    markers = setup.model.pose(bodies).markers
    kept: list[int] = []
    for index in np.argsort(cost):
        distance = np.linalg.norm(markers[kept] - markers[index], axis=-1).mean(axis=-1)
        if (distance > FINDING.min_distance_m / 2).all():
            kept.append(int(index))
    return np.array(kept)


def _judged(cost: np.ndarray, markers: np.ndarray) -> tuple[int, int | None, float]:
    """The best of bodies by cost (B,), the next best that puts the markers (B, M, 3) elsewhere, and how sure it is.

    None where there is no other.
    """
    best = int(np.argmin(cost))
    distance = np.linalg.norm(markers - markers[best], axis=-1).mean(axis=-1)
    others = np.flatnonzero(distance > FINDING.min_distance_m)
    if not len(others):
        return best, None, 1.0
    second = int(others[np.argmin(cost[others])])
    return best, second, _chance(cost[second] - cost[best])


def _chance(lead: float) -> float:
    """How sure a lead in cost makes."""
    return float(1 / (1 + np.exp(-np.clip(lead / FINDING.temper, -50, 50))))
