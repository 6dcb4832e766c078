# SPDX-License-Identifier: GPL-3.0-or-later
"""Posing a body on labelled 3D points: one subject, so one shape and size over all frames, and a pose in each.

Used to put the body in the way of a recorded take, and to learn marker sets.
"""

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..blobs.cost import Pull
from ..blobs.fit import fit_body
from ..data.markersets import MarkerSet
from ..geometry import rotations
from .bodies import PLACEMENT, Bodies, BodyModel
from .prior import Prior

NOISE = 0.01  # m, how far a marker sits from where a well fitted body carries it: skin moves
REACH = 0.2  # m; farther off than this a point pulls less and less, it may be labelled wrongly
FEWEST = 4  # markers; a frame with fewer has no pose
SUBJECT_FRAMES = 40  # enough to tell one subject's size and shape
KEY_STRIDE = 8  # frames; those in between start from their neighbours' poses
POOR = 3.0  # times the median cost; a frame that is posed worse than this is tried again
KEY_STEPS, STEPS, AGAIN_STEPS = 15, 4, 12  # of the fit: of key frames, of all, of those that are tried again
# What posing takes, in frames times steps: the subject's shape, as measured; and the part of the frames tried again.
SUBJECT_WORK, RETRIED = 1500, 0.05
BATCH = 256  # frames posed at once: large enough for NumPy, small enough for the cache
HOLD = 1e9  # 1/m², holds a column against any data, yet is not so large that the rest is lost in rounding
OWN_SD = 0.02  # heights, how far a subject's own markers stray from where the shape puts them


def fit_points(
    model: BodyModel,
    points: np.ndarray,
    *,
    height: float | None = None,
    prior: Prior | None = None,
    progress: Callable[[float], None] | None = None,
) -> Bodies:
    """T bodies of one subject posed on its markers.

    points (T, M, 3) m, NaN where missing, in the marker set's order; `height` m, if it was measured. Scale, shape and
    own offsets are the same in every body. A frame with fewer than four markers gets NaN translation, quaternion and
    bends. `progress` is told the share that is done. Raises ValueError when no frame has more.
    """
    seen = np.isfinite(points).all(axis=2)
    enough = np.flatnonzero(seen.sum(axis=1) >= FEWEST)
    if not len(enough):
        raise ValueError("no frame has enough markers to pose a body on")
    if prior is None:
        prior = Prior(model, height=height, height_sd=None if height is None else 0.03)
    subject = fit_subject(model, points[_subject_frames(seen, enough)], prior)
    told = _told(progress, len(enough))
    posed = pose_subject(model, subject.pick(slice(0, 1)), points[enough], prior, told)
    return _spread_out(posed, enough, len(points))


def fit_subject(model: BodyModel, points: np.ndarray, prior: Prior, steps: int = 8) -> Bodies:
    """Bodies (T) that share scale, shape and own offsets, on a few frames (T, M, 3) m that all have a pose."""
    free = fit_body(model, aligned(model, points, prior), point_pull(points), 12, prior).bodies
    bodies = replace(free, scale=_shared(free.scale), shape=_shared(free.shape))
    bodies = descend_subject(model, bodies, points, prior, steps)
    for _ in range(2):
        bodies = _with_own(model, bodies, points)
        bodies = descend_subject(model, bodies, points, prior, 3)
    return bodies


def _told(progress: Callable[[float], None] | None, frames: int) -> Callable[[int], None]:
    """A function that is told how many frames went how many steps on, and tells `progress` the share of it all."""
    whole = SUBJECT_WORK + frames * (KEY_STEPS / KEY_STRIDE + STEPS + RETRIED * 3 * AGAIN_STEPS)
    done = SUBJECT_WORK

    def told(work: int):
        nonlocal done
        done += work
        if progress is not None:
            progress(min(done / whole, 1.0))

    told(0)
    return told


def pose_subject(
    model: BodyModel,
    subject: Bodies,
    points: np.ndarray,
    prior: Prior,
    told: Callable[[int], None] = lambda _: None,
) -> Bodies:
    """One subject (a batch of 1) posed on frames (T, M, 3) m that all have enough markers; nothing else is fitted.

    `told` is called with the number of frames times the steps that they were moved on by, batch after batch.
    """
    stiff = BodyModel(baked(model, subject))
    held = _Held(Prior(stiff, prior.strength, height=prior.height), slice(6, PLACEMENT))
    keys = np.unique(np.append(np.arange(0, len(points), KEY_STRIDE), len(points) - 1))
    start = replace(aligned(stiff, points[keys], prior), scale=np.repeat(subject.scale, len(keys), axis=0))
    posed = _fit_batches(stiff, start, points[keys], held, KEY_STEPS, told)
    if len(keys) < len(points):
        posed = _fit_batches(stiff, _between(posed, keys, len(points)), points, held, STEPS, told)
        posed = _tried_again(stiff, posed, points, held, told)
    return replace(
        posed,
        scale=np.repeat(subject.scale, len(points), axis=0),
        shape=np.repeat(subject.shape, len(points), axis=0),
        own=np.repeat(subject.own, len(points), axis=0),
    )


def point_pull(points: np.ndarray, noise: float = NOISE, reach: float = REACH):
    """The data of a fit on labelled points (B, M, 3) m, NaN where missing: Cauchy's loss of the distances."""
    seen = np.isfinite(points).all(axis=2)
    known = np.where(seen[..., None], points, 0.0)

    def pull(markers: np.ndarray) -> Pull:
        away = np.where(seen[..., None], markers - known, 0.0)
        square = np.einsum("bmi,bmi->bm", away, away) / reach**2
        weight = seen / (1 + square) / noise**2
        cost = (reach / noise) ** 2 * np.log1p(square).sum(axis=1)
        return Pull(cost, away * weight[..., None], weight[..., None, None] * np.eye(3))

    return pull


def aligned(model: BodyModel, points: np.ndarray, prior: Prior) -> Bodies:
    """Bodies in the mean pose and shape, laid on points (B, M, 3) m as rigid bodies (Kabsch; Umeyama's size).

    Markers count less the more joints are between them and the root: limbs move, the trunk tells where one faces.
    """
    bodies = model.rest(len(points), 1.0)
    bodies.bends[:, 1:] = prior.bend_mean.reshape(-1, 3)
    shape = model.pose(bodies.pick(slice(0, 1))).markers[0]
    depth = np.bincount(model.carried[0], minlength=model.marker_count)
    weight = np.where(np.isfinite(points).all(axis=2), 4.0**-depth, 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    known = np.where(weight[..., None] > 0, points, 0.0)
    there = np.einsum("bm,bmi->bi", weight, known)
    here = weight @ shape
    outer = np.einsum("bm,bmi,bmj->bij", weight, known - there[:, None], shape - here[:, None])
    left, values, right = np.linalg.svd(outer)
    values[:, 2] *= np.sign(np.linalg.det(left @ right))
    left[:, :, 2] *= np.sign(np.linalg.det(left @ right))[:, None]
    turn = left @ right
    variance = np.einsum("bm,bmi,bmi->b", weight, shape - here[:, None], shape - here[:, None])
    size = np.clip(values.sum(axis=1) / np.maximum(variance, 1e-9), 0.6 * prior.height, 1.6 * prior.height)
    vector = rotations.rotation_vector(turn)
    return replace(
        bodies,
        translation=there - size[:, None] * (turn @ here[..., None])[..., 0],
        quaternion=rotations.turned(bodies.quaternion, vector),
        scale=np.repeat(size[:, None], 3, axis=1),
    )


def descend_subject(
    model: BodyModel, bodies: Bodies, points: np.ndarray, prior: Prior, steps: int, noise: float = NOISE
) -> Bodies:
    """Damped Gauss-Newton on all frames' poses and the shared scale and shape at once.

    The frames meet only in the shared columns, so each frame's pose is eliminated (Schur complement) before the shared
    system is solved. The prior counts in every frame, as skin moves alike in all of them.
    """
    pull = point_pull(points, noise)
    shared = np.r_[6:PLACEMENT, PLACEMENT + 3 * (model.joint_count - 1) : model.parameters]
    damping = 1e-3
    cost, gradient, normal = _equations(model, bodies, pull, prior)
    for _ in range(steps):
        tried = bodies.moved(-_subject_step(gradient, normal, shared, damping))
        new = _equations(model, tried, pull, prior)
        if new[0] <= cost:
            bodies, (cost, gradient, normal), damping = tried, new, max(damping / 10, 1e-8)
        else:
            damping *= 10
    return bodies


def _equations(model: BodyModel, bodies: Bodies, pull, prior: Prior) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost of all frames together, then gradient (T, P) and normal matrix (T, P, P) of each."""
    posed, columns = model.derivatives(bodies)
    data = pull(posed.markers)
    flat = columns.reshape(len(columns), -1, columns.shape[-1])
    weight = np.repeat(data.hessian[..., 0, 0], 3, axis=1)[..., None]
    cost, slope, curve = prior.terms(bodies)
    gradient = (data.gradient.reshape(len(flat), 1, -1) @ flat)[:, 0] + slope
    return float((data.cost + cost).sum()), gradient, flat.transpose(0, 2, 1) @ (flat * weight) + curve


def _subject_step(gradient: np.ndarray, normal: np.ndarray, shared: np.ndarray, damping: float) -> np.ndarray:
    """(T, P) minus the damped step; the shared columns get the same in all frames."""
    single = np.setdiff1d(np.arange(normal.shape[1]), shared)
    own, cross = _damped(normal[:, single[:, None], single], damping), normal[:, single[:, None], shared]
    solved = np.linalg.solve(own, np.concatenate([cross, gradient[:, single, None]], axis=2))
    common = _damped(normal[:, shared[:, None], shared].sum(axis=0), damping)
    common = common - (cross.transpose(0, 2, 1) @ solved[..., :-1]).sum(axis=0)
    rest = gradient[:, shared].sum(axis=0) - (cross.transpose(0, 2, 1) @ solved[..., -1:]).sum(axis=0)[:, 0]
    step = np.empty_like(gradient)
    step[:, shared] = np.linalg.solve(common, rest)
    step[:, single] = solved[..., -1] - solved[..., :-1] @ step[0, shared]
    return step


def _damped(normal: np.ndarray, damping: float) -> np.ndarray:
    diagonal = np.einsum("...ii->...i", normal)
    return normal + np.eye(normal.shape[-1]) * (diagonal * damping + 1e-9)[..., None, :]


def _shared(values: np.ndarray) -> np.ndarray:
    return np.repeat(np.median(values, axis=0, keepdims=True), len(values), axis=0)


def _with_own(model: BodyModel, bodies: Bodies, points: np.ndarray) -> Bodies:
    """The subject's own offsets from what is left: the mean over frames in the segment's axes, drawn towards none."""
    posed = model.pose(bodies)
    turn = posed.rotations[:, model.attachment]
    left = (turn.swapaxes(-1, -2) @ (points - posed.markers)[..., None])[..., 0] / bodies.scale[:, None]
    count = np.isfinite(left[..., 0]).sum(axis=0)[:, None]
    trust = 1 / (1 + (NOISE / (OWN_SD * bodies.scale.mean())) ** 2)
    mean = np.nansum(left, axis=0) / np.maximum(count, 1)
    return replace(bodies, own=bodies.own + trust * mean)


def _subject_frames(seen: np.ndarray, enough: np.ndarray) -> np.ndarray:
    """Frames to tell the subject's size and shape by: spread over the take, the fullest of each stretch."""
    stretches = np.array_split(enough, min(SUBJECT_FRAMES, len(enough)))
    return np.array([stretch[np.argmax(seen[stretch].sum(axis=1))] for stretch in stretches])


def baked(model: BodyModel, subject: Bodies) -> MarkerSet:
    """The marker set of one subject: the mean is the subject, and no modes are left."""
    offsets = model.shaped_offsets(subject)[0]
    markerset, joints = model.markerset, model.joint_count
    return replace(
        markerset,
        skeleton=replace(markerset.skeleton, offsets=offsets[:joints]),
        offsets=offsets[joints:],
        spread=replace(markerset.spread, modes=np.zeros((0, *offsets.shape))),
    )


class _Held:
    """A prior that holds some columns where they are."""

    def __init__(self, prior: Prior, columns: slice):
        self.prior, self.columns = prior, columns

    def terms(self, bodies: Bodies) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        cost, gradient, hessian = self.prior.terms(bodies)
        hessian = hessian.copy()
        held = np.arange(len(hessian))[self.columns]
        hessian[held, held] += HOLD
        return cost, gradient, hessian


def _fit_batches(model: BodyModel, start: Bodies, points: np.ndarray, prior, steps: int, told) -> Bodies:
    parts = []
    for first in range(0, len(points), BATCH):
        chosen = slice(first, first + BATCH)
        parts.append(fit_body(model, start.pick(chosen), point_pull(points[chosen]), steps, prior).bodies)
        told(steps * len(points[chosen]))
    return Bodies(*(np.concatenate([getattr(part, name) for part in parts]) for name in Bodies.__dataclass_fields__))


def _tried_again(model: BodyModel, posed: Bodies, points: np.ndarray, prior: _Held, told) -> Bodies:
    """The frames that are posed worse than most, once more from where they are and from the frame before and after."""
    cost = point_pull(points)(model.pose(posed).markers).cost
    poor = np.flatnonzero(cost > POOR * np.median(cost))
    for shift in (0, -1, 1):
        if not len(poor):
            break
        start = posed.pick(np.clip(poor + shift, 0, len(points) - 1))
        again = _fit_batches(model, start, points[poor], prior, AGAIN_STEPS, told)
        new = point_pull(points[poor])(model.pose(again).markers).cost
        better = new < cost[poor]
        for name in Bodies.__dataclass_fields__:
            getattr(posed, name)[poor[better]] = getattr(again, name)[better]
        cost[poor[better]] = new[better]
    return posed


def _between(keys_posed: Bodies, keys: np.ndarray, count: int) -> Bodies:
    """Bodies for `count` frames, linearly between those of the key frames."""
    frames = np.arange(count)
    after = np.clip(np.searchsorted(keys, frames), 1, len(keys) - 1) if len(keys) > 1 else np.zeros(count, dtype=int)
    before = np.maximum(after - 1, 0)
    share = (frames - keys[before]) / np.maximum(keys[after] - keys[before], 1)
    fields = {}
    for name in Bodies.__dataclass_fields__:
        one, two = getattr(keys_posed, name)[before], getattr(keys_posed, name)[after]
        if name == "quaternion":
            two = np.where(np.einsum("fi,fi->f", one, two)[:, None] < 0, -two, two)
        fields[name] = one + share.reshape(-1, *[1] * (one.ndim - 1)) * (two - one)
    fields["quaternion"] /= np.linalg.norm(fields["quaternion"], axis=1, keepdims=True)
    return Bodies(**fields)


def _spread_out(posed: Bodies, frames: np.ndarray, count: int) -> Bodies:
    """Bodies for all `count` frames: those posed at `frames`, NaN poses elsewhere."""
    fields = {}
    for name in Bodies.__dataclass_fields__:
        values = getattr(posed, name)
        missing = np.nan if name in {"translation", "quaternion", "bends"} else values[0]
        whole = np.empty((count, *values.shape[1:]))
        whole[:] = missing
        whole[frames] = values
        fields[name] = whole
    return Bodies(**fields)
