# SPDX-License-Identifier: GPL-3.0-or-later
"""The subject as known so far: the fitted body, its own marker offsets and how sure we are of each of them."""

from dataclasses import dataclass, replace

import numpy as np

from . import cost
from .body import Bodies, BodyModel
from .cameras import Cameras
from .clock import Clock
from .fit import covariance, fit_body
from .labelling import Expectation, Naming, Rules
from .markersets import MarkerSet
from .occlusion import CapsuleOcclusion, Occlusion
from .prior import Prior
from .triangulation import triangulate
from .views import Sight, View

SKIN = 0.006  # m by which skin lets a marker move against its segment, standard deviation
SHRINK = 0.9  # of the capsules: a marker believed hidden can take no part in the fit


@dataclass(frozen=True, eq=False)
class Setup:
    """What stays the same through a take."""

    cameras: Cameras
    sight: Sight
    model: BodyModel
    prior: Prior
    occlusion: Occlusion
    rules: Rules
    marker_sd: np.ndarray
    clock: Clock

    @classmethod
    def of(cls, cameras: Cameras, markerset: MarkerSet, occlusion: Occlusion | None = None, rules: Rules | None = None) -> "Setup":
        """Everything that `cameras` and `markerset` fix; `occlusion` defaults to the marker set's capsules."""
        model = BodyModel(markerset)
        body = occlusion or CapsuleOcclusion(markerset, SHRINK)
        return cls(cameras, Sight(cameras), model, Prior(model), body, rules or Rules(), np.asarray(markerset.spread.marker_sd), Clock())

    def visible(self, bodies: Bodies) -> tuple[np.ndarray, np.ndarray]:
        """Markers (B, M, 3) m of bodies, and which of them each camera can see (B, C, M): virtual occlusion."""
        posed = self.model.pose(bodies)
        hidden = self.occlusion.hidden(posed.rotations, posed.joints, bodies.scale, posed.markers, self.sight.centres)
        image = self.sight.image(self.sight.local(posed.markers))
        return posed.markers, ~hidden & self.sight.inside(image)


@dataclass(frozen=True, eq=False)
class Subject:
    """One person in one frame.

    bodies    a single body
    own_sd    (M,) m, how sure the subject's own offset of each marker is
    """

    bodies: Bodies
    own_sd: np.ndarray


def meet(view: View, naming: Naming, setup: Setup) -> tuple[np.ndarray, np.ndarray]:
    """Points (M, 3) m in which the named blobs meet and residuals (M,) m; NaN with fewer than two cameras."""
    image = named_image(view, naming)
    points, residual = triangulate(image, naming.slot[None] >= 0, setup.sight)
    return points[0], residual[0]


def named_image(view: View, naming: Naming) -> np.ndarray:
    """(1, C, M, 2) normalised image of every named blob; anything where there is none."""
    return view.image[np.arange(len(view.image))[:, None], np.maximum(naming.slot, 0)][None]


def named_pull(view: View, naming: Naming, subject: Subject, setup: Setup):
    """The data term of named blobs: function markers → cost.Pull. Several cameras of one marker share its offset's
    uncertainty, so each counts for its part of it."""
    seen = naming.slot >= 0
    image = named_image(view, naming)
    count = np.maximum(seen.sum(axis=0), 1)
    depth = setup.sight.local(setup.model.pose(subject.bodies).markers)[0, ..., 2]
    noise = setup.rules.pixel / setup.sight.focal[:, None] * depth + setup.rules.slack
    deviation = np.sqrt(noise**2 + count * subject.own_sd**2)
    deviation = np.where(seen, deviation, np.inf)[None]
    return lambda markers: cost.ray_pull(markers, image, deviation, setup.sight)


def refit(view: View, naming: Naming, subject: Subject, setup: Setup, steps: int, prior=None) -> tuple[Subject, cost.Pull]:
    """Joints, shape and placement once more, now with names instead of nearest blobs."""
    pull = named_pull(view, naming, subject, setup)
    bodies = fit_body(setup.model, subject.bodies, pull, steps, prior or setup.prior).bodies
    return replace(subject, bodies=bodies), pull(setup.model.pose(bodies).markers)


def learn_own(points: np.ndarray, subject: Subject, setup: Setup, rate: float) -> Subject:
    """Moves the subject's own offsets towards the markers found in space (M, 3) m, NaN where not found.

    `rate` is the share of the remaining error that is taken over; an offset stays within three deviations of the
    marker set's own spread, so that a wrong name cannot drag it along.
    """
    bodies, model = subject.bodies, setup.model
    posed = model.pose(bodies)
    known = np.isfinite(points[:, 0])
    turn = posed.rotations[0, model.attachment]
    error = np.where(known[:, None], points - posed.markers[0], 0)
    local = np.einsum("mji,mj->mi", turn, error) / bodies.scale[0]
    own = bodies.own[0] + rate * local
    most = 3 * setup.marker_sd[:, None]
    length = np.linalg.norm(own, axis=1, keepdims=True)
    own *= np.minimum(1, most / np.maximum(length, 1e-9))
    own_sd = np.where(known, np.maximum((1 - rate) * subject.own_sd, SKIN), subject.own_sd)
    return Subject(replace(bodies, own=own[None]), own_sd)


def expect(subject: Subject, pull: cost.Pull, prior, setup: Setup) -> Expectation:
    """Where each marker should be and how sure that is, after a fit whose data had `pull` at its end."""
    markers, visible = setup.visible(subject.bodies)
    spread = covariance(setup.model, subject.bodies, pull, prior)[0]
    spread = spread + (subject.own_sd**2)[:, None, None] * np.eye(3)
    return Expectation(markers[0], spread, visible[0])
