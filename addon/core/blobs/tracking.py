# SPDX-License-Identifier: GPL-3.0-or-later
"""Follows the subject from frame to frame: the paper's future tracker, starting each frame from the last one's body."""

from dataclasses import dataclass, replace

import numpy as np

from ..body.bodies import PLACEMENT, Bodies, BodyModel, Posed
from ..geometry import rotations
from .labelling import Expectation, Naming
from .subject import Setup, Subject, expect, learn_noise, learn_own, name, refit
from .views import View

# Standard deviations of a frame's change against the prediction, at 60 frames a second.
TRANSLATION, TURN, STRETCH, BEND, SHAPE = 0.03, 0.10, 0.002, 0.20, 0.05
SURPRISE = 0.010  # m a marker may be off its prediction, standard deviation; it grows while the marker is not seen
STRANGE = 8  # frames unseen that a track's first forecast counts as: nothing is known of its velocity
FADING = 0.9  # share of a marker's lag that is left a frame after it was seen
GROWTH = 0.004
MOST_SURPRISE = 0.06
OWN_RATE = 0.15
NOISE_RATE = 0.05
KEEP = 0.85  # share of the velocity carried on when predicting
FEWEST = 0.35  # share of the markers that should be seen and are named, below which a frame is poor


class Anchor:
    """The prior of a tracked frame: the marker set's own, and that the body moved no farther than bodies move."""

    def __init__(self, prior, predicted: Bodies, slack: float):
        self.prior, self.predicted = prior, predicted
        joints, modes = predicted.bends.shape[1], predicted.shape.shape[1]
        deviation = np.concatenate(
            [
                np.full(3, TRANSLATION * slack),
                np.full(3, TURN * slack),
                np.full(3, STRETCH),
                np.full(3 * (joints - 1), BEND * slack),
                np.full(modes, SHAPE),
            ]
        )
        self.weight = deviation**-2

    def terms(self, bodies: Bodies):
        """See `prior.Prior.terms`."""
        cost, gradient, hessian = self.prior.terms(bodies)
        change = difference(bodies, self.predicted)
        cost = cost + (change**2 * self.weight).sum(axis=1)
        return cost, gradient + change * self.weight, hessian + np.diag(self.weight)


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
    """A subject on the move.

    subject   after the last frame
    velocity  (1, P) change of the parameters a frame
    lag       (M, 3) m, how far each marker was from where the body had it when it was last found in space
    unseen    (M,) frames since then
    visible   (C, M) which markers each camera could see
    poor      True when too little was named in the last frame
    """

    subject: Subject
    velocity: np.ndarray
    lag: np.ndarray
    unseen: np.ndarray
    visible: np.ndarray
    poor: bool = False

    @classmethod
    def begin(cls, subject: Subject, points: np.ndarray, visible: np.ndarray, model: BodyModel) -> "Track":
        """A track that starts from a found subject, standing still.

        points (M, 3) m are its markers, visible (C, M) says which of them each camera could see.
        """
        lag = np.nan_to_num(points - model.pose(subject.bodies).markers[0])
        return cls(subject, np.zeros((1, model.parameters)), lag, np.full(model.marker_count, STRANGE), visible)

    def doubting(self, markers: np.ndarray, setup: Setup) -> "Track":
        """The track with all forgotten that it learned of some markers under each other's names."""
        own, own_sd = self.subject.bodies.own.copy(), self.subject.own_sd.copy()
        own[:, markers] = 0
        own_sd[markers] = setup.marker_sd[markers] * float(self.subject.bodies.scale.mean())
        lag, unseen = self.lag.copy(), self.unseen.copy()
        lag[markers], unseen[markers] = 0, STRANGE
        subject = replace(self.subject, bodies=replace(self.subject.bodies, own=own), own_sd=own_sd)
        return replace(self, subject=subject, lag=lag, unseen=unseen)

    @property
    def lost(self) -> bool:
        """True when the subject was not recognised: after one dropout the feet may already have changed places."""
        return self.poor


@dataclass(frozen=True, eq=False)
class Followed:
    """One tracked frame: the track after it, its names and what was expected."""

    track: Track
    naming: Naming
    expected: Expectation


def follow(track: Track, view: View, setup: Setup) -> Followed:
    """Names one frame, given the track up to the frame before."""
    predicted = replace(track.subject, bodies=track.subject.bodies.moved(KEEP * track.velocity))
    prior = Anchor(setup.prior, predicted.bodies, setup.pace)
    with setup.clock("label"):
        naming = name(view, _forecast(predicted, track, setup), predicted, setup, step1_only=True)
    with setup.clock("fit"):
        subject, state = refit(view, naming, predicted, setup, 2, prior)
        expected = expect(subject, state, setup)
        expected = replace(expected, points=expected.points + FADING * track.lag)
    with setup.clock("label"):
        naming = name(view, expected, subject, setup)
    return Followed(_advanced(track, subject, state.posed, naming, expected, setup), naming, expected)


def _forecast(predicted: Subject, track: Track, setup: Setup) -> Expectation:
    """Where the markers should be before the frame is looked at."""
    posed = setup.model.pose(predicted.bodies)
    deviation = np.minimum(SURPRISE * setup.pace + GROWTH * track.unseen, MOST_SURPRISE)
    spread = (deviation**2)[:, None, None] * np.eye(3)
    return Expectation(posed.markers[0] + track.lag, spread, track.visible)


def _advanced(
    track: Track, subject: Subject, posed: Posed, naming: Naming, expected: Expectation, setup: Setup
) -> Track:
    change = difference(subject.bodies, track.subject.bodies)
    change[:, 6:PLACEMENT] = 0
    velocity = 0.5 * track.velocity + 0.5 * change
    named = (naming.slot >= 0).any(axis=0).sum()
    due = max(expected.visible.any(axis=0).sum(), 4)
    poor = bool(named < FEWEST * due)
    points = naming.meeting.points
    seen = np.isfinite(points[:, 0])
    unseen = np.where(seen, 0, track.unseen + 1)
    subject = learn_own(points, learn_noise(naming, subject, setup, NOISE_RATE), posed, setup, OWN_RATE)
    lag = np.where(seen[:, None], (1 - OWN_RATE) * (points - posed.markers[0]), FADING * track.lag)
    return Track(subject, velocity, lag, unseen, expected.visible, poor)
