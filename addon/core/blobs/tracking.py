# SPDX-License-Identifier: GPL-3.0-or-later
"""Follows the subject from frame to frame: the paper's future tracker, starting each frame from the last one's body."""

from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import PLACEMENT, Bodies, BodyModel, Posed
from ..data.physical import MARKER_LIMITS, SIGMAS
from ..geometry import rotations
from ..geometry.triangulation import MEETING
from ..geometry.views import NOWHERE, View
from ..kernels import calls, in_use
from ..kernels.frame_calls import Follower
from ..kernels.structures import once_each
from ..papers.virtual_occlusions.fit import DAMPING
from ..papers.virtual_occlusions.labelling import CONDITION, LABEL_STEPS, Expectation, Naming, naming_of
from ..papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion
from ..posing.posing import POSING
from .subject import SUBJECT, Setup, Subject, expect, learn_noise, learn_own, name, refit


class ANCHORING:
    """Standard deviations of what a frame's body is off its prediction at `SUBJECT.reference_rate`."""

    translation_m: float = 0.03  # physical: of the root, and
    # its turn; what acceleration and braking add to the last velocity in a sixtieth of a second
    turn_rad: float = 0.10  # physical
    stretch_m: float = 0.002  # physical: of the scale; a size does not change, it is only known better
    bend_rad: float = 0.20  # physical: of every joint; hands and feet turn fastest
    shape: float = 0.05  # physical: in the modes' own standard deviations; known better, as the size


class TRACKING:
    """How a subject is followed."""

    # share of the last frame's change that is carried on: limbs swing, and slow down; with all of it 0.8 % of walks
    # in five noisy cameras (`gait15`) are lost
    velocity_kept: float = 0.85  # measured
    # share of what a marker is off that the subject's own offset takes over in a frame
    own_rate: float = 0.15  # physical
    # share of the noise that a frame shows which is taken over, a memory of twenty frames
    noise_rate: float = 0.05  # physical


# Iterations of a frame's fit, which starts from the prediction: docs/results/virtual-occlusions.md has more and fewer.
FOLLOWING_STEPS = 2


class Anchor:
    """The prior of a tracked frame: the marker set's own, and that the body moved no farther than bodies move."""

    def __init__(self, prior, predicted: Bodies, slack: float):
        self.prior, self.predicted = prior, predicted
        self.weight = anchor_weight(predicted.bends.shape[1], predicted.shape.shape[1], slack)

    def terms(self, bodies: Bodies):
        """See `prior.Prior.terms`."""
        cost, gradient, hessian = self.prior.terms(bodies)
        change = difference(bodies, self.predicted)
        cost = cost + (change**2 * self.weight).sum(axis=1)
        return cost, gradient + change * self.weight, hessian + np.diag(self.weight)

    def compiled(self, model: BodyModel):
        """As the compiled fit takes it."""
        return calls.prior_arrays(self.prior, model, self.predicted.rows[0], self.weight)


def anchor_weight(joints: int, modes: int, slack: float) -> np.ndarray:
    """(P,) how hard a prediction holds each parameter: one over the square of its standard deviation."""
    moving = ANCHORING.translation_m * slack, ANCHORING.turn_rad * slack, ANCHORING.stretch_m
    bending = ANCHORING.bend_rad * slack, ANCHORING.shape
    return np.repeat([*moving, *bending], [3, 3, 3, 3 * (joints - 1), modes]) ** -2


def difference(bodies: Bodies, origin: Bodies) -> np.ndarray:
    """(B, P) the step that leads from `origin` to `bodies`, in the order of `Bodies.moved`."""
    return np.concatenate(
        [
            bodies.translation - origin.translation,
            rotations.turn_between(origin.quaternion, bodies.quaternion),
            bodies.scale - origin.scale,
            (bodies.bends - origin.bends)[:, 1:].reshape(len(bodies.bends), -1),
            bodies.shape - origin.shape,
        ],
        axis=1,
    )


@dataclass(frozen=True, eq=False)
class Track:
    """A subject on the move."""

    subject: Subject  # after the last frame
    velocity: np.ndarray  # (1, P) change of the parameters a frame
    lag: np.ndarray  # (M, 3) m, how far each marker was from where the body had it; 0 where it was not found in space
    visible: np.ndarray  # (C, M) which markers each camera could see
    # True when too little was named in the last frame: after one dropout the feet may have changed places
    lost: bool = False

    @classmethod
    def begin(cls, subject: Subject, points: np.ndarray, visible: np.ndarray, model: BodyModel) -> "Track":
        """A track that starts from a found subject, standing still.

        points (M, 3) m are its markers, visible (C, M) says which of them each camera could see.
        """
        lag = np.nan_to_num(points - model.pose(subject.bodies).markers[0])
        return cls(subject, np.zeros((1, model.parameters)), lag, visible)

    def doubting(self, markers: np.ndarray, setup: Setup) -> "Track":
        """The track without what it learned of some markers under each other's names."""
        own, own_sd = self.subject.bodies.own.copy(), self.subject.own_sd.copy()
        own[:, markers] = 0
        own_sd[markers] = setup.marker_sd[markers] * float(self.subject.bodies.scale.mean())
        lag = self.lag.copy()
        lag[markers] = 0
        subject = replace(self.subject, bodies=replace(self.subject.bodies, own=own), own_sd=own_sd)
        return replace(self, subject=subject, lag=lag)


@dataclass(frozen=True, eq=False)
class Followed:
    """One tracked frame: the track after it, its names and what was expected."""

    track: Track
    naming: Naming
    expected: Expectation


def follow(track: Track, view: View, setup: Setup, fixed: np.ndarray | None = None) -> Followed:
    """Names one frame, given the track up to the frame before and the blobs that a person named, `fixed` (C, M)."""
    followed = followed_by_library(track, view, setup, fixed) if in_use() else None
    return followed or followed_by_numpy(track, view, setup, fixed)


def followed_by_numpy(track: Track, view: View, setup: Setup, fixed: np.ndarray | None) -> Followed:
    """Names what is clear where the track leads, fits the body to that, and names all by the fit."""
    predicted = replace(track.subject, bodies=track.subject.bodies.moved(TRACKING.velocity_kept * track.velocity))
    prior = Anchor(setup.prior, predicted.bodies, setup.pace)
    with setup.clock("label"):
        spread = np.broadcast_to((POSING.marker_sd_m * setup.pace) ** 2 * np.eye(3), (len(track.lag), 3, 3))
        points = setup.model.pose(predicted.bodies).markers[0] + track.lag
        forecast = Expectation(points, spread, track.visible)
        naming = name(view, forecast, predicted, setup, step1_only=True, fixed=fixed)
    with setup.clock("fit"):
        subject, state = refit(naming, predicted, setup, FOLLOWING_STEPS, prior)
        expected = expect(subject, state, setup)
    with setup.clock("label"):
        naming = name(view, expected, subject, setup, fixed=fixed)
    return Followed(advanced(track, subject, state.posed, naming, expected, setup), naming, expected)


def followed_by_library(track: Track, view: View, setup: Setup, fixed: np.ndarray | None) -> Followed | None:
    """The same by the compiled library; None where a fit cannot be solved."""
    follower, subject, model = follower_of(setup), track.subject, setup.model
    fixed = follower.nobody if fixed is None else fixed
    learned = subject.bodies.own.ravel(), subject.own_sd, track.velocity[0], track.lag.ravel(), [subject.pixel]
    with setup.clock("fit"):
        numbers = subject.bodies.rows[0], *learned
        done = follower.fit(view, fixed, numbers, subject.pixel, track.visible)
        if done is None:
            return None
        fitted, visible = done
        if not follower.sees:
            posed = Posed(*(fitted[name][None] for name in ("rotations", "joints", "markers")))
            visible = setup.visible(fitted["row"][None, 7:10], posed)[0]
        expected = Expectation(fitted["points"], fitted["covariance"], visible)
    with setup.clock("label"):
        made, after, poor = follower.name(visible)
        naming = naming_of(view, setup.sight, expected, replace(setup.rules, pixel=subject.pixel), fixed, made)
        bodies = model.of_rows(after["row"][None], after["own"][None])
        subject = Subject(bodies, after["own_sd"], float(after["pixel"]))
        track = Track(subject, after["velocity"][None], after["lag"], visible, poor)
        return Followed(track, naming, expected)


@once_each
def follower_of(setup: Setup) -> Follower:
    """What following takes that stays the same through a take, as the compiled library takes it."""
    model, body = setup.model, setup.occlusion
    capsules = (body.segment, body.start, body.axis, body.radius) if type(body) is CapsuleOcclusion else None
    anchor = anchor_weight(model.joint_count, len(model.modes), setup.pace)
    numbers = {
        "fit_steps": FOLLOWING_STEPS,
        "min_due": POSING.min_markers,
        "min_meetings": setup.rules.min_meetings,
        "behind": NOWHERE,
        "ridge": DAMPING.ridge,
        "standoff": OCCLUDING.standoff,
        "min_side_share": OCCLUDING.min_side_share,
        "sd": POSING.marker_sd_m * setup.pace,
        "velocity_kept": TRACKING.velocity_kept,
        # Nothing is known of frames before the last one.
        "velocity_rate": 1.0,
        "sd_growth": 0.0,
        "max_sd": np.inf,
        "lag_kept": 0.0,
        "own_rate": TRACKING.own_rate,
        "noise_rate": TRACKING.noise_rate,
        "min_named_share": SUBJECT.min_named,
        "skin": MARKER_LIMITS.skin_m,
        "max_own": SIGMAS,
        "min_noise": SUBJECT.min_noise_px,
        "max_noise": SUBJECT.max_noise_px,
        "kept_share": MEETING.kept_share,
        "trimmed_scale": MEETING.trimmed_scale,
    }
    return Follower(
        model, setup.sight, setup.prior, capsules, setup.marker_sd, anchor, setup.rules, DAMPING, CONDITION,
        LABEL_STEPS, numbers,
    )  # fmt: skip


def advanced(
    track: Track, subject: Subject, posed: Posed, naming: Naming, expected: Expectation, setup: Setup
) -> Track:
    """The track after a frame with these names, of a subject posed so."""
    change = difference(subject.bodies, track.subject.bodies)
    change[:, 6:PLACEMENT] = 0
    named = (naming.slot >= 0).any(axis=0).sum()
    due = max(int(expected.visible.any(axis=0).sum()), POSING.min_markers)
    points = naming.meeting.points
    seen = np.isfinite(points[:, 0])
    subject = learn_noise(naming, subject, setup, TRACKING.noise_rate)
    subject = learn_own(points, subject, posed, setup, TRACKING.own_rate)
    off = (1 - TRACKING.own_rate) * (points - posed.markers[0])
    lost = bool(named < SUBJECT.min_named * due)
    return Track(subject, change, np.where(seen[:, None], off, 0), expected.visible, lost)


@dataclass(frozen=True, eq=False)
class FrameResult:
    """One labelled frame, before it is written into the chunk's arrays."""

    bodies: Bodies
    naming: Naming
    expected: Expectation
    placement: float
    sure: np.ndarray
