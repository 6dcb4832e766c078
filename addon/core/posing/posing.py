# SPDX-License-Identifier: GPL-3.0-or-later
"""Posing a body on labelled 3D points: one subject, so one shape and size over all frames, and a pose in each.

Used to put the body in the way of a recorded take, and to learn marker sets.
"""

from collections.abc import Callable, Generator
from dataclasses import replace

import numpy as np

from ..body.bodies import PLACEMENT, Bodies, BodyModel, Posed
from ..body.prior import Prior
from ..data.lanes import blocks
from ..data.made import IN_MEMORY, MakeTable, Table
from ..data.markersets import MarkerSet
from ..data.progress import finished
from ..geometry import rotations
from ..geometry.rigid import best_turns
from ..kernels import calls
from ..papers.virtual_occlusions.cost import PointPull
from ..papers.virtual_occlusions.fit import fit_body, fit_until_still

POSING_FRAMES = 20_000  # of one subject that are posed as a take of their own, so that memory does not grow
KEY_STRIDE = 8  # frames; those in between start from their neighbours' poses
BATCH_FRAMES = 256  # posed at once, few enough for the processor's cache


class POSING:
    """How a body is posed on labelled points."""

    marker_sd_m: float = 0.01  # physical: how far a marker sits from where a well fitted body carries it, as skin moves
    reach_m: float = 0.2  # physical: farther off than this a point pulls less and less, it may be labelled wrongly
    own_sd: float = 0.02  # physical: heights, how far a subject's own markers stray from where the shape puts them
    # a frame with fewer has no pose; three points fix one, a fourth tells it from its mirror
    min_markers: int = 4  # physical
    subject_frames: int = 40  # memory: which one subject's size and shape are taken from
    # of a frame's cost to the median; one that is posed worse than this is tried again
    max_cost_ratio: float = 3.0  # physical
    # and to that of the frame beside it, which a body that moves differs little from
    max_cost_jump: float = 1.25  # measured: with it filled gaps of elbows in break dance are off by 7.7 mm, not 12.5
    # of a body's first size to the prior's height, either way: a grown person on a child's marker set
    max_size_ratio: float = 1.6  # physical
    # of a marker in the first alignment, for every joint between it and the root; limbs move
    limb_weight: float = 0.25  # physical


# Iterations, at most: frames that are still go no further. Of a pose that begins far off, of one that begins near, and
# of the fit with shared size and shape; of this once more after each round of own offsets.
FAR_STEPS, NEAR_STEPS = 15, 4
SUBJECT_STEPS, OWN_ROUNDS, OWN_STEPS = 8, 2, 3
STEPS_AT_ONCE = 2  # iterations, after which frames that are still are left out
STILL_GAIN = 1e-3  # what a still frame's last iteration lowered its cost by; a marker 1.4 mm off costs ten times that
HOLD = 1e9  # 1/m², holds a column against any data, yet is not so large that the rest is lost in rounding


def fit_points(model: BodyModel, points: Table) -> Bodies:
    """T bodies of one subject posed on its markers.

    points (T, M, 3) m, NaN where missing, in the marker set's order. Scale, shape and own offsets are the same in every
    body. A frame with too few markers gets NaN translation, quaternion and bends. Raises ValueError when no frame has
    more.
    """
    return finished(fit_in_steps(model, points, Prior(model)))


def fit_in_steps(
    model: BodyModel,
    points: Table,
    prior: Prior,
    subject_frames: int = POSING.subject_frames,
    make_table: MakeTable = IN_MEMORY,
    subject: Bodies | None = None,
) -> Generator[float, None, Bodies]:
    """What `fit_points` does, a little at a time; yields the share that is done. The `subject` may be known already.

    Else its size and shape are taken from so many `subject_frames`. `make_table` says where the poses are kept.
    """
    enough = np.flatnonzero(markers_there(points) >= POSING.min_markers)
    if subject is None:
        subject = subject_of(model, points, prior, subject_frames)
    count = _counter(len(enough))
    poses = {name: (len(points), *getattr(subject, name).shape[1:]) for name in ("translation", "quaternion", "bends")}
    fields = _same_in(subject, len(points))
    for name, shape in poses.items():
        fields[name] = make_table(shape, float)
        for rows in blocks(len(points), int(np.prod(shape[1:]))):
            fields[name][rows] = np.nan
    yield count(0)
    for at in range(0, len(enough), POSING_FRAMES):
        part = enough[at : at + POSING_FRAMES]
        bodies = yield from _pose_in_steps(model, subject, points[part], prior, count)
        for name in poses:
            fields[name][part] = getattr(bodies, name)
    return Bodies(**fields)


def markers_there(points: Table) -> np.ndarray:
    """(T,) how many markers there are in each frame of points (T, M, 3)."""
    parts = blocks(*points.shape[:2])
    counts = [np.isfinite(points[part]).all(axis=2).sum(axis=1) for part in parts]
    return np.concatenate([np.zeros(0, int), *counts])


def subject_of(model: BodyModel, points: Table, prior: Prior, frames: int = POSING.subject_frames) -> Bodies:
    """The size and shape of the subject of points (T, M, 3) m, as a body (a batch of 1), from so many of the frames.

    Raises ValueError when no frame has enough markers.
    """
    there = markers_there(points)
    enough = np.flatnonzero(there >= POSING.min_markers)
    if not len(enough):
        raise ValueError("no frame has enough markers to pose a body on")
    stretches = np.array_split(enough, min(frames, len(enough)))
    fullest = np.array([stretch[np.argmax(there[stretch])] for stretch in stretches])
    return fit_subject(model, points[fullest], prior).pick(slice(0, 1))


def fit_subject(model: BodyModel, points: np.ndarray, prior: Prior) -> Bodies:
    """Bodies (T) that share scale, shape and own offsets, on a few frames (T, M, 3) m that all have a pose."""
    free = _until_still(model, aligned(model, points, prior), points, FAR_STEPS, prior)
    bodies = replace(free, scale=_shared(free.scale), shape=_shared(free.shape))
    bodies = descend_subject(model, bodies, points, prior, SUBJECT_STEPS)
    for _ in range(OWN_ROUNDS):
        bodies = _with_own(model, bodies, points)
        bodies = descend_subject(model, bodies, points, prior, OWN_STEPS)
    return bodies


def _counter(frames: int) -> Callable[[int], float]:
    """A function that hears how many frames went how many steps on, and says how far that is in it all, about."""
    whole, done = frames * (FAR_STEPS / KEY_STRIDE + NEAR_STEPS), 0

    def count(work: int) -> float:
        nonlocal done
        done += work
        return min(done / whole, 1.0)

    return count


def pose_subject(model: BodyModel, subject: Bodies, points: np.ndarray, prior: Prior) -> Bodies:
    """One subject (a batch of 1) posed on frames (T, M, 3) m that all have enough markers; nothing else is fitted."""
    return finished(_pose_in_steps(model, subject, points, prior, float))


def _pose_in_steps(
    model: BodyModel, subject: Bodies, points: np.ndarray, prior: Prior, count: Callable[[int], float]
) -> Generator[float, None, Bodies]:
    """The same batch after batch.

    `count` is called with the number of frames times the steps that they were moved on by; what it says is yielded.
    """
    stiff, held = _stiff(model, subject, prior)
    keys = np.unique(np.append(np.arange(0, len(points), KEY_STRIDE), len(points) - 1))
    start = replace(aligned(stiff, points[keys], prior), scale=np.repeat(subject.scale, len(keys), axis=0))
    posed = yield from _fit_batches(stiff, start, points[keys], held, FAR_STEPS, count)
    if len(keys) < len(points):
        start = _between(posed, keys, len(points))
        posed = yield from _fit_batches(stiff, start, points, held, NEAR_STEPS, count)
        posed = yield from _tried_again(stiff, posed, points, held, count)
    return replace(posed, **_same_in(subject, len(points)))


def _stiff(model: BodyModel, subject: Bodies, prior: Prior) -> tuple[BodyModel, "_Held"]:
    """The model of one subject (a batch of 1) and the prior of its poses: nothing else is fitted."""
    stiff = BodyModel(baked(model, subject))
    return stiff, _Held(Prior(stiff, height=prior.height), slice(6, PLACEMENT))


class FollowedBody:
    """One subject (a batch of 1) posed on frames as they come, each from where the body was in the one before."""

    def __init__(self, model: BodyModel, subject: Bodies):
        self.subject = subject
        self._model, self._prior = _stiff(model, subject, Prior(model))
        self._last: Bodies | None = None

    def pose(self, points: np.ndarray) -> Posed | None:
        """Where it is (a batch of 1) in a frame with its markers at points (M, 3) m, NaN where missing.

        None where they are too few. After that it is looked for anew, as it is where it does not fit.
        """
        frame, there = points[None], markers_there(points[None])[0]
        if there < POSING.min_markers:
            self._last = None
            return None
        near = None if self._last is None else self._fitted(self._last, frame, NEAR_STEPS)
        # A marker that is a standard deviation off costs 1. A body that was turned round does not turn back by itself.
        if near is None or near[1] > POSING.max_cost_ratio * there:
            start = replace(aligned(self._model, frame, self._prior.prior), scale=self.subject.scale)
            anew = self._fitted(start, frame, FAR_STEPS)
            near = anew if near is None or anew[1] < near[1] else near
        self._last = near[0]
        return self._model.pose(self._last)

    def _fitted(self, start: Bodies, frame: np.ndarray, steps: int) -> tuple[Bodies, float]:
        """The body moved on from where it starts, and its cost."""
        found = _until_still(self._model, start, frame, steps, self._prior)
        return found, float(_cost(self._model, found, frame, slice(None))[0])


def _same_in(subject: Bodies, count: int) -> dict[str, np.ndarray]:
    """What is the same of one subject in every one of so many frames."""
    return {name: _each(getattr(subject, name), count) for name in ("scale", "shape", "own")}


def _each(values: np.ndarray, count: int) -> np.ndarray:
    """The same values (1, …) for every one of so many frames, held once."""
    return np.broadcast_to(values, (count, *values.shape[1:]))


def labelled_pull(points: np.ndarray, noise: float = POSING.marker_sd_m) -> PointPull:
    """The data of a fit on labelled points (B, M, 3) m, NaN where missing."""
    return PointPull(points, noise, POSING.reach_m)


def aligned(model: BodyModel, points: np.ndarray, prior: Prior) -> Bodies:
    """Bodies in the mean pose and shape, laid on points (B, M, 3) m as rigid bodies, in Umeyama's size.

    Markers count less the more joints are between them and the root: limbs move, the trunk shows where one faces.
    """
    bodies = model.rest(len(points), 1.0)
    bodies.bends[:, 1:] = prior.bend_mean.reshape(-1, 3)
    shape = model.pose(bodies.pick(slice(0, 1))).markers[0]
    depth = np.bincount(model.carried[0], minlength=model.marker_count)
    weight = np.where(np.isfinite(points).all(axis=2), POSING.limb_weight**depth, 0.0)
    weight /= weight.sum(axis=1, keepdims=True)
    known = np.where(weight[..., None] > 0, points, 0.0)
    there = np.einsum("bm,bmi->bi", weight, known)
    here = weight @ shape
    outer = np.einsum("bm,bmi,bmj->bij", weight, known - there[:, None], shape - here[:, None])
    turn, values = best_turns(outer)
    variance = np.einsum("bm,bmi,bmi->b", weight, shape - here[:, None], shape - here[:, None])
    size = values.sum(axis=1) / np.maximum(variance, 1e-9)
    size = np.clip(size, prior.height / POSING.max_size_ratio, POSING.max_size_ratio * prior.height)
    vector = rotations.rotation_vector(turn)
    return replace(
        bodies,
        translation=there - size[:, None] * (turn @ here[..., None])[..., 0],
        quaternion=rotations.turned(bodies.quaternion, vector),
        scale=np.repeat(size[:, None], 3, axis=1),
    )


def descend_subject(
    model: BodyModel, bodies: Bodies, points: np.ndarray, prior: Prior, steps: int, noise: float = POSING.marker_sd_m
) -> Bodies:
    """Damped Gauss-Newton on all frames' poses and the shared scale and shape at once.

    The frames meet only in the shared columns, so each frame's pose is eliminated (Schur complement) before the shared
    system is solved. The prior counts in every frame, as skin moves alike in all of them.
    """
    pull = labelled_pull(points, noise)
    shared = np.ones(model.parameters, bool)
    shared[:6] = shared[PLACEMENT : PLACEMENT + 3 * (model.joint_count - 1)] = False
    damping = 1e-3
    cost, gradient, normal = _equations(model, bodies, pull, prior)
    for _ in range(steps):
        tried = bodies.moved(-_subject_step(gradient, normal, shared, damping))
        new = _equations(model, tried, pull, prior)
        if new[0] <= cost:
            still = cost - new[0] < STILL_GAIN * len(points)
            bodies, (cost, gradient, normal), damping = tried, new, max(damping / 10, 1e-8)
            if still:
                break
        else:
            damping *= 10
    return bodies


def _equations(model: BodyModel, bodies: Bodies, pull: PointPull, prior: Prior) -> tuple[float, np.ndarray, np.ndarray]:
    """Cost of all frames together, then gradient (T, P) and normal matrix (T, P, P) of each."""
    state = fit_body(model, bodies, pull, 0, prior).state
    return float(state.cost.sum()), state.gradient, state.normal


def _subject_step(gradient: np.ndarray, normal: np.ndarray, shared: np.ndarray, damping: float) -> np.ndarray:
    """(T, P) minus the damped step; the columns that are `shared` (P,) get the same in all frames."""
    order, singles = np.argsort(shared, kind="stable"), len(shared) - np.count_nonzero(shared)
    normal, gradient = normal[:, order[:, None], order], gradient[:, order]
    own, cross = _damped(normal[:, :singles, :singles], damping), normal[:, :singles, singles:]
    solved = np.linalg.solve(own, np.concatenate([cross, gradient[:, :singles, None]], axis=2))
    common = _damped(normal[:, singles:, singles:].sum(axis=0), damping)
    common = common - (cross.transpose(0, 2, 1) @ solved[..., :-1]).sum(axis=0)
    rest = gradient[:, singles:].sum(axis=0) - (cross.transpose(0, 2, 1) @ solved[..., -1:]).sum(axis=0)[:, 0]
    step = np.empty_like(gradient)
    together = np.linalg.solve(common, rest)
    step[:, order[singles:]] = together
    step[:, order[:singles]] = solved[..., -1] - solved[..., :-1] @ together
    return step


def _damped(normal: np.ndarray, damping: float) -> np.ndarray:
    damped, at = normal.copy(), np.arange(normal.shape[-1])
    damped[..., at, at] += normal[..., at, at] * damping + 1e-9
    return damped


def _shared(values: np.ndarray) -> np.ndarray:
    return np.repeat(np.median(values, axis=0, keepdims=True), len(values), axis=0)


def _with_own(model: BodyModel, bodies: Bodies, points: np.ndarray) -> Bodies:
    """The subject's own offsets from what is left: the mean over frames in the segment's axes, drawn towards none."""
    posed = model.pose(bodies)
    turn = posed.rotations[:, model.attachment]
    left = (turn.swapaxes(-1, -2) @ (points - posed.markers)[..., None])[..., 0] / bodies.scale[:, None]
    count = np.isfinite(left[..., 0]).sum(axis=0)[:, None]
    shrinkage = 1 / (1 + (POSING.marker_sd_m / (POSING.own_sd * bodies.scale.mean())) ** 2)
    mean = np.nansum(left, axis=0) / np.maximum(count, 1)
    return replace(bodies, own=bodies.own + shrinkage * mean)


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
        self.prior, self.hessian = prior, prior.hessian.copy()
        held = np.arange(len(self.hessian))[columns]
        self.hessian[held, held] += HOLD

    def terms(self, bodies: Bodies) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        cost, gradient, _ = self.prior.terms(bodies)
        return cost, gradient, self.hessian

    def compiled(self, model: BodyModel):
        return calls.prior_arrays(self.prior, model, hessian=self.hessian)


def _fit_batches(
    model: BodyModel, start: Bodies, points: np.ndarray, prior, steps: int, count: Callable[[int], float]
) -> Generator[float, None, Bodies]:
    parts = []
    for chosen in _batches(len(points)):
        parts.append(_until_still(model, start.pick(chosen), points[chosen], steps, prior))
        yield count(steps * len(points[chosen]))
    own = _each(start.own[:1], len(points))  # no fit moves them
    none = own[:0, :0]
    return replace(Bodies.join([replace(part, own=none) for part in parts]), own=own)


def _until_still(model: BodyModel, start: Bodies, points: np.ndarray, steps: int, prior) -> Bodies:
    """Bodies moved on from where they start, each until it is still, so many steps at most."""
    still = STEPS_AT_ONCE, STILL_GAIN
    return fit_until_still(model, start, lambda some: labelled_pull(points[some]), steps, prior, *still)


def _tried_again(
    model: BodyModel, posed: Bodies, points: np.ndarray, prior: _Held, count: Callable[[int], float]
) -> Generator[float, None, Bodies]:
    """The frames posed worse than most or than the one beside, once more from where they are and from those beside.

    What that makes better is tried on the frames beside it in turn: a limb may be in another fold for a while.
    """
    cost = np.concatenate([_cost(model, posed, points, part) for part in _batches(len(points))])
    median = np.median(cost)
    frames, news = np.arange(len(points)), np.ones(len(points), bool)
    while news.any():
        before = cost.copy()
        least = np.minimum(cost[np.maximum(frames - 1, 0)], cost[np.minimum(frames + 1, frames[-1])])
        # One more besides, as by a marker that is a standard deviation off: of a cost near nothing any ratio is large.
        poor = cost > np.minimum(POSING.max_cost_ratio * median, POSING.max_cost_jump * least + 1)
        for shift in (0, -1, 1):
            beside = np.clip(frames + shift, 0, len(points) - 1)
            at = np.flatnonzero(poor & news[beside])
            if not len(at):
                continue
            again = yield from _fit_batches(model, posed.pick(beside[at]), points[at], prior, FAR_STEPS, count)
            new = np.concatenate([_cost(model, again, points[at], part) for part in _batches(len(at))])
            better = new < cost[at]
            for name in ("translation", "quaternion", "scale", "bends"):
                getattr(posed, name)[at[better]] = getattr(again, name)[better]
            cost[at[better]] = new[better]
        news = before - cost > 1  # as much as that one more
    return posed


def _batches(count: int) -> list[slice]:
    return [slice(first, first + BATCH_FRAMES) for first in range(0, count, BATCH_FRAMES)]


def _cost(model: BodyModel, bodies: Bodies, points: np.ndarray, part: slice) -> np.ndarray:
    """(B,) the cost of some of the frames."""
    return labelled_pull(points[part])(model.pose(bodies.pick(part)).markers).cost


def _between(keys_posed: Bodies, keys: np.ndarray, count: int) -> Bodies:
    """Bodies for `count` frames, linearly between those of the key frames."""
    frames = np.arange(count)
    after = np.clip(np.searchsorted(keys, frames), 1, len(keys) - 1) if len(keys) > 1 else np.zeros(count, dtype=int)
    before = np.maximum(after - 1, 0)
    share = (frames - keys[before]) / np.maximum(keys[after] - keys[before], 1)
    fields = {}
    for name in ("translation", "quaternion", "scale", "bends"):
        one, two = getattr(keys_posed, name)[before], getattr(keys_posed, name)[after]
        if name == "quaternion":
            two = np.where(np.einsum("fi,fi->f", one, two)[:, None] < 0, -two, two)
        fields[name] = one + share.reshape(-1, *[1] * (one.ndim - 1)) * (two - one)
    fields["quaternion"] /= np.linalg.norm(fields["quaternion"], axis=1, keepdims=True)
    return Bodies(**fields, shape=_each(keys_posed.shape[:1], count), own=_each(keys_posed.own[:1], count))
