# SPDX-License-Identifier: GPL-3.0-or-later
"""Which blob is which marker, conservatively, in the three steps of the first paper's section 5 and algorithm 1.

Distances are measured against how sure the fit is of each projection, so one rule serves a loose first fit and a
tight track. Beyond the paper: a name that several cameras give must meet in one point in space, or it is withdrawn.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ...data.physical import SIGMAS
from ...data.takes import BY_EDIT, CONFLICT, EXCLUSIVE, REMAINING
from ...geometry.triangulation import MAX_CONDITION, RAY_RIDGE, Meeting, Rays, trimmed_deviation
from ...geometry.views import NOWHERE, VIEWING, Sight, View
from ...kernels import frame_calls, in_use

SPREAD_UNIT = 1e-8  # m⁴, the spread whose log is nought
TOO_FAR = 1e9  # a cost that no blob and marker can have
CONDITION = RAY_RIDGE, MAX_CONDITION  # as the compiled library takes them
LABEL_STEPS = EXCLUSIVE, CONFLICT, REMAINING, BY_EDIT


@dataclass(frozen=True)
class Rules:
    """How labels are given; distances count in standard deviations of the fit and the blob."""

    pixel: float = 1.0  # physical: px, standard deviation of a blob's centre, until the take shows its own
    # what a calibration adds in space, whatever the lens; makers report half a millimetre
    slack_m: float = 0.0005  # physical
    # no blob farther than this from a projection is considered, an arm's thickness
    max_distance_m: float = 0.12  # physical
    # the neighbourhood, four standard deviations, which one right blob in 3,000 exceeds; two rays make a marker within
    # as many of the model's
    max_square: float = 16.0  # paper, 5.1
    # squared deviations to the next marker of a blob that is clear: seven times less likely
    min_lead: float = 4.0  # paper, 5.1
    # deviations by which a ray may miss the point that it helped to make; half of them lose 1.9 % of walks in five
    # noisy cameras (`body26`), twice as many 0.2 %
    max_miss: float = 3.5  # measured
    # deviations by which a blob may lie off a reprojected point, which is uncertain, too; half of them lose 0.4 %
    # there, twice as many nothing
    max_off_point: float = 5.0  # measured
    # squared deviations within which a blob belongs to the point that it lies on, three
    max_on_point: float = SIGMAS**2  # paper, 5.2
    merged_m: float = 0.02  # physical: between two markers whose images melt into one blob, larger than a marker
    min_meetings: int = 5  # physical: markers that must meet in space to show the blobs' noise, as many as one limb has

    @property
    def min_behind_m(self) -> float:
        """By how much nearer to a camera a marker must be than another to hide it: a marker's radius."""
        return self.merged_m / 2


@dataclass(frozen=True, eq=False)
class Expectation:
    """Where the fit expects M markers: points (M, 3) m, covariance (M, 3, 3) m², visible (C, M)."""

    points: np.ndarray
    covariance: np.ndarray
    visible: np.ndarray


@dataclass(eq=False)
class Naming:
    """The labels of one frame, as they grow."""

    frame: "Frame"  # what they are measured against
    slot: np.ndarray  # (C, M) which blob of a camera is the marker, -1 where none
    step: np.ndarray  # (C, M) index into takes.STEPS
    owner: np.ndarray  # (C, K) which marker a blob is, -1 where none
    partner: np.ndarray  # (C, M) the other marker of a merged blob, -1 where the blob is the marker's alone
    conflicts: np.ndarray  # (M,) blobs that were in conflict over the marker
    _meeting: Meeting | None = None
    _reprojection: np.ndarray | None = None

    @classmethod
    def empty(cls, frame: "Frame") -> "Naming":
        """Nothing named yet but what a person named."""
        shape = frame.nll.shape[:2]
        nobody = np.full(frame.view.real.shape, -1)
        zeros = np.zeros(shape, int)
        naming = cls(frame, zeros - 1, zeros, nobody, zeros - 1, np.zeros(shape[1], int))
        camera, marker = np.nonzero(frame.fixed >= 0)
        naming.give(camera, marker, frame.fixed[camera, marker], BY_EDIT)
        return naming

    @property
    def meeting(self) -> Meeting:
        """Where the named blobs of every marker meet."""
        if self._meeting is None:
            self._meeting = self.frame.rays.meet(self.rays, self.frame.depth)
        return self._meeting

    @property
    def reprojection(self) -> np.ndarray:
        """(C, M, K) squared deviations of blobs from where markers meet; TOO_FAR where far, or no point."""
        if self._reprojection is None:
            self._reprojection = self.frame.against_points(self.meeting.points)
        return self._reprojection

    @property
    def open(self) -> np.ndarray:
        """(C, M, K) True where neither the blob nor, in this camera, the marker is named."""
        return (self.slot < 0)[..., None] & ((self.owner < 0) & self.frame.view.real)[:, None]

    @property
    def rays(self) -> np.ndarray:
        """(C, M) the slots whose rays may be met: all named blobs but the merged ones."""
        return np.where(self.partner >= 0, -1, self.slot)

    def give(self, camera, marker, slot, step):
        """Names blobs; arrays of equal length."""
        self.slot[camera, marker] = slot
        self.step[camera, marker] = step
        self.owner[camera, slot] = marker
        self._meeting = self._reprojection = None

    def withdraw(self, camera, marker):
        """Takes names back."""
        self.owner[camera, self.slot[camera, marker]] = -1
        self.slot[camera, marker] = -1
        self.step[camera, marker] = 0
        self._meeting = self._reprojection = None


class Frame:
    """One frame's blobs against one expectation: every distance that the three steps ask for.

    nll     (C, M, K) twice the negative log-likelihood of each blob under each marker, up to a constant: squared
            deviations plus the log of their size; TOO_FAR where a blob is too far off
    metres  (C, M) m, standard deviation of a blob's position at the marker's depth
    depth   (C, M) m
    image   (C, M, 2) normalised image of the expected markers
    fixed   (C, M) the blob that is the marker because a person says so, -1 where nobody does
    """

    def __init__(
        self,
        view: View,
        sight: Sight,
        expected: Expectation,
        rules: Rules,
        fixed: np.ndarray | None = None,
        made: Mapping[str, np.ndarray] | None = None,
    ):
        """`made` are the arrays that the compiled library has measured already, by name."""
        self.view, self.sight, self.expected, self.rules = view, sight, expected, rules
        self.cameras, self.markers = np.arange(len(view.image)), np.arange(len(expected.points))
        self.fixed = np.full((len(self.cameras), len(self.markers)), -1) if fixed is None else fixed
        if made is not None:
            self.depth, self.metres, self.slope = made["depth"], made["metres"], made["slope"]
            self.image, self.nll = made["image"], made["nll"]
            return
        local = sight.local(expected.points[None])
        image = sight.image(local)
        self.depth = np.maximum(local[0, ..., 2], VIEWING.min_depth_m)
        self.metres = rules.pixel / sight.focal[:, None] * self.depth + rules.slack_m
        self.slope = sight.derivatives(local, image)[0]
        self.image = image[0]
        self.nll = self._against(self.image, self._spread(expected.covariance), self.depth, self.metres)
        camera, marker = np.nonzero(self.fixed >= 0)
        self.nll[camera, marker] = TOO_FAR
        self.nll[camera, :, self.fixed[camera, marker]] = TOO_FAR

    @cached_property
    def rays(self) -> Rays:
        """Those of the blobs."""
        return Rays(self.view, self.sight)

    @cached_property
    def between2(self) -> np.ndarray:
        """(C, M, M) m², squared distance at which two markers look from each other at the first one's depth."""
        between = self.image[:, :, None] - self.image[:, None]
        return (between[..., 0] ** 2 + between[..., 1] ** 2) * (self.depth**2)[..., None]

    @cached_property
    def in_front(self) -> np.ndarray:
        """(C, M, M) True where the second marker stands before the first, nearer to the camera on one line."""
        return (self.between2 < self.rules.merged_m**2) & (
            self.depth[:, None, :] < self.depth[..., None] - self.rules.min_behind_m
        )

    def against_points(self, points: np.ndarray) -> np.ndarray:
        """(C, M, K) squared deviations of blobs from points (M, 3) m; TOO_FAR where far or the point is NaN."""
        known = np.isfinite(points[:, 0])
        image = self.sight.image(self.sight.local(np.where(known[:, None], points, 0)[None]))[0]
        between = self.view.image[:, None] - image[:, :, None]
        square = between[..., 0] ** 2 + between[..., 1] ** 2
        square *= ((self.depth / self.metres) ** 2)[..., None]
        return np.where((square < self.rules.max_off_point**2) & known[None, :, None], square, TOO_FAR)

    def with_ray(self, camera: np.ndarray, marker: np.ndarray, slot: np.ndarray) -> np.ndarray:
        """(C, N, K) `nll` of N markers once one camera has named them: what the model and that ray expect together.

        The expectation is brought up to the ray as a Kalman filter would; what is left is the doubt along the ray.
        """
        slope, spread = self.slope[camera, marker], self.expected.covariance[marker]
        gain = spread @ slope.swapaxes(-1, -2)
        noise = (self.metres / self.depth)[camera, marker] ** 2
        gain = gain @ np.linalg.inv(slope @ gain + noise[:, None, None] * np.eye(2))
        off = self.view.image[camera, slot] - self.image[camera, marker]
        moved = (gain @ off[..., None])[..., 0]
        image = self.image[:, marker] + (self.slope[:, marker] @ moved[..., None])[..., 0]
        spread = self._spread(spread - gain @ slope @ spread, marker)
        return self._against(image, spread, self.depth[:, marker], self.metres[:, marker])

    def _spread(self, covariance: np.ndarray, marker=slice(None)) -> np.ndarray:
        """(C, M, 2, 2) how uncertain the images of markers of `covariance` (M, 3, 3) m² are, blobs' noise included."""
        slope, noise = self.slope[:, marker], (self.metres / self.depth)[:, marker] ** 2
        spread = slope @ covariance @ slope.swapaxes(-1, -2)
        spread[..., 0, 0] += noise
        spread[..., 1, 1] += noise
        return spread

    def _against(self, image, spread, depth, metres) -> np.ndarray:
        """(C, M, K) `nll` of every marker and blob: squared deviations and the log of the spread's size."""
        between = self.view.image[:, None] - image[:, :, None]
        x, y = between[..., 0], between[..., 1]
        xx, yy, xy = spread[..., 0, 0], spread[..., 1, 1], spread[..., 0, 1]
        det = np.maximum(xx * yy - xy * xy, (metres / depth) ** 4)
        square = (x * x * yy[..., None] + y * y * xx[..., None] - 2 * x * y * xy[..., None]) / det[..., None]
        distance2 = (x * x + y * y) * (depth**2)[..., None]
        within = (square < self.rules.max_square) & (distance2 < self.rules.max_distance_m**2)
        within &= self.view.real[:, None]
        size = np.log(det * depth**4 / SPREAD_UNIT)
        return np.where(within, square + size[..., None], TOO_FAR)


def name_markers(
    view: View,
    sight: Sight,
    expected: Expectation,
    rules: Rules,
    fixed: np.ndarray | None = None,
    step1_only: bool = False,
) -> Naming:
    """Algorithm 1 on one frame, of which some blobs may be named already: `fixed` (C, M), see `Frame`.

    Its first step alone is enough to bring a tracked body up to date before the frame is named in earnest.
    """
    named = named_by_library if in_use() else named_by_numpy
    return named(view, sight, expected, rules, fixed, step1_only)


def named_by_numpy(view, sight, expected, rules, fixed, step1_only: bool) -> Naming:
    """The same by NumPy."""
    frame = Frame(view, sight, expected, rules, fixed)
    naming = Naming.empty(frame)
    claims = identify_visible(frame, naming)
    withdraw_unmet(frame, naming)
    if step1_only:
        return naming
    if claims.any():
        resolve_conflicts(frame, naming, claims)
        withdraw_unmet(frame, naming)
    if ((naming.owner < 0) & view.real).any():
        name_remaining(frame, naming)
        withdraw_unmet(frame, naming)
        name_merged(frame, naming)
    return naming


def named_by_library(view, sight, expected, rules, fixed, step1_only: bool) -> Naming:
    """The same by the compiled library."""
    made = frame_calls.name_markers(view, sight, expected, rules, fixed, CONDITION, NOWHERE, LABEL_STEPS, step1_only)
    return naming_of(view, sight, expected, rules, fixed, made)


def naming_of(view, sight, expected, rules, fixed, made: dict[str, np.ndarray]) -> Naming:
    """The naming of a frame whose arrays, by name, the compiled library has made."""
    frame = Frame(view, sight, expected, rules, fixed, made)
    named = {name: made[name] for name in ("slot", "step", "owner", "partner", "conflicts")}
    return Naming(frame, **named, _meeting=Meeting(made["met"], made["residual"], made["miss"]))


def identify_visible(frame: Frame, naming: Naming) -> np.ndarray:
    """Step 1: maps each blob to the closest projection of a visible marker; names those that are alone and clear.

    Returns claims (C, M, K): which blobs are in conflict over which marker.
    """
    nll = np.where(frame.expected.visible[..., None], frame.nll, TOO_FAR)
    closest = nll.argmin(axis=1)
    best = np.take_along_axis(nll, closest[:, None], axis=1)[:, 0]
    second = np.partition(nll, 1, axis=1)[:, 1] if nll.shape[1] > 1 else np.full_like(best, TOO_FAR)
    mapped = best < TOO_FAR
    claims = (closest[:, None] == frame.markers[None, :, None]) & mapped[:, None]
    unclear = mapped & (second - best < frame.rules.min_lead)
    candidates = unclear[:, None] & (nll - best[:, None] < frame.rules.min_lead)
    alone = claims & ~unclear[:, None] & (claims.sum(axis=2, keepdims=True) == 1)
    camera, marker, slot = np.nonzero(alone)
    naming.give(camera, marker, slot, EXCLUSIVE)
    conflicting = (claims | candidates) & (naming.slot < 0)[..., None] & (naming.owner < 0)[:, None]
    naming.conflicts += conflicting.sum(axis=(0, 2)) * (conflicting.sum(axis=(0, 2)) > 0)
    return conflicting


def withdraw_unmet(frame: Frame, naming: Naming):
    """Takes back names whose rays do not meet: the worst ray while three or more are left, both when two disagree.

    What a person named stays.
    """
    for _ in range(len(frame.cameras)):
        seen = (naming.slot >= 0) & np.isfinite(naming.meeting.points[:, 0])
        excess = np.where(seen, naming.meeting.miss / (frame.rules.max_miss * frame.metres), 0)
        bad = excess.max(axis=0) > 1
        several = seen.sum(axis=0) >= 3
        seen &= frame.fixed < 0
        excess = np.where(seen, excess, 0)
        bad &= seen.any(axis=0)
        if not bad.any():
            return
        worst = (excess == excess.max(axis=0)) & seen & bad
        naming.withdraw(*np.nonzero(np.where(several, worst, seen & bad)))


def resolve_conflicts(frame: Frame, naming: Naming, claims: np.ndarray):
    """Step 2: blobs in conflict, by what the other cameras know of the marker.

    Two or more named blobs elsewhere: the blob nearest to the reprojected point. One: the blob that makes the point
    nearest to the model's marker. None: the blob nearest to the model's projection.
    """
    for helpers in (2, 1, 0):
        cost = _conflict_costs(frame, naming, claims, helpers)
        _give_best(naming, cost, CONFLICT)


def _conflict_costs(frame: Frame, naming: Naming, claims: np.ndarray, helpers: int) -> np.ndarray:
    """(C, M, K) what each open claim costs whose marker has exactly `helpers` (2: or more) named blobs elsewhere."""
    named = (naming.slot >= 0).sum(axis=0)
    now = named >= 2 if helpers == 2 else named == helpers
    is_open = claims & now[None, :, None] & naming.open
    if not is_open.any():
        return np.full(claims.shape, TOO_FAR)
    is_open &= ~_better_elsewhere(frame, naming) & ~_shadowed(frame, naming)
    if helpers == 2:
        return np.where(is_open, naming.reprojection, TOO_FAR)
    if helpers == 1:
        return _one_helper_cost(frame, naming, is_open)
    return np.where(is_open & _undisputed(frame, is_open), frame.nll, TOO_FAR)


def _better_elsewhere(frame: Frame, naming: Naming) -> np.ndarray:
    """(C, M, K) where a blob lies on the reprojected point of another marker that its camera still lacks."""
    square = np.where((naming.slot < 0)[..., None], naming.reprojection, TOO_FAR)
    least = square.min(axis=1, keepdims=True)
    return (least < frame.rules.max_on_point) & (square > least)


def nll_given_names(frame: Frame, naming: Naming) -> np.ndarray:
    """(C, M, K) `Frame.nll` of every blob and marker, by all that is known of the marker once some blobs are named.

    The point where its blobs meet if there is one, else the model and its only ray, else the model alone.
    """
    met = naming.reprojection
    met = np.where(met < TOO_FAR, met + np.log(frame.metres**4 / SPREAD_UNIT)[..., None], TOO_FAR)
    known = np.isfinite(naming.meeting.points[:, 0])
    found = np.where(known[None, :, None], met, frame.nll)
    single = np.flatnonzero((naming.rays >= 0).sum(axis=0) == 1)
    if len(single):
        camera = (naming.rays[:, single] >= 0).argmax(axis=0)
        found[:, single] = frame.with_ray(camera, single, naming.rays[camera, single])
    return found


def _shadowed(frame: Frame, naming: Naming) -> np.ndarray:
    """(C, M, K) where a blob belongs to a marker that stands in front of this one, on the same line to the camera.

    Whatever hides the nearer marker hides the farther one too, so one blob for both is the nearer one's, or both's.
    """
    nll = nll_given_names(frame, naming)
    camera, behind, before = np.nonzero(frame.in_front)
    fits = nll[camera, before] < np.minimum(nll[camera, behind] + frame.rules.min_lead, TOO_FAR)
    fits &= (naming.slot[camera, before] < 0)[:, None]
    shadowed = np.zeros(nll.shape, dtype=bool)
    np.logical_or.at(shadowed, (camera, behind), fits)
    return shadowed


def give_nearer(frame: Frame, naming: Naming):
    """Gives a blob that two markers on one line may have made to the nearer of them, which hides the other.

    Not where no other camera sees the nearer one, nor where the other would not have two blobs left.
    """
    nll = nll_given_names(frame, naming)
    camera, behind, before = np.nonzero(frame.in_front & (naming.slot >= 0)[..., None] & (naming.slot < 0)[:, None])
    slot = naming.slot[camera, behind]
    lead = nll[camera, before, slot] - nll[camera, behind, slot]
    fits = (nll[camera, before, slot] < TOO_FAR) & (lead < frame.rules.min_lead) & (frame.fixed[camera, behind] < 0)
    fits &= (naming.slot >= 0).sum(axis=0)[before] > 0
    for index in np.argsort(lead, kind="stable"):
        c, m, k = camera[index], before[index], slot[index]
        still = naming.slot[c, m] < 0 and naming.owner[c, k] == behind[index]
        if fits[index] and still and (naming.slot[:, behind[index]] >= 0).sum() > 2:
            naming.withdraw(c, behind[index])
            naming.give(c, m, k, REMAINING)


def _undisputed(frame: Frame, is_open: np.ndarray) -> np.ndarray:
    """(C, M, K) where a marker fits one blob clearly better than its other open blobs, and the blob it."""
    nll = np.where(is_open, frame.nll, TOO_FAR)
    return _clearly_least(nll, 1, frame.rules.min_lead) & _clearly_least(nll, 2, frame.rules.min_lead)


def _clearly_least(cost: np.ndarray, axis: int, min_lead: float) -> np.ndarray:
    if cost.shape[axis] == 1:
        return cost < TOO_FAR
    two = np.partition(cost, 1, axis=axis)
    least, second = np.take(two, [0], axis=axis), np.take(two, [1], axis=axis)
    return (cost == least) & (second - least >= min_lead)


def _one_helper_cost(frame: Frame, naming: Naming, is_open: np.ndarray) -> np.ndarray:
    """(C, M, K) how far the point of candidate and helper lies from the model's marker, squared deviations."""
    cost = np.full(is_open.shape, TOO_FAR)
    camera, marker, slot = np.nonzero(is_open)
    helper = (naming.slot >= 0)[:, marker].argmax(axis=0)
    pairs = np.full((len(frame.cameras), len(camera)), -1)
    each = np.arange(len(camera))
    pairs[camera, each] = slot
    pairs[helper, each] = naming.slot[helper, marker]
    met = frame.rays.meet(pairs)
    offset = np.where(np.isfinite(met.points), met.points - frame.expected.points[marker], 1e3)
    floor = frame.rules.slack_m**2 * np.eye(3)
    whitened = np.linalg.solve(frame.expected.covariance[marker] + floor, offset[..., None])[..., 0]
    square = np.einsum("ni,ni->n", offset, whitened)
    fine = (met.residual < frame.rules.max_miss * frame.metres[camera, marker]) & (square < frame.rules.max_square)
    cost[camera, marker, slot] = np.where(fine, square, TOO_FAR)
    return cost


def _give_best(naming: Naming, cost: np.ndarray, step: int):
    """Names greedily, best first, one blob a marker and one marker a blob in every camera."""
    camera, marker, slot = np.nonzero(cost < TOO_FAR)
    for index in np.argsort(cost[camera, marker, slot], kind="stable"):
        c, m, k = camera[index], marker[index], slot[index]
        if naming.slot[c, m] < 0 and naming.owner[c, k] < 0:
            naming.give(c, m, k, step)


def name_remaining(frame: Frame, naming: Naming):
    """Step 3: blobs still unnamed against markers still unnamed in their camera, without the occlusion test.

    Markers that other cameras have fixed in space come first; the rest go by the model's projection when it is clear.
    What is left are false markers.
    """
    is_open = naming.open & ~_shadowed(frame, naming)
    _give_best(naming, np.where(is_open, naming.reprojection, TOO_FAR), REMAINING)
    likely = frame.nll < TOO_FAR
    named = (naming.slot >= 0).sum(axis=0)
    is_open = naming.open & (named == 1)[None, :, None] & likely
    if is_open.any():
        _give_best(naming, _one_helper_cost(frame, naming, is_open), REMAINING)
    named = (naming.slot >= 0).sum(axis=0)
    is_open = naming.open & (named == 0)[None, :, None] & likely
    if is_open.any():
        _give_best(naming, np.where(is_open & _undisputed(frame, is_open), frame.nll, TOO_FAR), REMAINING)


def doubles(naming: Naming) -> np.ndarray:
    """(C, M) a marker's only name, whose blob lies on the point that other cameras made of another marker.

    One marker in space then has two names, each in other cameras: of two neighbours of which one was never put on, the
    model gives a part of the other's blobs to each.
    """
    named = naming.slot >= 0
    camera, marker = np.nonzero(named & (named.sum(axis=0) == 1))
    square = naming.reprojection[camera, :, naming.slot[camera, marker]]
    on_other = (naming.slot[camera] < 0) & (square < naming.frame.rules.max_on_point)
    found = np.zeros_like(named)
    found[camera, marker] = on_other.any(axis=1)
    return found


def name_merged(frame: Frame, naming: Naming):
    """Blobs still unnamed that lie between two markers which look like one from there: named after the nearer one.

    Two markers in one blob draw its centre between them, so it fits neither, and its ray is nobody's.
    """
    free, reach2 = naming.slot < 0, frame.rules.merged_m**2
    near = (frame.between2 < reach2) & free[..., None] & free[:, None]
    near &= frame.depth[..., None] <= frame.depth[:, None]
    near[:, frame.markers, frame.markers] = False
    camera, first, second = np.nonzero(near)
    if not len(camera):
        return
    middle = (frame.image[camera, first] + frame.image[camera, second]) / 2
    between = frame.view.image[camera] - middle[:, None]
    square = (between[..., 0] ** 2 + between[..., 1] ** 2) * (frame.depth[camera, first] ** 2)[:, None]
    square = np.where((naming.owner[camera] < 0) & frame.view.real[camera], square, TOO_FAR)
    slot = square.argmin(axis=1)
    alone = (square < reach2).sum(axis=1) == 1
    square = square[np.arange(len(slot)), slot]
    for index in np.argsort(square):
        c, m, k = camera[index], first[index], slot[index]
        fits = alone[index] and square[index] < reach2 / 4
        if fits and naming.slot[c, m] < 0 and naming.owner[c, k] < 0:
            naming.give(c, m, k, REMAINING)
            naming.partner[c, m] = second[index]


def pixel_noise(naming: Naming, sight: Sight) -> float:
    """px, standard deviation of the blobs' positions as the meeting rays show it; NaN when too few rays meet.

    See `triangulation.trimmed_deviation`.
    """
    seen = naming.rays >= 0
    freedom = 2.0 * seen.sum(axis=0) - 3
    usable = (freedom > 0) & np.isfinite(naming.meeting.residual)
    if usable.sum() < naming.frame.rules.min_meetings:
        return float("nan")
    squares = ((naming.meeting.miss * sight.focal[:, None] / naming.frame.depth) ** 2 * seen).sum(axis=0)[usable]
    return trimmed_deviation(squares, freedom[usable])
