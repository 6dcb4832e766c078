# SPDX-License-Identifier: GPL-3.0-or-later
"""The compiled functions of bodies and blobs: what a NumPy function takes and gives, its sizes checked at the border.

Each has the name and the arguments of the NumPy function that it stands for; see there for what it does. All raise
ValueError where an array has not the shape that the others ask for.
"""

from ctypes import Structure
from dataclasses import astuple
from typing import NamedTuple

import numpy as np

from .library import compiled
from .structures import FLAG, call, filled, given, indices, once_each


def pose(model, bodies) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stands for `bodies.pose`."""
    posed = _posed_outputs(model, len(bodies))
    scratch = np.empty(12 * model.joint_count + 3 * model.marker_count)
    call(compiled.pose, model_arrays(model), body_arrays(model, bodies), *posed, scratch)
    return posed


def derivatives(model, bodies) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Stands for `bodies.derivatives`."""
    posed = _posed_outputs(model, len(bodies))
    columns = np.empty((len(bodies), model.marker_count, 3, model.parameters))
    joint_count, width = model.joint_count, 3 + len(model.modes)
    scratch = np.empty(21 * joint_count + 3 * model.marker_count + 3 * (joint_count + 1) * width)
    call(compiled.derivatives, model_arrays(model), body_arrays(model, bodies), *posed, columns, scratch)
    return *posed, columns


@once_each
def model_arrays(model) -> Structure:
    """A marker set as the library takes it, made once."""
    carries = np.zeros((model.marker_count, max(model.joint_count - 1, 0)), FLAG)
    carries[model.carried] = 1
    parts = model.joint_count + model.marker_count
    return filled(
        "Model", model.joint_count, model.marker_count, len(model.modes),
        # The root's parent is not looked at; the others' come before them.
        indices(model.parents, (model.joint_count,), model.joint_count, lowest=-1),
        indices(model.attachment, (model.marker_count,), model.joint_count, lowest=0),
        given(model.offsets, (parts, 3)),
        given(model.modes, (len(model.modes), parts, 3)),
        carries,
    )  # fmt: skip


def body_arrays(model, bodies) -> Structure:
    """Bodies as the library takes them."""
    count = len(bodies)
    return filled(
        "BodyArrays", count,
        given(bodies.translation, (count, 3)),
        given(bodies.quaternion, (count, 4)),
        given(bodies.scale, (count, 3)),
        given(bodies.bends, (count, model.joint_count, 3)),
        given(bodies.shape, (count, len(model.modes))),
        given(bodies.own, (count, model.marker_count, 3)),
    )  # fmt: skip


@once_each
def sight_arrays(sight) -> Structure:
    """Cameras as the library takes them, made once."""
    rotation, translation = given(sight.rotation, (sight.count, 3, 3)), given(sight.translation[:, 0], (sight.count, 3))
    return filled("SightArrays", sight.count, rotation, translation, sight.min_depth)


class PullOfData(NamedTuple):
    """What data says to markers as the library takes it, and the cameras that it is seen by, None for none."""

    arrays: Structure
    sight: Structure | None


def pull(markers, data: PullOfData) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stands for `cost.DataPull._by_numpy`."""
    count = markers.shape[1]
    markers = given(markers, (len(markers), count, 3))
    cost, gradient, hessian = np.empty(len(markers)), np.empty(markers.shape), np.empty((*markers.shape, 3))
    scratch = np.empty(_pull_scratch(count, data.arrays.size))
    call(compiled.pull, *data, len(markers), count, markers, cost, gradient, hessian, scratch)
    return cost, gradient, hessian


def _pull_scratch(markers: int, size: int) -> int:
    return (markers + 1) * (size + 1) + 9 * markers


RAY_PULL, BLOB_PULL, CLOUD_PULL, POINT_PULL = range(4)


def ray_arrays(pull, bodies: int, markers: int) -> PullOfData:
    """A `RayPull` on so many bodies of so many markers as the library takes it."""
    sets, sight = len(pull.image), pull.sight
    if sets not in (1, bodies):
        raise ValueError(f"{sets} sets of names for {bodies} bodies; expected one, or one each")
    image = given(pull.image, (sets, sight.count, markers, 2))
    deviation = given(pull.deviation, (sets, sight.count, markers))
    return PullOfData(filled("PullArrays", RAY_PULL, sets, 0, image, deviation), sight_arrays(sight))


def blob_arrays(pull, bodies: int, markers: int) -> PullOfData:
    """The same of a `BlobPull`."""
    view, sight = pull.view, pull.sight
    shape = (sight.count, view.real.shape[1])
    image, real = given(view.image, (*shape, 2)), given(view.real, shape, FLAG)
    visible = given(pull.visible, (bodies, sight.count, markers), FLAG)
    arrays = filled("PullArrays", BLOB_PULL, 1, shape[1], image, None, real, visible, pull.softness, pull.reach)
    return PullOfData(arrays, sight_arrays(sight))


def cloud_arrays(pull, bodies: int, markers: int) -> PullOfData:  # noqa: ARG001 - as the others have it
    """The same of a `CloudPull`."""
    count = len(pull.points)
    points, weight = given(pull.points, (count, 3)), given(pull.weight, (count,))
    values = points, weight, None, None, pull.softness, pull.reach
    return PullOfData(filled("PullArrays", CLOUD_PULL, 1, count, *values), None)


def point_arrays(pull, bodies: int, markers: int) -> PullOfData:
    """The same of a `PointPull`."""
    points = given(pull.points, (bodies, markers, 3))
    arrays = filled("PullArrays", POINT_PULL, bodies, 0, points, softness=pull.noise, reach=pull.reach)
    return PullOfData(arrays, None)


def fit_body(model, start, data: PullOfData, steps: int, prior, width: int, damping) -> tuple | None:
    """Stands for `fit.descend`: rows of bodies and the arrays of `State`, the trace; None where NumPy has to do it."""
    count, markers = len(start), model.marker_count
    rows, own = _rows_of(model, start)
    gradient, normal = np.empty((count, width)), np.empty((count, width, width))
    posed = _posed_outputs(model, count)
    columns, trace = np.empty((count, markers, 3, width)), np.empty((steps + 1, count))
    scratch = np.empty(fit_scratch(model, width, data.arrays.size))
    fine = call(
        compiled.fit_body, model_arrays(model), data.sight, data.arrays, prior.compiled(model),
        damping_arrays(damping), count, width, steps, rows, own, gradient, normal, *posed, columns, trace,
        scratch,
    )  # fmt: skip
    return (rows, gradient, normal, *posed, columns, trace) if fine else None


def fit_until_still(
    model, start, data: PullOfData, steps: int, at_once: int, still: float, prior, width: int, damping
) -> np.ndarray | None:
    """Stands for `fit.fit_until_still`: rows of bodies; None where NumPy has to do it."""
    rows, own = _rows_of(model, start)
    scratch = np.empty(fit_scratch(model, width, data.arrays.size) + at_once + 1 + _step_length(model, width))
    fine = call(
        compiled.fit_until_still, model_arrays(model), data.sight, data.arrays, prior.compiled(model),
        damping_arrays(damping), len(rows), width, steps, at_once, still, rows, own, scratch,
    )  # fmt: skip
    return rows if fine else None


@once_each
def damping_arrays(options) -> Structure:
    """How steps are damped, as the library takes it."""
    return filled("DampingArrays", *astuple(options))


def _rows_of(model, start) -> tuple[np.ndarray, np.ndarray]:
    """Bodies as rows, which the library changes in place, and their own offsets."""
    rows = given(start.rows, (len(start), row_length(model)))
    return rows, given(start.own, (len(start), model.marker_count, 3))


def row_length(model) -> int:
    """How many numbers a body has."""
    return 10 + 3 * model.joint_count + len(model.modes)


def fit_scratch(model, width: int, size: int = 0) -> int:
    """How many numbers a fit takes to work in, to data of such a size."""
    joints, markers, modes = model.joint_count, model.marker_count, len(model.modes)
    body = width * (width + 1) + _step_length(model, width) + 12 * markers
    posing = 21 * joints + 3 * markers + 3 * (joints + 1) * (3 + modes)
    return body + max(posing, _pull_scratch(markers, size), 4 * width + 2, model.parameters)


def _step_length(model, width: int) -> int:
    """How many numbers say where one body is in its descent."""
    joints, markers = model.joint_count, model.marker_count
    return row_length(model) + width * (width + 1) + 12 * joints + 3 * markers + 3 * markers * width


def prior_arrays(prior, model, predicted=None, weight=None, hessian=None) -> Structure:
    """A prior as the library takes it, with the row of the predicted body, if any, and what holds to it.

    `hessian` is another than its own.
    """
    bends = 3 * (model.joint_count - 1)
    return filled(
        "PriorArrays", 1.0, prior.height, prior.upright,
        given(prior.bend_mean, (bends,)),
        given(prior.bend_precision, (bends, bends)),
        given(prior.scale_precision, (3, 3)),
        given(prior.hessian if hessian is None else hessian, (model.parameters, model.parameters)),
        None if predicted is None else given(predicted, (row_length(model),)),
        None if weight is None else given(weight, (model.parameters,)),
    )  # fmt: skip


def covariance(normal, columns, ridge) -> np.ndarray | None:
    """Stands for `fit.marker_covariance`; None where a normal is not positive definite."""
    bodies, markers, _, width = columns.shape
    normal, columns = given(normal, (bodies, width, width)), given(columns, (bodies, markers, 3, width))
    spread, scratch = np.empty((bodies, markers, 3, 3)), np.empty(width * (width + 3 * markers))
    fine = call(compiled.covariance, bodies, markers, width, normal, columns, ridge, spread, scratch)
    return spread if fine else None


def capsules_hide(start, axis, radius, markers, centres, standoff, min_side_share) -> np.ndarray:
    """Stands for `occlusion.capsules_hide`."""
    (bodies, capsules), count, cameras = radius.shape, markers.shape[1], len(centres)
    start, axis = given(start, (bodies, capsules, 3)), given(axis, (bodies, capsules, 3))
    radius, markers = given(radius, (bodies, capsules)), given(markers, (bodies, count, 3))
    centres, standoff = given(centres, (cameras, 3)), given(standoff, (bodies,))
    hidden = np.empty((bodies, cameras, count), bool)
    given_parts = start, axis, radius, markers, centres, standoff
    call(compiled.capsules_hide, bodies, capsules, count, cameras, *given_parts, min_side_share, hidden)
    return hidden


def blob_rays(image, rotation, centres) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stands for `triangulation.blob_rays`."""
    cameras, blobs = image.shape[:2]
    image, rotation = given(image, (cameras, blobs, 2)), given(rotation, (cameras, 3, 3))
    centres = given(centres, (cameras, 3))
    direction, across = np.empty((cameras, blobs, 3)), np.empty((cameras, blobs, 3, 3))
    anchor = np.empty((cameras, blobs, 3))
    call(compiled.blob_rays, cameras, blobs, image, rotation, centres, direction, across, anchor)
    return direction, across, anchor


def meet(slot, depth, across, anchor, centres, ridge, max_condition) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Stands for `triangulation.meet`."""
    (cameras, count), blobs = slot.shape, across.shape[1]
    slot = indices(slot, (cameras, count), blobs, lowest=-1)
    depth = None if depth is None else given(depth, (cameras, count))
    across, anchor = given(across, (cameras, blobs, 3, 3)), given(anchor, (cameras, blobs, 3))
    centres = given(centres, (cameras, 3))
    points, residual, miss = np.empty((count, 3)), np.empty(count), np.empty((cameras, count))
    scratch = np.empty(cameras)
    rays, made = (slot, depth, across, anchor, centres), (points, residual, miss)
    call(compiled.meet, cameras, blobs, count, *rays, ridge, max_condition, *made, scratch)
    return points, residual, miss


def straightened(image, lens, reach, *steps) -> np.ndarray:
    """Stands for `cameras.straightened`."""
    count = len(image)
    image, lens, reach = given(image, (count, 2)), given(lens, (count, 5)), given(reach, (count,))
    found = np.empty((count, 2))
    call(compiled.straightened, count, image, lens, reach, *steps, found)
    return found


def _posed_outputs(model, count: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    return (
        np.empty((count, model.joint_count, 3, 3)),
        np.empty((count, model.joint_count, 3)),
        np.empty((count, model.marker_count, 3)),
    )
