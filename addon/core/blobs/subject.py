# SPDX-License-Identifier: GPL-3.0-or-later
"""The subject as known so far: the fitted body, its own marker offsets and how sure we are of each of them."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from itertools import permutations
from time import perf_counter
from typing import Self

import numpy as np

from ..body.bodies import Bodies, BodyModel, Posed
from ..body.prior import Prior
from ..body.sides import limb_exchanges, mirror_order, mirrored_places
from ..data.markersets import MarkerSet
from ..data.physical import MARKER_LIMITS, SIGMAS
from ..geometry.cameras import Cameras
from ..geometry.views import Sight, View
from ..papers.virtual_occlusions.cost import RayPull
from ..papers.virtual_occlusions.fit import State, fit_body
from ..papers.virtual_occlusions.labelling import Expectation, Frame, Naming, Rules, name_markers, pixel_noise
from ..papers.virtual_occlusions.occlusion import OCCLUDING, CapsuleOcclusion, Occlusion

TIMED_STAGES = ("place", "fit", "label")


class SUBJECT:
    """What is taken for granted of a subject, and what it may be found to be."""

    # heights; a subject's markers are never taken to sit surer than this where the marker set has them. Other labs
    # than the one it was learned from put them elsewhere by a centimetre, as five people of three of them show
    min_marker_sd: float = 0.008  # measured
    # the blobs' noise is never taken to be less, a few frames may look better than cameras are
    min_noise_px: float = 0.25  # physical
    max_noise_px: float = 3.0  # physical: nor more; beyond it names are wrong, not blobs
    reference_rate: float = 60.0  # paper, 6: frames a second for which movement from frame to frame is stated elsewhere
    # of a frame's blobs that a subject has where there is no crowd of ghosts, and of its markers where it is one at
    # all or is not lost; less than half, as bodies hide one side
    min_named: float = 0.4  # physical
    # movement a frame, as a share of that at the reference rate, is never taken to be less: what the prediction
    # misses does not shrink with the time between frames
    min_pace: float = 0.6  # physical


MAX_SEGMENT_MARKERS = 4  # of which every order is tried; of five there would be 119


class Clock:
    """Adds up how long each stage of the labelling took, in seconds: `with clock("fit"): ...`."""

    def __init__(self):
        self.seconds = dict.fromkeys(TIMED_STAGES, 0.0)

    @contextmanager
    def __call__(self, stage: str):
        """A context whose seconds count for `stage`, one of TIMED_STAGES."""
        begin = perf_counter()
        try:
            yield
        finally:
            self.seconds[stage] += perf_counter() - begin

    def take(self) -> dict[str, float]:
        """The seconds since the last call."""
        taken = self.seconds
        self.seconds = dict.fromkeys(TIMED_STAGES, 0.0)
        return taken


@dataclass(frozen=True, eq=False)
class Setup:
    """What stays the same through a take."""

    cameras: Cameras
    sight: Sight
    model: BodyModel
    prior: Prior
    occlusion: Occlusion
    rules: Rules
    marker_sd: np.ndarray  # (M,) heights, how far a subject's own markers sit from where the marker set has them
    clock: Clock
    rate: float  # frames a second
    exchanges: np.ndarray  # (B, M) see `standing_exchanges`

    @classmethod
    def of(cls, cameras: Cameras, markerset: MarkerSet, occlusion: Occlusion | None = None, rate: float = 60.0) -> Self:
        """Everything that `cameras` and `markerset` fix; `occlusion` defaults to the marker set's capsules.

        `rate` is frames a second.
        """
        model, sd = BodyModel(markerset), np.maximum(markerset.spread.marker_sd, SUBJECT.min_marker_sd)
        body = occlusion or CapsuleOcclusion(markerset, OCCLUDING.fitted_shrink)
        known = cameras, Sight(cameras), model, Prior(model), body, Rules(), sd
        return cls(*known, Clock(), rate, standing_exchanges(markerset))

    @property
    def pace(self) -> float:
        """How much farther than at the reference rate the subject moves in a frame."""
        return max(SUBJECT.reference_rate / self.rate, SUBJECT.min_pace)

    def visible(self, scale: np.ndarray, posed: Posed) -> np.ndarray:
        """Which markers of posed bodies of scale (B, 3) each camera can see (B, C, M): virtual occlusion."""
        hidden = self.occlusion.hidden(posed.rotations, posed.joints, scale, posed.markers, self.sight.centres)
        return ~hidden & self.sight.inside(self.sight.image(self.sight.local(posed.markers)))


@dataclass(frozen=True, eq=False)
class Subject:
    """One person in one frame."""

    bodies: Bodies  # a single body
    own_sd: np.ndarray  # (M,) m, how sure the subject's own offset of each marker is
    pixel: float  # px, standard deviation of a blob's position, as far as known


def slots_pull(frame: Frame, slots: np.ndarray, subject: Subject, setup: Setup) -> RayPull:
    """The data term of B sets of names of a frame's blobs: slots (B, C, M), -1 where none.

    Several cameras of one marker share the uncertainty of its offset, so each counts for its part of it.
    """
    seen = slots >= 0
    image = frame.view.image[frame.cameras[:, None], np.maximum(slots, 0)]
    count = np.maximum(seen.sum(axis=1), 1)
    deviation = np.sqrt(frame.metres**2 + (count * subject.own_sd**2)[:, None])
    return RayPull(image, np.where(seen, deviation, np.inf), setup.sight)


def named_pull(naming: Naming, subject: Subject, setup: Setup) -> RayPull:
    """The data term of a frame's names for its subject."""
    return slots_pull(naming.frame, naming.rays[None], subject, setup)


def refit(naming: Naming, subject: Subject, setup: Setup, steps: int, prior) -> tuple[Subject, State]:
    """Joints, shape and placement once more, now with names instead of nearest blobs; also the state it ended in."""
    fit = fit_body(setup.model, subject.bodies, named_pull(naming, subject, setup), steps, prior)
    return replace(subject, bodies=fit.bodies), fit.state


def learn_own(points: np.ndarray, subject: Subject, posed: Posed, setup: Setup, rate: float) -> Subject:
    """Moves the subject's own offsets towards the markers found in space (M, 3) m, NaN where not found.

    `posed` is the subject's body, `rate` the share of the remaining error that is taken over.
    """
    bodies = subject.bodies
    known = np.isfinite(points[:, 0])
    turn = posed.rotations[0, setup.model.attachment]
    error = np.where(known[:, None], points - posed.markers[0], 0)
    local = (turn.swapaxes(-1, -2) @ error[..., None])[..., 0] / bodies.scale[0]
    own = bodies.own[0] + rate * local
    most = SIGMAS * setup.marker_sd[:, None]  # so that a wrong name cannot drag one along
    length = np.sqrt((own**2).sum(axis=1, keepdims=True))
    own = own * np.minimum(1, most / np.maximum(length, 1e-9))
    # However long a subject is watched, skin moves.
    own_sd = np.where(known, np.maximum((1 - rate) * subject.own_sd, MARKER_LIMITS.skin_m), subject.own_sd)
    return replace(subject, bodies=replace(bodies, own=own[None]), own_sd=own_sd)


def expect(subject: Subject, state: State, setup: Setup) -> Expectation:
    """Where each marker should be and how sure that is, after a fit that ended in `state`."""
    spread = state.covariance()[0] + (subject.own_sd**2)[:, None, None] * np.eye(3)
    return Expectation(state.posed.markers[0], spread, setup.visible(state.bodies.scale, state.posed)[0])


def name(
    view: View,
    expected: Expectation,
    subject: Subject,
    setup: Setup,
    step1_only: bool = False,
    fixed: np.ndarray | None = None,
) -> Naming:
    """Algorithm 1, or only its first step, with the rules that the take's own noise asks for.

    `fixed` (C, M) are the blobs that a person named, -1 where nobody did.
    """
    rules = replace(setup.rules, pixel=subject.pixel)
    return name_markers(view, setup.sight, expected, rules, fixed, step1_only)


def learn_noise(naming: Naming, subject: Subject, setup: Setup, rate: float) -> Subject:
    """Takes over the share `rate` of the noise that this frame's meeting rays show."""
    measured = pixel_noise(naming, setup.sight)
    if not np.isfinite(measured):
        return subject
    pixel = (1 - rate) * subject.pixel + rate * measured
    return replace(subject, pixel=float(np.clip(pixel, SUBJECT.min_noise_px, SUBJECT.max_noise_px)))


def standing_exchanges(markerset: MarkerSet) -> np.ndarray:
    """(B, M) every exchange that the marker set itself allows in any pose: limb for limb, and around a segment.

    Marker m gets the blobs that had the name of marker order[m].
    """
    rest, order = markerset.rest_markers, mirror_order(markerset.markers)
    order = mirrored_places(rest) if order is None else order  # names may show no sides
    orders = [*limb_exchanges(order, rest), *_clusters(markerset)]
    return np.unique(np.array(orders, dtype=int).reshape(-1, len(markerset)), axis=0)


def _clusters(markerset: MarkerSet) -> Iterator[np.ndarray]:
    """Every other order of the markers of a segment that carries a few."""
    for segment in range(len(markerset.skeleton)):
        own = np.flatnonzero(np.asarray(markerset.attachment) == segment)
        if 2 < len(own) <= MAX_SEGMENT_MARKERS:  # two are neighbours anyhow
            for places in permutations(own):
                order = np.arange(len(markerset))
                order[own] = places
                if list(places) != list(own):
                    yield order
